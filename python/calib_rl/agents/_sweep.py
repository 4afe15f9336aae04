"""Agents of every setting in every environment."""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import os
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._files import warn_of_damage
from .._progress import Observer, observer
from .._study import Study
from ._protocol import Factory, Task, Values
from ._runs import AgentRuns
from ._streams import Streams
from ._unit import Unit, open_streams, plain, run_there, run_unit, stored, unfinished


def grid(values: Mapping[str, Sequence[Any]]) -> list[dict[str, Any]]:
    """All combinations of values.

    Args:
        values: The values of each hyperparameter.

    Returns:
        One dictionary for each combination.

    Examples:
        >>> grid({"a": [1, 2], "b": ["x"]})
        [{'a': 1, 'b': 'x'}, {'a': 2, 'b': 'x'}]
    """
    return [dict(zip(values, combination)) for combination in product(*values.values())]


class _ExampleAgent:
    """Predicts the mean of the returns so far, for examples."""

    def __init__(self, task: Task, rate: float = 0.1) -> None:
        self.gamma, self.rate, self.value = task.gamma, rate, 0.0

    def predict(self, observation: NDArray[np.float32]) -> float:
        return self.value

    def update(self, observation: NDArray[np.float32], reward: float, next_observation: NDArray[np.float32]) -> None:
        self.value += self.rate * (reward + self.gamma * self.value - self.value)

    def state_dict(self) -> Mapping[str, Any]:
        return {"value": self.value}


class Sweep:
    """Runs of agents in the environments of a study.

    Args:
        study: The study. Its model, if it has one, is built if it is missing. ``[sweep]`` names the sensors, steps and runs. ``agent.gamma`` and
            ``agent.gammas`` say which returns are predicted. Its grid and the rest of ``[agent]`` are those of calib's own agents, and do not matter here.
        folder: Where results go. ``agents`` in the results of the study, unless given.
        progress: Whether to print the progress, or an observer.

    Examples:
        >>> from calib_rl._study import _example_study
        >>> class MeanReturn:
        ...     def __init__(self, task, rate):
        ...         self.gamma, self.rate, self.value = task.gamma, rate, 0.0
        ...     def predict(self, observation):
        ...         return self.value
        ...     def update(self, observation, reward, next_observation):
        ...         self.value += self.rate * (reward + self.gamma * self.value - self.value)
        ...     def state_dict(self):
        ...         return {"value": self.value}
        >>> runs = Sweep(_example_study(), progress=False).run(MeanReturn, {"rate": [0.01, 0.1]})
        >>> list(runs.evaluate().settings)
        ['PIT300']
    """

    def __init__(
        self, study: Study, folder: str | os.PathLike[str] | None = None, *, progress: bool | Observer = True
    ) -> None:
        self.study = study
        self.folder: Path = Path(folder) if folder is not None else study.results / "agents"
        self._observer = observer(progress)
        if study.has_model:
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
        """Run an agent with every setting in every environment.

        Finished runs are kept, as long as the streams, the settings, the factory's name and ``version`` are the same. A run whose file is damaged or
        was edited is made again.

        Args:
            factory: Makes an agent: ``factory(task, **values)``. With several processes it must be a function of a module.
            values: Values of every hyperparameter, all of whose combinations are run, or a list of settings.
            default: The setting that you would use without calib. The first, unless given. It is added if ``values`` lacks it.
            processes: Processes to run in. Their results are the same.
            version: Change it when the agent's code changes.
            keep_states: Whether to pickle what each agent has learned beside the runs. Finished runs without it are made again.

        Returns:
            The runs.

        Raises:
            Exception: An agent raised it. Finished runs are kept.

        Warns:
            CalibWarning: The files of some runs are damaged or were edited.

        Examples:
            >>> from calib_rl._study import _example_study
            >>> sweep = Sweep(_example_study(), progress=False)
            >>> runs = sweep.run(_ExampleAgent, [{"rate": 0.01}, {"rate": 0.1}], default={"rate": 0.1})
            >>> list(runs.evaluate().settings["PIT300"])
            ['rate']
        """
        candidates = grid(values) if isinstance(values, Mapping) else [dict(setting) for setting in values]
        if not candidates:
            raise ValueError("there are no values to run")
        if default is not None and dict(default) not in candidates:
            candidates.append(dict(default))
        chosen = candidates.index(dict(default)) if default is not None else 0
        units = list(self._units(factory, candidates, version, keep_states))
        store = self.folder / "units"
        store.mkdir(parents=True, exist_ok=True)
        left, damaged = unfinished(units, store)
        warn_of_damage(damaged, stacklevel=2)
        self._observer.told("talk", f"agents: {len(units)} runs, {len(units) - len(left)} of them there already")
        if processes > 1 and left:
            self._in_processes(factory, left, processes)
        else:
            for done, unit in enumerate(left):
                run_unit(self.streams, factory, unit, store)
                self._observer.progress("agents", done + 1, len(left))
        described = [(json.dumps(candidate, default=plain), position == chosen) for position, candidate in enumerate(candidates)]
        scores = []
        for unit in units:
            predictions, updates = stored(unit, store)
            scores.append(self.streams._native.score(unit.stream, unit.sensor, unit.candidate, predictions, updates))
        self._observer.progress("", 0, 0)
        runs = self.folder / "runs.parquet"
        self.streams._native.write(os.fspath(runs), described, scores)
        return AgentRuns(self.folder, self.study)

    def _units(
        self, factory: Factory, candidates: list[dict[str, Any]], version: str, keep_states: bool
    ) -> Iterator[Unit]:
        name = f"{getattr(factory, '__module__', '')}.{getattr(factory, '__qualname__', type(factory).__qualname__)}"
        for stream in self.streams.all:
            for sensor in stream.sensors:
                for candidate, values in enumerate(candidates):
                    what = [name, version, values, sensor, stream.gamma, stream.environment, stream.run]
                    what += [stream.inputs, stream.seed, stream.steps, stream.start_row]
                    text = json.dumps(what, sort_keys=True, default=plain)
                    key = hashlib.blake2b(text.encode(), digest_size=16).hexdigest()
                    yield Unit(stream.position, sensor, candidate, values, key, keep_states)

    def _in_processes(self, factory: Factory, left: list[Unit], processes: int) -> None:
        store = self.folder / "units"
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(processes, context, open_streams, (self.study._given(),)) as pool:
            waiting: set[Future[None]] = {pool.submit(run_there, factory, unit, os.fspath(store)) for unit in left}
            try:
                while waiting:
                    done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                    for future in done:
                        future.result()
                    self._observer.progress("agents", len(left) - len(waiting), len(left))
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                raise
