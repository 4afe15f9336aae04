"""Runs of agents, and their verdict."""

from __future__ import annotations

import json
import os
from pathlib import Path

from .. import _calib
from .._progress import Observer, observer
from .._study import Study
from .._verdict import Runs, Verdict


class AgentRuns(Runs):
    """Runs of agents of your own. `Sweep.run` returns it. docs/formats.md describes the columns.

    Args:
        path: The folder of the runs.
        study: The study whose streams they are of.

    Examples:
        >>> from calib_rl._study import _example_study
        >>> from calib_rl.agents._sweep import Sweep, _ExampleAgent
        >>> runs = Sweep(_example_study(), progress=False).run(_ExampleAgent, {"rate": [0.01, 0.1]})
        >>> list(runs.evaluate().settings)
        ['PIT300']
    """

    def __init__(self, path: Path, study: Study) -> None:
        super().__init__(path)
        self._study = study

    def states(self) -> list[Path]:
        """The state that agents had at the end of their runs.

        Returns:
            Pickles, if they were kept (``keep_states=True``).

        Examples:
            >>> from calib_rl._study import _example_study
            >>> from calib_rl.agents._sweep import Sweep, _ExampleAgent
            >>> sweep = Sweep(_example_study(), progress=False)
            >>> runs = sweep.run(_ExampleAgent, {"rate": [0.1]}, keep_states=True, version="kept")
            >>> len(runs.states()) > 0
            True
        """
        return sorted((self.path / "units").glob("*.state.pickle"))

    def evaluate(self, *, progress: bool | Observer = False) -> Verdict:
        """Choose a setting by the study's ``[evaluate]``, and judge the choice by held-out data, as ``calib evaluate STUDY --runs FILE``.

        Args:
            progress: Whether to print the progress, or an observer.

        Returns:
            The verdict.

        Examples:
            >>> from calib_rl._study import _example_study
            >>> from calib_rl.agents._sweep import Sweep, _ExampleAgent
            >>> runs = Sweep(_example_study(), progress=False).run(_ExampleAgent, {"rate": [0.01, 0.1]})
            >>> list(runs.evaluate().settings)
            ['PIT300']
        """
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
        runs: Parquet with the columns ``environment``, ``sensor``, ``run``, ``candidate`` and ``rmse``. See docs/formats.md for the others.
        study: How to judge. By the defaults, unless given.
        folder: Where the summary, figures and ``report.html`` go. ``evaluate`` beside the table, unless given.
        progress: Whether to print the progress, or an observer.

    Returns:
        The verdict.

    Raises:
        CalibError: A column is missing, or a value is wrong. The text says which.

    Examples:
        >>> import tempfile, pathlib
        >>> from calib_rl._study import _example_study
        >>> study = _example_study()
        >>> _ = study.run(progress=False)
        >>> verdict = evaluate(study.results / "sweep" / "runs.parquet", folder=tempfile.mkdtemp())
        >>> list(verdict.chosen)
        ['PIT300']
    """
    runs = Path(runs)
    folder = Path(folder) if folder is not None else runs.parent / "evaluate"
    job = None if study is None else study._job
    summary, negative = _calib.evaluate_runs(os.fspath(runs), job, os.fspath(folder), observer(progress))
    return Verdict(folder, runs.parent, folder / "report.html", json.loads(summary), negative)
