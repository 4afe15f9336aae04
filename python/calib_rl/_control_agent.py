"""calib's own agents that act, as objects."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _calib, _onnx
from ._acting import ActionModel, acting_model
from ._checks import LARGEST_SEED, opened, position, whole

if TYPE_CHECKING:
    from ._study import Study


class Training(NamedTuple):
    """Result of `ControlAgent.train`.

    Examples:
        >>> agent = ControlAgent(_example_model(), step_size=0.1, gamma=0.9)
        >>> training = agent.train(_example_model(), 500, timeout=50)
        >>> training.episodes
        10
    """

    mean_return: float
    """Mean return an episode in the model, learning included."""
    episodes: int
    """Episodes that ended or were cut."""


class ControlAgent:
    """An agent of calib that acts and learns, as ``calib control`` compares them.

    It observes the columns of `ActionModel.columns`, in the units of the sensors, and answers with the position of an action in `ActionModel.actions`. Call
    `begin` at the start of an episode, and `step` with the result of each action. If the study has ``control.every`` = N, call `step` once every N rows,
    with the sum of their rewards, and hold the action in between.

    Examples:
        >>> model = _example_model()
        >>> agent = ControlAgent(model, algorithm="expected_sarsa", step_size=0.1, temperature=0.1, gamma=0.9)
        >>> training = agent.train(model, 2000, timeout=50)
        >>> action = agent.begin([0.5])
        >>> agent.actions[action].name in {"valve=0", "valve=0.5", "valve=1"}
        True
        >>> action = agent.step(-0.1, [0.55])
    """

    def __init__(self, model: ActionModel, *, seed: int = 0, **settings: Any) -> None:
        """Make an untrained agent.

        Args:
            model: Model whose columns and actions the agent will use. The model itself is not kept.
            seed: Seed of the agent's random numbers.
            settings: As in ``[control.agent]`` of a study, such as ``step_size=0.1``.

        Raises:
            ValueError: A setting does not exist, or its value is not valid.
            TypeError: ``model`` is not an `ActionModel`.
        """
        self._native = _calib.ControlAgent(acting_model(model)._native, json.dumps(settings, default=_plain), whole(seed, "seed", 0, LARGEST_SEED))

    @staticmethod
    def of(study: Study | str | os.PathLike[str], *, seed: int = 0) -> ControlAgent:
        """Make an agent with the setting that ``calib control`` chose. It is untrained: `train` it, or let it learn at the plant.

        Look at the verdict first: calib names a setting even if it advises against deployment. Values that ``calib control`` got with ``--set`` are
        part of the study: open it with the same values, ``Study(path, set={"control.steps": 3000})``.

        Args:
            study: The study, or its file.
            seed: Seed of the agent's random numbers.

        Returns:
            The agent.

        Raises:
            CalibError: ``calib control`` was not run, or the agents are of a program.

        Examples:
            >>> import calib_rl
            >>> study = calib_rl.Study(_example_model().path.parents[1] / "study.toml")
            >>> try:
            ...     ControlAgent.of(study)
            ... except calib_rl.CalibError as error:
            ...     print("calib control" in str(error))
            True
        """
        study = opened(study)
        settings = json.loads(_calib.ControlAgent.chosen(study._job))
        return ControlAgent(ActionModel.of(study), seed=seed, **settings)

    @staticmethod
    def load(path: str | os.PathLike[str]) -> ControlAgent:
        """Open a saved agent. It continues with what it had learned, at the beginning of an episode.

        Args:
            path: The file.

        Returns:
            The agent.

        Raises:
            CalibError: The file is not an agent of calib.

        Examples:
            >>> import os, tempfile
            >>> path = os.path.join(tempfile.mkdtemp(), "agent.safetensors")
            >>> ControlAgent(_example_model(), step_size=0.1).save(path)
            >>> ControlAgent.load(path).settings["step_size"]
            0.1
        """
        own = ControlAgent.__new__(ControlAgent)
        own._native = _calib.ControlAgent.load(os.fspath(path))
        return own

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the agent as safetensors: weights, the state of Adam, settings, columns with their scales, and actions.

        The replay buffer of a network is not written: a loaded agent collects its own.

        Args:
            path: The file.

        Raises:
            CalibError: The agent has diverged, or the file cannot be written.

        Examples:
            >>> import os, tempfile
            >>> path = os.path.join(tempfile.mkdtemp(), "agent.safetensors")
            >>> ControlAgent(_example_model()).save(path)
            >>> os.path.isfile(path)
            True
        """
        self._native.save(os.fspath(path))

    def to_onnx(self, path: str | os.PathLike[str]) -> None:
        """Write the agent's current values as ONNX, for a plant without Python. The file does not learn.

        Its input ``state`` is ``float32 [batch, columns]``: readings of the sensors in their units, in the order of `columns`. Its output ``values`` is
        ``float32 [batch, actions]``, as from `values`. The action to take is the one with the largest value. The metadata of the file has four
        texts. ``columns`` (name, offset, scale), ``actions`` (name, values) and ``settings`` are JSON. ``fingerprint`` is the
        fingerprint of the file that `save` writes.

        Do not give it missing numbers: with tiles the runtime refuses NaN, and a network answers NaN.

        Args:
            path: The file. An existing file is replaced.

        Raises:
            ImportError: The package onnx is missing: ``pip install onnx``.
            CalibError: The agent has diverged, or the file cannot be written.

        Examples:
            >>> import os, tempfile
            >>> path = os.path.join(tempfile.mkdtemp(), "agent.onnx")
            >>> ControlAgent(_example_model()).to_onnx(path)
            >>> os.path.isfile(path)
            True
        """
        with tempfile.TemporaryDirectory() as folder:
            saved = Path(folder) / "agent.safetensors"
            self.save(saved)
            _onnx.written(saved, Path(path))

    @property
    def settings(self) -> dict[str, Any]:
        """All hyperparameters by name."""
        return dict(json.loads(self._native.settings))

    @property
    def columns(self) -> list[str]:
        """Names of the observed columns, in the order of an observation."""
        return self._native.columns

    @property
    def actions(self) -> list[AgentAction]:
        """The actions, in the order of their positions."""
        return [AgentAction(name, tuple(values)) for name, values in self._native.actions]

    def begin(self, observation: ArrayLike | Mapping[str, float]) -> int:
        """Begin an episode.

        Args:
            observation: Readings of the sensors, ``[d]`` in the order of `columns`, or by the names of the columns.

        Returns:
            The action to take: its position in `actions`.

        Raises:
            ValueError: A column is missing or not a finite number.
            CalibError: The agent has diverged.

        Examples:
            >>> ControlAgent(_example_model()).begin({"level": 0.5}) in range(3)
            True
        """
        return self._native.begin(self._seen(observation))

    def step(
        self, reward: float, observation: ArrayLike | Mapping[str, float], *, terminal: bool = False, learn: bool = True
    ) -> int | None:
        """Learn from the result of the last action, and choose the next one.

        Args:
            reward: The reward of the last action.
            observation: Current readings of the sensors, as in `begin`.
            terminal: Whether the episode ends here, so that nothing follows. If it is only cut, call `step` as usual, ignore the action that it
                returns, and `begin` the next episode.
            learn: ``False`` to act without learning.

        Returns:
            The next action, or ``None`` after a terminal.

        Raises:
            ValueError: No episode is running, or a number is not finite.
            CalibError: The agent has diverged.

        Examples:
            >>> agent = ControlAgent(_example_model())
            >>> action = agent.begin([0.5])
            >>> agent.step(-0.1, [0.6], terminal=True) is None
            True
        """
        return self._native.step(float(reward), self._seen(observation), bool(terminal), bool(learn))

    def values(self, observation: ArrayLike | Mapping[str, float]) -> NDArray[np.float64]:
        """Return the agent's value of each action.

        Args:
            observation: Readings of the sensors, as in `begin`.

        Returns:
            The value of each action, ``float64 [actions]``.

        Raises:
            ValueError: A column is missing or not a finite number.

        Examples:
            >>> ControlAgent(_example_model(), initial_weight=2.0).values([0.5])
            array([2., 2., 2.])
        """
        return np.array(self._native.values(self._seen(observation)))

    def train(
        self, model: ActionModel, steps: int, *, member: int = 0, timeout: int | None = None, seed: int = 0
    ) -> Training:
        """Train the agent in a model, so that it is not untrained when it starts at the plant.

        Args:
            model: The model, with the agent's columns and actions. The ranges of its columns may differ.
            steps: Number of steps.
            member: Position of the ensemble member.
            timeout: Steps after which an episode is cut. Default: as in the study.
            seed: Seed of the model's random numbers.

        Returns:
            The result, including the learning phase.

        Raises:
            ValueError: The model has other columns or actions.
            TypeError: ``model`` is not an `ActionModel`.
            IndexError: The member does not exist.
            CalibError: The agent has diverged.

        Examples:
            >>> model = _example_model()
            >>> ControlAgent(model).train(model, 100, timeout=50).episodes
            2
        """
        model = acting_model(model)
        cut = model.timeout if timeout is None else whole(timeout, "timeout", 1)
        mean_return, episodes = self._native.train(
            model._native, position(member, "member"), whole(steps, "steps", 1), cut, whole(seed, "seed", 0, LARGEST_SEED)
        )
        return Training(mean_return, episodes)

    def _seen(self, observation: ArrayLike | Mapping[str, float]) -> ArrayLike:
        # A row of a frame has names too, and its order has no meaning.
        if not isinstance(observation, Mapping) and not hasattr(observation, "keys"):
            return observation
        named: Any = observation
        missing = [name for name in self.columns if name not in named]
        if missing:
            raise ValueError(f"the observation has no {missing[0]!r}, expected every one of `columns`")
        return [float(named[name]) for name in self.columns]

    def __repr__(self) -> str:
        settings = self.settings
        return f"<calib_rl.ControlAgent: {settings['algorithm']}, {len(self.columns)} columns, {len(self.actions)} actions>"


class AgentAction(NamedTuple):
    """An action of a `ControlAgent`.

    Examples:
        >>> ControlAgent(_example_model()).actions[0]
        AgentAction(name='valve=0', values=(0.0,))
    """

    name: str
    """What it is called."""
    values: tuple[float, ...]
    """What it sets, one a column of the actions."""


def _plain(value: Any) -> Any:
    """Converts a number of NumPy to one of Python."""
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"a setting is {value!r}, expected a number or a text")


def _example_model() -> ActionModel:
    """Returns a model with actions, for examples."""
    from ._acting import _example_model as example

    return example()
