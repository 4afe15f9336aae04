"""Results of `calib_rl.tune`."""

from __future__ import annotations

import html
import json
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from . import _calib
from ._errors import CalibError
from ._files import why_unwritable
from ._tune_settings import Failure, Names, Setting, counted, short
from ._verdict import frame_of


@dataclass(frozen=True)
class Tuned:
    """Result of `tune`. ``print`` shows the advice, `why` returns all reasons, and a notebook also shows a table.

    Examples:
        >>> from calib_rl._tune_settings import label
        >>> label({"gamma": 0.9, "width": 64})
        'gamma=0.9 width=64'
    """

    settings: list[Setting]
    """What was compared: the settings that did not fail, and were not left out on the way."""
    chosen: Setting | None
    """The setting with the best mean rank over the members of all kinds of models, whether the log supports it or not. ``None`` where all failed."""
    default: Setting | None
    """What it is compared with."""
    advice: list[str]
    """What to do, in a few lines: what to deploy, what the choice gets, and up to three reasons against it, the strongest first. `why` has all of it."""
    doubts: list[str]
    """Why the log does not support the choice, the strongest reason first. Empty if it does."""
    failures: list[Failure]
    """Settings that failed."""
    halved: list[tuple[int, list[Setting]]]
    """With ``halving``: after how many steps which settings were left out."""
    verdict: dict[str, Any] = field(repr=False)
    """All figures, as ``calib control --json`` has them under ``verdict``, with settings by their place in `settings`."""
    runs: list[dict[str, Any]] = field(repr=False)
    """Every setting in every member and run: `setting` and its `place` in `settings`, `kind`, `member`, `run`, `mean_return`, `episodes`, `terminals`,
    `cut_off`, `uncovered`, the `returns` of whole episodes, and `conduct`. `cut_off` counts the episodes that were reset before their end. `conduct`
    is what the agent did at the end of the run, as in ``verdict.json`` of ``calib control``. It is ``None`` but for the first run in the first of
    the ``members``."""

    @property
    def is_supported(self) -> bool:
        """Whether the log supports the choice."""
        return self.chosen is not None and not self.doubts

    def why(self) -> list[str]:
        """Explain the advice: all reasons, a remedy for each, and the evidence.

        Returns:
            Lines of text, the first two of which are those of `advice`.

        Examples:
            >>> print(*tuned.why(), sep="\\n")  # doctest: +SKIP
        """
        return list(self.verdict.get("why", self.advice))

    def frame(self) -> Any:
        """The settings, best first.

        Returns:
            A frame of polars, or of pandas if polars is not installed. It has the columns `setting`, `mean_rank`, `worst_rank`, `mean_return`, `uncovered` and `chosen_again`, and one for each hyperparameter,
            under its name. The name ends in ``_value`` if it would otherwise be one of these. A value is empty if the setting does not have it.
        """
        rows = self._rows()
        columns: dict[str, list[Any]] = {name: [row[name] for row in rows] for name in (rows[0] if rows else {})}
        texts, order = Names(self.settings).texts, self._order()
        for name in dict.fromkeys(name for setting in self.settings for name in setting):
            values = [self.settings[place].get(name) for place in order]
            kinds = {type(value) for value in values if value is not None}
            # Columns of frames have one type.
            if kinds == {int, float}:
                values = [None if value is None else float(value) for value in values]
            elif not (kinds <= {int} or kinds in ({float}, {bool}, {str})):
                values = [texts[place].get(name) for place in order]
            columns[f"{name}_value" if name in columns else name] = values
        return frame_of(columns)

    def runs_frame(self) -> Any:
        """Results of every setting in every ensemble member and run.

        Returns:
            `runs` as such a frame, without the returns of episodes.
        """
        labels = Names(self.settings).labels
        names = ["setting", "kind", "member", "run", "mean_return", "episodes", "terminals", "cut_off", "uncovered"]
        return frame_of({name: [labels[run["place"]] if name == "setting" else run[name] for run in self.runs] for name in names})

    def report(self, path: str | os.PathLike[str]) -> Path:
        """Write the result as one self-contained HTML page.

        Args:
            path: The file. An existing file is replaced, and missing folders are made.

        Returns:
            The path.

        Raises:
            CalibError: The file cannot be written, for example because a folder has its name, or its folder cannot be written to.
            ValueError: Every setting failed, so that there is nothing to show.

        Examples:
            >>> tuned.report("tuned.html")  # doctest: +SKIP
            PosixPath('tuned.html')
        """
        if self.chosen is None:
            raise ValueError("every setting failed: `failures` says why")
        if Path(path).is_dir():
            raise CalibError(f"{os.fspath(path)} is a folder, and the report is a file; name one, such as {Path(path) / 'report.html'}")
        kinds = list(dict.fromkeys(run["kind"] for run in self.runs))
        members = sorted({run["member"] for run in self.runs})
        returns: dict[tuple[int, str, int], list[float]] = {}
        for run in self.runs:
            returns.setdefault((run["place"], run["kind"], run["member"]), []).append(run["mean_return"])

        def mean(place: int, kind: str, member: int) -> float | None:
            value = float(np.mean(returns.get((place, kind, member), [np.nan])))
            return value if np.isfinite(value) else None

        roles = {self.verdict["default"]: "default", self.verdict["chosen"]: "chosen"}
        settings = [
            {
                **row,
                "name": row["setting"],
                "mean_return": row["mean_return"] if np.isfinite(row["mean_return"]) else None,
                "role": roles.get(place, ""),
                "returns": [[mean(place, kind, member) for member in members] for kind in kinds],
            }
            for place, row in zip(self._order(), self._rows())
        ]
        runs = len(self.runs) // max(1, len(self.settings) * len(kinds) * len(members))
        page = {
            "title": "Agents that act",
            "subtitle": f"{counted(len(settings), 'setting')} in {counted(len(members), 'ensemble member')} of {counted(len(kinds), 'kind')} of models, "
            f"{counted(runs, 'run')} each",
            "decision": self.verdict["decision"],
            "findings": self.verdict["findings"],
            "warnings": [*self.doubts, *map(str, self.failures)],
            "settings": settings,
            "kinds": kinds,
            "conduct": self._conduct(),
            "command": f"tuned.report({os.fspath(path)!r})",
        }
        try:
            _calib.write_tuned_page(os.fspath(path), json.dumps(page))
        except CalibError as error:
            # The error of compiled code does not say why.
            reason = why_unwritable(Path(path).parent)
            raise CalibError(f"{error}{'' if reason is None else f' ({reason})'}; name a file in a folder that you may write to") from None
        return Path(path)

    def _conduct(self) -> dict[str, Any] | None:
        """Returns what the chosen agent did, in the first kind of model. ``None`` if its run there was not made."""
        names = {"neighbors": "neighbours", "increments": "increments", "network": "network"}
        for run in self.runs:
            if run["place"] == self.verdict["chosen"] and (conduct := run["conduct"]) is not None:
                model = f"{names[run['kind']]} of ensemble member {run['member']}"
                return {"model": model, "actions": conduct["actions"], "conduct": conduct}
        return None

    def _order(self) -> list[int]:
        """Returns the places of the settings: the chosen one first, then by rank."""
        if not self.verdict:
            return []
        ranks, chosen = self.verdict["selection"], self.verdict["chosen"]
        return sorted(range(len(self.settings)), key=lambda place: (place != chosen, ranks["mean_ranks"][place], ranks["worst_ranks"][place]))

    def _rows(self) -> list[dict[str, Any]]:
        """Returns a row for each setting, in this order."""
        if not self.verdict:
            return []
        selection, again = self.verdict["selection"], self.verdict["chosen_of_resamples"]
        labels = Names(self.settings).labels
        return [
            {
                "setting": labels[place],
                "mean_rank": selection["mean_ranks"][place],
                "worst_rank": selection["worst_ranks"][place],
                "mean_return": selection["mean_errors"][place],
                "uncovered": uncovered(self.verdict["coverage"][place]),
                "chosen_again": again[place] / max(1, sum(again)),
            }
            for place in self._order()
        ]

    def __str__(self) -> str:
        first, *rest = self.advice
        lines = [first, *(f"    {line}" for line in rest), *(f"note: {failure}" for failure in self.failures)]
        return "\n".join([*lines, *(["all reasons: .why()"] if self.verdict else [])])

    def _repr_html_(self) -> str:
        items = "".join(f"<li>{html.escape(line)}</li>" for line in self.advice[1:])
        failed = "".join(f"<li>{html.escape(str(failure))}</li>" for failure in self.failures)
        rows = self._rows()
        cells = "".join("<tr>" + "".join(f"<td>{html.escape(short(value))}</td>" for value in row.values()) + "</tr>" for row in rows)
        header = "".join(f"<th>{html.escape(name)}</th>" for name in (rows[0] if rows else {}))
        return f"<p><b>{html.escape(self.advice[0])}</b></p><ul>{items}{failed}</ul><table><tr>{header}</tr>{cells}</table>"


def uncovered(coverage: dict[str, int]) -> float:
    """The share of the steps that the log does not cover."""
    return (coverage["missing"] + coverage["far"]) / max(1, coverage["steps"])
