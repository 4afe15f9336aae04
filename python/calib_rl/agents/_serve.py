"""An agent as a program that calib starts."""

from __future__ import annotations

import json
import os
import sys
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ._protocol import Agent, Factory, Task, is_number, made


def serve(factory: Factory) -> None:
    """Be the program of a study with ``agent.kind = "external"``: answer on standard output what comes on standard input, until it ends.

    Output that agents print goes to standard error. If an agent raises an exception, calib ends with its message.

    Args:
        factory: Makes an agent: ``factory(task, **parameters)``, with the parameters of ``[agent.parameters]`` and ``[sweep.grid]``.

    Examples:
        >>> serve(MyAgent)    # doctest: +SKIP
    """
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    # Earlier output that is not written yet goes to standard error too.
    sys.stdout.flush()
    try:
        _answer_all(factory, sys.stdin.buffer, answers)
    except Exception as error:
        _answer(answers, {"error": f"{type(error).__name__}: {error}"})
        raise


def _answer(answers: IO[bytes], what: dict[str, Any]) -> None:
    answers.write(json.dumps(what, allow_nan=False).encode() + b"\n")
    answers.flush()


def _answer_all(factory: Factory, questions: IO[bytes], answers: IO[bytes]) -> None:
    served: _Served | None = None
    while line := questions.readline():
        question = json.loads(line)
        if "begin" in question:
            told = question["begin"]
            if "actions" in told:
                raise ValueError("the study has [control], so its agents act; serve is for agents that predict. For agents that act, use calib_rl.tune")
            task = Task(*(told[name] for name in Task._fields))
            served = _Served(made(factory, task, told["parameters"]), task)
            _answer(answers, {"ready": 1})
        elif served is not None:
            size = question["states"] * served.task.columns
            states = np.frombuffer(questions.read(4 * size), "<f4").reshape(-1, served.task.columns)
            predictions = served.predictions(states, question["begins"], question["ends"])
            _answer(answers, {"predictions": predictions, "updates": served.updates})


class _Served:
    """An agent, and the state that it saw last."""

    def __init__(self, agent: Agent, task: Task) -> None:
        self.agent, self.task, self.updates = agent, task, 0
        self._before: NDArray[np.float32] | None = None

    def predictions(self, states: NDArray[np.float32], begins: bool, ends: bool) -> list[float | None]:
        """Returns one prediction per state. The last one is null if it is not finite, and 0 at the end of a segment, where the agent is not asked."""
        if begins:
            self._before = None
            if begin := getattr(self.agent, "begin", None):
                begin()
        predictions: list[float | None] = []
        for place, state in enumerate(states):
            if self._before is not None:
                self.agent.update(self._before, float(state[self.task.column]), state)
                self.updates += 1
            self._before = state
            if ends and place + 1 == len(states):
                return [*predictions, 0.0]
            prediction = float(self.agent.predict(state))
            if not is_number(prediction):
                return [*predictions, None]
            predictions.append(prediction)
        return predictions
