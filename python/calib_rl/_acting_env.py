"""A model with actions as an environment of Gymnasium. Users call `calib_rl.gym`."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any, Literal

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from . import _calib
from ._acting import ActionModel
from ._checks import LARGEST_SEED, finite, position, whole
from ._errors import CalibWarning
from ._kinds import ModelKind
from ._model import Units, check_units, physical_values
from ._walks import (
    AUTORESET,
    Column,
    WalkSettings,
    dealt_members,
    observation_space,
    observed_columns,
    one_seed,
    seed_walkers,
)

Pessimism = Literal["nearest", "minimum_return"]
ActionKind = Literal["discrete", "multi_discrete", "box"]
AnySpace = gymnasium.Space[Any]


class _Actions:
    """The action space of a model, and its conversion to the actions of walkers."""

    def __init__(self, model: ActionModel, wanted: ActionKind | AnySpace | None, live: bool, model_kind: ModelKind) -> None:
        levels = np.array([action.values for action in model.actions], np.float64)
        low, high = np.array(list(model.action_columns.values()), np.float64).T
        self.names = list(model.action_columns)
        self.live, self.low, self.high = live, low, high
        self.range = np.where(high > low, high - low, 1.0)
        self.values, self.levels = levels, levels / self.range
        kind = wanted if isinstance(wanted, str) else _kind(wanted)
        if live and kind != "box":
            raise ValueError("live searches for what is set, which is a number: it wants action_space='box'")
        if live and model_kind == "network":
            raise ValueError("live searches among recorded settings, and a network knows levels alone; take kind='neighbors' or 'increments'")
        if live and not model.is_continuous:
            raise ValueError("live wants a model whose actions are numbers; build it with levels=, such as levels=7")
        self.space: AnySpace
        if kind == "discrete":
            self.space = spaces.Discrete(len(levels))
        elif kind == "multi_discrete":
            grid = [np.unique(column) for column in levels.T]
            sizes = [len(values) for values in grid]
            if np.prod(sizes) != len(levels):
                raise ValueError(
                    f"multi_discrete wants every combination of {' x '.join(map(str, sizes))} values, and the log took {len(levels)}; "
                    "take action_space='discrete', or build the model with levels="
                )
            self.table = np.zeros(sizes, np.int64)
            for number, level in enumerate(levels):
                self.table[tuple(np.searchsorted(values, value) for values, value in zip(grid, level))] = number
            self.space = spaces.MultiDiscrete(sizes)
        elif kind == "box":
            self.space = spaces.Box(low.astype(np.float32), high.astype(np.float32), dtype=np.float32)
        else:
            raise ValueError(f"action_space is {kind!r}, expected 'discrete', 'multi_discrete', 'box', or a space")
        self.kind = kind
        if not isinstance(wanted, str) and wanted is not None and wanted != self.space:
            raise ValueError(
                f"action_space is {wanted}, and that of this model is {self.space}; leave it out, or lay a wrapper such as "
                "gymnasium.wrappers.RescaleAction over the environment"
            )

    def of(self, actions: Any) -> ArrayLike:
        """Returns the actions of all walkers in the form that these take."""
        if self.kind == "discrete":
            return _wholes(actions)
        if self.kind == "multi_discrete":
            places = self._rows(_wholes(actions))
            outside = (places < 0) | (places >= self.table.shape)
            if outside.any():
                row = places[outside.any(axis=1).argmax()]
                raise ValueError(f"an action is {row.tolist()}, expected numbers from 0 to {[size - 1 for size in self.table.shape]}")
            levels: NDArray[np.int64] = self.table[tuple(places.T)]
            return levels
        try:
            values = np.asarray(actions, np.float64)
        except (TypeError, ValueError):
            values = np.full((1, len(self.low)), np.nan)
        if not np.isfinite(values).all():
            raise ValueError(f"an action is {actions}, which is no number: {self._why_not_finite(values)}")
        values = self._rows(values)
        return values if self.live else self._nearest(values)

    def _rows(self, actions: NDArray[Any]) -> NDArray[Any]:
        """Returns these actions, one in each row.

        Raises:
            ValueError: They have another number of columns than the model's actions.
        """
        columns = len(self.low)
        if actions.ndim != 2 or actions.shape[1] != columns:
            raise ValueError(f"an action has the shape {actions.shape[1:]}, expected ({columns},), a number for each column of actions")
        return actions

    def _why_not_finite(self, values: NDArray[np.float64]) -> str:
        """Returns why an agent sets values that are no numbers, for an error."""
        if values.ndim == 2 and values.shape[1] == len(self.low):
            wrong = ~np.isfinite(values).all(axis=0)
            # Some agents scale what they set by its range.
            if (self.low[wrong] == self.high[wrong]).all():
                name = self.names[int(wrong.argmax())]
                return f"{name} has one value in the log, so that an agent may divide by its range of 0; leave it out of actions= when you build the model"
        return "the agent has diverged"

    def _nearest(self, values: NDArray[np.float64]) -> NDArray[np.int64]:
        shares = values[:, None, :] / self.range
        nearest: NDArray[np.int64] = np.square(shares - self.levels).sum(axis=2).argmin(axis=1)
        return nearest

    def set_by(self, actions: NDArray[Any]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Returns the numbers of the actions, or of the nearest ones with ``live``, and the values that they set, ``[n, action columns]``."""
        if self.live:
            # Walkers do the same.
            values = np.asarray(actions, np.float64).clip(self.low, self.high)
            return self._nearest(values), values
        levels = np.asarray(self.of(actions), np.int64)
        return levels, self.values[levels]


def _wholes(actions: Any) -> NDArray[np.int64]:
    """Returns actions as integers.

    Raises:
        ValueError: One is not an integer, such as that of an agent that has diverged.
    """
    given = np.asarray(actions)
    if given.dtype.kind not in "biu":
        try:
            numbers = given.astype(np.float64)
        except (TypeError, ValueError):
            numbers = np.full(given.shape, np.nan)
        wrong = ~(np.isfinite(numbers) & (numbers == np.floor(numbers)))
        if wrong.any():
            raise ValueError(
                f"an action is {given[wrong].flat[0]}, expected a whole number; take action_space='box' for an agent that sets values, and see "
                "that the agent has not diverged"
            )
        given = numbers
    return given.astype(np.int64)


def _kind(wanted: AnySpace | None) -> str:
    if wanted is None or isinstance(wanted, spaces.Discrete):
        return "discrete"
    if isinstance(wanted, spaces.MultiDiscrete):
        return "multi_discrete"
    if isinstance(wanted, spaces.Box):
        return "box"
    return type(wanted).__name__


class ActingSettings(WalkSettings):
    """The common part of single and vector environments."""

    walkers: _calib.ActionWalkers

    def __init__(
        self,
        model: ActionModel,
        members: Sequence[int],
        observe: Sequence[Column] | None,
        timeout: int | None,
        units: Units,
        pessimism: Pessimism,
        worst_return: float | None,
        action_space: ActionKind | AnySpace | None,
        live: bool,
        kind: ModelKind,
    ) -> None:
        check_units(units)
        if pessimism not in ("nearest", "minimum_return"):
            raise ValueError(f"pessimism is {pessimism!r}, expected 'nearest' or 'minimum_return'")
        columns = observed_columns(model.columns, observe)
        self.columns = columns
        self.actions = _Actions(model, action_space, live, kind)
        most = model.timeout if timeout is None else whole(timeout, "timeout", 1)
        worst = model.worst_return if worst_return is None else finite(worst_return, "worst_return")
        self.observation_space = observation_space(model, columns, units)
        self.timeout = most
        super().__init__(model, (list(members), columns, units == "physical", most, pessimism == "minimum_return", worst, live, kind))
        if kind == "network" and (told := model._native.unstored_networks) is not None:
            warnings.warn(told, CalibWarning, stacklevel=4)


class ActingEnv(gymnasium.Env[NDArray[np.float32], Any]):
    """One environment of an ensemble member of a model with actions. See `calib_rl.gym.make`."""

    metadata: dict[str, Any] = {"render_modes": []}

    def __init__(
        self,
        model: ActionModel,
        member: int = 0,
        *,
        observe: Sequence[Column] | None = None,
        timeout: int | None = None,
        units: Units = "normalised",
        pessimism: Pessimism = "nearest",
        worst_return: float | None = None,
        action_space: ActionKind | AnySpace | None = None,
        live: bool = False,
        kind: ModelKind = "neighbors",
    ) -> None:
        member = position(member, "member")
        self._settings = ActingSettings(model, [member], observe, timeout, units, pessimism, worst_return, action_space, live, kind)
        self.model, self.member, self.timeout, self.units = model, member, self._settings.timeout, units
        self.observation_space, self.action_space = self._settings.observation_space, self._settings.actions.space
        self._has_begun, self._over = False, True

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin an episode at the start of a recorded one."""
        super().reset(seed=seed)
        walkers = self._settings.walkers
        if seed is not None:
            walkers.seed([whole(seed, "seed", most=LARGEST_SEED)])
        seen, _, _, _, rows, times, distances, covered, displaced = walkers.reset()
        self._has_begun, self._over = True, False
        return seen[0], _info(int(rows[0]), int(times[0]), float(distances[0]), bool(covered[0]), displaced[0])

    def step(self, action: Any) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Take an action."""
        if self._over:
            raise gymnasium.error.ResetNeeded(
                "the episode is over: call reset() before step(), and see that a vector environment does not use one env twice"
                if self._has_begun
                else "no episode has begun: call reset() first"
            )
        actions, walkers = self._settings.actions, self._settings.walkers
        if actions.live:
            all_seen, rewards, ends, cuts, rows, times, distances, covered, displaced = walkers.step(actions.of(np.asarray(action)[None]))
            seen, reward, terminated, truncated = all_seen[0], float(rewards[0]), bool(ends[0]), bool(cuts[0])
            info = [int(rows[0]), int(times[0]), float(distances[0]), bool(covered[0]), displaced[0]]
        else:
            level = action if type(action) is int and actions.kind == "discrete" else np.asarray(actions.of(np.asarray(action)[None])).item()
            seen, reward, terminated, truncated, *info = walkers.step_one(level)
        self._over = terminated or truncated
        return seen, reward, terminated, truncated, _info(*info)

    def lived(self) -> str:
        """Coverage and displacement of all steps so far, as JSON."""
        return self._settings.walkers.lived()

    def in_units(self, seen: NDArray[np.float32]) -> dict[str, NDArray[np.float64]]:
        """Observations ``[n, columns]`` by the name of their column, in the units of the log."""
        columns = [self.model._native.columns[place] for place in self._settings.columns]
        physical = np.asarray(seen, np.float64) if self.units == "physical" else physical_values(columns, seen)
        return {name: values for (name, _, _), values in zip(columns, physical.T)}

    def set_by(self, actions: Sequence[Any]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """The number of each action, or of the nearest one with ``live``, and the values that it sets, ``[n, action columns]``."""
        # `step` takes an action of `Discrete` as a number and as an array of one.
        shape = self.action_space.shape or ()
        return self._settings.actions.set_by(np.stack([np.asarray(action).reshape(shape) for action in actions]))


def _info(row: Any, time: Any, distance: Any, covered: Any, displacement: Any) -> dict[str, Any]:
    return {"row": row, "time": time, "distance": distance, "covered": covered, "displacement": displacement}


class ActingVectorEnv(VectorEnv[NDArray[np.float32], Any, NDArray[Any]]):
    """Many environments at once, with one call of compiled code per step. See `calib_rl.gym.make_vec`."""

    metadata: dict[str, Any] = {"render_modes": [], **AUTORESET}

    def __init__(
        self,
        model: ActionModel,
        num_envs: int,
        members: int | Sequence[int] = 0,
        *,
        observe: Sequence[Column] | None = None,
        timeout: int | None = None,
        units: Units = "normalised",
        pessimism: Pessimism = "nearest",
        worst_return: float | None = None,
        action_space: ActionKind | AnySpace | None = None,
        live: bool = False,
        kind: ModelKind = "neighbors",
    ) -> None:
        dealt = dealt_members(num_envs, members, len(model.columns))
        num_envs = len(dealt)
        self._settings = ActingSettings(model, dealt, observe, timeout, units, pessimism, worst_return, action_space, live, kind)
        self.model, self.members, self.num_envs = model, dealt, num_envs
        self.single_observation_space = self._settings.observation_space
        self.single_action_space = self._settings.actions.space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._all = np.ones(num_envs, np.bool_)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Reset all environments, or those that ``options["reset_mask"]`` marks.

        Environment ``i`` of seed ``s`` equals a single environment with seed ``s + i``.
        """
        super().reset(seed=one_seed(seed))
        walkers = self._settings.walkers
        seed_walkers(walkers, seed, self.num_envs)
        seen, _, _, _, *info = walkers.reset((options or {}).get("reset_mask"))
        return seen, self._info(*info)

    def step(
        self, actions: Any
    ) -> tuple[NDArray[np.float32], NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Take a step in every environment. One whose episode is over is reset instead, as in ``AutoresetMode.NEXT_STEP``."""
        settings = self._settings
        seen, rewards, terminated, truncated, *info = settings.walkers.step(settings.actions.of(actions))
        return seen, rewards, terminated, truncated, self._info(*info)

    def _info(self, row: Any, time: Any, distance: Any, covered: Any, displacement: Any) -> dict[str, Any]:
        info = _info(row, time, distance, covered, displacement)
        return info | {f"_{name}": self._all for name in info}
