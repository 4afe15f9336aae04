"""The command ``calib`` of the wheel."""

import sys

from . import _calib


def main() -> int:
    """Run the command line with the arguments of this process.

    Returns:
        The exit code: 0 done, 1 a negative answer, 2 wrong usage, study or data, 3 a bug, 130 interrupted.
    """
    return _calib.main(["calib", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
