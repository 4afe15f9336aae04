"""Stored results of `calib_rl.tune`, which the same call finds again."""

from __future__ import annotations

import hashlib
import json
import math
import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ._acting import ActionModel
from ._errors import CalibError, CalibWarning
from ._files import made_folder, read_sealed_json, warn_of_damage, why_unwritable, write_sealed_json
from ._identity import Unstable, identity
from ._tune_conduct import is_conduct
from ._tune_settings import Setting

if TYPE_CHECKING:
    from ._tune_unit import Unit

# The version of the results. It covers changes that the rest of the key does not show.
_FORMAT = 5


class Kept:
    """A folder with the result of every unit.

    The values that results depend on are described once, before agents can change them.

    Args:
        folder: The folder. It is made if it is missing.
        make_agent: The function that makes an agent.
        model: The model with actions.
        settings: All settings.
        labels: The name of each setting, for the warning.
        environment: Further arguments of the environment.

    Raises:
        CalibError: The folder is a file, or cannot be made.
    """

    def __init__(
        self,
        folder: str | os.PathLike[str],
        make_agent: Callable[..., Any],
        model: ActionModel,
        settings: Sequence[Setting],
        labels: Sequence[str],
        environment: Mapping[str, Any],
    ) -> None:
        # An agent may change the working folder.
        self._folder = made_folder(Path(folder).absolute(), "results")
        self._settings: list[str | None] = [None] * len(settings)
        unstable = []
        try:
            self._common = [
                _FORMAT,
                model._digest,
                identity(make_agent, "make_agent"),
                identity(dict(environment), "environment"),
            ]
        except Unstable as error:
            unstable.append(str(error))
        else:
            for place, (setting, label) in enumerate(zip(settings, labels)):
                try:
                    self._settings[place] = identity(setting, label)
                except Unstable as error:
                    unstable.append(str(error))
        if unstable:
            which = "the results of some settings" if any(self._settings) else "the results"
            warnings.warn(
                f"folder: {which} are not kept, because {unstable[0]}, which cannot be compared with that of another call; make it inside "
                "make_agent, or leave folder= out",
                CalibWarning,
                stacklevel=3,
            )

    def _path(self, unit: Unit) -> Path | None:
        setting = self._settings[unit.candidate]
        if setting is None:
            return None
        key = [*self._common, setting, [unit.kind, unit.member, unit.run, unit.seed, unit.steps]]
        return self._folder / f"unit-{hashlib.sha256(json.dumps(key).encode()).hexdigest()[:32]}.json"

    def read_all(self, units: Sequence[Unit]) -> dict[int, dict[str, Any]]:
        """Returns the stored results by the place of their unit. A file that is damaged, edited or of another form is ignored, and Python warns of it."""
        results, damaged = {}, []
        for place, unit in enumerate(units):
            path = self._path(unit)
            if path is None or not path.is_file():
                continue
            try:
                came = read_sealed_json(path)
                if not _is_result(came, unit):
                    raise ValueError(f"{path} is no result of this unit")
            except (OSError, ValueError, RecursionError, OverflowError):
                damaged.append(path)
                continue
            # A call with other ensemble members records another one.
            if not unit.is_recorded:
                came.pop("conduct", None)
            elif "conduct" not in came:
                continue
            # Another grid may have the setting in another position.
            came["run"]["candidate"] = unit.candidate
            results[place] = came
        # The user's call of `tune` is above `run_all`.
        warn_of_damage(damaged, stacklevel=4)
        return results

    def require_writable(self) -> None:
        """Refuses a folder in which no result can be stored, before agents learn for hours.

        Raises:
            CalibError: No file can be made in it.
        """
        if (reason := why_unwritable(self._folder)) is not None:
            raise CalibError(f"folder: no file can be written in {self._folder} ({reason}); name one that you may write to, or leave folder= out")

    def write(self, unit: Unit, came: Mapping[str, Any]) -> None:
        """Store the result of a unit."""
        path = self._path(unit)
        if path is None:
            return
        path.parent.mkdir(parents=True, exist_ok=True)
        told = {"setting": {name: repr(value) for name, value in unit.setting.items()}, **came}
        write_sealed_json(path, told)


def _is_result(came: Any, unit: Unit) -> bool:
    """Whether a file holds the result of this unit."""
    run = came.get("run") if isinstance(came, dict) else None
    if not isinstance(run, dict) or [run.get("kind"), run.get("member"), run.get("run")] != [unit.kind, unit.member, unit.run]:
        return False
    coverage, drift = run.get("coverage"), run.get("drift")
    if not isinstance(coverage, dict) or not isinstance(drift, dict):
        return False
    counts = [run.get("episodes"), run.get("terminals"), came.get("cut_off"), drift.get("episodes")]
    counts += [coverage.get(name) for name in ("steps", "missing", "far")]
    lists = [came.get("returns"), run.get("curve"), drift.get("sums"), drift.get("squares")]
    return (
        all(type(count) is int and 0 <= count < 2**63 for count in counts)
        and all(isinstance(numbers, list) for numbers in lists)
        and all(_is_number(number) for numbers in lists for number in numbers)
        and _is_number(run.get("mean_return"))
        and (came.get("conduct") is None or is_conduct(came["conduct"]))
    )


def _is_number(value: Any) -> bool:
    return type(value) in (int, float) and math.isfinite(value)
