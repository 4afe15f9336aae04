"""One agent on one stream, and its files: in this process, or in one of several."""

from __future__ import annotations

import base64
import multiprocessing
import pickle
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import _calib
from .._files import digest, read_sealed_json, write_sealed_json, write_whole
from .._orphans import end_with_parent
from .._study import Study
from ._protocol import Factory, made
from ._streams import Streams, predicted

# The version of the records of runs.
_FORMAT = 1
# The type of stored predictions, on every machine.
_PREDICTION = np.dtype("<f4")


class Unit(NamedTuple):
    """A run of one setting for one sensor on one stream, and the key that its files are named after."""

    stream: int
    sensor: str
    candidate: int
    values: dict[str, Any]
    key: str
    keep_states: bool


def plain(value: Any) -> Any:
    """A value of NumPy, or anything with a text, for JSON."""
    return value.tolist() if hasattr(value, "tolist") else str(value)


def _record_file(unit: Unit, store: Path) -> Path:
    return store / f"{unit.key}.json"


def _state_file(unit: Unit, store: Path) -> Path:
    return store / f"{unit.key}.state.pickle"


def _record(unit: Unit, store: Path) -> dict[str, Any]:
    """Returns the record of a stored run.

    Raises:
        OSError: It cannot be read.
        ValueError: It is damaged, was edited, or is of another run.
    """
    path = _record_file(unit, store)
    record = read_sealed_json(path)
    if [record.get("format"), record.get("key")] != [_FORMAT, unit.key]:
        raise ValueError(f"{path} is not the record of this run")
    return record


def unfinished(units: Sequence[Unit], store: Path) -> tuple[list[Unit], list[Path]]:
    """Returns the runs that have to be made, and the files of stored ones that are damaged or edited."""
    left, damaged = [], []
    for unit in units:
        path = _record_file(unit, store)
        try:
            is_stored = path.exists()
            if is_stored:
                learned = _record(unit, store)["state"]
                if unit.keep_states:
                    path = _state_file(unit, store)
                    is_stored = learned is not None and path.exists()
                    if is_stored and digest(path.read_bytes()) != learned:
                        raise ValueError(f"{path} does not have the checksum of its record")
        except (OSError, ValueError):
            is_stored = False
            damaged.append(path)
        if not is_stored:
            left.append(unit)
    return left, damaged


def stored(unit: Unit, store: Path) -> tuple[NDArray[np.float32], int]:
    """Returns the predictions of a stored run, and how often its agent learned.

    Raises:
        OSError: It cannot be read.
        ValueError: It is damaged, was edited, or is of another run.
    """
    record = _record(unit, store)
    return np.frombuffer(base64.b64decode(record["predictions"]), _PREDICTION), int(record["updates"])


def run_unit(streams: Streams, factory: Factory, unit: Unit, store: Path) -> None:
    """Make a run, and put its record into the store."""
    stream = streams.all[unit.stream]
    states, pieces = stream.states()
    task = streams.task(stream, unit.sensor, states.shape[1])
    agent = made(factory, task, unit.values)
    predictions, updates = predicted(agent, states, pieces, task.column, stream.steps)
    learned = pickle.dumps(dict(agent.state_dict())) if unit.keep_states else None
    record = {
        "format": _FORMAT,
        "key": unit.key,
        "environment": stream.environment,
        "run": stream.run,
        "sensor": unit.sensor,
        "setting": {name: repr(value) for name, value in unit.values.items()},
        "updates": updates,
        "state": None if learned is None else digest(learned),
        "predictions": base64.b64encode(predictions.astype(_PREDICTION).tobytes()).decode(),
    }
    with _STORING:
        if learned is not None:
            write_whole(_state_file(unit, store), learned)
        # The record is written last, so a run with a record is complete.
        write_sealed_json(_record_file(unit, store), record)
        _remove_earlier(unit, store)


def _remove_earlier(unit: Unit, store: Path) -> None:
    """Removes the files that earlier versions stored of a run. They have no checksum and count as not made, so it was made again."""
    replaced = ["npy", "npy.updates", *(["npy.state.pickle"] if unit.keep_states else [])]
    for ending in replaced:
        (store / f"{unit.key}.{ending}").unlink(missing_ok=True)


# Held while a run is stored.
_STORING = threading.Lock()
_STREAMS: list[Streams] = []


def open_streams(given: dict[str, Any]) -> None:
    """Begin a process: open the streams that it will need."""
    parent = multiprocessing.parent_process()
    if parent is not None and parent.pid is not None:
        end_with_parent(parent.pid, _STORING)
    _calib.set_threads(1)
    _STREAMS.append(Streams(Study(**given)))


def run_there(factory: Factory, unit: Unit, store: str) -> None:
    """Make a run in a process that has opened the streams."""
    run_unit(_STREAMS[0], factory, unit, Path(store))
