"""A calibration model as an environment of Gymnasium (1.0 or later).

What an agent sees is recorded rows in an order that never was: every step goes to where one of the nearest recorded transitions went.
**No action changes what follows.** A calibration model stands for a plant as it was operated; agents that predict are tuned in it, and
agents that act can be run in it, but not judged by what their actions would have done.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from ._model import Model, Units

try:
    from gymnasium.vector import AutoresetMode
except ImportError:  # 1.0 does so too, and has no name for it
    _AUTORESET: dict[str, Any] = {}
else:
    _AUTORESET = {"autoreset_mode": AutoresetMode.NEXT_STEP}

Column = str | int


def _position(model: Model, column: Column) -> int:
    if isinstance(column, str):
        names = model.columns
        if column not in names:
            raise ValueError(f"no column is called {column!r}; the model has {', '.join(names)}")
        return names.index(column)
    width = model.states.shape[1]
    if not 0 <= column < width:
        raise ValueError(f"column {column}: the model has {width}, from 0 on")
    return int(column)


def _space(model: Model, columns: list[int], units: Units) -> Any:
    low, high = model._native.extremes()
    if units == "physical":
        low, high = model.physical(low).astype(np.float32), model.physical(high).astype(np.float32)
    return spaces.Box(low[columns], high[columns], dtype=np.float32)


class _Settings:
    """What single and vector environments share."""

    def __init__(
        self,
        model: Model,
        members: Sequence[int],
        observe: Sequence[Column] | None,
        reward: Column,
        max_steps: int | None,
        units: Units,
        action_space: gymnasium.Space[Any] | None,
    ) -> None:
        if units not in ("normalised", "physical"):
            raise ValueError(f"units are {units!r}, expected 'normalised' or 'physical'")
        if max_steps is not None and max_steps < 1:
            raise ValueError(f"max_steps is {max_steps}, expected 1 or more, or None for episodes without an end")
        every = range(model.states.shape[1])
        columns = list(every) if observe is None else [_position(model, column) for column in observe]
        if not columns:
            raise ValueError("observe names no column")
        self.observation_space: gymnasium.Space[NDArray[np.float32]] = _space(model, columns, units)
        self.action_space: gymnasium.Space[Any] = spaces.Discrete(1) if action_space is None else action_space
        self.walkers = model._native.walkers(
            [int(member) for member in members], columns, _position(model, reward), max_steps or 0, units == "physical"
        )


class CalibrationEnv(gymnasium.Env[NDArray[np.float32], Any]):
    """One walk through a member of a model; see `make`."""

    metadata: dict[str, Any] = {"render_modes": []}

    def __init__(
        self,
        model: Model,
        member: int = 0,
        *,
        observe: Sequence[Column] | None = None,
        reward: Column = 0,
        max_steps: int | None = 1000,
        units: Units = "normalised",
        action_space: gymnasium.Space[Any] | None = None,
    ) -> None:
        settings = _Settings(model, [member], observe, reward, max_steps, units, action_space)
        self.model, self.member = model, member
        self.observation_space, self.action_space = settings.observation_space, settings.action_space
        self._walkers = settings.walkers

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin at a random recorded state of the member."""
        super().reset(seed=seed)
        if seed is not None:
            self._walkers.seed([seed])
        seen, _, _, rows, times, distances = self._walkers.reset()
        return seen[0], {"row": int(rows[0]), "time": int(times[0]), "distance": float(distances[0])}

    def step(self, action: Any) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Go one step on; the action changes nothing."""
        seen, reward, over, row, time, distance = self._walkers.step_one()
        return seen, reward, False, over, {"row": row, "time": time, "distance": distance}


class CalibrationVectorEnv(VectorEnv[NDArray[np.float32], Any, NDArray[Any]]):
    """Many walks at once, a call of compiled code a step; see `make_vec`."""

    metadata: dict[str, Any] = {"render_modes": [], **_AUTORESET}

    def __init__(
        self,
        model: Model,
        num_envs: int,
        members: int | Sequence[int] = 0,
        *,
        observe: Sequence[Column] | None = None,
        reward: Column = 0,
        max_steps: int | None = 1000,
        units: Units = "normalised",
        action_space: gymnasium.Space[Any] | None = None,
    ) -> None:
        if num_envs < 1:
            raise ValueError(f"num_envs is {num_envs}, expected 1 or more")
        given = [members] if isinstance(members, (int, np.integer)) else list(members)
        dealt = [int(given[number % len(given)]) for number in range(num_envs)]
        settings = _Settings(model, dealt, observe, reward, max_steps, units, action_space)
        self.model, self.members, self.num_envs = model, dealt, num_envs
        self.single_observation_space, self.single_action_space = settings.observation_space, settings.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._walkers = settings.walkers
        self._never = np.zeros(num_envs, np.bool_)
        self._all = np.ones(num_envs, np.bool_)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin anew: all, or those that ``options["reset_mask"]`` marks. Walk ``i`` of seed ``s`` is that of a single environment with ``s + i``."""
        one = seed if seed is None or isinstance(seed, (int, np.integer)) else None
        super().reset(seed=None if one is None else int(one))
        if one is not None:
            self._walkers.seed([int(one) + number for number in range(self.num_envs)])
        elif seed is not None and not isinstance(seed, (int, np.integer)):
            self._walkers.seed([None if of is None else int(of) for of in seed])
        mask = (options or {}).get("reset_mask")
        seen, _, _, rows, times, distances = self._walkers.reset(mask)
        return seen, self._info(rows, times, distances)

    def step(
        self, actions: Any
    ) -> tuple[NDArray[np.float32], NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Go one step on with every walk; one that was over begins anew instead, as ``AutoresetMode.NEXT_STEP`` has it."""
        seen, rewards, over, rows, times, distances = self._walkers.step()
        return seen, rewards, self._never.copy(), over, self._info(rows, times, distances)

    def _info(
        self, rows: NDArray[np.int64], times: NDArray[np.int64], distances: NDArray[np.float32]
    ) -> dict[str, Any]:
        every = self._all
        return {"row": rows, "_row": every, "time": times, "_time": every, "distance": distances, "_distance": every}


def make(
    model: Model,
    *,
    member: int = 0,
    observe: Sequence[Column] | None = None,
    reward: Column = 0,
    max_steps: int | None = 1000,
    units: Units = "normalised",
    action_space: gymnasium.Space[Any] | None = None,
) -> CalibrationEnv:
    """A member of a model as an environment.

    Args:
        model: The model.
        member: Position of the member.
        observe: Columns that are observed, by name or position; all without it.
        reward: The column whose value after a step is its reward.
        max_steps: Steps after which an episode is truncated; ``None`` for never.
        units: What observations and rewards are in.
        action_space: What actions are drawn from; one action without it. No action changes anything.

    Returns:
        The environment. Observations are ``float32 [columns]``, bounded by what was recorded; ``info`` has the ``row`` of the model's data
        that is seen, its ``time`` in microseconds since 1970 (its number where there are no times), and the ``distance`` from the state
        before to the recorded one whose transition was taken.

    Raises:
        ValueError: There is no such column.
        IndexError: There is no such member.

    Examples:
        >>> import numpy as np
        >>> import calib_rl
        >>> import calib_rl.gym
        >>> model = calib_rl.build_model(np.random.default_rng(0).random((500, 3)))
        >>> env = calib_rl.gym.make(model, member=1, reward=2, max_steps=10)
        >>> seen, info = env.reset(seed=1)
        >>> seen.shape, sorted(info)
        ((3,), ['distance', 'row', 'time'])
        >>> seen, reward, terminated, truncated, info = env.step(0)
        >>> reward == float(seen[2]), terminated, truncated
        (True, False, False)
    """
    return CalibrationEnv(
        model,
        member,
        observe=observe,
        reward=reward,
        max_steps=max_steps,
        units=units,
        action_space=action_space,
    )


def make_vec(
    model: Model,
    num_envs: int,
    *,
    members: int | Sequence[int] = 0,
    observe: Sequence[Column] | None = None,
    reward: Column = 0,
    max_steps: int | None = 1000,
    units: Units = "normalised",
    action_space: gymnasium.Space[Any] | None = None,
) -> CalibrationVectorEnv:
    """Many walks through members of a model as a vector environment, without Python between them.

    Args:
        model: The model.
        num_envs: Walks.
        members: The member of all walks, or a list that is dealt to them in turn.
        observe: As in `make`; so are the others.
        reward: See `make`.
        max_steps: See `make`.
        units: See `make`.
        action_space: See `make`.

    Returns:
        The vector environment: observations ``float32 [num_envs, columns]``, rewards ``float64 [num_envs]``. Episodes begin anew in the
        step after the one that ended them.

    Examples:
        >>> import numpy as np
        >>> import calib_rl
        >>> import calib_rl.gym
        >>> model = calib_rl.build_model(np.random.default_rng(0).random((500, 3)))
        >>> env = calib_rl.gym.make_vec(model, 256, members=range(5))
        >>> seen, info = env.reset(seed=1)
        >>> seen.shape, env.step(env.action_space.sample())[1].shape
        ((256, 3), (256,))
    """
    return CalibrationVectorEnv(
        model,
        num_envs,
        members,
        observe=observe,
        reward=reward,
        max_steps=max_steps,
        units=units,
        action_space=action_space,
    )
