"""What steps leave behind, as frames and as text."""

from __future__ import annotations

import html
import json
from pathlib import Path
from typing import Any


def frame(path: Path) -> Any:
    """A table of results as a frame of polars, or of pandas where polars is not installed."""
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


class Rollouts:
    """Rollouts of a model, in a folder of results."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def tables(self) -> list[str]:
        """Names of the tables that there are."""
        return sorted(str(table.relative_to(self.path).with_suffix("")) for table in self.path.rglob("*.parquet"))

    def frame(self, name: str) -> Any:
        """One of `tables` as a frame."""
        return frame(self.path / f"{name}.parquet")

    def __repr__(self) -> str:
        return f"<calib_rl.Rollouts: {self.path}>"


class Runs:
    """Runs of a sweep: one row a value, sensor, environment and run."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def frame(self) -> Any:
        """``runs.parquet`` as a frame; docs/formats.md describes its columns."""
        return frame(self.path / "runs.parquet")

    def curves(self) -> Any:
        """Learning curves as a frame, one row a point."""
        return frame(self.path / "curves.parquet")

    def __repr__(self) -> str:
        return f"<calib_rl.Runs: {self.path}>"


class Verdict:
    """What to deploy, and the evidence.

    Attributes:
        negative: Whether some sensor's members prefer no value to another.
        report: The report, one self-contained page.
    """

    def __init__(self, path: Path, sweep: Path, report: Path, outcome: str = "done") -> None:
        self.path = path
        self.report = report
        self.negative: bool = outcome == "negative"
        self._sweep = sweep
        summary = path / "summary.json"
        self.summary: dict[str, Any] = json.loads(summary.read_text(encoding="utf-8")) if summary.exists() else {}

    @property
    def advice(self) -> list[list[str]]:
        """The verdict in words: a list of lines a sensor, the first of which says what to deploy."""
        lines: list[list[str]] = self.summary.get("advice", [])
        return lines

    @property
    def chosen(self) -> dict[str, str]:
        """The chosen value of each sensor, as its label."""
        labels = self.summary.get("candidates", [])
        return {of["sensor"]: labels[of["chosen"]] for of in self.summary.get("verdicts", [])}

    @property
    def caveats(self) -> list[str]:
        """What to know before relying on the verdict, and notes of the sweep."""
        return [*self.summary.get("caveats", []), *self.summary.get("notes", [])]

    def runs(self) -> Any:
        """The runs that it follows from, as a frame."""
        return Runs(self._sweep).frame()

    def curves(self) -> Any:
        """Learning curves, as a frame."""
        return Runs(self._sweep).curves()

    def scores(self) -> Any:
        """Mean error of every value in every environment, as a frame: `sensor`, `environment`, `candidate`, `label`, `mean`, `chosen`."""
        rows: dict[str, list[Any]] = {name: [] for name in ("sensor", "environment", "candidate", "label", "mean", "chosen")}
        labels = self.summary.get("candidates", [])
        for verdict in self.summary.get("verdicts", []):
            scores = [(f"member:{number}", member) for number, member in enumerate(verdict["members"])]
            if verdict.get("log_replay"):
                scores.append(("log-replay", verdict["log_replay"]))
            if verdict.get("truth"):
                scores.append(("online", verdict["truth"]["scores"]))
            for environment, score in scores:
                for candidate, of in enumerate(score["candidates"]):
                    mean = of.get("mean")
                    rows["sensor"].append(verdict["sensor"])
                    rows["environment"].append(environment)
                    rows["candidate"].append(candidate)
                    rows["label"].append(labels[candidate])
                    rows["mean"].append(float("inf") if mean is None else mean)
                    rows["chosen"].append(candidate == verdict["chosen"])
        try:
            import polars
        except ImportError:
            import pandas

            return pandas.DataFrame(rows)
        return polars.DataFrame(rows)

    def __str__(self) -> str:
        lines = [line if position == 0 else f"    {line}" for of in self.advice for position, line in enumerate(of)]
        return "\n".join([*lines, *(f"note: {note}" for note in self.caveats)])

    def __repr__(self) -> str:
        return str(self) or f"<calib_rl.Verdict: {self.report}>"

    def _repr_html_(self) -> str:
        parts = []
        for first, *rest in self.advice:
            items = "".join(f"<li>{html.escape(line)}</li>" for line in rest)
            parts.append(f"<p><b>{html.escape(first)}</b></p><ul>{items}</ul>")
        notes = "".join(f"<li>{html.escape(note)}</li>" for note in self.caveats)
        if notes:
            parts.append(f"<p>Notes</p><ul>{notes}</ul>")
        parts.append(f"<p>Report: <code>{html.escape(str(self.report))}</code></p>")
        return "".join(parts)
