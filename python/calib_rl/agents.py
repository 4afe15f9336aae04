"""Agents of your own in the environments of a study.

An agent learns to predict the discounted sum of a sensor's future, ``G_t = Σ_k γᵏ o_{t+k+1}``, from the states that it sees. It is any
object with the three methods of `Agent`. `Sweep` runs it in every member of the calibration model, on the held-out log (Online) and on the
replayed log, over the very streams that calib's own agents learn from, with the same seed for all values of a run; and writes a table that
``calib evaluate --runs`` judges. `serve` makes a program of an agent, for studies with ``agent.kind = "external"``: the command line then
runs it as its own.
"""

from __future__ import annotations

import hashlib
import json
import math
import multiprocessing
import os
import pickle
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from itertools import product
from pathlib import Path
from typing import IO, Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from . import _calib
from ._progress import Observer, observer
from ._study import Study
from ._verdict import Runs, Verdict

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


class Stream:
    """A run's stream of states.

    Attributes:
        environment: ``"member:0"`` …, ``"online"`` or ``"log-replay"``.
        run: Number of the run there.
        seed: For the agents of the run.
        steps: Steps of the run. The stream has more states, so that the last returns are complete; agents do not see them.
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

    def states(self) -> tuple[NDArray[np.float32], list[tuple[int, int]]]:
        """Normalised states, ``float32 [m, d]``, and the unbroken pieces of them, as ranges."""
        return self._native.states(self.position)

    def __repr__(self) -> str:
        return f"<calib_rl.agents.Stream: {self.environment}, run {self.run}, {self.steps} steps>"


class Streams:
    """The streams of a study, whose model must be built.

    Args:
        study: The study.
        progress: Whether to print what is done, or an observer.
    """

    def __init__(self, study: Study, *, progress: bool | Observer = False) -> None:
        self.study = study
        self._native = _calib.Streams.of_job(study._job, observer(progress))
        self.all: list[Stream] = [Stream(self._native, position, told) for position, told in enumerate(self._native.runs())]
        self.sensors: dict[str, int] = dict(self._native.sensors())
        self.gamma: float = self._native.gamma
        self.part: str = self._native.part

    def task(self, stream: Stream, sensor: str, columns: int) -> Task:
        """What an agent of this stream is to predict."""
        return Task(sensor, self.sensors[sensor], columns, self.gamma, stream.seed)

    def run(
        self, factory: Factory, stream: Stream, sensor: str, values: Values, candidate: int = 0
    ) -> tuple[_calib.Score, Agent]:
        """Run one agent over one stream.

        Args:
            factory: Makes the agent: ``factory(task, **values)``.
            stream: One of `all`.
            sensor: What to predict.
            values: Hyperparameters.
            candidate: Their position among those that are compared.

        Returns:
            Its score, whose ``nrmse`` is +∞ where a prediction was not finite, and the agent as it was at the end.
        """
        states, pieces = stream.states()
        task = self.task(stream, sensor, states.shape[1])
        agent = factory(task, **values)
        if not isinstance(agent, Agent):
            raise TypeError(f"{type(agent).__name__} is no agent: it needs the methods predict, update and state_dict")
        predictions, updates = _predictions(agent, states, pieces, task.column, stream.steps)
        score = self._native.score(stream.position, sensor, candidate, predictions, updates)
        return score, agent


def _predictions(
    agent: Agent, states: NDArray[np.float32], pieces: list[tuple[int, int]], column: int, steps: int
) -> tuple[NDArray[np.float32], int]:
    predictions = np.zeros(steps, np.float32)
    largest = float(np.finfo(np.float32).max)
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
            if not abs(prediction) <= largest:
                predictions[t] = math.nan
                return predictions, updates
            predictions[t] = prediction
            update(states[t], rewards[t + 1], states[t + 1])
            updates += 1
    return predictions, updates


def grid(values: Mapping[str, Sequence[Any]]) -> list[dict[str, Any]]:
    """All combinations of values.

    Examples:
        >>> grid({"a": [1, 2], "b": ["x"]})
        [{'a': 1, 'b': 'x'}, {'a': 2, 'b': 'x'}]
    """
    return [dict(zip(values, combination)) for combination in product(*values.values())]


class Sweep:
    """Runs of agents in the environments of a study.

    Args:
        study: The study; its model is built if it is missing. ``[sweep]`` says what is run: sensors, steps, runs; ``agent.gamma`` which
            return is predicted. Its grid and the rest of ``[agent]`` are those of calib's own agents, and do not matter here.
        folder: Where results go; ``agents`` in the results of the study without it.
        progress: Whether to print what is done, or an observer.
    """

    def __init__(
        self, study: Study, folder: str | os.PathLike[str] | None = None, *, progress: bool | Observer = True
    ) -> None:
        self.study = study
        self.folder: Path = Path(folder) if folder is not None else study.results / "agents"
        self._observer = observer(progress)
        study.build_model(progress=False)
        self.streams: Streams = Streams(study)

    def run(
        self,
        factory: Factory,
        values: Mapping[str, Sequence[Any]] | Sequence[Values],
        *,
        default: Values | None = None,
        processes: int = 1,
        version: str = "",
        keep_states: bool = False,
    ) -> AgentRuns:
        """Run an agent of every value in every environment.

        What was run before is not run again, as long as the streams, the values, the factory's name and ``version`` are the same.

        Args:
            factory: Makes an agent: ``factory(task, **values)``. With several processes it must be a function of a module.
            values: Values of every hyperparameter, all of whose combinations are run, or a list of combinations.
            default: The combination that nobody has to decide; the first without it. It is added if it is none of ``values``.
            processes: Processes to run in; their results are the same.
            version: Change it when the agent's code changes.
            keep_states: Whether what each agent has learnt is pickled beside the runs.

        Returns:
            The runs.

        Raises:
            Exception: What an agent raised; runs that were finished are kept.
        """
        candidates = grid(values) if isinstance(values, Mapping) else [dict(of) for of in values]
        if not candidates:
            raise ValueError("there are no values to run")
        if default is not None and dict(default) not in candidates:
            candidates.append(dict(default))
        chosen = candidates.index(dict(default)) if default is not None else 0
        units = list(self._units(factory, candidates, version, keep_states))
        store = self.folder / "units"
        store.mkdir(parents=True, exist_ok=True)
        left = [unit for unit in units if not (store / unit.key).exists()]
        self._observer.told("talk", f"agents: {len(units)} runs, {len(units) - len(left)} of them there already")
        if processes > 1 and left:
            self._in_processes(factory, left, processes)
        else:
            for done, unit in enumerate(left):
                _run_unit(self.streams, factory, unit, store)
                self._observer.progress("agents", done + 1, len(left))
        described = [(json.dumps(of, default=_plain), position == chosen) for position, of in enumerate(candidates)]
        scores = []
        for unit in units:
            predictions, updates = np.load(store / unit.key), int((store / f"{unit.key}.updates").read_text())
            scores.append(self.streams._native.score(unit.stream, unit.sensor, unit.candidate, predictions, updates))
        self._observer.progress("", 0, 0)
        runs = self.folder / "runs.parquet"
        self.streams._native.write(os.fspath(runs), described, scores)
        return AgentRuns(self.folder, self.study)

    def _units(
        self, factory: Factory, candidates: list[dict[str, Any]], version: str, keep_states: bool
    ) -> Iterator[_Unit]:
        name = f"{getattr(factory, '__module__', '')}.{getattr(factory, '__qualname__', type(factory).__qualname__)}"
        for stream in self.streams.all:
            for sensor in self.streams.sensors:
                for candidate, values in enumerate(candidates):
                    what = [name, version, values, sensor, self.streams.gamma, stream.environment, stream.run]
                    what += [stream.inputs, stream.seed, stream.steps, stream.start_row]
                    text = json.dumps(what, sort_keys=True, default=_plain)
                    key = f"{hashlib.blake2b(text.encode(), digest_size=16).hexdigest()}.npy"
                    yield _Unit(stream.position, sensor, candidate, values, key, keep_states)

    def _in_processes(self, factory: Factory, left: list[_Unit], processes: int) -> None:
        store = self.folder / "units"
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(processes, context, _open_streams, (self.study._given(),)) as pool:
            waiting: set[Future[None]] = {pool.submit(_run_there, factory, unit, os.fspath(store)) for unit in left}
            try:
                while waiting:
                    done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                    for future in done:
                        future.result()
                    self._observer.progress("agents", len(left) - len(waiting), len(left))
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                raise


class _Unit(NamedTuple):
    stream: int
    sensor: str
    candidate: int
    values: dict[str, Any]
    key: str
    keep_states: bool


def _plain(value: Any) -> Any:
    """A value of NumPy, or anything with a text, for JSON."""
    return value.tolist() if hasattr(value, "tolist") else str(value)


def _run_unit(streams: Streams, factory: Factory, unit: _Unit, store: Path) -> None:
    states, pieces = streams.all[unit.stream].states()
    task = streams.task(streams.all[unit.stream], unit.sensor, states.shape[1])
    agent = factory(task, **unit.values)
    if not isinstance(agent, Agent):
        raise TypeError(f"{type(agent).__name__} is no agent: it needs the methods predict, update and state_dict")
    predictions, updates = _predictions(agent, states, pieces, task.column, streams.all[unit.stream].steps)
    (store / f"{unit.key}.updates").write_text(str(updates))
    if unit.keep_states:
        (store / f"{unit.key}.state.pickle").write_bytes(pickle.dumps(dict(agent.state_dict())))
    unfinished = store / f".{unit.key}.{os.getpid()}.tmp"
    with open(unfinished, "wb") as file:
        np.save(file, predictions)
    # The array is written last: where it is, the run is done.
    os.replace(unfinished, store / unit.key)


_STREAMS: list[Streams] = []


def _open_streams(given: dict[str, Any]) -> None:
    _calib.set_threads(1)
    _STREAMS.append(Streams(Study(**given)))


def _run_there(factory: Factory, unit: _Unit, store: str) -> None:
    _run_unit(_STREAMS[0], factory, unit, Path(store))


class AgentRuns(Runs):
    """Runs of agents of your own: one row a value, sensor, environment and run; docs/formats.md describes the columns."""

    def __init__(self, path: Path, study: Study) -> None:
        super().__init__(path)
        self._study = study

    def states(self) -> list[Path]:
        """Pickles of what agents had learnt, if they were kept."""
        return sorted((self.path / "units").glob("*.state.pickle"))

    def evaluate(self, *, progress: bool | Observer = False) -> Verdict:
        """Choose a value by the study's ``[evaluate]``, and judge the choice by held-out data: as ``calib evaluate STUDY --runs FILE``."""
        return evaluate(self.path / "runs.parquet", self._study, progress=progress)


def evaluate(
    runs: str | os.PathLike[str],
    study: Study | None = None,
    *,
    folder: str | os.PathLike[str] | None = None,
    progress: bool | Observer = False,
) -> Verdict:
    """Judge a table of runs that something else made.

    Args:
        runs: Parquet with the columns ``environment``, ``sensor``, ``run``, ``candidate`` and ``rmse``; see docs/formats.md for the others.
        study: How to judge; the defaults without it.
        folder: Where the summary, figures and ``report.html`` go; ``evaluate`` beside the table without it.
        progress: Whether to print what is done, or an observer.

    Raises:
        CalibError: A column is missing, or a value is wrong; the text says which.
    """
    runs = Path(runs)
    folder = Path(folder) if folder is not None else runs.parent / "evaluate"
    job = None if study is None else study._job
    outcome = _calib.evaluate_runs(os.fspath(runs), job, os.fspath(folder), observer(progress))
    return Verdict(folder, runs.parent, folder / "report.html", outcome)


def optuna_objective(
    sweep: Sweep,
    factory: Factory,
    suggest: Callable[[Any], Values],
    *,
    sensor: str | None = None,
    environments: Callable[[str], bool] = lambda environment: environment != "online",
) -> Callable[[Any], float]:
    """The error of an agent in the calibration model, as an objective for Optuna, or anything with trials that report and prune.

    Args:
        sweep: Where agents are run.
        factory: Makes an agent: ``factory(task, **values)``.
        suggest: Draws the values of a trial, such as ``lambda trial: {"learning_rate": trial.suggest_float("learning_rate", 1e-4, 1, log=True)}``.
        sensor: What is predicted; the study's first without it.
        environments: Which environments count. Online does not by default: it is what a choice is judged by.

    Returns:
        A function of a trial: the geometric mean of the errors over all streams, as calib's rule ``pooled`` compares values. The mean so far
        is reported after each stream, members first in turn, so that pruners see the same streams of every trial.
    """
    name = next(iter(sweep.streams.sensors)) if sensor is None else sensor
    counted = [stream for stream in sweep.streams.all if environments(stream.environment)]
    if not counted:
        raise ValueError("no environment counts")
    counted.sort(key=lambda stream: stream.run)

    def objective(trial: Any) -> float:
        values = suggest(trial)
        total = 0.0
        for step, stream in enumerate(counted):
            score, _ = sweep.streams.run(factory, stream, name, values)
            if not math.isfinite(score.nrmse):
                return math.inf
            total += math.log(max(score.nrmse, 1e-300))
            trial.report(math.exp(total / (step + 1)), step)
            if trial.should_prune():
                import optuna

                raise optuna.TrialPruned
        return math.exp(total / len(counted))

    return objective


def serve(factory: Factory) -> None:
    """Be the program of a study with ``agent.kind = "external"``: answer on standard output what comes on standard input, until it ends.

    What the agents print goes to standard error. An exception of an agent is told to calib, which then ends with it.

    Args:
        factory: Makes an agent: ``factory(task, **parameters)``, with the parameters of ``[agent.parameters]`` and ``[sweep.grid]``.
    """
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    # What was printed before, and has not been written yet, goes there too.
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
            task = Task(*(told[name] for name in Task._fields))
            agent = factory(task, **told["parameters"])
            if not isinstance(agent, Agent):
                raise TypeError(f"{type(agent).__name__} is no agent: it needs the methods predict, update and state_dict")
            served = _Served(agent, task)
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
        """One a state; the last is null where it is not finite. At the end of a piece none is asked of the agent."""
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
            if not abs(prediction) <= float(np.finfo(np.float32).max):
                return [*predictions, None]
            predictions.append(prediction)
        return predictions
