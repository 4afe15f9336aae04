"""A calibration model as an objective."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from ._protocol import Factory, Values
from ._sweep import Sweep


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
        sensor: The sensor to predict. Default: the first of the study.
        environments: Which environments count. The held-out period (``"online"``) does not by default: the choice is judged by it.

    Returns:
        A function of a trial: the geometric mean of the errors over all streams, as calib's rule ``pooled`` compares values. The mean so far
        is reported after each stream, members first in turn, so that pruners see the same streams of every trial.

    Raises:
        ValueError: No environment counts.

    Examples:
        With Optuna, ``optuna.create_study().optimize(objective, n_trials=20)``. Here a trial that always suggests 0.1:

        >>> from calib_rl._study import _example_study
        >>> from calib_rl.agents._sweep import _ExampleAgent
        >>> class Trial:
        ...     def suggest_float(self, name, low, high, log=False):
        ...         return 0.1
        ...     def report(self, value, step):
        ...         pass
        ...     def should_prune(self):
        ...         return False
        >>> sweep = Sweep(_example_study(), progress=False)
        >>> objective = optuna_objective(sweep, _ExampleAgent, lambda trial: {"rate": trial.suggest_float("rate", 1e-4, 1.0, log=True)})
        >>> 0 < objective(Trial()) < 10
        True
    """
    name = next(iter(sweep.streams.sensors)) if sensor is None else sensor
    counted = [stream for stream in sweep.streams.all if name in stream.sensors and environments(stream.environment)]
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
