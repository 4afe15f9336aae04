"""Which settings of an agent of one's own to deploy."""

from __future__ import annotations

import hashlib
import html
import inspect
import itertools
import json
import os
import pickle
import queue
import subprocess
import sys
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import numpy as np

from . import _calib
from ._acting import ActionModel, acting_model
from ._checks import LARGEST_SEED, position, whole
from ._errors import CalibError
from ._kinds import ModelKind
from ._verdict import frame_of

if TYPE_CHECKING:
    from ._tune_unit import Unit

Setting = dict[str, Any]
Grid = Mapping[str, Sequence[Any]] | Sequence[Mapping[str, Any]]

_RESAMPLES = 1000
# What a result follows from beside what is in its key.
_FORMAT = 2


@dataclass(frozen=True)
class Failure:
    """A setting that failed, and is not in the verdict. `Tuned.failures` has them.

    Examples:
        >>> failure = Failure({"gamma": 2.0}, 0, 0, "make_agent", "ValueError: gamma", "")
        >>> print(failure)
        gamma=2 failed in ensemble member 0, run 0, in make_agent: ValueError: gamma; see that make_agent(env, **setting) can be called with it
    """

    setting: Setting
    """The setting."""
    member: int
    """The member in which it failed first."""
    run: int
    """The run there."""
    place: str
    """``"make_agent"``, ``"learn"``, or ``"process"``."""
    error: str
    """What was raised."""
    trace: str
    """Where, as Python tells it."""

    def __str__(self) -> str:
        remedy = {
            "make_agent": "see that make_agent(env, **setting) can be called with it",
            "learn": "see to the agent, or leave the setting out",
            "process": "give it less memory or fewer processes=, or leave the setting out",
        }[self.place]
        return f"{label(self.setting)} failed in ensemble member {self.member}, run {self.run}, in {self.place}: {self.error}; {remedy}"


@dataclass(frozen=True)
class Tuned:
    """What `tune` found. ``print`` shows the advice, `why` all reasons, and a notebook shows a table too.

    Examples:
        >>> from calib_rl._tune import label
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
    verdict: dict[str, Any]
    """All figures, as ``calib control --json`` has them under ``verdict``, with settings by their place in `settings`."""
    runs: list[dict[str, Any]] = field(repr=False)
    """Every setting in every member and run: `setting`, `kind`, `member`, `run`, `mean_return`, `episodes`, `terminals`, `uncovered`, and the `returns` of its episodes."""

    @property
    def is_supported(self) -> bool:
        """Whether the log supports the choice."""
        return self.chosen is not None and not self.doubts

    def why(self) -> list[str]:
        """The advice with all reasons, what to do about each, and the evidence.

        Returns:
            Lines of text, the first two of which are those of `advice`.

        Examples:
            >>> print(*tuned.why(), sep="\\n")  # doctest: +SKIP
        """
        return list(self.verdict.get("why", self.advice))

    def frame(self) -> Any:
        """The settings, best first.

        Returns:
            A frame with the columns `setting`, `mean_rank`, `worst_rank`, `mean_return`, `uncovered` and `chosen_again`.
        """
        rows = self._rows()
        columns: dict[str, list[Any]] = {name: [row[name] for row in rows] for name in (rows[0] if rows else {})}
        return frame_of(columns)

    def runs_frame(self) -> Any:
        """Every setting in every member and run.

        Returns:
            `runs` as a frame, without the returns of episodes.
        """
        names = ["setting", "kind", "member", "run", "mean_return", "episodes", "terminals", "uncovered"]
        return frame_of({name: [label(run[name]) if name == "setting" else run[name] for run in self.runs] for name in names})

    def report(self, path: str | os.PathLike[str]) -> Path:
        """Write what was found as one HTML page that loads nothing from anywhere.

        Args:
            path: The file. One that is there is replaced, and folders above it are made.

        Returns:
            The path.

        Raises:
            CalibError: It cannot be written.
            ValueError: Every setting failed, so that there is nothing to show.

        Examples:
            >>> tuned.report("tuned.html")  # doctest: +SKIP
            PosixPath('tuned.html')
        """
        if self.chosen is None:
            raise ValueError("every setting failed: `failures` says why")
        kinds = list(dict.fromkeys(run["kind"] for run in self.runs))
        members = sorted({run["member"] for run in self.runs})
        returns: dict[tuple[str, str, int], list[float]] = {}
        for run in self.runs:
            returns.setdefault((label(run["setting"]), run["kind"], run["member"]), []).append(run["mean_return"])

        def mean(setting: str, kind: str, member: int) -> float | None:
            value = float(np.mean(returns.get((setting, kind, member), [np.nan])))
            return value if np.isfinite(value) else None

        roles = {label(self.default): "default"} if self.default is not None else {}
        settings = [
            {
                **row,
                "name": row["setting"],
                "mean_return": row["mean_return"] if np.isfinite(row["mean_return"]) else None,
                "role": "chosen" if row["setting"] == label(self.chosen) else roles.get(row["setting"], ""),
                "returns": [[mean(row["setting"], kind, member) for member in members] for kind in kinds],
            }
            for row in self._rows()
        ]
        runs = len(self.runs) // max(1, len(self.settings) * len(kinds) * len(members))
        page = {
            "title": "Agents that act",
            "subtitle": f"{len(settings)} settings in {len(members)} ensemble members of {len(kinds)} kinds of models, {runs} {'run' if runs == 1 else 'runs'} each",
            "decision": self.verdict["decision"],
            "findings": self.verdict["findings"],
            "warnings": [*self.doubts, *map(str, self.failures)],
            "settings": settings,
            "kinds": kinds,
            "command": f"tuned.report({os.fspath(path)!r})",
        }
        _calib.write_tuned_page(os.fspath(path), json.dumps(page))
        return Path(path)

    def _rows(self) -> list[dict[str, Any]]:
        if not self.verdict:
            return []
        selection, again = self.verdict["selection"], self.verdict["chosen_of_resamples"]
        rows = [
            {
                "setting": label(setting),
                "mean_rank": selection["mean_ranks"][place],
                "worst_rank": selection["worst_ranks"][place],
                "mean_return": selection["mean_errors"][place],
                "uncovered": _uncovered(self.verdict["coverage"][place]),
                "chosen_again": again[place] / max(1, sum(again)),
            }
            for place, setting in enumerate(self.settings)
        ]
        return sorted(rows, key=lambda row: (row["setting"] != label(self.chosen or {}), row["mean_rank"], row["worst_rank"]))

    def __str__(self) -> str:
        first, *rest = self.advice
        lines = [first, *(f"    {line}" for line in rest), *(f"note: {failure}" for failure in self.failures)]
        return "\n".join([*lines, *(["all reasons: .why()"] if self.verdict else [])])

    def _repr_html_(self) -> str:
        items = "".join(f"<li>{html.escape(line)}</li>" for line in self.advice[1:])
        failed = "".join(f"<li>{html.escape(str(failure))}</li>" for failure in self.failures)
        rows = self._rows()
        cells = "".join("<tr>" + "".join(f"<td>{html.escape(_short(value))}</td>" for value in row.values()) + "</tr>" for row in rows)
        header = "".join(f"<th>{html.escape(name)}</th>" for name in (rows[0] if rows else {}))
        return f"<p><b>{html.escape(self.advice[0])}</b></p><ul>{items}{failed}</ul><table><tr>{header}</tr>{cells}</table>"


def tune(
    make_agent: Callable[..., Any],
    grid: Grid,
    model: ActionModel,
    *,
    total_timesteps: int,
    default: Setting | None = {},  # noqa: B006 - it is not changed
    runs: int = 1,
    members: Iterable[int] | None = None,
    kinds: Sequence[ModelKind] = ("neighbors", "increments", "network"),
    folder: str | os.PathLike[str] | None = None,
    processes: int | None = None,
    halving: int | None = None,
    seed: int = 0,
    environment: Mapping[str, Any] | None = None,
    most_uncovered: float | None = None,
    fewest_terminals: int | None = None,
    progress: bool = False,
) -> Tuned:
    """Let an agent of one's own learn with every setting in every member of a model, and recommend a setting.

    A unit is one setting in one run of one member: a new agent, which learns for ``total_timesteps`` steps. What counts is its mean return an episode, learning
    included. All settings meet the same chance: the same seeds of the environment, of NumPy, of Python, and of PyTorch where it is imported.

    Args:
        make_agent: ``make_agent(env, **setting)`` returns anything with ``learn(total_timesteps)``, such as an algorithm of Stable-Baselines3. If it has an
            argument ``seed``, it is given one. Other processes are given the function by value where ``cloudpickle`` is installed, else by its module and name.
        grid: Values of each argument, all combinations of which are settings, or a list of settings.
        model: The model with actions.
        total_timesteps: Steps of each agent.
        default: What would be deployed without a choice. It is compared too. ``{}`` is the agent's own default, ``None`` is nothing.
        runs: Runs of each setting in each member.
        members: Positions of members. All, unless given.
        kinds: Kinds of models that agents learn in, of which every member is made. See ``kind`` of `calib_rl.gym.make`. Unlike kinds err in unlike ways, and the
            choice is the best by mean rank over the members of all. One kind alone takes a third of the time.
        folder: Where the result of each unit is kept: the same call goes on from there when it was stopped, and makes only what is missing. Unless given, nothing is kept.
        processes: Processes. As many as there are processors, unless given. With 1 everything happens in this one.
        halving: Leave out all but one in so many settings after a part of the steps, in up to three rounds. For example, 3 keeps a third after a ninth of
            the steps, and a ninth after a third. The default stays.
        seed: Root of all chance.
        environment: Further arguments of `calib_rl.gym.make`, such as ``{"observe": ["level"], "timeout": 200}``.
        most_uncovered: Largest share of the steps that the log may leave uncovered. The study's, unless given.
        fewest_terminals: Fewest terminals of the log, if it has a column of them. The study's, unless given.
        progress: Whether to print what is done.

    Returns:
        The verdict. It says *deploy* only where the log supports the choice. `Tuned.doubts` are the reasons why it does not. Settings that fail are in
        `Tuned.failures`, and the others go on without them.

    Raises:
        CalibError: The log of the model has one action, so that there is nothing to choose.
        ValueError: There is no setting, or one that comes twice. An argument is outside its range.
        TypeError: ``model`` is no `ActionModel`. ``make_agent`` cannot be given to other processes.
        KeyboardInterrupt: Ctrl-C. With a ``folder`` the same call goes on.

    Examples:
        >>> import tempfile
        >>> import calib_rl
        >>> from calib_rl._acting import _example_log
        >>> class Constant:
        ...     def __init__(self, env, action=1):
        ...         self.env, self.action = env, action
        ...     def learn(self, total_timesteps):
        ...         over = True
        ...         for _ in range(total_timesteps):
        ...             if over:
        ...                 self.env.reset()
        ...             _, _, terminated, truncated, _ = self.env.step(self.action)
        ...             over = terminated or truncated
        >>> model = calib_rl.build_model(_example_log(), tempfile.mkdtemp(), actions=["valve"], reward="reward", timeout=50)
        >>> tuned = calib_rl.tune(Constant, {"action": [0, 2]}, model, total_timesteps=500, processes=1)
        >>> tuned.chosen, tuned.default
        ({}, {})
    """
    model = acting_model(model)
    if (told := model._native.only_action) is not None:
        raise CalibError(told)
    environment = dict(environment or {})
    settings = _settings(grid, default)
    each = [position(member, "members") for member in (range(model.members) if members is None else members)]
    if not each or max(each) >= model.members or len(set(each)) != len(each):
        raise ValueError(f"members is {each}; the model has {model.members}, from 0 on, each once")
    if not kinds or isinstance(kinds, str) or not set(kinds) <= set(get_args(ModelKind)) or len(set(kinds)) != len(kinds):
        raise ValueError(f"kinds is {kinds!r}, expected a list of 'neighbors', 'increments' and 'network', each once")
    if "kind" in environment:
        raise ValueError("environment has a kind; give the kinds of models by kinds=")
    work = _Work(
        make_agent=make_agent,
        model=model,
        settings=settings,
        members=each,
        kinds=list(kinds),
        runs=whole(runs, "runs", 1),
        seed=whole(seed, "seed", most=LARGEST_SEED),
        environment=environment,
        folder=None if folder is None else Path(folder),
        processes=whole(processes, "processes", 1) if processes is not None else os.cpu_count() or 1,
        progress=progress,
    )
    steps = whole(total_timesteps, "total_timesteps", 1)
    limits = {"most_uncovered": most_uncovered, "fewest_terminals": fewest_terminals}
    alive, halved = list(range(len(settings))), []
    for part in _parts(halving, len(settings)):
        results = work.run_all(alive, max(1, steps // part))
        alive = [place for place in alive if place not in work.failed]
        if part == 1 or not alive:
            break
        verdict = work.judged(alive, results, default, limits)
        ranks = verdict["selection"]
        order = sorted(range(len(alive)), key=lambda place: (ranks["mean_ranks"][place], ranks["worst_ranks"][place]))
        kept = {alive[place] for place in order[: max(1, -(-len(alive) // (halving or 1)))]}
        kept |= {place for place in alive if settings[place] == default}
        halved.append((max(1, steps // part), [settings[place] for place in alive if place not in kept]))
        alive = [place for place in alive if place in kept]
    failures = [work.failed[place] for place in sorted(work.failed)]
    if not alive:
        advice = ["Deploy nothing: every setting failed."]
        return Tuned([], None, default, advice, [], failures, halved, {}, [])
    verdict = work.judged(alive, results, default, limits, work.constants(max(1, steps)))
    doubts = verdict.pop("reasons")
    compared = [settings[place] for place in alive]
    chosen = compared[verdict["chosen"]]
    told = [
        {
            "setting": settings[place],
            **{name: unit["run"][name] for name in ("kind", "member", "run", "mean_return", "episodes", "terminals")},
            "uncovered": _uncovered(unit["run"]["coverage"]),
            "returns": unit["returns"],
        }
        for place, units in results.items()
        if place in alive
        for unit in units
    ]
    advice = verdict.pop("summary")
    return Tuned(compared, chosen, default, advice, doubts, failures, halved, verdict, told)


def label(setting: Setting) -> str:
    """A setting in a line."""
    return " ".join(f"{name}={_short(value)}" for name, value in setting.items()) or "the agent's own default"


def _short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _uncovered(coverage: dict[str, int]) -> float:
    return (coverage["missing"] + coverage["far"]) / max(1, coverage["steps"])


def _settings(grid: Grid, default: Setting | None) -> list[Setting]:
    if isinstance(grid, Mapping):
        for name, values in grid.items():
            if isinstance(values, str) or not isinstance(values, Iterable):
                raise TypeError(f"grid[{name!r}] is {values!r}, expected a list of values")
        settings = [dict(zip(grid, values)) for values in itertools.product(*grid.values())]
    else:
        settings = [dict(setting) for setting in grid]
    if not settings or settings == [{}]:
        raise ValueError("the grid has no setting; give values of an argument of make_agent, such as {'gamma': [0.9, 0.99]}")
    for place, setting in enumerate(settings):
        if setting in settings[:place]:
            raise ValueError(f"the grid has {label(setting)} twice; remove one")
    if default is not None and default not in settings:
        # Of settings that come to the same the first is chosen.
        settings.insert(0, dict(default))
    return settings


def _parts(halving: int | None, settings: int) -> list[int]:
    """The parts of all steps after which settings are left out; 1 at last."""
    if halving is None:
        return [1]
    factor, parts = whole(halving, "halving", 2), [1]
    while len(parts) < 3 and settings > factor ** len(parts):
        parts.append(factor ** len(parts))
    return parts[::-1]


@dataclass
class _Work:
    """All units of a call, and what came of them."""

    make_agent: Callable[..., Any]
    model: ActionModel
    settings: list[Setting]
    members: list[int]
    kinds: list[ModelKind]
    runs: int
    seed: int
    environment: dict[str, Any]
    folder: Path | None
    processes: int
    progress: bool
    failed: dict[int, Failure] = field(default_factory=dict)

    def run_all(self, places: list[int], steps: int) -> dict[int, list[dict[str, Any]]]:
        """What came of these settings in every run of every member."""
        from ._tune_unit import Unit

        units: list[Unit] = []
        for kind, member, run in itertools.product(self.kinds, self.members, range(self.runs)):
            # The same chance for all settings, and for all kinds of models.
            sequence = np.random.SeedSequence([self.seed, member, run])
            seed = int(sequence.generate_state(1, np.uint64)[0])
            units += [Unit(self.settings[place], place, kind, member, run, seed, steps) for place in places]
        known = {place: unit for place, unit in enumerate(map(self.kept, units)) if unit is not None}
        missing = [place for place in range(len(units)) if place not in known]
        if self.progress:
            print(f"{len(places)} settings x {len(self.members)} ensemble members of {', '.join(self.kinds)} x {self.runs} runs of {steps:,} steps, {len(known)} training runs are there already", file=sys.stderr)
        self._run_missing(units, missing, known)
        results: dict[int, list[dict[str, Any]]] = {place: [] for place in places}
        for place, unit in enumerate(units):
            came = known.get(place)
            if came is None:
                continue
            if "error" in came:
                failure = Failure(unit.setting, unit.member, unit.run, came["place"], came["error"], came["trace"])
                self.failed.setdefault(unit.candidate, failure)
            else:
                results[unit.candidate].append(came)
        return results

    def _run_missing(self, units: list[Unit], missing: list[int], known: dict[int, dict[str, Any]]) -> None:
        from ._tune_unit import run_unit

        failed: set[int] = set()
        lock = threading.Lock()
        done = 0

        def end(place: int, came: dict[str, Any]) -> None:
            nonlocal done
            with lock:
                known[place] = came
                done += 1
                if "error" in came:
                    failed.add(units[place].candidate)
                else:
                    self._keep(units[place], came)
                if self.progress:
                    print(f"{done} of {len(missing)}: {label(units[place].setting)}, {units[place].kind}, member {units[place].member}", file=sys.stderr)

        if min(self.processes, len(missing)) <= 1:
            for place in missing:
                # A setting that failed once is not tried again.
                if units[place].candidate not in failed:
                    end(place, run_unit(self.make_agent, self.model, units[place], self.environment))
            return
        waiting: queue.SimpleQueue[int] = queue.SimpleQueue()
        for place in missing:
            waiting.put(place)
        message = _message(self.make_agent, self.model, self.environment)
        stop = threading.Event()
        crashes: list[BaseException] = []

        def serve() -> None:
            worker = None
            try:
                while not stop.is_set():
                    try:
                        place = waiting.get_nowait()
                    except queue.Empty:
                        return
                    if units[place].candidate in failed:
                        continue
                    worker = worker or _Worker(message)
                    workers.append(worker)
                    came = worker.run(units[place])
                    if stop.is_set():
                        return
                    if came is None:
                        came = {"place": "process", "error": f"the process ended with {worker.ended()}", "trace": ""}
                        worker = None
                    end(place, came)
            except BaseException as error:  # told to whoever called
                crashes.append(error)
                stop.set()
            finally:
                if worker is not None:
                    worker.close()

        workers: list[_Worker] = []
        threads = [threading.Thread(target=serve, daemon=True) for _ in range(min(self.processes, len(missing)))]
        for thread in threads:
            thread.start()
        try:
            for thread in threads:
                while thread.is_alive():
                    thread.join(0.2)
        except BaseException:
            stop.set()
            for worker in workers:
                worker.kill()
            raise
        if crashes:
            raise crashes[0]

    def constants(self, steps: int) -> list[dict[str, Any]]:
        """What always taking one action gets in the members of each kind of model, and what random actions get: every agent has to beat both."""
        from .gym import make_vec

        actions, members = len(self.model.actions), len(self.members)
        environment = {**self.environment, "action_space": "discrete", "live": False}
        timeout = environment.get("timeout") or self.model.timeout
        # Members are dealt to walks in turn.
        of_random, of_constant = self.model._native.fixed_walks(self.runs, steps, timeout)
        policies = actions + 1
        policy = np.repeat(np.arange(policies), [*[of_constant * members] * actions, of_random * members])
        count = len(policy)
        member = np.arange(count) % members
        is_random = policy == actions
        drawn = np.random.default_rng(np.random.SeedSequence([self.seed, 2]))
        found = []
        for kind in self.kinds:
            walks = make_vec(self.model, count, members=self.members, kind=kind, **environment)
            walks.reset(seed=int(np.random.SeedSequence([self.seed, 1]).generate_state(1, np.uint32)[0]))
            rewards, episodes, lengths, uncovered = np.zeros(count), np.zeros(count), np.zeros(count), np.zeros(count, np.int64)
            over = np.zeros(count, np.bool_)
            for _ in range(steps):
                taken = np.where(is_random, drawn.integers(actions, size=count), policy)
                _, reward, terminated, truncated, info = walks.step(taken)
                # The step after the end of an episode begins the next one, and is none of it.
                rewards += np.where(over, 0.0, reward)
                uncovered += ~info["covered"] & ~over
                lengths = np.where(over, 0, lengths + 1)
                over = terminated | truncated
                episodes += over
            returns = rewards / np.maximum(episodes + np.where(over, 0, lengths) / timeout, 1.0)
            by_policy = [[float(np.mean(returns[(policy == one) & (member == place)])) for one in range(policies)] for place in range(members)]
            coverage = [{"steps": steps * members * of_constant, "missing": 0, "far": int(uncovered[policy == action].sum())} for action in range(actions)]
            by_action, at_random = [own[:actions] for own in by_policy], [own[actions] for own in by_policy]
            found.append({"kind": kind, "members": by_action, "random": at_random, "coverage": coverage})
        return found

    def judged(
        self,
        places: list[int],
        results: dict[int, list[dict[str, Any]]],
        default: Setting | None,
        limits: dict[str, Any],
        constants: list[dict[str, Any]] | None = None,
    ) -> dict[str, Any]:
        """The verdict about these settings, by their place among them."""
        numbers = {member: number for number, member in enumerate(self.members)}
        runs = [
            {**unit["run"], "candidate": number, "member": numbers[unit["run"]["member"]]}
            for number, place in enumerate(places)
            for unit in results[place]
        ]
        compared = [self.settings[place] for place in places]
        standard = compared.index(default) if default is not None and default in compared else None
        timeout = self.environment.get("timeout") or self.model.timeout
        verdict: dict[str, Any] = json.loads(
            self.model._native.judge(
                json.dumps(runs),
                [label(setting) for setting in compared],
                [[(name, _short(value)) for name, value in setting.items()] for setting in compared],
                standard,
                # It is among the settings, unless it failed.
                default is not None and standard is None,
                timeout,
                limits["most_uncovered"],
                limits["fewest_terminals"],
                _RESAMPLES,
                self.seed,
                json.dumps(constants or []),
                list(self.members),
            )
        )
        return verdict

    def _path(self, unit: Unit) -> Path | None:
        if self.folder is None:
            return None
        manifest = (self.model.path / "manifest.json").read_bytes()
        identity = [
            _FORMAT,
            hashlib.sha256(manifest).hexdigest(),
            _source(self.make_agent),
            {name: repr(value) for name, value in sorted(unit.setting.items())},
            [unit.kind, unit.member, unit.run, unit.seed, unit.steps],
            {name: repr(value) for name, value in sorted(self.environment.items())},
        ]
        name = hashlib.sha256(json.dumps(identity).encode()).hexdigest()[:32]
        return self.folder / f"unit-{name}.json"

    def kept(self, unit: Unit) -> dict[str, Any] | None:
        """What came of a unit, if it was kept."""
        path = self._path(unit)
        if path is None or not path.exists():
            return None
        try:
            came: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        except ValueError:
            return None
        if "run" in came:
            # Another grid may have it in another place.
            came["run"]["candidate"] = unit.candidate
            return came
        return None

    def _keep(self, unit: Unit, came: dict[str, Any]) -> None:
        path = self._path(unit)
        if path is None:
            return
        path.parent.mkdir(parents=True, exist_ok=True)
        unfinished = path.with_name(f".{path.name}.{os.getpid()}.tmp")
        told = {"setting": {name: repr(value) for name, value in unit.setting.items()}, **came}
        unfinished.write_text(json.dumps(told), encoding="utf-8")
        os.replace(unfinished, path)


def _source(make_agent: Callable[..., Any]) -> str:
    """What an agent follows from, as far as it can be told."""
    try:
        return inspect.getsource(make_agent)
    except (OSError, TypeError):
        return getattr(make_agent, "__qualname__", repr(make_agent))


def _packer() -> Callable[[Any], bytes]:
    """Functions of the program itself, and of notebooks, are packed by value where that is possible."""
    try:
        import cloudpickle
    except ImportError:
        return pickle.dumps
    packer: Callable[[Any], bytes] = cloudpickle.dumps
    return packer


def _message(make_agent: Callable[..., Any], model: ActionModel, environment: dict[str, Any]) -> str:
    """What a process is told first."""
    if _packer() is pickle.dumps and getattr(make_agent, "__module__", None) == "__main__":
        raise TypeError(
            "make_agent is defined in the program itself, and other processes cannot import that; install cloudpickle, define it in a module "
            "that can be imported, or take processes=1"
        )
    try:
        packed = _packer()((make_agent, str(model.path), environment))
    except Exception as error:
        raise TypeError(f"make_agent cannot be given to other processes ({error}); see that what it refers to can be pickled, or take processes=1") from error
    text = packed.hex()
    return f"{json.dumps(sys.path)}\n{len(text)}\n{text}\n"


class _Worker:
    """A process that lives one unit after the other."""

    def __init__(self, message: str) -> None:
        # Each unit on one processor, with the same sums whatever else there is to do.
        threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "RAYON_NUM_THREADS"), "1")
        command = [sys.executable, "-c", "from calib_rl._tune_unit import main; main()"]
        path = os.pathsep.join(folder for folder in sys.path if folder)
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, encoding="utf-8", env={**os.environ, **threads, "PYTHONPATH": path}
        )
        self._send(message)

    def _send(self, text: str) -> None:
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(text)
            self._process.stdin.flush()
        except OSError:
            pass  # it has ended, which its answer tells

    def run(self, unit: Unit) -> dict[str, Any] | None:
        """What came of a unit. ``None`` if the process ended."""
        try:
            text = _packer()(vars(unit)).hex()
        except Exception as error:
            return {"place": "make_agent", "error": f"a value of the setting cannot be given to other processes: {error}", "trace": ""}
        self._send(text + "\n")
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        came: dict[str, Any] | None = json.loads(line) if line.endswith("\n") else None
        return came

    def ended(self) -> str:
        """How it ended."""
        code = self._process.wait()
        return f"signal {-code}, as where memory runs out" if code < 0 else f"exit code {code}"

    def close(self) -> None:
        """Let it end."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.close()
        except OSError:
            pass
        self._process.wait()

    def kill(self) -> None:
        """End it now."""
        self._process.kill()
