"""Functions that need no study."""

from __future__ import annotations

import contextlib
import difflib
import json
import os
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _calib
from ._acting import ActionModel
from ._built_study import write_built_study
from ._checks import whole
from ._errors import CalibError, CalibWarning
from ._files import made_folder
from ._frames import Table, arrow_stream, table_of
from ._model import Model, of_arrays
from ._progress import Heard, Observer, observer
from ._study import Study

Index = Literal["auto", "kd_tree", "join", "scan"]

# The keys and sections at the top of a study.
SECTIONS = (
    "seed",
    "output",
    "simulate",
    "data",
    "profiles",
    "compare",
    "models",
    "deployments",
    "sensors",
    "preprocess",
    "representation",
    "model",
    "dynamics",
    "rollout",
    "agent",
    "pretrain",
    "control",
    "sweep",
    "evaluate",
)


class Warping(NamedTuple):
    """A dynamic time warping distance. `dtw` returns it.

    Examples:
        >>> import calib_rl
        >>> warping = calib_rl.dtw([0, 1, 2, 1], [0, 0, 1, 2, 1], path=True)
        >>> warping.distance, warping.end
        (0.0, 4)
    """

    distance: float
    """Cumulated along the best path, in units of the local distance."""
    normalized: float | None
    """Divided as the step pattern says. ``None`` for patterns without a normalisation."""
    end: int
    """Sample of the reference at which the path ends."""
    path: tuple[NDArray[np.int64], NDArray[np.int64]] | None
    """Matched samples of the query and of the reference, if they were asked for."""


@overload
def build_model(
    log: Any,
    /,
    folder: str | os.PathLike[str],
    *,
    actions: Sequence[str],
    reward: str | Sequence[Mapping[str, Any]],
    reward_row: Literal["next", "same"] | None = None,
    terminal: str | None = None,
    levels: int | None = None,
    timeout: int | None = None,
    progress: bool | Observer = False,
    **sections: Any,
) -> ActionModel: ...
@overload
def build_model(
    log: Any,
    /,
    folder: str | os.PathLike[str] | None = None,
    *,
    segments: Sequence[int] | None = None,
    progress: bool | Observer = False,
    **sections: Any,
) -> Model: ...
def build_model(
    log: Any,
    /,
    folder: str | os.PathLike[str] | None = None,
    *,
    segments: Sequence[int] | None = None,
    actions: Sequence[str] | None = None,
    reward: str | Sequence[Mapping[str, Any]] | None = None,
    reward_row: Literal["next", "same"] | None = None,
    terminal: str | None = None,
    levels: int | None = None,
    timeout: int | None = None,
    progress: bool | Observer = False,
    **sections: Any,
) -> Model | ActionModel:
    """Build a calibration model from a table, a log or an array.

    Args:
        log: One of these. It has no name, because ``data`` is a section of the study:

            - anything with ``__arrow_c_stream__`` (frames of polars and pandas, tables of pyarrow, relations of DuckDB): a column of
              times and one per channel. It is written as ``folder/log.parquet``, batch by batch and without a copy of the whole, and is
              then read like a log on the command line. It replaces only files that calib wrote there before.
            - a path to logs: read where they are.
            - an array of normalised states ``[n, d]``, real numbers of any type and layout: copied once, as ``float32``.
        folder: Where the study, the log and the results go. Tables and paths need it. The same call with another log replaces the log and the model there.
        segments: For an array: number of rows of each unbroken segment. Default: all rows are one segment.
        actions: Columns of the action in each row, for agents that act. The model is then a model with actions. The whole log is read, unless ``data=``
            says otherwise. All other columns of numbers are the state, except ``reward``, ``terminal`` and the columns in ``data={"exclude": [...]}``.
        reward: The column of the reward of the step that led to a row, or terms, such as ``[{"column": "flow", "weight": 1.0}]``.
        reward_row: ``"next"``, the default, if the reward and the terminal of a step are in the row that it led to. ``"same"`` if they are in the
            row of its action, as in logs of steps ``(state, action, reward, done)``.
        terminal: The column that is 1 where an episode ends, if there is one. An episode also ends where the log has a gap.
        levels: For continuous actions: number of levels of each column that agents choose among. A few values far from all others count as missing.
            Default: every recorded combination of values is an action.
        timeout: Steps after which an episode is cut.
        progress: Whether to print the progress, or an observer.
        sections: For tables and paths: sections of the study, such as ``model={"members": 5}, preprocess={"subsample": 10}``.
            For an array: keys of ``[model]``, such as ``members=5, neighbors=3``.

    Returns:
        The model: memory-mapped from ``folder``, or in memory if it is of an array. An `ActionModel` if there are ``actions``.

    Raises:
        CalibError: A value of an array is NaN or infinite. A log is wrong, or has only one action. Two columns of a frame have one name, or a column
            has that of the index and other times. ``folder/log.parquet`` exists, and calib did not write it. ``folder`` is a file, or cannot be written to.
        StudyError: A section is not valid. Nothing is written then.
        FileExistsError: ``folder`` has a model of other arguments, or a study that calib did not write there. A study of a call that failed is replaced.
        ImportError: A frame of pandas needs pyarrow or polars. Nothing is written then.
        TypeError: The data is of another type, or has no real numbers. An argument does not exist.
        ValueError: An argument is outside its range.
        MemoryError: There is not enough memory for a copy of an array.

    Warns:
        CalibWarning: Something in the log costs rows, or may have another meaning. It is issued for every value of ``progress``.

    Examples:
        >>> import numpy as np
        >>> import calib_rl
        >>> states = np.random.default_rng(0).random((500, 4))
        >>> calib_rl.build_model(states, segments=[300, 200], members=4, neighbors=2)
        <calib_rl.Model: 4 members of 498 transitions, 2 neighbours, 4 columns>
    """
    acting: dict[str, Any] = {"reward": reward, "reward_row": reward_row, "terminal": terminal, "levels": levels, "timeout": timeout}
    if actions is None and (stray := [name for name, value in acting.items() if value is not None]):
        raise TypeError(f"{stray[0]} is for models with actions; name the columns of what was done with actions=")
    if isinstance(actions, str):
        raise TypeError(f"actions is {actions!r}, expected a list of columns, such as [{actions!r}]")
    if not (reward is None or isinstance(reward, str)):
        reward = acting["reward"] = _terms(reward)
    data = sections.get("data")
    table = table_of(log, data.get("timestamp") if isinstance(data, Mapping) else None)
    is_path = isinstance(log, (str, os.PathLike))
    heard = Heard(progress)
    if table is None and not is_path:
        if actions is not None:
            raise TypeError("a model with actions is made of a table with a column of times, or of logs; got an array")
        if folder is not None:
            raise TypeError("a model of an array lies in memory, without a folder; give a table with a column of times instead")
        return of_arrays(log, segments, sections, progress)
    if segments is not None:
        raise TypeError("segments are for arrays; those of a log follow from its times")
    _refuse_unknown(sections, actions is not None)
    if levels is not None:
        acting["levels"] = whole(levels, "levels", 2)
    if timeout is not None:
        acting["timeout"] = whole(timeout, "timeout", 1)
    if folder is None:
        raise TypeError("folder says where the model of a log lies")
    # Paths in a study are relative to its file, so that the folder can be moved with its contents.
    own = {**sections.pop("data", {}), "path": str(Path(log).absolute()) if is_path else _LOG}
    if actions is not None:
        # There is no held-out period: agents are compared in the ensemble members, each of which lacks a block.
        own = {"train_fraction": 1.0, **own}
        given = {name: value for name, value in acting.items() if value is not None}
        sections["control"] = {**sections.get("control", {}), "actions": list(actions), **given}
    study = _written(Path(folder) / "study.toml", {"data": own, **sections}, table)
    heard.warnings.extend(table.left_out if table is not None else [])
    try:
        model: Model | ActionModel = study.build_model(progress=heard) if actions is None else study.build_control_model(progress=heard)
    except BaseException:
        # Where warnings are errors, what was raised is told all the same.
        with contextlib.suppress(Warning):
            for text in heard.warnings:
                warnings.warn(text, CalibWarning, stacklevel=2)
        raise
    for text in heard.warnings:
        warnings.warn(text, CalibWarning, stacklevel=2)
    return model


# The file for a table.
_LOG = "log.parquet"


def _terms(reward: Any) -> list[Mapping[str, Any]]:
    """Returns the terms of a reward.

    Raises:
        TypeError: It is neither a column nor a sequence of terms.
    """
    terms = list(reward) if isinstance(reward, Sequence) else []
    if not terms or not all(isinstance(term, Mapping) for term in terms):
        raise TypeError(f"reward is {reward!r}, expected the name of a column, or terms, such as [{{'column': 'flow', 'weight': 1.0}}]")
    return terms


def _written(path: Path, sections: dict[str, Any], table: Table | None) -> Study:
    """Writes the study of these sections at ``path``, and the log of a table beside it. Returns the study.

    Raises:
        StudyError: A section is not valid. Nothing is written in this case.
        CalibError: The folder is a file, or cannot be written to.
        FileExistsError: The file holds another study.
        ImportError: A pandas frame cannot be read. Nothing is written in this case.
    """
    # These arguments belong to the call, and are not part of the study's file.
    output = sections.pop("output", None)
    beside: dict[str, Any] = {"output": None if output is None else os.fspath(output)}
    if isinstance(sections.get("model"), str):
        beside["model"] = sections.pop("model")
    text = _calib.to_toml(sections)
    _calib.Job(os.fspath(path), text, **beside)
    stream = None if table is None else arrow_stream(table.columns)
    made_folder(path.parent, "models")
    try:
        write_built_study(path, text, beside["output"])
    except FileExistsError:
        raise
    except OSError as error:
        raise CalibError(f"folder: {path} cannot be written ({error.strerror}); name a folder that you may write to") from error
    if stream is not None:
        _calib.write_log(stream, os.fspath(path.parent / _LOG))
    return Study(path, **beside)


def _refuse_unknown(sections: Mapping[str, Any], is_acting: bool) -> None:
    """Refuses a keyword that is not a section of a study, and names the nearest argument, section or key.

    Raises:
        TypeError: There is such a keyword.
    """
    unknown = next((name for name in sections if name not in SECTIONS), None)
    if unknown is None:
        return
    arguments = ["reward", "reward_row", "terminal", "levels", "timeout"] if is_acting else ["segments"]
    # The names that a wrong keyword may stand for, with the way to give each.
    meant = {name: f"{name}=" for name in ["actions", *arguments, "folder", "progress", *SECTIONS]}
    study: dict[str, Any] = {"data": {"path": "log.parquet"}, "control": {"actions": ["action"]}}
    resolved = json.loads(_calib.Job("study.toml", _calib.to_toml(study)).json())
    if is_acting:
        for key in resolved["control"]:
            meant.setdefault(key, f"control={{{key!r}: ...}}")
        for key in resolved["control"]["model"]:
            meant.setdefault(key, f"control={{'model': {{{key!r}: ...}}}}")
    for section in ["data", "preprocess"] if is_acting else ["model", "data", "preprocess"]:
        for key in resolved[section]:
            meant.setdefault(key, f"{section}={{{key!r}: ...}}")
    nearest = difflib.get_close_matches(unknown, meant, n=1, cutoff=0.7)
    hint = f"did you mean {meant[nearest[0]]}?" if nearest else f"sections of a study are {', '.join(SECTIONS)}"
    raise TypeError(f"build_model() got an unexpected argument {unknown!r}; {hint}")


def knn_join(
    array: ArrayLike,
    k: int,
    *,
    queries: ArrayLike | None = None,
    exclude_self: bool = False,
    index: Index = "auto",
    progress: bool | Observer = False,
) -> tuple[NDArray[np.uint32], NDArray[np.float32]]:
    """Find the ``k`` nearest points of every point, or of every query, by exact search.

    The order is by squared distance in double precision, ties by position. Results are the same for every ``index`` and number
    of threads.

    Args:
        array: Points, ``[n, d]``: real numbers of any type and layout, copied once as ``float32``.
        k: Number of neighbours of each point or query.
        queries: Other points, ``[q, d]``, whose neighbours are searched instead.
        exclude_self: Whether to exclude the point itself. Not for ``queries``.
        index: The search structure. ``"auto"`` takes the one that suits the data.
        progress: Whether to print the progress, or an observer.

    Returns:
        Positions ``uint32 [n, k]``, nearest first, and Euclidean distances ``float32 [n, k]``.

    Raises:
        ValueError: A value is NaN or infinite, or there are fewer than ``k`` points to find.
        TypeError: The points are not real numbers, or ``k`` is not a whole number.
        MemoryError: There is not enough memory.
        KeyboardInterrupt: Ctrl-C.

    Examples:
        >>> import calib_rl
        >>> neighbors, distances = calib_rl.knn_join([[0.0], [1.0], [3.0]], 1, exclude_self=True)
        >>> neighbors.tolist(), distances.tolist()
        ([[1], [0], [1]], [[1.0], [1.0], [2.0]])
    """
    return _calib.knn_join(array, whole(k, "k", 1), queries, exclude_self, index, observer(progress))


def dtw(
    x: ArrayLike,
    y: ArrayLike,
    *,
    step_pattern: str = "symmetric2",
    local_distance: Literal["absolute", "squared", "euclidean"] = "absolute",
    window: str = "none",
    ends: Literal["closed", "openEnd", "openBegin", "openBoth"] = "closed",
    path: bool = False,
) -> Warping:
    """Compute the dynamic time warping distance of two series.

    Args:
        x: The query, ``[n]`` or ``[n, channels]``.
        y: The reference, ``[m]`` or ``[m, channels]``.
        step_pattern: One of R's dtw package, such as ``"symmetric2"``, ``"asymmetric"``, ``"symmetricP1"``, ``"rabinerJuang:6c"``.
        local_distance: Distance between two samples.
        window: Cells that a path may visit, as in ``calib dtw --window``: ``"none"``, ``"sakoechiba:10"``.
        ends: Ends of the reference that may stay unmatched.
        path: Whether to return the matched samples.

    Returns:
        The distance. The memory use grows with ``n + m``.

    Raises:
        ValueError: A series is empty or not finite, no path is admissible, or an option is unknown.
        MemoryError: There is not enough memory for the path.
        KeyboardInterrupt: Ctrl-C.

    Examples:
        >>> import calib_rl
        >>> calib_rl.dtw([0, 1, 2, 1], [0, 0, 1, 2.5, 1]).distance
        1.0
    """
    distance, normalized, end, both = _calib.dtw(x, y, step_pattern, local_distance, window, ends, path)
    return Warping(distance, normalized, end, None if both is None else (both[0], both[1]))


def simulate(folder: str | os.PathLike[str], *, force: bool = False, progress: bool | Observer = False, **options: Any) -> str:
    """Write the log of a simulated membrane plant, one Parquet file per day.

    Args:
        folder: The folder of the log.
        force: Whether to replace the log of another simulated plant.
        progress: Whether to print the progress, or an observer.
        options: Keys of ``[simulate]``: ``days``, ``channels``, ``period_secs``, ``seed``, ``noise``, ….

    Returns:
        A description of the log, in words.

    Raises:
        CalibError: The folder holds other logs.
        TypeError: An option does not exist.
        ValueError: An option is outside its range.

    Examples:
        >>> import calib_rl, pathlib, tempfile
        >>> folder = pathlib.Path(tempfile.mkdtemp()) / "plant"
        >>> text = calib_rl.simulate(folder, days=1, channels=6, period_secs=60)
        >>> len(list(folder.glob("*.parquet")))
        1
    """
    return _calib.simulate(os.fspath(folder), options, force, observer(progress))


def set_threads(threads: int) -> None:
    """Limit the threads that calib uses. Call it before anything else. Results do not depend on it.

    The default is ``RAYON_NUM_THREADS``, or the number of processors.

    Args:
        threads: Number of threads, from 1 to 1024.

    Raises:
        RuntimeError: Threads are already running.
        ValueError: It is less than 1, or more than 1024.

    Examples:
        >>> import calib_rl
        >>> calib_rl.set_threads(2)    # doctest: +SKIP
    """
    _calib.set_threads(whole(threads, "threads", 1))
