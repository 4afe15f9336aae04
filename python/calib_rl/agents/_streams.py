"""Streams of states that agents learn from, and one agent on one of them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .. import _calib
from .._progress import Observer, observer
from .._study import Study
from ._protocol import Agent, Factory, Task, Values, is_number, made


class Stream:
    """A run's stream of states. `Streams.all` has them.

    Examples:
        >>> from calib_rl._study import _example_study
        >>> study = _example_study()
        >>> _ = study.build_model(progress=False)
        >>> stream = Streams(study).all[0]
        >>> states, pieces = stream.states()
        >>> states.dtype, pieces[0][0]
        (dtype('float32'), 0)

    Attributes:
        environment: ``"member:0"`` …, ``"online"`` or ``"log-replay"``.
        run: Number of the run there.
        gamma: The discount factor of the returns that are predicted on it.
        sensors: The sensors that are predicted on it: those with this discount factor.
        seed: For the agents of the run.
        steps: Steps of the run. The stream has more states, so that the last returns are complete. Agents do not see them.
    """

    def __init__(self, native: _calib.Streams, position: int, told: tuple[str, int, int, int, str, int]) -> None:
        self._native = native
        self.position = position
        self.environment: str = told[0]
        self.run: int = told[1]
        self.start_row: int = told[2]
        self.seed: int = told[3]
        self.inputs: str = told[4]
        self.steps: int = told[5]
        self.gamma: float = native.gamma_of(position)
        self.sensors: list[str] = native.predicted(position)

    def states(self) -> tuple[NDArray[np.float32], list[tuple[int, int]]]:
        """The states of the stream.

        Returns:
            Normalised states, ``float32 [m, d]``, and the unbroken pieces of them, as ranges.

        Examples:
            >>> from calib_rl._study import _example_study
            >>> study = _example_study()
            >>> _ = study.build_model(progress=False)
            >>> streams = Streams(study)
            >>> streams.all[0].states()[0].shape[0] >= streams.all[0].steps
            True
        """
        return self._native.states(self.position)

    def __repr__(self) -> str:
        return f"<calib_rl.agents.Stream: {self.environment}, run {self.run}, {self.steps} steps>"


class Streams:
    """The streams of a study. Its model must be built, if it has one.

    Args:
        study: The study.
        progress: Whether to print the progress, or an observer.

    Attributes:
        all: Every `Stream`. Sensors with discount factors of their own (``agent.gammas``) have streams of their own.
        sensors: The predicted sensors, each with its column.
        gamma: The discount factor of sensors without one of their own.
        part: Which part of a run is scored.

    Examples:
        >>> from calib_rl._study import _example_study
        >>> study = _example_study()
        >>> _ = study.build_model(progress=False)
        >>> streams = Streams(study)
        >>> sorted({stream.environment.split(":")[0] for stream in streams.all})
        ['log-replay', 'member', 'online']
    """

    def __init__(self, study: Study, *, progress: bool | Observer = False) -> None:
        self.study = study
        self._native = _calib.Streams.of_job(study._job, observer(progress))
        self.all: list[Stream] = [Stream(self._native, position, told) for position, told in enumerate(self._native.runs())]
        self.sensors: dict[str, int] = dict(self._native.sensors())
        self.gamma: float = self._native.gamma
        self.part: str = self._native.part

    def task(self, stream: Stream, sensor: str, columns: int) -> Task:
        """The task of an agent on this stream.

        Args:
            stream: One of `all`.
            sensor: The sensor to predict.
            columns: Columns of the states.

        Returns:
            The task.

        Raises:
            ValueError: The sensor is not one of the stream.

        Examples:
            >>> from calib_rl._study import _example_study
            >>> study = _example_study()
            >>> _ = study.build_model(progress=False)
            >>> streams = Streams(study)
            >>> streams.task(streams.all[0], "PIT300", columns=6).gamma
            0.8
        """
        if sensor not in stream.sensors:
            raise ValueError(f"{stream!r} is a stream of {', '.join(stream.sensors)}; choose one of Streams.all with {sensor} in its sensors")
        return Task(sensor, self.sensors[sensor], columns, stream.gamma, stream.seed)

    def run(
        self, factory: Factory, stream: Stream, sensor: str, values: Values, candidate: int = 0
    ) -> tuple[_calib.Score, Agent]:
        """Run one agent over one stream.

        Args:
            factory: Makes the agent: ``factory(task, **values)``.
            stream: One of `all`.
            sensor: The sensor to predict.
            values: Hyperparameters.
            candidate: The position of the setting among those that are compared.

        Returns:
            Its score, and the agent as it was at the end. ``score.nrmse`` and ``score.rmse`` are +∞ where a prediction
            was not finite. ``score.skill`` is the error reduction against predicting the mean return, and ``score.parts``
            has the same for each part of the run.


        Examples:
            >>> from calib_rl.agents._sweep import _ExampleAgent
            >>> from calib_rl._study import _example_study
            >>> study = _example_study()
            >>> _ = study.build_model(progress=False)
            >>> streams = Streams(study)
            >>> score, agent = streams.run(_ExampleAgent, streams.all[0], "PIT300", {"rate": 0.1})
            >>> score.nrmse > 0
            True
        """
        states, pieces = stream.states()
        task = self.task(stream, sensor, states.shape[1])
        agent = made(factory, task, values)
        predictions, updates = predicted(agent, states, pieces, task.column, stream.steps)
        score = self._native.score(stream.position, sensor, candidate, predictions, updates)
        return score, agent


def predicted(
    agent: Agent, states: NDArray[np.float32], pieces: list[tuple[int, int]], column: int, steps: int
) -> tuple[NDArray[np.float32], int]:
    """The predictions of an agent on ``steps`` states, and how often it learned. It stops at the first that is not a number."""
    predictions = np.zeros(steps, np.float32)
    rewards = states[:, column].astype(float).tolist()
    predict, update = agent.predict, agent.update
    begin = getattr(agent, "begin", None)
    updates = 0
    for start, end in pieces:
        if start >= steps:
            break
        if begin is not None:
            begin()
        for t in range(start, min(end - 1, steps)):
            prediction = float(predict(states[t]))
            if not is_number(prediction):
                predictions[t] = math.nan
                return predictions, updates
            predictions[t] = prediction
            update(states[t], rewards[t + 1], states[t + 1])
            updates += 1
    return predictions, updates
