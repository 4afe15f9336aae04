"""Conversion of tables of other libraries."""

from __future__ import annotations

import datetime
import re
import sys
import warnings
from collections import Counter
from collections.abc import Sequence
from decimal import Decimal
from numbers import Real
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ._errors import CalibError

# Names that pandas gives to row numbers: to an index that it wrote to Parquet, and to a column without a heading in a CSV file.
_WRITTEN_INDEX = re.compile(r"__index_level_\d+__")
_NO_HEADING = re.compile(r"(Unnamed: \d+)?")
# A column of row numbers counts by one in this share of its steps at least, for rows may be missing and files joined. Our choice.
_COUNTS = 0.95


class Table(NamedTuple):
    """A table in a form that calib reads."""

    columns: Any
    """Anything with ``__arrow_c_stream__``."""
    left_out: list[str]
    """Which of its columns are left out, in sentences."""


def table_of(log: Any, times: str | None = None) -> Table | None:
    """Converts a frame. An index of times becomes a column, and row numbers are dropped.

    Args:
        log: The frame.
        times: The column with the times, if given. It is kept.

    Returns:
        The table. ``None`` if ``log`` is not a table.

    Raises:
        CalibError: Two columns of a frame have the same name, or a column has that of an index of other times.
    """
    if _is_frame(log, "pandas"):
        _refuse_equal_names(log)
        indexed = _without_index(log, times)
        numbers = [name for name in indexed.columns if name != times and _are_row_numbers(str(name), indexed[name])]
        return Table(indexed.drop(columns=numbers) if numbers else indexed, [_told(str(name)) for name in numbers])
    if not hasattr(log, "__arrow_c_stream__"):
        return None
    if _is_frame(log, "polars"):
        numbers = [name for name in log.columns if name != times and _are_row_numbers(name, log[name])]
        return Table(log.drop(numbers), [_told(name) for name in numbers])
    return Table(log, [])


def arrow_stream(columns: Any) -> Any:
    """Returns the capsule of a table's ``__arrow_c_stream__``.

    Raises:
        ImportError: The table is a pandas frame, and neither pyarrow nor polars is installed.
    """
    try:
        return columns.__arrow_c_stream__()
    except ImportError:
        if not _is_frame(columns, "pandas"):
            raise
    return _polars_frame(columns).__arrow_c_stream__()


def _is_frame(log: Any, module: str) -> bool:
    """Whether this is a frame of a library, which must then have been imported."""
    library = sys.modules.get(module)
    return library is not None and isinstance(log, getattr(library, "DataFrame", ()))


def _refuse_equal_names(frame: Any) -> None:
    """Refuses a pandas frame with two columns of one name, which other libraries cannot read.

    Raises:
        CalibError: There are two. Names are compared as texts.
    """
    names = [str(name) for name in frame.columns]
    twice = next((name for name, count in Counter(names).items() if count > 1), None)
    if twice is not None:
        raise CalibError(f"the frame has more than one column {twice!r}; give each a name of its own, or leave all but one out")


def _without_index(frame: Any, times: str | None) -> Any:
    """Returns a pandas frame whose index is a column if it has times or names, and is left out if it numbers the rows.

    Raises:
        CalibError: A column has the name of an index of other times, and is not the column ``times``.
    """
    import pandas

    index = frame.index
    if isinstance(index, pandas.RangeIndex):
        return frame
    if isinstance(index, pandas.PeriodIndex):
        index = index.to_timestamp()
    plain = frame.reset_index(drop=True)
    if index.nlevels > 1:
        for level in reversed(range(index.nlevels)):
            plain = _with_column(plain, index.names[level] or f"level_{level}", index.get_level_values(level), times)
        return plain
    if index.name is None and pandas.api.types.is_numeric_dtype(index.dtype):
        return plain
    return _with_column(plain, "time" if index.name is None else index.name, index, times)


def _with_column(frame: Any, name: Any, values: Any, times: str | None) -> Any:
    """Returns the frame with a level of its index as another first column, unless it has a column of that name.

    Raises:
        CalibError: The level has times, and the column has others and is not the column ``times``.
    """
    import pandas

    if name not in frame.columns:
        frame.insert(0, name, values)
    elif name != times and isinstance(values, pandas.DatetimeIndex) and not _has_times(frame[name], values):
        raise CalibError(
            f"the frame has a column {name!r} whose values are not those of its index of times, which gets the same name; rename the one that is not "
            f"the time, or take the column with data={{'timestamp': {name!r}}}"
        )
    return frame


def _has_times(column: Any, index: Any) -> bool:
    """Whether a column has the times of an index, in any time zone: as times, as texts or as numbers since 1970."""
    import pandas

    times = pandas.to_datetime(index, utc=True)
    units = ["s", "ms", "us", "ns"] if pandas.api.types.is_numeric_dtype(column.dtype) else [None]
    for unit in units:
        with warnings.catch_warnings():
            # About texts without a common form.
            warnings.simplefilter("ignore", UserWarning)
            try:
                read = pandas.to_datetime(pandas.Index(column), unit=unit, utc=True, errors="coerce")
            except (TypeError, ValueError):
                return False
        if ((read == times) | (read.isna() & times.isna())).all():
            return True
    return False


def _are_row_numbers(name: str, values: Any) -> bool:
    """Whether a column has no name of its own, and numbers the rows."""
    is_written_index = _WRITTEN_INDEX.fullmatch(name) is not None
    if not is_written_index and _NO_HEADING.fullmatch(name) is None:
        return False
    numbers: NDArray[Any] = np.asarray(values.to_numpy())
    if numbers.dtype.kind not in "iuf" or not np.isfinite(numbers).all() or (numbers % 1 != 0).any():
        return False
    # Differences of unsigned numbers would wrap around.
    steps = np.diff(numbers.astype(np.float64))
    return is_written_index or bool(len(steps) == 0 or (steps == 1.0).mean() >= _COUNTS)


def _told(name: str) -> str:
    return f"the column {name!r} numbers the rows and is left out: give it another name to keep it as a sensor"


def _polars_frame(frame: Any) -> Any:
    """Converts a pandas frame to a polars frame, column by column, without pyarrow."""
    try:
        import polars
    except ImportError:
        told = "a frame of pandas is read with pyarrow or with polars, and neither is installed: pip install pyarrow, or pip install polars"
        raise ImportError(told) from None
    return polars.DataFrame([_polars_column(str(name), values) for name, values in frame.items()])


def _polars_column(name: str, values: Any) -> Any:
    """Converts a pandas column to a polars column: times with a time zone become UTC, others are numbers or texts."""
    import pandas
    import polars

    dtype = values.dtype
    if isinstance(dtype, pandas.DatetimeTZDtype):
        return _polars_times(name, values.dt.tz_convert("UTC").dt.tz_localize(None)).dt.replace_time_zone("UTC")
    if isinstance(dtype, np.dtype) and dtype.kind == "M":
        return _polars_times(name, values)
    if isinstance(dtype, np.dtype) and dtype.kind in "biufm":
        return polars.Series(name, values.to_numpy(np.float32 if dtype == np.float16 else dtype))
    if not isinstance(dtype, (np.dtype, pandas.CategoricalDtype)) and pandas.api.types.is_numeric_dtype(dtype):
        is_whole = not values.isna().any() and pandas.api.types.is_integer_dtype(dtype)
        return polars.Series(name, values.to_numpy(np.int64 if is_whole else np.float64, na_value=0 if is_whole else np.nan))
    objects = values.astype(object)
    there = objects.notna().tolist()
    cells = [value if is_there else None for value, is_there in zip(objects.tolist(), there, strict=True)]
    return polars.Series(name, _plain_cells(cells), strict=False)


def _polars_times(name: str, times: Any) -> Any:
    import polars

    instants = times.to_numpy()
    return polars.Series(name, instants if instants.dtype == "datetime64[ns]" else instants.astype("datetime64[us]"))


def _plain_cells(cells: Sequence[Any]) -> list[Any]:
    """Converts the cells of a column of objects: to numbers if all are, to times if all are, or else to texts."""
    there = [cell for cell in cells if cell is not None]
    if all(isinstance(cell, (Real, Decimal, np.bool_)) for cell in there):
        return [None if cell is None else float(cell) for cell in cells]
    if all(isinstance(cell, datetime.datetime) and cell.tzinfo is None for cell in there):
        return list(cells)
    return [None if cell is None else str(cell) for cell in cells]
