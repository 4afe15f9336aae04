"""What an agent does at the end of a run of `calib_rl.tune`: its last steps, and the actions that it takes along what it observes."""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from ._acting_env import ActingEnv

# As in `calib control`: steps that are stored one by one, most steps that are counted, and columns.
_STORED = 200
_COUNTED = 5_000
_COLUMNS = 4
# Each part of a column has the same number of recorded states.
_PARTS = 5


class _Step(NamedTuple):
    seen: NDArray[np.float32]
    action: Any
    reward: float
    begins: bool


class LastSteps:
    """Keeps the last quarter of a run of ``steps`` steps in ``env``."""

    def __init__(self, env: ActingEnv, steps: int) -> None:
        self._env = env
        self._kept: deque[_Step] = deque(maxlen=min(_COUNTED, -(-steps // 4)))
        self._seen: NDArray[np.float32] | None = None
        self._begins = True

    def begin(self, seen: NDArray[np.float32]) -> None:
        """Begin an episode with this observation."""
        # Agents may change what they get.
        self._seen, self._begins = seen.copy(), True

    def add(self, action: Any, reward: float, seen: NDArray[np.float32]) -> None:
        """Add a step that led to the observation ``seen``."""
        # An agent may have reset the environment without its wrappers.
        if self._seen is not None:
            self._kept.append(_Step(self._seen, np.array(action), reward, self._begins))
        self._seen, self._begins = seen.copy(), False

    def conduct(self) -> dict[str, Any] | None:
        """Returns what the agent did, as ``conduct`` in ``verdict.json`` of `calib control`, and the names of the ``actions``.

        Returns:
            Observations in the units of the log, and the values that the actions set. ``None`` if one of them is not finite.
        """
        model, steps = self._env.model, list(self._kept)
        if not steps:
            return None
        observed = self._env.in_units(np.stack([step.seen for step in steps]))
        levels, values = self._env.set_by([step.action for step in steps])
        rewards = np.array([step.reward for step in steps])
        if not all(np.isfinite(numbers).all() for numbers in (values, rewards, *observed.values())):
            return None
        last = slice(max(0, len(steps) - _STORED), None)
        return {
            "actions": [action.name for action in model.actions],
            "steps": len(steps),
            "set": [{"column": name, "values": _short(column[last])} for name, column in zip(model.action_columns, values.T)],
            "columns": [self._column(name, observed[name], levels, last) for name in list(observed)[:_COLUMNS]],
            "rewards": _short(rewards[last]),
            "begins": [place for place, step in enumerate(steps[last]) if step.begins],
        }

    def _column(self, name: str, values: NDArray[np.float64], levels: NDArray[np.int64], last: slice) -> dict[str, Any]:
        model = self._env.model
        place = model.columns.index(name)
        bounds = np.quantile(model.states[:, place], np.arange(1, _PARTS + 1) / _PARTS)
        _, offset, scale = model._native.columns[place]
        upper = bounds * scale + offset
        if self._env.units == "physical":
            # Observations are rounded so, and a recorded value must not pass its own bound.
            upper = upper.astype(np.float32).astype(np.float64)
        upper = np.unique(upper)
        # A value beyond the recorded range belongs to the last part.
        parts = np.minimum(np.searchsorted(upper, values), len(upper) - 1)
        counts = np.zeros((len(model.actions), len(upper)), np.int64)
        np.add.at(counts, (levels, parts), 1)
        steps = counts.sum(axis=0)
        return {
            "column": name,
            "values": _short(values[last]),
            "upper": _short(upper),
            "steps": steps.tolist(),
            "taken": [_short(shares) for shares in counts / np.maximum(steps, 1)],
        }


def _short(values: ArrayLike) -> list[float]:
    """Returns numbers with six significant digits, which take less than half of the room."""
    return [float(f"{value:.6g}") for value in np.asarray(values)]


def is_conduct(value: Any) -> bool:
    """Whether a value of a file has the form of `LastSteps.conduct`."""
    try:
        actions, told, rewards = value["actions"], value["set"], value["rewards"]
        columns, begins = value["columns"], value["begins"]
        names = [*actions, *(one["column"] for one in (*told, *columns))]
        series = [rewards, *(one["values"] for one in (*told, *columns))]
        taken = [one["taken"] for one in columns]
        parts = [row for one in columns for row in (one["upper"], *one["taken"])]
        counts = [value["steps"], *begins, *(count for one in columns for count in one["steps"])]
        lists = [actions, told, columns, begins, *taken, *series, *parts, *(one["steps"] for one in columns)]
        return (
            all(isinstance(each, list) for each in lists)
            and all(isinstance(name, str) for name in names)
            and all(type(count) is int and count >= 0 for count in counts)
            and all(len(numbers) == len(rewards) for numbers in series)
            and 0 < len(rewards) <= value["steps"] <= _COUNTED
            and all(place < len(rewards) for place in begins)
            and all(len(one["taken"]) == len(actions) and sum(one["steps"]) == value["steps"] for one in columns)
            and all(len(row) == len(one["upper"]) > 0 for one in columns for row in (one["steps"], *one["taken"]))
            and all(type(number) in (int, float) and math.isfinite(number) for row in (*series, *parts) for number in row)
        )
    except (KeyError, TypeError, OverflowError):
        return False
