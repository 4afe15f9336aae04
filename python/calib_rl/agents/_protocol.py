"""What an agent is, and what it is asked."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

Values = Mapping[str, Any]


@runtime_checkable
class Agent(Protocol):
    """What can be swept. A method ``begin()``, if there is one, is called where an unbroken piece of a stream begins."""

    def predict(self, observation: NDArray[np.float32]) -> float:
        """The return that is expected from a state, ``float32 [d]``, in normalised units."""

    def update(self, observation: NDArray[np.float32], reward: float, next_observation: NDArray[np.float32]) -> Any:
        """Learn from a transition: ``reward`` is the predicted sensor in ``next_observation``, normalised."""

    def state_dict(self) -> Mapping[str, Any]:
        """What was learnt, by name; kept beside the runs if `Sweep` is asked to."""


class Task(NamedTuple):
    """What an agent is to predict."""

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
