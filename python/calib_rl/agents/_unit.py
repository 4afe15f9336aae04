"""One agent on one stream, and its files: in this process, or in one of several."""

from __future__ import annotations

import io
import multiprocessing
import pickle
import threading
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .. import _calib
from .._files import write_whole
from .._orphans import end_with_parent
from .._study import Study
from ._protocol import Factory, made
from ._streams import Streams, predicted


class Unit(NamedTuple):
    """A run of one value for one sensor on one stream, and the name of its file."""

    stream: int
    sensor: str
    candidate: int
    values: dict[str, Any]
    key: str
    keep_states: bool


def plain(value: Any) -> Any:
    """A value of NumPy, or anything with a text, for JSON."""
    return value.tolist() if hasattr(value, "tolist") else str(value)


def _state_file(unit: Unit, store: Path) -> Path:
    return store / f"{unit.key}.state.pickle"


def is_stored(unit: Unit, store: Path) -> bool:
    """Whether the store has the run, with what its agent learned if that is kept."""
    return (store / unit.key).exists() and (not unit.keep_states or _state_file(unit, store).exists())


def run_unit(streams: Streams, factory: Factory, unit: Unit, store: Path) -> None:
    """Make a run, and put its predictions and updates into the store."""
    states, pieces = streams.all[unit.stream].states()
    task = streams.task(streams.all[unit.stream], unit.sensor, states.shape[1])
    agent = made(factory, task, unit.values)
    predictions, updates = predicted(agent, states, pieces, task.column, streams.all[unit.stream].steps)
    learned = pickle.dumps(dict(agent.state_dict())) if unit.keep_states else None
    array = io.BytesIO()
    np.save(array, predictions)
    with _STORING:
        (store / f"{unit.key}.updates").write_text(str(updates))
        if learned is not None:
            write_whole(_state_file(unit, store), learned)
        # The array is written last, so a run with an array is complete.
        write_whole(store / unit.key, array.getvalue())


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
