"""Results of steps, as frames and as text."""

from __future__ import annotations

import html
from pathlib import Path
from typing import Any


def frame(path: Path) -> Any:
    """Returns a table of results as a frame of polars, or of pandas if polars is not installed."""
    try:
        import polars
    except ImportError:
        pass
    else:
        return polars.read_parquet(path)
    try:
        import pandas
    except ImportError as missing:
        raise ImportError(f"{path} is Parquet: install polars, or pandas with pyarrow, to read it as a frame") from missing
    return pandas.read_parquet(path)


def frame_of(columns: dict[str, list[Any]]) -> Any:
    """Returns columns as a frame of polars, or of pandas if polars is not installed."""
    try:
        import polars
    except ImportError:
        import pandas

        return pandas.DataFrame(columns)
    return polars.DataFrame(columns)


class Rollouts:
    """Rollouts of a model, in a folder of results. `Study.rollout` returns them.

    Args:
        path: The folder ``rollout`` of a study's results.

    Examples:
        >>> from calib_rl._study import _example_study
        >>> rollouts = _example_study().rollout(progress=False)
        >>> "trajectories" in rollouts.tables()
        True
        >>> "member" in rollouts.frame("trajectories").columns
        True
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def tables(self) -> list[str]:
        """List the tables.

        Returns:
            The names of tables that `frame` accepts, such as ``["dtw", "trajectories"]``.

        Examples:
            >>> from calib_rl._study import _example_study
            >>> "measures" in _example_study().rollout(progress=False).tables()
            True
        """
        return sorted(str(table.relative_to(self.path).with_suffix("")) for table in self.path.rglob("*.parquet"))

    def frame(self, name: str) -> Any:
        """Read one table as a frame.

        Args:
            name: One of `tables`.

        Returns:
            A frame of polars, or of pandas if polars is not installed.

        Examples:
            >>> from calib_rl._study import _example_study
            >>> rollouts = _example_study().rollout(progress=False)
            >>> rollouts.frame("trajectories").columns[:3]
            ['member', 'rollout', 'step']
        """
        return frame(self.path / f"{name}.parquet")

    def __repr__(self) -> str:
        return f"<calib_rl.Rollouts: {self.path}>"


class Runs:
    """Runs of a sweep. `Study.sweep` returns them.

    Args:
        path: The folder ``sweep`` of a study's results.

    Examples:
        >>> from calib_rl._study import _example_study
        >>> runs = _example_study().sweep(progress=False).frame()
        >>> runs.select("sensor", "environment", "learning_rate", "nrmse").columns
        ['sensor', 'environment', 'learning_rate', 'nrmse']
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def frame(self) -> Any:
        """Read all runs: one row for each setting, sensor, environment and run.

        Returns:
            ``runs.parquet`` as a frame of polars or pandas. docs/formats.md describes its columns.

        Examples:
            >>> from calib_rl._study import _example_study
            >>> runs = _example_study().sweep(progress=False)
            >>> sorted(set(runs.frame()["environment"]))[:2]
            ['log-replay', 'member:0']
        """
        return frame(self.path / "runs.parquet")

    def curves(self) -> Any:
        """Learning curves.

        Returns:
            ``curves.parquet`` as a frame of polars or pandas: one row for each point of a curve.

        Examples:
            >>> from calib_rl._study import _example_study
            >>> runs = _example_study().sweep(progress=False)
            >>> "rmse" in runs.curves().columns
            True
        """
        return frame(self.path / "curves.parquet")

    def __repr__(self) -> str:
        return f"<calib_rl.Runs: {self.path}>"


class Verdict:
    """The recommended deployment, and its evidence. `Study.run` and `Study.evaluate` return it.

    ``print`` shows the advice with all reasons, and a notebook shows it as a page.

    Args:
        path: The folder ``evaluate`` of a study's results.
        sweep: The folder ``sweep`` of the same results.
        report: The report.
        summary: What ``calib evaluate --json`` prints.
        negative: Whether the answer is negative.

    Attributes:
        path: The folder of the results.
        report: Path of the report, one self-contained page.
        summary: What ``calib evaluate --json`` prints, as a dictionary. It is the content of ``summary.json``. docs/formats.md describes it.
        negative: Whether, for at least one sensor, the evidence shows no difference between settings.

    Examples:
        >>> from calib_rl._study import _example_study
        >>> verdict = _example_study().run(progress=False)
        >>> list(verdict.settings), list(verdict.settings["PIT300"])
        (['PIT300'], ['learning_rate'])
        >>> verdict.recommendations["PIT300"] in ("deploy", "keep_default", "use_simple_predictor", "do_not_deploy", "not_checked")
        True
        >>> verdict.report.name
        'report.html'
    """

    def __init__(self, path: Path, sweep: Path, report: Path, summary: dict[str, Any], negative: bool) -> None:
        self.path = path
        self.report = report
        self.summary = summary
        self.negative = negative
        self._sweep = sweep

    @property
    def advice(self) -> list[list[str]]:
        """The verdict in words: one list of lines for each sensor. The first line says what to deploy.

        Examples:
            >>> from calib_rl._study import _example_study
            >>> verdict = _example_study().run(progress=False)
            >>> "PIT300" in verdict.advice[0][0]
            True
        """
        lines: list[list[str]] = self.summary.get("advice", [])
        return lines

    @property
    def chosen(self) -> dict[str, str]:
        """The chosen setting of each sensor, as text: ``{"PIT300": "learning_rate = 0.001"}``. See `settings` for numbers.

        Examples:
            >>> from calib_rl._study import _example_study
            >>> verdict = _example_study().run(progress=False)
            >>> verdict.chosen["PIT300"].split(" = ")[0]
            'learning_rate'
        """
        labels = self.summary.get("candidates", [])
        return {verdict["sensor"]: labels[verdict["chosen"]] for verdict in self.summary.get("verdicts", [])}

    @property
    def settings(self) -> dict[str, dict[str, Any]]:
        """The chosen setting of each sensor, by hyperparameter: ``{"PIT300": {"learning_rate": 0.001}}``.

        Look at `recommendations` too: a setting is chosen even if it should not be deployed.

        Examples:
            >>> from calib_rl._study import _example_study
            >>> verdict = _example_study().run(progress=False)
            >>> verdict.settings["PIT300"]["learning_rate"] in (0.001, 0.01)
            True
        """
        return {choice["sensor"]: dict(choice["values"]) for choice in self.summary.get("choices", [])}

    @property
    def recommendations(self) -> dict[str, str]:
        """The recommendation for each sensor.

        It is ``"deploy"``, ``"keep_default"``, ``"use_simple_predictor"``, ``"do_not_deploy"`` or ``"not_checked"``.

        Examples:
            >>> from calib_rl._study import _example_study
            >>> verdict = _example_study().run(progress=False)
            >>> list(verdict.recommendations)
            ['PIT300']
        """
        return {choice["sensor"]: choice["recommendation"] for choice in self.summary.get("choices", [])}

    @property
    def caveats(self) -> list[str]:
        """Caveats of the verdict, and notes of the sweep.

        Examples:
            >>> from calib_rl._study import _example_study
            >>> verdict = _example_study().run(progress=False)
            >>> all(isinstance(text, str) for text in verdict.caveats)
            True
        """
        return [*self.summary.get("caveats", []), *self.summary.get("notes", [])]

    def runs(self) -> Any:
        """Read the runs behind the verdict.

        Returns:
            A frame, as `Runs.frame`.

        Examples:
            >>> from calib_rl._study import _example_study
            >>> verdict = _example_study().run(progress=False)
            >>> "nrmse" in verdict.runs().columns
            True
        """
        return Runs(self._sweep).frame()

    def curves(self) -> Any:
        """Read the learning curves of these runs.

        Returns:
            A frame, as `Runs.curves`.

        Examples:
            >>> from calib_rl._study import _example_study
            >>> verdict = _example_study().run(progress=False)
            >>> "step" in verdict.curves().columns
            True
        """
        return Runs(self._sweep).curves()

    def scores(self) -> Any:
        """Read the mean error of every setting in every environment.

        Returns:
            A frame with the columns `sensor`, `environment`, `candidate`, `label`, `mean`, `skill` and `chosen`. `skill` is the
            error reduction against predicting the mean. It is missing for a setting that diverged.


        Examples:
            >>> from calib_rl._study import _example_study
            >>> verdict = _example_study().run(progress=False)
            >>> verdict.scores().columns
            ['sensor', 'environment', 'candidate', 'label', 'mean', 'skill', 'chosen']
        """
        names = ("sensor", "environment", "candidate", "label", "mean", "skill", "chosen")
        rows: dict[str, list[Any]] = {name: [] for name in names}
        labels = self.summary.get("candidates", [])
        for verdict in self.summary.get("verdicts", []):
            scores = [(f"member:{number}", member) for number, member in enumerate(verdict["members"])]
            if verdict.get("log_replay"):
                scores.append(("log-replay", verdict["log_replay"]))
            if verdict.get("truth"):
                scores.append(("online", verdict["truth"]["scores"]))
            for environment, score in scores:
                for candidate, runs in enumerate(score["candidates"]):
                    mean = runs.get("mean")
                    rows["sensor"].append(verdict["sensor"])
                    rows["environment"].append(environment)
                    rows["candidate"].append(candidate)
                    rows["label"].append(labels[candidate])
                    rows["mean"].append(float("inf") if mean is None else mean)
                    rows["skill"].append(score["skill"][candidate])
                    rows["chosen"].append(candidate == verdict["chosen"])
        return frame_of(rows)

    def parts(self) -> Any:
        """Read the choice and the advice by each part of the runs, as if errors over that part counted (``sweep.scored``).

        Returns:
            A frame with the columns `sensor`, `part`, `label`, `recommendation`, `predictor`, `compared`, `ratio`, `low` and `high`.
            `label` is the setting that this part chooses. `predictor` is the simple predictor to use, and missing unless that is the
            recommendation. `ratio` is the error of the setting over this part divided by that of the simple predictor `compared`,
            with a 95 % interval over windows. `predictor` is another one if a setting that does not learn starts from it. Numbers
            are missing where they are not known.

        Examples:
            >>> from calib_rl._study import _example_study
            >>> verdict = _example_study().run(progress=False)
            >>> list(verdict.parts()["part"])
            ['whole_run', 'after_first_quarter', 'final_quarter']
        """
        names = ("sensor", "part", "label", "recommendation", "predictor", "compared", "ratio", "low", "high")
        rows: dict[str, list[Any]] = {name: [] for name in names}
        labels = self.summary.get("candidates", [])
        for verdict in self.summary.get("verdicts", []):
            for choice in verdict.get("parts", []):
                simple = choice.get("simple") or {}
                ratio = simple.get("ratio") or {}
                interval = ratio.get("interval") or {}
                rows["sensor"].append(verdict["sensor"])
                rows["part"].append(choice["part"])
                rows["label"].append(labels[choice["chosen"]])
                rows["recommendation"].append(choice["recommendation"])
                rows["predictor"].append(choice.get("predictor"))
                rows["compared"].append(simple.get("predictor"))
                rows["ratio"].append(ratio.get("value"))
                rows["low"].append(interval.get("low"))
                rows["high"].append(interval.get("high"))
        return frame_of(rows)

    def __str__(self) -> str:
        lines = [line if position == 0 else f"    {line}" for advice in self.advice for position, line in enumerate(advice)]
        return "\n".join([*lines, *(f"note: {note}" for note in self.caveats)])

    def __repr__(self) -> str:
        return str(self) or f"<calib_rl.Verdict: {self.report}>"

    def _repr_html_(self) -> str:
        parts = [_html_of(lines) for lines in self.advice]
        notes = "".join(f"<li>{html.escape(note)}</li>" for note in self.caveats)
        if notes:
            parts.append(f"<p>Notes</p><ul>{notes}</ul>")
        parts.append(_html_of_report(self.report))
        return "".join(parts)


class ControlVerdict:
    """What to deploy of an agent that acts, and its evidence. `Study.control` returns it, and `Study.run` for a study of agents that act.

    ``print`` shows the advice with all reasons, and a notebook shows it as a page.

    Args:
        path: The folder ``control`` of a study's results.
        summary: What ``calib control --json`` prints.
        advice: The advice in words.

    Attributes:
        path: The folder of the results.
        report: Path of the report, one self-contained page.
        summary: What ``calib control --json`` prints, as a dictionary. docs/formats.md describes it.
        advice: The advice in words, with all reasons. The first line says what to deploy.

    Examples:
        >>> from calib_rl._study import _example_acting_study
        >>> verdict = _example_acting_study().control(progress=False)
        >>> verdict.choice["step_size"] in (0.01, 0.3)
        True
        >>> verdict.summary["decision"]["support"] in ("supported", "keep_default", "unsupported")
        True
    """

    def __init__(self, path: Path, summary: dict[str, Any], advice: list[str]) -> None:
        self.path = path
        self.report: Path = path / "report.html"
        self.summary = summary
        self.advice = advice

    @property
    def negative(self) -> bool:
        """Whether there is a reason against the choice, so that ``calib control`` ends with code 1.

        Examples:
            >>> from calib_rl._study import _example_acting_study
            >>> verdict = _example_acting_study().control(progress=False)
            >>> verdict.negative == bool(verdict.summary["verdict"]["doubts"])
            True
        """
        return bool(self.summary["verdict"]["doubts"])

    @property
    def choice(self) -> dict[str, Any]:
        """The chosen setting: every field of the agent, or the parameters of a program's.

        Look at `negative` too: a setting is chosen even if it should not be deployed.

        Examples:
            >>> from calib_rl._study import _example_acting_study
            >>> "temperature" in _example_acting_study().control(progress=False).choice
            True
        """
        chosen: dict[str, Any] = self.summary["choice"]
        return chosen

    @property
    def held_out(self) -> list[dict[str, Any]]:
        """The held-out periods in the order of time; empty if the study holds nothing out.

        Each has its ``deployment``, if it has a name, the number of recorded ``decisions``, the share that is ``uncovered`` by the training
        range, and what was recorded: ``behaviour`` per episode and ``mean_reward`` per step.

        Examples:
            >>> from calib_rl._study import _example_acting_study
            >>> _example_acting_study().control(progress=False).held_out
            []
        """
        periods: list[dict[str, Any]] = self.summary.get("held_out", [])
        return periods

    @property
    def log_warnings(self) -> list[str]:
        """The warnings about the log, one sentence or more each; empty if there are none.

        Examples:
            >>> from calib_rl._study import _example_acting_study
            >>> isinstance(_example_acting_study().control(progress=False).log_warnings, list)
            True
        """
        warnings: list[str] = self.summary.get("log_warnings", [])
        return warnings

    def runs(self) -> Any:
        """Read the runs behind the verdict.

        Returns:
            ``runs.parquet`` as a frame of polars or pandas: one row for each setting in each run of each member of each kind of model.

        Examples:
            >>> from calib_rl._study import _example_acting_study
            >>> "mean_return" in _example_acting_study().control(progress=False).runs().columns
            True
        """
        return frame(self.path / "runs.parquet")

    def __str__(self) -> str:
        first, *rest = self.advice
        return "\n".join([first, *(f"    {line}" for line in rest)])

    def __repr__(self) -> str:
        return str(self)

    def _repr_html_(self) -> str:
        return _html_of(self.advice) + _html_of_report(self.report)


def _html_of(advice: list[str]) -> str:
    """Returns advice as HTML: its first line, and the others as a list."""
    first, *rest = advice
    items = "".join(f"<li>{html.escape(line)}</li>" for line in rest)
    return f"<p><b>{html.escape(first)}</b></p><ul>{items}</ul>"


def _html_of_report(report: Path) -> str:
    return f"<p>Report: <code>{html.escape(str(report))}</code></p>"
