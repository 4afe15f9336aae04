"""Checks of arguments that are numbers or studies. Errors name the argument and the expected value."""

from __future__ import annotations

import math
import operator
import os
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ._study import Study

LARGEST = 2**63 - 1
LARGEST_SEED = 2**64 - 1


def whole(value: Any, name: str, least: int = 0, most: int = LARGEST) -> int:
    """Returns a whole number from ``least`` to ``most``.

    Raises:
        TypeError: It is not a whole number.
        ValueError: It is out of range.
    """
    try:
        number = operator.index(value)
    except TypeError:
        raise TypeError(f"{name} is {value!r}, expected a whole number, such as {max(least, 1)}") from None
    if number < least:
        raise ValueError(f"{name} is {number}, expected a whole number of at least {least}")
    if number > most:
        raise ValueError(f"{name} is {number}, expected a whole number of at most {most}")
    return number


def position(value: Any, name: str) -> int:
    """Returns a position, from 0.

    Raises:
        TypeError: It is not a whole number.
        IndexError: It is negative or too large.
    """
    number = whole(value, name, -LARGEST, 2 * LARGEST)
    if not 0 <= number <= LARGEST:
        raise IndexError(f"{name} is {number}; positions count from 0 on")
    return number


def opened(study: Study | str | os.PathLike[str]) -> Study:
    """Returns a study, opened if the argument is a file.

    Raises:
        StudyError: The file is not a study.
        TypeError: It is neither a study nor a path.
    """
    from ._study import Study

    if isinstance(study, Study):
        return study
    if not isinstance(study, (str, os.PathLike)):
        raise TypeError(f"a study is a calib_rl.Study or the path of its file; got {type(study).__name__}")
    return Study(study)


def share(value: Any, name: str) -> float:
    """Returns a share, from 0 to 1.

    Raises:
        TypeError: It is not a number.
        ValueError: It is out of range.
    """
    try:
        number = float(value) if not isinstance(value, (str, bytes)) else None
    except (TypeError, ValueError):
        number = None
    if number is None:
        raise TypeError(f"{name} is {value!r}, expected a share, such as 0.05")
    if not 0.0 <= number <= 1.0:
        raise ValueError(f"{name} is {number:g}, expected a share from 0 to 1")
    return number


def finite(value: Any, name: str) -> float:
    """Returns a finite number.

    Raises:
        ValueError: It is not a finite number.
    """
    try:
        number = float(value) if not isinstance(value, (str, bytes)) else math.nan
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise ValueError(f"{name} is {value!r}, expected a finite number, such as -10.0")
    return number
