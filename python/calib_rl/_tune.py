"""Choice of the setting of a user's own agent."""

from __future__ import annotations

import contextlib
import inspect
import itertools
import json
import os
import queue
import sys
import threading
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, get_args

import numpy as np

from ._acting import ActionModel, acting_model, require_own_folder
from ._checks import LARGEST_SEED, position, share, whole
from ._errors import CalibError, CalibWarning
from ._kinds import ModelKind
from ._tune_kept import Kept
from ._tune_settings import Failure, Grid, Names, Setting, counted, settings_of, short
from ._tune_workers import Worker, message_for
from ._tuned import Tuned, uncovered

if TYPE_CHECKING:
    from ._tune_unit import Unit

_RESAMPLES = 1000


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
    """Train your own agent with every setting in every ensemble member of a model, and recommend a setting.

    A unit is one setting in one run of one ensemble member: a new agent, which learns for ``total_timesteps`` steps. It is judged by its mean return per episode, including the learning
    phase. All settings have the same seeds of the environment, of NumPy, of Python, and of PyTorch if it is imported.

    Args:
        make_agent: ``make_agent(env, **setting)`` returns anything with ``learn(total_timesteps)``, such as an algorithm of Stable-Baselines3. If it has an
            argument ``seed``, it gets one. Every agent gets a copy of its setting. Other processes get the function by value if ``cloudpickle`` is installed, and otherwise by its module and name.
        grid: Values of each argument, whose combinations are the settings, or a list of settings.
        model: The model with actions.
        total_timesteps: Number of steps of each agent.
        default: The setting that would be deployed without a choice. It is compared too. ``{}`` is the agent's own default, ``None`` is no setting.
        runs: Number of runs of each setting in each ensemble member.
        members: Positions of ensemble members. Default: all.
        kinds: Kinds of models that agents learn in, each with every ensemble member. See ``kind`` of `calib_rl.gym.make`. Different kinds have different errors, and the
            choice is the best by mean rank over the ensemble members of all kinds. A single kind needs a third of the time.
        folder: The folder in which the result of each unit is stored. After an interruption, the same call runs only the missing units. A result belongs to
            this call if the model, the setting, ``environment``, and ``make_agent`` with all that it refers to in the program's own code are equal by
            value. If a value cannot be compared, such as a lock, Python warns and stores no results. Default: nothing is stored.
        processes: Number of processes. Default: the number of processors. With 1 everything runs in this process.
        halving: Keep only one in N settings after a part of the steps, in up to three rounds. For example, 3 keeps a third after a ninth of
            the steps, and a ninth after a third. The default is always kept.
        seed: Seed of all random numbers.
        environment: Further arguments of `calib_rl.gym.make`, such as ``{"observe": ["level"], "timeout": 200}``.
        most_uncovered: Largest share of the steps that the log may leave uncovered, from 0 to 1. Default: as in the study.
        fewest_terminals: Minimum number of terminals in the log, if it has a column of terminals. Default: as in the study.
        progress: Whether to print the progress.

    Returns:
        The verdict. It says *deploy* only if the log supports the choice. `Tuned.doubts` are the reasons against it. Settings that fail are in
        `Tuned.failures`, and the others continue without them.

    Raises:
        CalibError: The log of the model has only one action, so that there is nothing to choose. The folder is a file, cannot be made, or cannot be
            written to where results are missing. Several processes need networks, and these cannot be stored. The folder of the model holds another
            model than when this one was opened, or none, and several processes need it.
        ValueError: There is no setting, or one occurs twice. An argument is outside its range. No environment can be made with ``environment``.
        TypeError: An argument is of another type. ``make_agent`` cannot be given to other processes.
        KeyboardInterrupt: Ctrl-C. With a ``folder`` the same call continues.

    Warns:
        CalibWarning: Results are not kept, because a value cannot be compared. Or stored results are damaged or were edited, and are made again.

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
    if not callable(make_agent):
        raise TypeError(_uncallable(make_agent))
    settings, standard = settings_of(grid, default)
    model = acting_model(model)
    if (told := model._native.only_action) is not None:
        raise CalibError(told)
    number = whole(processes, "processes", 1) if processes is not None else os.cpu_count() or 1
    require_own_folder(model, number > 1)
    steps = whole(total_timesteps, "total_timesteps", 1)
    limits = {
        "most_uncovered": None if most_uncovered is None else share(most_uncovered, "most_uncovered"),
        "fewest_terminals": None if fewest_terminals is None else whole(fewest_terminals, "fewest_terminals"),
    }
    parts, each, kinds = _parts(halving, len(settings)), _members(members, model), _kinds(kinds)
    work = _Work(
        make_agent=make_agent,
        model=model,
        settings=settings,
        default=standard,
        members=each,
        kinds=kinds,
        runs=whole(runs, "runs", 1),
        seed=whole(seed, "seed", most=LARGEST_SEED),
        environment=_environment(environment, model, kinds),
        processes=number,
        progress=progress,
    )
    if folder is not None:
        work.kept = Kept(folder, make_agent, model, settings, work.labels, work.environment)
    alive, halved, alike_so_far = list(range(len(settings))), [], True
    for part in parts:
        part_steps = max(1, steps // part)
        results = work.run_all(alive, part_steps)
        alive = [place for place in alive if place not in work.failed]
        # Settings that are left may be alike although others were not, such as a default and a setting that spells it out.
        every_run = _runs(settings, alive, results)
        alike_so_far &= not work.failed and _are_alike(every_run, len(alive))
        if part == 1 or not alive:
            break
        verdict = work.judged(alive, results, limits, part_steps)
        ranks = verdict["selection"]
        order = sorted(range(len(alive)), key=lambda place: (ranks["mean_ranks"][place], ranks["worst_ranks"][place]))
        kept = {alive[place] for place in order[: max(1, -(-len(alive) // (halving or 1)))]}
        kept |= {place for place in alive if place == standard}
        halved.append((part_steps, [settings[place] for place in alive if place not in kept]))
        alive = [place for place in alive if place in kept]
    shown = None if standard is None else settings[standard]
    failures = [work.failed[place] for place in sorted(work.failed)]
    if not alive:
        advice = ["Deploy nothing: every setting failed."]
        return Tuned([], None, shown, advice, [], failures, halved, {}, [])
    verdict = work.judged(alive, results, limits, steps, work.constants(steps))
    doubts, advice = verdict.pop("reasons"), verdict.pop("summary")
    compared = [settings[place] for place in alive]
    remarks = _cut_off(every_run)
    if alike_so_far:
        alike = _alike(len(settings), steps, work)
        doubts.insert(0, alike)
        # Before the other reasons: after the headline and what the choice gets, and in `why` after what the headline means.
        advice[2:] = [alike, *advice[2:4]]
        verdict["why"].insert(3, alike)
    verdict["why"] += remarks
    return Tuned(compared, compared[verdict["chosen"]], shown, [*advice, *remarks], doubts, failures, halved, verdict, every_run)


def _uncallable(make_agent: object) -> str:
    """Returns the error about a ``make_agent`` that cannot be called."""
    kind = type(make_agent).__name__
    article = "an" if kind[0].lower() in "aeiou" else "a"
    return (
        f"make_agent is {article} {kind}, expected a function or a class that tune can call as make_agent(env, **setting); the order is "
        "tune(make_agent, grid, model)"
    )


def _runs(settings: list[Setting], places: list[int], results: dict[int, list[dict[str, Any]]]) -> list[dict[str, Any]]:
    """Returns the rows of `Tuned.runs` for the settings in these places."""
    return [
        {
            "setting": settings[place],
            "place": number,
            **{name: unit["run"][name] for name in ("kind", "member", "run", "mean_return", "episodes", "terminals")},
            "cut_off": unit["cut_off"],
            "uncovered": uncovered(unit["run"]["coverage"]),
            "returns": unit["returns"],
            "conduct": unit.get("conduct"),
        }
        for number, place in enumerate(places)
        for unit in results[place]
    ]


def _are_alike(runs: list[dict[str, Any]], settings: int) -> bool:
    """Whether all settings have the same returns of episodes in every run."""
    got: dict[tuple[str, int, int], set[str]] = {}
    for run in runs:
        got.setdefault((run["kind"], run["member"], run["run"]), set()).add(json.dumps([run["mean_return"], run["returns"]]))
    return settings > 1 and all(len(different) == 1 for different in got.values())


def _alike(settings: int, steps: int, work: _Work) -> str:
    """Returns the doubt about settings that all have the same returns."""
    alike = (
        f"all {settings} settings got the same returns in every training run: either no setting changes what the agent does, or agents do not begin "
        f"to learn within total_timesteps={steps}; raise it above n_steps (2,048 in PPO) and learning_starts, or lower these"
    )
    space = work.environment.get("action_space")
    if space != "box" and type(space).__name__ != "Box":
        return alike
    # An agent that begins around 0 with a spread of 1 reaches all of such a range. (Our choice.)
    ranges = ((name, low, high) for name, (low, high) in work.model.action_columns.items() if not (-2.0 <= low <= -0.5 and 0.5 <= high <= 2.0))
    if (wide := next(ranges, None)) is None:
        return alike
    name, low, high = wide
    return (
        f"{alike}; or what the agent sets is always nearest to the same action, as that of PPO, which begins around 0 with a spread of 1, where {name} goes "
        f"from {short(low)} to {short(high)}: wrap env in gymnasium.wrappers.RescaleAction(env, -1.0, 1.0) in make_agent"
    )


def _cut_off(runs: list[dict[str, Any]]) -> list[str]:
    """Returns a remark about episodes that agents reset before their end, or an empty list."""
    cut, whole_ones = sum(run["cut_off"] for run in runs), sum(run["episodes"] for run in runs)
    if cut == 0:
        return []
    return [f"Reset before their end: {cut:,} of {cut + whole_ones:,} episodes. Each of them counts by its share of the timeout, with its rewards."]


def _members(members: Any, model: ActionModel) -> list[int]:
    if members is not None and (isinstance(members, str) or not isinstance(members, Iterable)):
        raise TypeError(f"members is {members!r}, expected a list of positions, such as [0, 1] or range(2)")
    each = [position(member, "members") for member in (range(model.members) if members is None else members)]
    if not each or max(each) >= model.members or len(set(each)) != len(each):
        raise ValueError(f"members is {each}; the model has {model.members}, from 0 on, each once")
    return each


def _kinds(kinds: Any) -> list[ModelKind]:
    given = [] if isinstance(kinds, str) or not isinstance(kinds, Iterable) else list(kinds)
    if not given or any(kind not in get_args(ModelKind) for kind in given) or len(set(given)) != len(given):
        raise ValueError(f"kinds is {kinds!r}, expected a list of 'neighbors', 'increments' and 'network', each once")
    return given


def _environment(environment: Any, model: ActionModel, kinds: Sequence[ModelKind]) -> dict[str, Any]:
    """Returns valid arguments of the environment. Checking them first prevents the failure of every setting."""
    from .gym import make

    if environment is not None and not isinstance(environment, Mapping):
        raise TypeError(f"environment is {environment!r}, expected arguments of calib_rl.gym.make, such as {{'timeout': 200}}")
    given = dict(environment or {})
    if "kind" in given:
        raise ValueError("environment has a kind; give the kinds of models by kinds=")
    # A model with actions refuses the left-out arguments.
    known = sorted(set(inspect.signature(make).parameters) - {"model", "member", "kind", "reward", "max_steps"})
    for name in given:
        if name not in known:
            raise ValueError(f"environment has {name!r}, expected arguments of calib_rl.gym.make: {', '.join(known)}")
    if given.get("live") and "network" in kinds:
        raise ValueError(
            "environment: live searches among recorded settings, and a network knows levels alone; give kinds=['neighbors', 'increments'], or leave live out"
        )
    # Making a network environment would train networks, and checks nothing more.
    try:
        make(model, **given).close()
    except (TypeError, ValueError, IndexError) as error:
        raise ValueError(f"environment: {error}") from error
    return given


def _parts(halving: int | None, settings: int) -> list[int]:
    """Returns the divisor of all steps for each round of the halving. The last one is 1."""
    if halving is None:
        return [1]
    factor, parts = whole(halving, "halving", 2), [1]
    while len(parts) < 3 and settings > factor ** len(parts):
        parts.append(factor ** len(parts))
    return parts[::-1]


@dataclass
class _Work:
    """All units of a call, and their results."""

    make_agent: Callable[..., Any]
    model: ActionModel
    settings: list[Setting]
    default: int | None
    members: list[int]
    kinds: list[ModelKind]
    runs: int
    seed: int
    environment: dict[str, Any]
    processes: int
    progress: bool
    kept: Kept | None = None
    failed: dict[int, Failure] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.labels = Names(self.settings).labels

    def run_all(self, places: list[int], steps: int) -> dict[int, list[dict[str, Any]]]:
        """Returns the results of these settings in every run of every ensemble member."""
        from ._tune_unit import Unit

        units: list[Unit] = []
        for kind, member, run in itertools.product(self.kinds, self.members, range(self.runs)):
            # All settings and all kinds of models have the same seed.
            sequence = np.random.SeedSequence([self.seed, member, run])
            seed = int(sequence.generate_state(1, np.uint64)[0])
            # Every setting shows the same run.
            is_recorded = member == self.members[0] and run == 0
            units += [Unit(self.settings[place], place, kind, member, run, seed, steps, is_recorded) for place in places]
        known = self.kept.read_all(units) if self.kept is not None else {}
        missing = [place for place in range(len(units)) if place not in known]
        if missing and self.kept is not None:
            self.kept.require_writable()
        if self.progress:
            members = f"{counted(len(self.members), 'ensemble member')} of {', '.join(self.kinds)}"
            runs = f"{counted(self.runs, 'run')} of {counted(steps, 'step')}"
            there = f"{counted(len(known), 'training run')} {'is' if len(known) == 1 else 'are'} there already"
            print(f"{counted(len(places), 'setting')} x {members} x {runs}, {there}", file=sys.stderr)
        self._run_missing(units, missing, known)
        results: dict[int, list[dict[str, Any]]] = {place: [] for place in places}
        for place, unit in enumerate(units):
            came = known.get(place)
            if came is None:
                continue
            if "error" in came:
                what = came["place"], came["error"], came["trace"]
                failure = Failure(unit.setting, unit.member, unit.run, *what, self.labels[unit.candidate], came.get("remedy", ""))
                self.failed.setdefault(unit.candidate, failure)
            else:
                results[unit.candidate].append(came)
        return results

    def _run_missing(self, units: list[Unit], missing: list[int], known: dict[int, dict[str, Any]]) -> None:
        from ._tune_unit import run_unit
        from .gym import make

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
                elif self.kept is not None:
                    self.kept.write(units[place], came)
                if self.progress:
                    which = f"{self.labels[units[place].candidate]}, {units[place].kind}, member {units[place].member}"
                    print(f"{done} of {len(missing)}: {which}{', failed' if 'error' in came else ''}", file=sys.stderr)

        if min(self.processes, len(missing)) <= 1:
            for place in missing:
                # A setting that failed once is not tried again.
                if units[place].candidate not in failed:
                    end(place, run_unit(self.make_agent, self.model, units[place], self.environment))
            return
        if any(units[place].kind == "network" for place in missing):
            # Processes read the networks that this one trains. If that fails, it fails there too, and is told with their settings.
            # The model is opened again, because they see what is stored, and not what this one has in memory.
            model = ActionModel.open(self.model.path)
            with contextlib.suppress(CalibError), warnings.catch_warnings():
                warnings.simplefilter("ignore", CalibWarning)
                make(model, kind="network", **self.environment).close()
            if (told := model._native.unstored_networks) is not None:
                raise CalibError(f"{told}, here in every process; or take processes=1")
        waiting: queue.SimpleQueue[int] = queue.SimpleQueue()
        for place in missing:
            waiting.put(place)
        message = message_for(self.make_agent, self.model, self.environment)
        stop = threading.Event()
        crashes: list[BaseException] = []

        def end_all() -> None:
            stop.set()
            for worker in list(workers):
                worker.kill()

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
                    if worker is None:
                        worker = Worker(message)
                        workers.append(worker)
                        # Who stopped meanwhile did not see it.
                        if stop.is_set():
                            return
                    came = worker.run(units[place])
                    if stop.is_set():
                        return
                    if came is None:
                        came = {"place": "process", "error": f"the process ended with {worker.ended()}", "trace": ""}
                        worker = None
                    end(place, came)
            except BaseException as error:  # told to whoever called
                crashes.append(error)
                end_all()
            finally:
                if worker is not None:
                    worker.close()

        workers: list[Worker] = []
        threads = [threading.Thread(target=serve, daemon=True) for _ in range(min(self.processes, len(missing)))]
        for thread in threads:
            thread.start()
        try:
            for thread in threads:
                while thread.is_alive():
                    thread.join(0.2)
        except BaseException:
            end_all()
            for thread in threads:
                thread.join(5.0)
            raise
        if crashes:
            raise crashes[0]

    def constants(self, steps: int) -> list[dict[str, Any]]:
        """Returns the results of constant actions and of random actions in the ensemble members of each kind of model. Every agent has to beat both."""
        from .gym import make_vec

        actions, members = len(self.model.actions), len(self.members)
        environment = {**self.environment, "action_space": "discrete", "live": False}
        timeout = environment.get("timeout") or self.model.timeout
        # Rollouts take the ensemble members in turn.
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
            rewards, episodes, lengths = np.zeros(count), np.zeros(count), np.zeros(count)
            walked, uncovered = np.zeros(count, np.int64), np.zeros(count, np.int64)
            over = np.zeros(count, np.bool_)
            for _ in range(steps):
                taken = np.where(is_random, drawn.integers(actions, size=count), policy)
                _, reward, terminated, truncated, info = walks.step(taken)
                # The step after the end of an episode begins the next one, and belongs to neither.
                rewards += np.where(over, 0.0, reward)
                walked += ~over
                uncovered += ~info["covered"] & ~over
                lengths = np.where(over, 0, lengths + 1)
                over = terminated | truncated
                episodes += over
            returns = rewards / np.maximum(episodes + np.where(over, 0, lengths) / timeout, 1.0)
            by_policy = [[float(np.mean(returns[(policy == one) & (member == place)])) for one in range(policies)] for place in range(members)]
            coverage = [{"steps": int(walked[policy == action].sum()), "missing": 0, "far": int(uncovered[policy == action].sum())} for action in range(actions)]
            by_action, at_random = [own[:actions] for own in by_policy], [own[actions] for own in by_policy]
            found.append({"kind": kind, "members": by_action, "random": at_random, "coverage": coverage})
        return found

    def judged(
        self,
        places: list[int],
        results: dict[int, list[dict[str, Any]]],
        limits: dict[str, Any],
        steps: int,
        constants: list[dict[str, Any]] | None = None,
    ) -> dict[str, Any]:
        """Returns the verdict about these settings after this number of steps of each agent. Settings are numbered by their place."""
        numbers = {member: number for number, member in enumerate(self.members)}
        runs = [
            {**unit["run"], "candidate": number, "member": numbers[unit["run"]["member"]]}
            for number, place in enumerate(places)
            for unit in results[place]
        ]
        compared = [self.settings[place] for place in places]
        standard = places.index(self.default) if self.default in places else None
        names = Names(compared)
        # Agents that live for less than an episode have no longer ones.
        timeout = min(self.environment.get("timeout") or self.model.timeout, steps)
        verdict: dict[str, Any] = json.loads(
            self.model._native.judge(
                json.dumps(runs),
                names.labels,
                [list(texts.items()) for texts in names.texts],
                standard,
                # The default is among the settings, unless it failed.
                self.default is not None and standard is None,
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
