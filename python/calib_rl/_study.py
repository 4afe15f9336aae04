"""Studies, and their steps."""

from __future__ import annotations

import functools
import json
import os
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from . import _calib
from ._acting import ActionModel
from ._model import Model
from ._progress import Observer, observer
from ._verdict import ControlVerdict, Rollouts, Runs, Verdict

Text = str | os.PathLike[str]


class Study:
    """A study: what to compute, resolved once and checked before anything runs.

    Every step computes what is missing and stores it in the folder of results. The command line can continue where Python stopped, and the
    other way round. Results are the same bytes.

    Args:
        source: The study file, or its sections as a dictionary, which is written to a file at ``path``.
        path: The file to which a study of a dictionary or of keywords is written. It must not hold another study.
        set: Values that replace those of the study, such as ``{"agent.gamma": 0.9}``, or texts as on the command line. A dictionary replaces all
            keys of its section, as in ``{"control.grid": {"step_size": [0.1]}}``.
        profile: The ``NAME`` of ``[profiles.NAME]``.
        model: The ``NAME`` of ``[models.NAME]``, or the section ``[model]`` as a dictionary. Default: all models.
        deployment: The ``NAME`` of ``[deployments.NAME]``. Default: all deployments.
        output: The folder of results, instead of the study's.
        redo: Whether to compute existing results again.
        sections: Sections of a study, as keywords: ``data={"path": "logs"}, sweep={"sensors": ["PIT300"]}``.

    Raises:
        StudyError: A key does not exist, or a value is not valid. The text names the place.
        FileExistsError: ``path`` holds another study.

    Examples:
        >>> import calib_rl, tempfile, pathlib
        >>> folder = pathlib.Path(tempfile.mkdtemp())
        >>> study = calib_rl.Study(data={"path": "plant"}, sweep={"sensors": ["PIT300"]}, path=folder / "study.toml")
        >>> study.config["sweep"]["sensors"]
        ['PIT300']
        >>> try:
        ...     calib_rl.Study(folder / "study.toml", set={"agent.gama": 0.9})
        ... except calib_rl.StudyError as error:
        ...     print("did you mean `gamma`?" in str(error))
        True
    """

    def __init__(
        self,
        source: Text | Mapping[str, Any] | None = None,
        *,
        path: Text | None = None,
        set: Mapping[str, Any] | Sequence[str] = (),
        profile: str | None = None,
        model: str | Mapping[str, Any] | None = None,
        deployment: str | None = None,
        output: Text | None = None,
        redo: bool = False,
        **sections: Any,
    ) -> None:
        if isinstance(model, Mapping):
            sections["model"], model = model, None
        text: str | None = None
        if source is None or isinstance(source, Mapping):
            merged = {**(source or {}), **sections}
            if not merged:
                raise TypeError("a study is a file, a dictionary, or sections as keywords; got nothing")
            if path is None:
                raise TypeError("path says where a study of a dictionary is written, such as path='study.toml'")
            text, source = _calib.to_toml(merged), path
        elif sections or path is not None:
            raise TypeError("a study file is complete; lay keys over it with set={'section.key': value}")
        self._arguments: dict[str, Any] = {
            "source": os.fspath(source),
            "set": _overrides(set),
            "profile": profile,
            "model": model,
            "deployment": deployment,
            "output": None if output is None else os.fspath(output),
        }
        given = {key: value for key, value in self._arguments.items() if key != "source"}
        # A study that is not valid raises an error here, before it is written.
        self._job = _calib.Job(os.fspath(source), text, redo=redo, **given)
        if text is not None:
            write_study(Path(source), text)

    def _given(self) -> dict[str, Any]:
        """Returns the arguments that make the same study in another process."""
        return self._arguments

    @property
    def path(self) -> Path:
        """The study file.

        Examples:
            >>> from calib_rl._study import _example_study
            >>> _example_study().path.name
            'study.toml'
        """
        return Path(self._job.path("study"))

    @property
    def results(self) -> Path:
        """The folder of all results.

        Examples:
            >>> from calib_rl._study import _example_study
            >>> _example_study().results.name
            'study-results'
        """
        return Path(self._job.path("root"))

    @property
    def config(self) -> dict[str, Any]:
        """The resolved study: every key, with its default if it was not given.

        Examples:
            >>> from calib_rl._study import _example_study
            >>> _example_study().config["agent"]["gamma"]
            0.8
        """
        resolved: dict[str, Any] = json.loads(self._job.json())
        return resolved

    @property
    def has_model(self) -> bool:
        """Whether the study has a calibration model. With ``model.kind = "none"`` only log replay decides.

        Examples:
            >>> import calib_rl
            >>> from calib_rl._study import _example_study
            >>> _example_study().has_model
            True
            >>> calib_rl.Study(_example_study().path, set={"model.kind": "none"}).has_model
            False
        """
        return self._job.has_model

    def command(self, step: str = "run") -> str:
        """The command that runs a step of this study on the command line.

        Args:
            step: ``"run"``, or the name of a command, such as ``"build-model"``.

        Returns:
            The command.

        Examples:
            >>> from calib_rl._study import _example_study
            >>> _example_study().command("sweep").startswith("calib sweep ")
            True
        """
        return self._job.command(step)

    def simulate(self, *, progress: bool | Observer = True) -> None:
        """Write the missing parts of the log of the plant that ``[simulate]`` describes.

        Args:
            progress: Whether to print the progress, or an observer.

        Examples:
            >>> from calib_rl._study import _example_study
            >>> study = _example_study()
            >>> study.simulate(progress=False)
            >>> (study.path.parent / "plant").is_dir()
            True
        """
        self._step("simulate", progress)

    def represent(self, *, progress: bool | Observer = True) -> None:
        """Train or import representations of the states, and choose one. Only for studies with ``[representation]``.

        Args:
            progress: Whether to print the progress, or an observer.

        Examples:
            >>> import calib_rl, tempfile
            >>> from calib_rl._study import _example_study
            >>> trained = {"representation.kind": "laplacian", "representation.dimension": 4, "representation.steps": 50}
            >>> study = calib_rl.Study(_example_study().path, set=trained, output=tempfile.mkdtemp())
            >>> study.represent(progress=False)
            >>> (study.results / "representation" / "candidates.parquet").is_file()
            True
        """
        self._step("represent", progress)

    def pretrain(self, *, progress: bool | Observer = True) -> None:
        """Pre-train one agent for each sensor. Only for studies with ``[pretrain]``.

        Args:
            progress: Whether to print the progress, or an observer.

        Examples:
            >>> import calib_rl, tempfile
            >>> from calib_rl._study import _example_study
            >>> study = calib_rl.Study(_example_study().path, set={"pretrain.epochs": 2}, output=tempfile.mkdtemp())
            >>> study.pretrain(progress=False)
            >>> (study.results / "pretrain" / "PIT300.safetensors").is_file()
            True
        """
        self._step("pretrain", progress)

    def build_model(self, *, progress: bool | Observer = True) -> Model:
        """Build the calibration model.

        Args:
            progress: Whether to print the progress, or an observer. The same holds for every step.

        Returns:
            The memory-mapped model.

        Raises:
            CalibError: The data is wrong, or the machine cannot run the step.
            KeyboardInterrupt: Ctrl-C. The same call continues from there.

        Examples:
            >>> from calib_rl._study import _example_study
            >>> _example_study().build_model(progress=False).members
            5
        """
        self._step("build_model", progress)
        return Model.of(self)

    def model(self) -> Model:
        """Open the model that was built before.

        Returns:
            The memory-mapped model.

        Raises:
            CalibError: The model was not built, or it is of another study.

        Examples:
            >>> from calib_rl._study import _example_study
            >>> study = _example_study()
            >>> built = study.build_model(progress=False)
            >>> study.model().path == built.path
            True
        """
        return Model.of(self)

    def build_control_model(self, *, progress: bool | Observer = True) -> ActionModel:
        """Build the model with actions of a study with ``[control]``, if it is missing.

        Args:
            progress: Whether to print the progress, or an observer.

        Returns:
            The memory-mapped model.

        Raises:
            CalibError: The data is wrong, the study has no ``[control]``, or the machine cannot run the step.

        Examples:
            >>> import calib_rl, pathlib, tempfile
            >>> from calib_rl._acting import _example_log
            >>> folder = pathlib.Path(tempfile.mkdtemp())
            >>> _ = calib_rl.build_model(_example_log(), folder, actions=["valve"], reward="reward")
            >>> study = calib_rl.Study(folder / "study.toml")
            >>> len(study.build_control_model(progress=False).actions)
            3
        """
        self._step("control_model", progress)
        return ActionModel.of(self)

    def rollout(self, *, progress: bool | Observer = True) -> Rollouts:
        """Make the rollouts of ``[rollout]``, and compare them with recorded trajectories.

        Args:
            progress: Whether to print the progress, or an observer.

        Returns:
            The tables of the rollouts.

        Raises:
            CalibError: The model was not built.

        Examples:
            >>> from calib_rl._study import _example_study
            >>> study = _example_study()
            >>> _ = study.build_model(progress=False)
            >>> study.rollout(progress=False).tables()
            ['dtw', 'measures', 'one_step', 'trajectories']
        """
        self._step("rollout", progress)
        return Rollouts(Path(self._job.path("rollout")))

    def sweep(self, *, progress: bool | Observer = True) -> Runs:
        """Train agents with every setting of the grid: in the models, on the replayed log, and on the held-out period.

        Args:
            progress: Whether to print the progress, or an observer.

        Returns:
            The runs.

        Raises:
            CalibError: The model was not built.
            KeyboardInterrupt: Ctrl-C. The same call continues from there.

        Examples:
            >>> from calib_rl._study import _example_study
            >>> study = _example_study()
            >>> _ = study.build_model(progress=False)
            >>> sorted(set(study.sweep(progress=False).frame()["learning_rate"]))
            [0.001, 0.01]
        """
        self._step("sweep", progress)
        return Runs(Path(self._job.path("sweep")))

    def evaluate(self, *, progress: bool | Observer = True) -> Verdict:
        """Choose a setting, judge the choice by held-out data, and write the report.

        Args:
            progress: Whether to print the progress, or an observer.

        Returns:
            The verdict.

        Raises:
            CalibError: The sweep is not complete.

        Examples:
            >>> from calib_rl._study import _example_study
            >>> study = _example_study()
            >>> _ = study.run(progress=False)
            >>> study.evaluate(progress=False).report.name
            'report.html'
        """
        return self._verdict(*self._job.evaluate(observer(progress)))

    def control(self, *, progress: bool | Observer = True) -> ControlVerdict:
        """Choose the setting of an agent that acts, judge the choice, and write the report. Only for studies with ``[control]``.

        Args:
            progress: Whether to print the progress, or an observer.

        Returns:
            The verdict.

        Raises:
            CalibError: The data is wrong, the study has no ``[control]``, or the machine cannot run the step.
            KeyboardInterrupt: Ctrl-C. The same call continues from there.

        Examples:
            >>> from calib_rl._study import _example_acting_study
            >>> _example_acting_study().control(progress=False).report.name
            'report.html'
        """
        summary, advice = self._job.control(observer(progress))
        return ControlVerdict(Path(self._job.path("control")), json.loads(summary), advice)

    def run(self, *, progress: bool | Observer = True) -> Verdict | ControlVerdict:
        """Run every missing step of the study, from its log to the verdict. For a study of agents that act this is `control`.

        Args:
            progress: Whether to print the progress, or an observer.

        Returns:
            The verdict: a `ControlVerdict` for a study of agents that act.

        Raises:
            CalibError: The data is wrong, or the machine cannot run the step.
            KeyboardInterrupt: Ctrl-C. The same call continues from there.

        Examples:
            >>> from calib_rl._study import _example_study
            >>> verdict = _example_study().run(progress=False)
            >>> list(verdict.settings)
            ['PIT300']
        """
        # A study of acting agents consists of one step.
        if self._job.is_of_acting_agents:
            return self.control(progress=progress)
        return self._verdict(*self._job.run(observer(progress)))

    def _step(self, name: str, progress: bool | Observer) -> None:
        self._job.step(name, observer(progress))

    def _verdict(self, summary: str, negative: bool) -> Verdict:
        evaluate, sweep, report = (Path(self._job.path(name)) for name in ("evaluate", "sweep", "report"))
        return Verdict(evaluate, sweep, report, json.loads(summary), negative)

    def __repr__(self) -> str:
        return f"<calib_rl.Study: {self.path}, results in {self.results}>"


@functools.cache
def _example_study() -> Study:
    """Returns a small study of a simulated plant in a temporary folder, for examples. It runs in a second."""
    study = Study(
        path=Path(tempfile.mkdtemp()) / "study.toml",
        simulate={"days": 2, "channels": 6, "period_secs": 60},
        data={"path": "plant", "train_fraction": 0.7},
        agent={"value_function": "linear", "gamma": 0.8, "batch_size": 16},
        rollout={"start": "random", "steps": 100},
        sweep={
            "sensors": ["PIT300"],
            "steps": 300,
            "online_runs": 2,
            "member_runs": 1,
            "log_replay_runs": 2,
            "grid": {"learning_rate": [1e-3, 1e-2]},
        },
    )
    study.simulate(progress=False)
    return study


@functools.cache
def _example_acting_study() -> Study:
    """Returns a small study of agents that act, in a temporary folder, for examples."""
    from ._acting import _example_log
    from ._functions import build_model

    folder = Path(tempfile.mkdtemp())
    build_model(_example_log(), folder, actions=["valve"], reward="reward", progress=False)
    quick = {"control.models": ["neighbors"], "control.steps": 400, "control.grid": {"step_size": [0.01, 0.3]}}
    return Study(folder / "study.toml", set=quick)


def _overrides(given: Mapping[str, Any] | Sequence[str]) -> list[str]:
    if isinstance(given, str):
        return [given]
    if not isinstance(given, Mapping):
        return [str(text) for text in given]
    return [f"{key}={_calib.to_toml_value(value, key)}" for key, value in given.items()]


def write_study(path: Path, text: str) -> None:
    """Write the file, but never replace another one."""
    if _holds(path, text):
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        unfinished.write_bytes(text.encode())
        try:
            # A hard link never replaces a file, not even one that another process has just written.
            os.link(unfinished, path)
        except FileExistsError:
            _holds(path, text)
        except OSError:
            # Some file systems have no hard links.
            os.replace(unfinished, path)
    finally:
        unfinished.unlink(missing_ok=True)


def _holds(path: Path, text: str) -> bool:
    """Whether the file exists and holds this text.

    Raises:
        FileExistsError: The file holds something else.
    """
    if not os.path.lexists(path):
        return False
    if not path.is_file() or path.read_bytes() != text.encode():
        raise FileExistsError(f"{path} holds another study; remove it, choose another path, or lay keys over it with set=")
    return True
