"""Agents of your own in the environments of a study.

An agent learns to predict the discounted sum of a sensor's future, ``G_t = Σ_k γᵏ o_{t+k+1}``, from the states that it sees. It is any
object with the three methods of `Agent`. `Sweep` runs it in every member of the calibration model, on the held-out period and on the
replayed log, over the very streams that calib's own agents learn from, with the same seed for all values of a run, and writes a table that
``calib evaluate --runs`` judges. `serve` makes a program of an agent, for studies with ``agent.kind = "external"``: the command line then
runs it as its own.
"""

from __future__ import annotations

from ._optuna import optuna_objective
from ._protocol import Agent, Factory, Task, Values
from ._runs import AgentRuns, evaluate
from ._serve import serve
from ._simple import LeastSquaresTD, Mean, Persistence, Ridge, SimplePredictor
from ._streams import Stream, Streams
from ._sweep import Sweep, grid

__all__ = [
    "Agent",
    "AgentRuns",
    "Factory",
    "LeastSquaresTD",
    "Mean",
    "Persistence",
    "Ridge",
    "SimplePredictor",
    "Stream",
    "Streams",
    "Sweep",
    "Task",
    "Values",
    "evaluate",
    "grid",
    "optuna_objective",
    "serve",
]
