"""The common part of environments with and without actions: columns, spaces, ensemble members, seeds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from . import _calib
from ._acting import ActionModel
from ._checks import LARGEST_SEED, position, whole
from ._model import Model, Units

try:
    from gymnasium.vector import AutoresetMode
except ImportError:  # 1.0 does so too, and has no name for it
    AUTORESET: dict[str, Any] = {}
else:
    AUTORESET = {"autoreset_mode": AutoresetMode.NEXT_STEP}

Column = str | int

# Memory of a walker here and in compiled code, without its observations, in bytes.
_WALKER_BYTES = 512


Seen = Model | ActionModel
Walkers = _calib.Walkers | _calib.ActionWalkers


class WalkSettings:
    """Walkers that can be pickled, with their arguments."""

    def __init__(self, model: Seen, walked: tuple[Any, ...]) -> None:
        self._model = model
        self._walked = walked
        # Each subclass has walkers of one type, and declares it.
        self.walkers: Any = model._native.walkers(*walked)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "walkers": self.walkers.state()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        at = state.pop("walkers")
        self.__dict__.update(state)
        self.walkers = self._model._native.walkers(*self._walked)
        self.walkers.restore(at)


def column_position(names: list[str], column: Column) -> int:
    """Returns the position of a column, given by name or position."""
    if isinstance(column, str):
        if column not in names:
            raise ValueError(f"no column is called {column!r}; the model has {', '.join(names)}")
        return names.index(column)
    number = whole(column, "a column", -LARGEST_SEED)
    if not 0 <= number < len(names):
        raise ValueError(f"column {number}: the model has {len(names)}, from 0 on")
    return number


def observed_columns(names: list[str], observe: Sequence[Column] | None) -> list[int]:
    """Returns the positions of the observed columns: all without ``observe``, and one if it is a name."""
    observe = [observe] if isinstance(observe, str) else observe
    columns = list(range(len(names))) if observe is None else [column_position(names, column) for column in observe]
    if not columns:
        raise ValueError("observe names no column")
    return columns


def observation_space(model: Seen, columns: list[int], units: Units) -> gymnasium.Space[NDArray[np.float32]]:
    """Returns the space of these columns, from the smallest to the largest recorded value."""
    low, high = model._native.extremes()
    if units == "physical":
        low, high = model.physical(low).astype(np.float32), model.physical(high).astype(np.float32)
    return spaces.Box(low[columns], high[columns], dtype=np.float32)


def dealt_members(num_envs: Any, members: int | Sequence[int], width: int) -> list[int]:
    """Returns the ensemble member of each environment with ``width`` columns: ``members`` are assigned in turn."""
    num_envs = whole(num_envs, "num_envs", 1)
    given = [members] if isinstance(members, (int, np.integer)) else list(members)
    if not given:
        raise ValueError("members names no member")
    given = [position(member, "members") for member in given]
    _calib.require_memory(num_envs * (_WALKER_BYTES + 16 * width), f"{num_envs} walks", "lower num_envs")
    return [given[number % len(given)] for number in range(num_envs)]


def one_seed(seed: int | Sequence[int | None] | None) -> int | None:
    """Returns the seed of all environments, if there is a single one."""
    return int(seed) if isinstance(seed, (int, np.integer)) else None


def seed_walkers(walkers: Walkers, seed: int | Sequence[int | None] | None, count: int) -> None:
    """Seed the environments: environment ``i`` of seed ``s`` with ``s + i``, or each with its own seed from a list."""
    if isinstance(seed, (int, np.integer)):
        first = whole(seed, "seed", most=LARGEST_SEED)
        walkers.seed([(first + number) % (LARGEST_SEED + 1) for number in range(count)])
    elif seed is not None:
        walkers.seed([None if own is None else whole(own, "seed", most=LARGEST_SEED) for own in seed])
