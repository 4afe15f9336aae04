"""A calibration model as an environment of Gymnasium (1.0 or later).

What an agent sees is recorded rows in an order that never was: every step goes to where one of the nearest recorded transitions went.
**No action changes what follows.** A calibration model stands for a plant as it was operated; agents that predict are tuned in it. There
is one action, and an agent that acts has nothing to learn here: ``calib control`` is for those.

Environments can be pickled, as ``SubprocVecEnv`` of Stable-Baselines3 needs it, and go on there where they were.
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

from . import _calib
from ._checks import LARGEST_SEED, position, whole
from ._model import Model, Units

try:
    from gymnasium.vector import AutoresetMode
except ImportError:  # 1.0 does so too, and has no name for it
    _AUTORESET: dict[str, Any] = {}
else:
    _AUTORESET = {"autoreset_mode": AutoresetMode.NEXT_STEP}

Column = str | int

# What a walk takes here and in compiled code, beside what it sees.
WALKER_BYTES = 512


def _position(model: Model, column: Column) -> int:
    if isinstance(column, str):
        names = model.columns
        if column not in names:
            raise ValueError(f"no column is called {column!r}; the model has {', '.join(names)}")
        return names.index(column)
    width = model.states.shape[1]
    number = whole(column, "a column", -LARGEST_SEED)
    if not 0 <= number < width:
        raise ValueError(f"column {number}: the model has {width}, from 0 on")
    return number


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
        if action_space is not None:
            raise ValueError(
                "action_space: this model has no actions, and nothing that an agent does changes what follows; leave it out, "
                "and use `calib control` for agents that act"
            )
        most = 0 if max_steps is None else whole(max_steps, "max_steps", 1)
        every = range(model.states.shape[1])
        columns = list(every) if observe is None else [_position(model, column) for column in observe]
        if not columns:
            raise ValueError("observe names no column")
        self.observation_space: gymnasium.Space[NDArray[np.float32]] = _space(model, columns, units)
        self.action_space: gymnasium.Space[Any] = spaces.Discrete(1)
        self._walked = list(members), columns, _position(model, reward), most, units == "physical"
        self._model = model
        self.walkers = model._native.walkers(*self._walked)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "walkers": self.walkers.state()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        at = state.pop("walkers")
        self.__dict__.update(state)
        self.walkers = self._model._native.walkers(*self._walked)
        self.walkers.restore(at)


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
        member = position(member, "member")
        settings = _Settings(model, [member], observe, reward, max_steps, units, action_space)
        self.model, self.member = model, member
        self.observation_space, self.action_space = settings.observation_space, settings.action_space
        self._settings = settings

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin at a random recorded state of the member."""
        super().reset(seed=seed)
        walkers = self._settings.walkers
        if seed is not None:
            walkers.seed([whole(seed, "seed", most=LARGEST_SEED)])
        seen, _, _, rows, times, distances = walkers.reset()
        return seen[0], {"row": int(rows[0]), "time": int(times[0]), "distance": float(distances[0])}

    def step(self, action: Any) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Go one step on; the action changes nothing."""
        seen, reward, over, row, time, distance = self._settings.walkers.step_one()
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
        num_envs = whole(num_envs, "num_envs", 1)
        given = [members] if isinstance(members, (int, np.integer)) else list(members)
        if not given:
            raise ValueError("members names no member")
        given = [position(member, "members") for member in given]
        width = model.states.shape[1] if observe is None else len(observe)
        _calib.require_memory(num_envs * (WALKER_BYTES + 16 * width), f"{num_envs} walks", "lower num_envs")
        dealt = [given[number % len(given)] for number in range(num_envs)]
        settings = _Settings(model, dealt, observe, reward, max_steps, units, action_space)
        self.model, self.members, self.num_envs = model, dealt, num_envs
        self.single_observation_space, self.single_action_space = settings.observation_space, settings.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._settings = settings
        self._never = np.zeros(num_envs, np.bool_)
        self._all = np.ones(num_envs, np.bool_)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin anew: all, or those that ``options["reset_mask"]`` marks. Walk ``i`` of seed ``s`` is that of a single environment with ``s + i``."""
        one = seed if seed is None or isinstance(seed, (int, np.integer)) else None
        super().reset(seed=None if one is None else int(one))
        walkers = self._settings.walkers
        if one is not None:
            first = whole(one, "seed", most=LARGEST_SEED)
            walkers.seed([(first + number) % (LARGEST_SEED + 1) for number in range(self.num_envs)])
        elif seed is not None and not isinstance(seed, (int, np.integer)):
            walkers.seed([None if of is None else whole(of, "seed", most=LARGEST_SEED) for of in seed])
        mask = (options or {}).get("reset_mask")
        seen, _, _, rows, times, distances = walkers.reset(mask)
        return seen, self._info(rows, times, distances)

    def step(
        self, actions: Any
    ) -> tuple[NDArray[np.float32], NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Go one step on with every walk; one that was over begins anew instead, as ``AutoresetMode.NEXT_STEP`` has it."""
        seen, rewards, over, rows, times, distances = self._settings.walkers.step()
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
        action_space: Must be ``None``: the model has no actions, and any other one is refused.

    Returns:
        The environment. Observations are ``float32 [columns]``, bounded by what was recorded; ``info`` has the ``row`` of the model's data
        that is seen, its ``time`` in microseconds since 1970 (its number where there are no times), and the ``distance`` from the state
        before to the recorded one whose transition was taken.

    Raises:
        ValueError: There is no such column, or an ``action_space`` is given.
        IndexError: There is no such member.
        TypeError: A number that is to be whole is not.

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

    Raises:
        ValueError: As `make`; or there are no members, or no walks.
        IndexError: There is no such member.
        MemoryError: There is no memory for so many walks.

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
