"""What calib refuses, with the texts of the command line."""


class CalibError(Exception):
    """The data is wrong, or the machine refuses; the text says what, where, what was expected and what to do."""


class StudyError(CalibError, ValueError):
    """A study that is not valid; the text begins with the place in the file, where there is one."""
CalibError.__module__ = StudyError.__module__ = "calib_rl"
