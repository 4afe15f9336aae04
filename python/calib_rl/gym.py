"""Calibration models as environments of Gymnasium (1.0 or later).

An agent observes recorded rows in a new order. In a model **with actions** (`calib_rl.ActionModel`), a step with an action goes to the next state of one of the
nearest recorded transitions with that action. Agents that act are tuned in it. In a model without actions (`calib_rl.Model`), no action changes the future: it represents a
plant as it was operated. Agents that predict are tuned in it, and an action space is refused.

``gymnasium.make("calib_rl.gym:calib/Model-v0", path=…)`` opens a model in a folder, of either kind, and takes the arguments of `make`. Once this module is
imported, ``"calib/Model-v0"`` is enough.

Environments can be pickled, as ``SubprocVecEnv`` of Stable-Baselines3 requires. A copy continues from the same state.
"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, overload

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from . import _calib
from ._acting import ActionModel
from ._acting_env import ActingEnv, ActingVectorEnv, ActionKind, Pessimism
from ._checks import LARGEST_SEED, position, whole
from ._kinds import ModelKind
from ._model import Model, Units, check_units
from ._walks import (
    AUTORESET,
    Column,
    WalkSettings,
    column_position,
    dealt_members,
    observation_space,
    observed_columns,
    one_seed,
    seed_walkers,
)

# The name of a model in Gymnasium.
_ID = "calib/Model-v0"

# Steps after which an episode in a model without actions is truncated.
_MAX_STEPS = 1000


class _Settings(WalkSettings):
    """The common part of single and vector environments."""

    walkers: _calib.Walkers

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
        check_units(units)
        if action_space is not None:
            raise ValueError(
                "action_space: this model has no actions, and nothing that an agent does changes what follows; leave it out, "
                "and use `calib control` for agents that act"
            )
        most = 0 if max_steps is None else whole(max_steps, "max_steps", 1)
        columns = observed_columns(model.columns, observe)
        self.observation_space = observation_space(model, columns, units)
        self.action_space: gymnasium.Space[Any] = spaces.Discrete(1)
        super().__init__(model, (list(members), columns, column_position(model.columns, reward), most, units == "physical"))


class CalibrationEnv(gymnasium.Env[NDArray[np.float32], Any]):
    """An environment of one ensemble member of a model without actions. `make` makes it, and describes its arguments.

    Examples:
        >>> import numpy as np
        >>> import calib_rl
        >>> model = calib_rl.build_model(np.random.default_rng(0).random((500, 3)))
        >>> env = CalibrationEnv(model, member=1, reward=2)
        >>> seen, info = env.reset(seed=1)
        >>> seen.shape
        (3,)
    """

    metadata: dict[str, Any] = {"render_modes": []}

    def __init__(
        self,
        model: Model,
        member: int = 0,
        *,
        observe: Sequence[Column] | None = None,
        reward: Column = 0,
        max_steps: int | None = _MAX_STEPS,
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
        """Begin an episode at a random recorded state of the member.

        Args:
            seed: Seed of the random numbers. Default: they continue from the previous seed.
            options: Not used.

        Returns:
            The first observation, and ``info``.

        Examples:
            >>> import numpy as np
            >>> import calib_rl
            >>> model = calib_rl.build_model(np.random.default_rng(0).random((500, 3)))
            >>> seen, info = CalibrationEnv(model).reset(seed=1)
            >>> sorted(info)
            ['distance', 'row', 'time']
        """
        super().reset(seed=seed)
        walkers = self._settings.walkers
        if seed is not None:
            walkers.seed([whole(seed, "seed", most=LARGEST_SEED)])
        seen, _, _, rows, times, distances = walkers.reset()
        return seen[0], {"row": int(rows[0]), "time": int(times[0]), "distance": float(distances[0])}

    def step(self, action: Any) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Take one step.

        Args:
            action: Any action. It changes nothing.

        Returns:
            Observation, reward, ``False``, whether the episode is over, and ``info``.

        Examples:
            >>> import numpy as np
            >>> import calib_rl
            >>> model = calib_rl.build_model(np.random.default_rng(0).random((500, 3)))
            >>> env = CalibrationEnv(model, reward=2, max_steps=1)
            >>> _ = env.reset(seed=1)
            >>> seen, reward, terminated, truncated, info = env.step(env.action_space.sample())
            >>> terminated, truncated
            (False, True)
        """
        seen, reward, over, row, time, distance = self._settings.walkers.step_one()
        return seen, reward, False, over, {"row": row, "time": time, "distance": distance}


class CalibrationVectorEnv(VectorEnv[NDArray[np.float32], Any, NDArray[Any]]):
    """Many environments of a model without actions at once. `make_vec` makes it, and describes its arguments.

    Examples:
        >>> import numpy as np
        >>> import calib_rl
        >>> model = calib_rl.build_model(np.random.default_rng(0).random((500, 3)))
        >>> env = CalibrationVectorEnv(model, 8, members=range(5))
        >>> env.reset(seed=1)[0].shape
        (8, 3)
    """

    metadata: dict[str, Any] = {"render_modes": [], **AUTORESET}

    def __init__(
        self,
        model: Model,
        num_envs: int,
        members: int | Sequence[int] = 0,
        *,
        observe: Sequence[Column] | None = None,
        reward: Column = 0,
        max_steps: int | None = _MAX_STEPS,
        units: Units = "normalised",
        action_space: gymnasium.Space[Any] | None = None,
    ) -> None:
        dealt = dealt_members(num_envs, members, len(observed_columns(model.columns, observe)))
        num_envs = len(dealt)
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
        """Reset all environments, or those that ``options["reset_mask"]`` marks.

        Args:
            seed: Environment ``i`` of seed ``s`` equals a single environment with seed ``s + i``. Or one seed for each environment.
            options: ``{"reset_mask": mask}``, with ``mask`` of type bool ``[num_envs]``.

        Returns:
            The observations, and ``info``.

        Examples:
            >>> import numpy as np
            >>> import calib_rl
            >>> model = calib_rl.build_model(np.random.default_rng(0).random((500, 3)))
            >>> CalibrationVectorEnv(model, 8, members=range(5)).reset(seed=1)[0].shape
            (8, 3)
        """
        super().reset(seed=one_seed(seed))
        walkers = self._settings.walkers
        seed_walkers(walkers, seed, self.num_envs)
        mask = (options or {}).get("reset_mask")
        seen, _, _, rows, times, distances = walkers.reset(mask)
        return seen, self._info(rows, times, distances)

    def step(
        self, actions: Any
    ) -> tuple[NDArray[np.float32], NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Take one step in every environment. One whose episode is over is reset instead, as in ``AutoresetMode.NEXT_STEP``.

        Args:
            actions: Any actions. They change nothing.

        Returns:
            Observations, rewards, terminated, truncated, and ``info``.

        Examples:
            >>> import numpy as np
            >>> import calib_rl
            >>> model = calib_rl.build_model(np.random.default_rng(0).random((500, 3)))
            >>> env = CalibrationVectorEnv(model, 8)
            >>> _ = env.reset(seed=1)
            >>> env.step(env.action_space.sample())[1].shape
            (8,)
        """
        seen, rewards, over, rows, times, distances = self._settings.walkers.step()
        return seen, rewards, self._never.copy(), over, self._info(rows, times, distances)

    def _info(
        self, rows: NDArray[np.int64], times: NDArray[np.int64], distances: NDArray[np.float32]
    ) -> dict[str, Any]:
        every = self._all
        return {"row": rows, "_row": every, "time": times, "_time": every, "distance": distances, "_distance": every}


# Arguments of `make` that apply only to models with actions, and their defaults.
_ACTING_DEFAULTS = {"timeout": None, "pessimism": "nearest", "worst_return": None, "live": False, "kind": "neighbors"}


def _settings_for(model: Any, reward: Column | None, max_steps: int | None, **settings: Any) -> dict[str, Any]:
    """Returns the arguments of `make` for this kind of model.

    Raises:
        ValueError: An argument is for models of the other kind.
        TypeError: This is not a model.
    """
    if isinstance(model, ActionModel):
        if reward is not None:
            raise ValueError("reward: rewards of a model with actions are those of its log; leave it out")
        if max_steps != _MAX_STEPS:
            raise ValueError("max_steps: episodes in a model with actions are cut after timeout steps; say timeout=")
        return settings
    _require_model(model)
    for name, default in _ACTING_DEFAULTS.items():
        if settings.pop(name) != default:
            raise ValueError(f"{name} is for models with actions; build one with calib_rl.build_model(..., actions=[...], reward=...)")
    return {"reward": 0 if reward is None else reward, "max_steps": max_steps, **settings}


@overload
def make(
    model: Model,
    *,
    member: int = 0,
    observe: Sequence[Column] | None = None,
    reward: Column | None = None,
    max_steps: int | None = _MAX_STEPS,
    units: Units = "normalised",
    action_space: Any = None,
) -> CalibrationEnv: ...
@overload
def make(
    model: ActionModel,
    *,
    member: int = 0,
    observe: Sequence[Column] | None = None,
    units: Units = "normalised",
    action_space: ActionKind | gymnasium.Space[Any] | None = None,
    timeout: int | None = None,
    pessimism: Pessimism = "nearest",
    worst_return: float | None = None,
    live: bool = False,
    kind: ModelKind = "neighbors",
) -> ActingEnv: ...
def make(
    model: Model | ActionModel,
    *,
    member: int = 0,
    observe: Sequence[Column] | None = None,
    reward: Column | None = None,
    max_steps: int | None = _MAX_STEPS,
    units: Units = "normalised",
    action_space: ActionKind | gymnasium.Space[Any] | None = None,
    timeout: int | None = None,
    pessimism: Pessimism = "nearest",
    worst_return: float | None = None,
    live: bool = False,
    kind: ModelKind = "neighbors",
) -> CalibrationEnv | ActingEnv:
    """Make an environment of an ensemble member of a model.

    Args:
        model: The model, with actions or without.
        member: Position of the member.
        observe: Observed columns, by name or position, or the name of one. Default: all.
        reward: Without actions: the column whose value after a step is its reward. Default: the first column.
        max_steps: Without actions: steps after which an episode is truncated. ``None`` for never.
        units: Units of observations, and of the rewards of a model without actions.
        action_space: With actions, ``"discrete"``: the actions of the model by number. ``"multi_discrete"``: a level of each column of the actions. ``"box"``: the
            values of the action columns, for which the nearest action is taken. Or a space of one of these kinds. Refused without actions.
        timeout: With actions: steps after which an episode is truncated. Default: as in the model.
        pessimism: With actions: if the log has no transition with the action within the model's radius, continue with the ``"nearest"`` one, or end the episode with
            the ``"minimum_return"``. An action that never occurs in the member ends the episode in either case.
        worst_return: The reward of such an end, a finite number. Default: as in the model.
        live: With ``"box"``: search with the exact values of the action, among all transitions of the member, instead of taking the nearest level. The time is proportional
            to the length of the log, and it needs a model with ``levels``.
        kind: With actions: the kind of model. ``"neighbors"`` goes to the recorded next state of a neighbour. ``"increments"`` adds the neighbour's recorded
            change to the state, in every column where that predicts better. So it leaves the recorded rows, but never the recorded range. Each step searches
            all transitions with the action. ``row`` in ``info`` is then the row that the neighbour led to, and ``displacement`` is 0.
            ``"network"`` goes to the prediction of a network trained on the log, as in ``calib control``. It is trained at its first use, in a second or two, and kept
            in the model's folder. ``row`` is then the row at the start of the episode, and every step counts as covered.

    Returns:
        The environment. Observations are ``float32 [columns]``, within the recorded range. ``info`` has the observed ``row`` of the model's data
        and the ``time`` of that row in microseconds since 1970, or its number if there are no times. Its ``distance`` is the distance
        from the previous state to the recorded state whose transition was taken. With actions it also has whether the step is ``covered``. The ``displacement``
        of each observed column is the sum of the jumps of the episode, from the agent's states to the sources of the transitions that were taken.

    Raises:
        ValueError: A column does not exist, an argument is for models of the other kind, or the model does not have this action space.
            ``worst_return`` is not a finite number.
        IndexError: The member does not exist.
        TypeError: ``model`` is not a model, or a number is not a whole number.

    Warns:
        CalibWarning: Networks were trained, and could not be stored.

    Examples:
        >>> import tempfile
        >>> import numpy as np
        >>> import calib_rl
        >>> import calib_rl.gym
        >>> from calib_rl._acting import _example_log
        >>> model = calib_rl.build_model(_example_log(), tempfile.mkdtemp(), actions=["valve"], reward="reward")
        >>> env = calib_rl.gym.make(model, member=1, timeout=10, units="physical")
        >>> env.action_space, env.observation_space.shape
        (Discrete(3), (1,))
        >>> seen, info = env.reset(seed=1)
        >>> seen, reward, terminated, truncated, info = env.step(2)
        >>> sorted(info)
        ['covered', 'displacement', 'distance', 'row', 'time']

        Without actions:

        >>> model = calib_rl.build_model(np.random.default_rng(0).random((500, 3)))
        >>> env = calib_rl.gym.make(model, member=1, reward=2, max_steps=10)
        >>> seen, info = env.reset(seed=1)
        >>> seen.shape, sorted(info)
        ((3,), ['distance', 'row', 'time'])
        >>> seen, reward, terminated, truncated, info = env.step(0)
        >>> reward == float(seen[2]), terminated, truncated
        (True, False, False)
    """
    acting: dict[str, Any] = {"timeout": timeout, "pessimism": pessimism, "worst_return": worst_return, "live": live, "kind": kind}
    settings = _settings_for(model, reward, max_steps, observe=observe, units=units, action_space=action_space, **acting)
    if isinstance(model, ActionModel):
        return ActingEnv(model, member, **settings)
    return CalibrationEnv(model, member, **settings)


@overload
def make_vec(
    model: Model,
    num_envs: int,
    *,
    members: int | Sequence[int] = 0,
    observe: Sequence[Column] | None = None,
    reward: Column | None = None,
    max_steps: int | None = _MAX_STEPS,
    units: Units = "normalised",
    action_space: Any = None,
) -> CalibrationVectorEnv: ...
@overload
def make_vec(
    model: ActionModel,
    num_envs: int,
    *,
    members: int | Sequence[int] = 0,
    observe: Sequence[Column] | None = None,
    units: Units = "normalised",
    action_space: ActionKind | gymnasium.Space[Any] | None = None,
    timeout: int | None = None,
    pessimism: Pessimism = "nearest",
    worst_return: float | None = None,
    live: bool = False,
    kind: ModelKind = "neighbors",
) -> ActingVectorEnv: ...
def make_vec(
    model: Model | ActionModel,
    num_envs: int,
    *,
    members: int | Sequence[int] = 0,
    observe: Sequence[Column] | None = None,
    reward: Column | None = None,
    max_steps: int | None = _MAX_STEPS,
    units: Units = "normalised",
    action_space: ActionKind | gymnasium.Space[Any] | None = None,
    timeout: int | None = None,
    pessimism: Pessimism = "nearest",
    worst_return: float | None = None,
    live: bool = False,
    kind: ModelKind = "neighbors",
) -> CalibrationVectorEnv | ActingVectorEnv:
    """Make a vector environment of ensemble members of a model, which steps all environments in compiled code.

    Args:
        model: The model, with actions or without.
        num_envs: Number of environments.
        members: The ensemble member of all environments, or a list that is assigned to them in turn.
        observe: See `make`.
        reward: See `make`.
        max_steps: See `make`.
        units: See `make`.
        action_space: See `make`.
        timeout: See `make`.
        pessimism: See `make`.
        worst_return: See `make`.
        live: See `make`.
        kind: See `make`.

    Returns:
        The vector environment: observations ``float32 [num_envs, columns]``, rewards ``float64 [num_envs]``. Episodes are reset in the
        step after their end.

    Raises:
        ValueError: As in `make`, or there are no members or no environments.
        IndexError: The member does not exist.
        MemoryError: There is not enough memory for the environments.

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
    acting: dict[str, Any] = {"timeout": timeout, "pessimism": pessimism, "worst_return": worst_return, "live": live, "kind": kind}
    settings = _settings_for(model, reward, max_steps, observe=observe, units=units, action_space=action_space, **acting)
    if isinstance(model, ActionModel):
        return ActingVectorEnv(model, num_envs, members, **settings)
    return CalibrationVectorEnv(model, num_envs, members, **settings)


def _require_model(model: Any) -> None:
    """Refuses an argument that is not a model, such as a path.

    Raises:
        TypeError: It is not a model.
    """
    if not isinstance(model, Model):
        shown = repr(model) if isinstance(model, (str, os.PathLike)) else type(model).__name__
        raise TypeError(f"model is {shown}, expected a calib_rl.Model or a calib_rl.ActionModel; of_path(folder) takes the folder of one")


def _opened(path: str | os.PathLike[str]) -> Model | ActionModel:
    manifest = Path(path) / "manifest.json"
    text = manifest.read_text(encoding="utf-8") if manifest.exists() else "{}"
    return ActionModel.open(path) if "record" in json.loads(text) else Model.open(path)


def of_path(path: str | os.PathLike[str], **arguments: Any) -> CalibrationEnv | ActingEnv:
    """Make the environment of a model in a folder. ``gymnasium.make("calib_rl.gym:calib/Model-v0", path=…)`` calls this function.

    Args:
        path: The folder of a model, with actions or without.
        arguments: The arguments of `make`.

    Returns:
        The environment.

    Examples:
        >>> from calib_rl._study import _example_study
        >>> env = of_path(_example_study().build_model(progress=False).path, reward="PIT300")
        >>> env.reset(seed=1)[0].dtype
        dtype('float32')
    """
    made: CalibrationEnv | ActingEnv = make(_opened(path), **arguments)
    return made


def vector_of_path(path: str | os.PathLike[str], num_envs: int, **arguments: Any) -> CalibrationVectorEnv | ActingVectorEnv:
    """Make the vector environment of a model in a folder. ``gymnasium.make_vec("calib_rl.gym:calib/Model-v0", path=…)`` calls this function.

    Args:
        path: The folder of a model, with actions or without.
        num_envs: Number of environments.
        arguments: The arguments of `make_vec`.

    Returns:
        The vector environment.

    Examples:
        >>> from calib_rl._study import _example_study
        >>> env = vector_of_path(_example_study().build_model(progress=False).path, 3)
        >>> env.num_envs
        3
    """
    made: CalibrationVectorEnv | ActingVectorEnv = make_vec(_opened(path), num_envs, **arguments)
    return made


if _ID not in gymnasium.registry:
    gymnasium.register(_ID, entry_point="calib_rl.gym:of_path", vector_entry_point="calib_rl.gym:vector_of_path")
