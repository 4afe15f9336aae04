"""Errors and warnings of calib, with the texts of the command line."""


class CalibError(Exception):
    """Wrong data, or a machine that cannot run the step. The text says what is wrong, where, what was expected and what to do.

    Examples:
        >>> import calib_rl
        >>> try:
        ...     calib_rl.Model.open("/no/such/folder")
        ... except calib_rl.CalibError as error:
        ...     print("there is no model")
        there is no model
    """


class StudyError(CalibError, ValueError):
    """An invalid study. The text begins with the place in the file, if there is one.

    It is a `CalibError` and a ``ValueError``, so that either catches it.

    Examples:
        >>> import calib_rl, tempfile
        >>> try:
        ...     calib_rl.Study({"agent": {"gama": 0.9}}, path=tempfile.mkdtemp() + "/study.toml")
        ... except calib_rl.StudyError as error:
        ...     print("gamma" in str(error))
        True
    """


class CalibWarning(UserWarning):
    """A warning of calib, for example about rows of a log that are left out. `build_model` issues it through ``warnings``.

    Examples:
        >>> import calib_rl, warnings
        >>> warnings.simplefilter("ignore", calib_rl.CalibWarning)
    """


CalibError.__module__ = StudyError.__module__ = CalibWarning.__module__ = "calib_rl"
