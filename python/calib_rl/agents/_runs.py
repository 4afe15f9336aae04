"""Runs of agents, and their verdict."""

from __future__ import annotations

import os
from pathlib import Path

from .. import _calib
from .._progress import Observer, observer
from .._study import Study
from .._verdict import Runs, Verdict


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
