"""The protocol of an agent that predicts, and its task."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

Values = Mapping[str, Any]


@runtime_checkable
class Agent(Protocol):
    """An agent that can be swept: any object with these three methods.

    A method ``begin()``, if there is one, is called where an unbroken piece of a stream begins.

    Examples:
        >>> class Constant:
        ...     def __init__(self, task, value=0.0):
        ...         self.value = value
        ...     def predict(self, observation):
        ...         return self.value
        ...     def update(self, observation, reward, next_observation):
        ...         pass
        ...     def state_dict(self):
        ...         return {"value": self.value}
        >>> isinstance(Constant(None), Agent)
        True
    """

    def predict(self, observation: NDArray[np.float32]) -> float:
        """Predict the return from a state.

        Args:
            observation: The state, ``float32 [d]``, normalised.

        Returns:
            The discounted sum of the sensor's future, in normalised units.
        """

    def update(self, observation: NDArray[np.float32], reward: float, next_observation: NDArray[np.float32]) -> Any:
        """Learn from a transition.

        Args:
            observation: The state before, ``float32 [d]``.
            reward: The predicted sensor in ``next_observation``, normalised.
            next_observation: The state after, ``float32 [d]``.
        """

    def state_dict(self) -> Mapping[str, Any]:
        """Return what was learned.

        Returns:
            Arrays or numbers by name. They are kept beside the runs if `Sweep.run` is asked to.
        """


class Task(NamedTuple):
    """The task of an agent: what it predicts. Factories get it as an argument.

    Examples:
        >>> task = Task(sensor="PIT300", column=3, columns=8, gamma=0.9, seed=42)
        >>> task.columns
        8
    """

    sensor: str
    """The sensor."""
    column: int
    """Its column in the states."""
    columns: int
    """Columns ``d`` of the states."""
    gamma: float
    """The discount factor."""
    seed: int
    """For the agents of a run, whatever their values."""


Factory = Callable[..., Agent]


def made(factory: Factory, task: Task, values: Values) -> Agent:
    """An agent of the factory, if it is one."""
    agent = factory(task, **values)
    if not isinstance(agent, Agent):
        raise TypeError(f"{type(agent).__name__} is no agent: it needs the methods predict, update and state_dict")
    return agent


def is_number(prediction: float) -> bool:
    """Whether single precision has it."""
    return abs(prediction) <= float(np.finfo(np.float32).max)
