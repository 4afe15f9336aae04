"""What `calib_rl.tune` counts, keeps, names and refuses."""

from __future__ import annotations

import copy
import functools
import json
import os
import pickle
import re
import shutil
import subprocess
import sys
import tempfile
import threading
import time
import warnings
from collections.abc import Callable
from decimal import Decimal
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gymnasium
import numpy as np
import pytest

import calib_rl
from calib_rl._files import write_sealed_json
from calib_rl._identity import Unstable, identity
from calib_rl._tune import _Work
from calib_rl._tune_kept import Kept
from calib_rl._tune_settings import Names, settings_of

polars = pytest.importorskip("polars")


@pytest.fixture(scope="module")
def acting(tmp_path_factory: pytest.TempPathFactory) -> calib_rl.ActionModel:
    from test_acting import tank

    return calib_rl.build_model(tank(), tmp_path_factory.mktemp("tune"), actions=["valve0"], reward="reward", timeout=40)


class Always:
    """An agent that always takes one action, and may limit its episodes."""

    def __init__(self, env: gymnasium.Env[Any, Any], action: int = 1, limit: int | None = None, value: Any = None) -> None:
        self.env = env if limit is None else gymnasium.wrappers.TimeLimit(env, limit)
        self.action = action

    def learn(self, total_timesteps: int) -> None:
        over = True
        for _ in range(total_timesteps):
            if over:
                self.env.reset()
            _, _, terminated, truncated, _ = self.env.step(self.action)
            over = terminated or truncated


def run(make_agent: Any, grid: Any, model: calib_rl.ActionModel, **arguments: Any) -> calib_rl.Tuned:
    given = {"total_timesteps": 100, "processes": 1, "kinds": ["neighbors"], "members": [0, 1], **arguments}
    return calib_rl.tune(make_agent, grid, model, **given)


def test_episodes_that_are_reset_early_count_with_their_rewards(acting: calib_rl.ActionModel) -> None:
    sums: dict[int | None, float] = {}

    class Sums(gymnasium.Wrapper[Any, Any, Any, Any]):
        def step(self, action: Any) -> Any:
            result = self.env.step(action)
            sums[limit] = sums.get(limit, 0.0) + float(result[1])
            return result

    limit: int | None = None

    def make(env: Any, **setting: Any) -> Always:
        nonlocal limit
        limit = setting.get("limit")
        return Always(Sums(env), **setting)

    tuned = run(make, {"limit": [10, 25]}, acting, members=[0], total_timesteps=400)
    for one in tuned.runs:
        # Ten timeouts of 40 steps.
        assert one["mean_return"] == pytest.approx(sums[one["setting"].get("limit")] / 10)
    assert {one["setting"].get("limit"): (one["episodes"], one["cut_off"]) for one in tuned.runs} == {None: (10, 0), 10: (0, 39), 25: (0, 15)}
    assert [len(one["returns"]) for one in tuned.runs] == [one["episodes"] for one in tuned.runs]
    assert "Reset before their end: 54 of 64 episodes" in str(tuned)
    assert "cut_off" in tuned.runs_frame().columns


class ByLevel(Always):
    """Opens the valve above the middle of the level, which is the second column, and shuts it below."""

    def learn(self, total_timesteps: int) -> None:
        level, over = 0.0, True
        for _ in range(total_timesteps):
            if over:
                level = self.env.reset()[0][1]
            seen, _, terminated, truncated, _ = self.env.step(2 if level > 0.5 else 0)
            level, over = seen[1], terminated or truncated


def test_the_last_steps_of_a_run_are_recorded(acting: calib_rl.ActionModel, tmp_path: Path) -> None:
    def tuned() -> calib_rl.Tuned:
        return run(ByLevel, {"limit": [10]}, acting, folder=tmp_path / "units", runs=2, default=None, environment={"observe": ["flow", "level"]})

    first = tuned()
    recorded = [one for one in first.runs if one["conduct"] is not None]
    assert [(one["member"], one["run"]) for one in recorded] == [(0, 0)]
    conduct = recorded[0]["conduct"]
    assert conduct["actions"] == [action.name for action in acting.actions]
    # The last quarter of 100 steps, in episodes of ten.
    assert conduct["steps"] == 25 == len(conduct["rewards"]) and conduct["begins"] == [5, 15]
    flow, level = conduct["columns"]
    assert (flow["column"], level["column"]) == ("flow", "level")
    assert 1.0 < min(flow["values"]) < max(flow["values"]) < 9.0, "in its unit"
    middle = acting.physical([[0.5] * len(acting.columns)])[0, acting.columns.index("level")]
    assert conduct["set"] == [{"column": "valve0", "values": [float(value > middle) for value in level["values"]]}]
    assert sum(level["steps"]) == 25 and level["upper"] == sorted(level["upper"])
    for part, upper in enumerate(level["upper"]):
        shares = [own[part] for own in level["taken"]]
        assert shares[1] == 0.0 and sum(shares) == pytest.approx(float(level["steps"][part] > 0), abs=1e-5)
        assert shares[2] == 0.0 or upper > middle
    assert tuned().runs == first.runs, "as they were stored"
    page = first.report(tmp_path / "page.html").read_text(encoding="utf-8")
    assert "The last steps of the chosen agent" in page and "What the chosen agent does along level" in page


@pytest.mark.parametrize("space", ["multi_discrete", "box"])
def test_actions_of_every_space_are_recorded_as_what_they_set(acting: calib_rl.ActionModel, space: str) -> None:
    action: Any = np.array([2]) if space == "multi_discrete" else np.array([0.9], np.float32)
    tuned = run(lambda env, limit=None: Always(env, action, limit), {"limit": [7]}, acting, environment={"action_space": space})
    conduct = next(one["conduct"] for one in tuned.runs if one["conduct"])
    assert conduct["set"][0]["values"] == [1.0] * 25, "0.9 is nearest to 1"
    for column in conduct["columns"]:
        assert column["taken"][2] == [float(count > 0) for count in column["steps"]]


@pytest.mark.parametrize("units", ["normalised", "physical"])
def test_a_recorded_value_is_in_the_part_that_it_bounds(units: str, tmp_path: Path) -> None:
    from test_acting import tank

    # Levels whose float32 is above and below them.
    levels = [0.1, 0.3, 0.7]
    log = tank().with_columns(flow=polars.Series(np.random.default_rng(2).choice(levels, 1200)))
    model = calib_rl.build_model(log, tmp_path, actions=["valve0"], reward="reward", timeout=40)
    tuned = run(Always, {"action": [0]}, model, environment={"units": units, "observe": ["flow"]})
    (column,) = tuned.runs[0]["conduct"]["columns"]
    assert column["upper"] == pytest.approx(levels)
    assert column["steps"] == [sum(abs(value - level) < 1e-3 for value in column["values"]) for level in levels]


def test_a_setting_beyond_the_recorded_range_is_recorded_as_its_end(tmp_path: Path) -> None:
    from test_acting import tank

    model = calib_rl.build_model(tank(), tmp_path, actions=["valve0"], reward="reward", levels=3, timeout=40)
    environment = {"action_space": "box", "live": True}
    for value, end in [(7.0, 1.0), (-3.0, 0.0)]:
        action: Any = np.array([value], np.float32)
        tuned = run(lambda env, limit=None, action=action: Always(env, action, limit), {"limit": [7]}, model, environment=environment)
        assert tuned.runs[0]["conduct"]["set"] == [{"column": "valve0", "values": [end] * 25}]


def test_actions_of_several_shapes_are_recorded(acting: calib_rl.ActionModel) -> None:
    class Shapes(Always):
        """Explores with numbers, and otherwise takes the arrays of one action that a policy returns."""

        def learn(self, total_timesteps: int) -> None:
            self.env.reset()
            for step in range(total_timesteps):
                _, _, terminated, truncated, _ = self.env.step([2, np.int64(2), np.array([2]), np.array([[2.0]])][step % 4])
                if terminated or truncated:
                    self.env.reset()

    mixed, plain = run(Shapes, {"limit": [7]}, acting), run(Always, {"action": [2]}, acting, default=None)
    assert not mixed.failures
    assert mixed.runs[0]["conduct"] == plain.runs[0]["conduct"]


def test_what_follows_the_counted_steps_counts_nothing(acting: calib_rl.ActionModel) -> None:
    class Rounds(Always):
        """An agent that rounds its steps up, as agents with batches do."""

        def learn(self, total_timesteps: int) -> None:
            super().learn(500)

    rounded, exact = run(Rounds, {"action": [0]}, acting), run(Always, {"action": [0]}, acting)
    assert rounded.runs == exact.runs and {(one["episodes"], one["cut_off"]) for one in exact.runs} == {(2, 0)}


def test_vector_environments_spend_steps_on_resets(acting: calib_rl.ActionModel) -> None:
    class Vector:
        def __init__(self, env: Any, share: float = 1.0) -> None:
            self.envs, self.share = gymnasium.vector.SyncVectorEnv([lambda: env]), share

        def learn(self, total_timesteps: int) -> None:
            self.envs.reset()
            for _ in range(int(total_timesteps * self.share)):
                self.envs.step(np.array([1]))

    tuned = run(Vector, {"share": [0.9]}, acting, total_timesteps=200)
    assert tuned.settings == [{}] and {one["episodes"] for one in tuned.runs} == {4}
    assert "returned after 176 steps in env; it must take all" in tuned.failures[0].error and "SubprocVecEnv" in tuned.failures[0].error


def _made(source: str) -> Any:
    """Returns an object that a notebook cell defines."""
    names: dict[str, Any] = {"Always": Always}
    exec(source, names)
    return names["make"]


def _factory(action: int) -> Callable[..., Always]:
    def make(env: Any, **setting: Any) -> Always:
        return Always(env, action, **setting)

    return make


class _Held:
    def __init__(self, action: int) -> None:
        self.action = action

    def __call__(self, env: Any, **setting: Any) -> Always:
        return Always(env, self.action, **setting)


ACTION = 0


def _by_global(env: Any, **setting: Any) -> Always:
    return Always(env, ACTION, **setting)


def _with_default(action: int) -> Callable[..., Always]:
    def make(env: Any, limit: Any = None, value: Any = None, *, action: int = action) -> Always:
        return Always(env, action, limit)

    return make


@pytest.mark.parametrize(
    "make",
    [
        _factory,
        _with_default,
        _Held,
        lambda action: functools.partial(Always, action=action),
        lambda action: _made(f"def make(env, **setting): return Always(env, {action}, **setting)"),
    ],
)
def test_kept_results_are_of_the_same_agent_by_value(make: Callable[[int], Any], acting: calib_rl.ActionModel, tmp_path: Path) -> None:
    def returns(action: int) -> list[float]:
        return [one["mean_return"] for one in run(make(action), {"limit": [40]}, acting, folder=tmp_path).runs]

    first = returns(0)
    assert len(list(tmp_path.iterdir())) == 4
    assert returns(0) == first and len(list(tmp_path.iterdir())) == 4, "nothing is made again"
    assert returns(2) != first and len(list(tmp_path.iterdir())) == 8


def test_kept_results_follow_globals(acting: calib_rl.ActionModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = run(_by_global, {"limit": [40]}, acting, folder=tmp_path).runs
    monkeypatch.setitem(globals(), "ACTION", 2)
    assert run(_by_global, {"limit": [40]}, acting, folder=tmp_path).runs != first
    monkeypatch.setitem(globals(), "ACTION", 0)
    assert run(_by_global, {"limit": [40]}, acting, folder=tmp_path).runs == first and len(list(tmp_path.iterdir())) == 8


def test_values_of_settings_are_kept_by_value(acting: calib_rl.ActionModel, tmp_path: Path) -> None:
    def values() -> list[Any]:
        return [lambda left: 0.1, lambda left: 0.2, _Held(1), _Held(2), np.arange(2000), np.arange(2000) % 1999, {"a": [1]}]

    def tuned() -> calib_rl.Tuned:
        made = run(Always, {"value": values()}, acting, folder=tmp_path, default=None, environment={"observe": np.array(["level"])})
        assert len(made.settings) == 7 and made.failures == [] and len(list(tmp_path.iterdir())) == 14
        return made

    tuned()
    labels = tuned().runs_frame()["setting"].unique().to_list()
    assert len(labels) == 7 and "value=<lambda> #1" in labels, labels


SCRIPT = """
import functools, sys
from calib_rl._identity import identity
class Agent:
    names = {"b", "a", "c"}
    def __init__(self, env, schedule=lambda left: left):
        self.env = env
    @property
    def all(self):
        return [name for name in self.names if name in {"x", "y"}]
def make(env): return Agent(env) if SCALE else make(env)
SCALE = {"b": 1.0, "a": (2, None)}
print(identity([make, functools.partial(make, 1), Agent(None)], "make"))
"""


def test_an_identity_is_the_same_in_every_process() -> None:
    def told(source: str, seed: str) -> str:
        environment = {**os.environ, "PYTHONHASHSEED": seed, "PYTHONPATH": os.pathsep.join(sys.path)}
        return subprocess.run([sys.executable, "-c", source], check=True, capture_output=True, text=True, env=environment).stdout

    first = told(SCRIPT, "1")
    assert told(SCRIPT, "2") == first and told(f"\n\n# moved{SCRIPT}", "3") == first
    for before, after in [("(2, None)", "(3, None)"), ('"x", "y"', '"x", "z"'), ("left: left)", "left: -left)"), ("make, 1)", "make, 2)")]:
        assert told(SCRIPT.replace(before, after), "1") != first, after


PACKAGE = """
def relative(env):
    from . import rewards
    return rewards.reward(env)
def absolute(env):
    from plant_agents import rewards as renamed
    return renamed.reward(env)
def within(env):
    from .rewards import reward
    return reward(env)
def broken(env):
    from plant_agents.raises import rewards
    return rewards
"""


def test_modules_that_a_function_imports_count_by_their_files(tmp_path: Path) -> None:
    package = tmp_path / "plant_agents"
    (package / "raises").mkdir(parents=True)
    (package / "__init__.py").write_text("", encoding="utf-8")
    (package / "agents.py").write_text(PACKAGE, encoding="utf-8")
    (package / "raises" / "__init__.py").write_text("raise RuntimeError('no licence')", encoding="utf-8")
    names = ["relative", "absolute", "within", "broken"]
    source = f"from calib_rl._identity import identity; from plant_agents import agents; print(*[identity(getattr(agents, name), name) for name in {names}])"

    def told(rewards: str) -> list[str]:
        (package / "rewards.py").write_text(rewards, encoding="utf-8")
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}
        return subprocess.run([sys.executable, "-c", source], check=True, capture_output=True, text=True, env=environment).stdout.split()

    first = told("def reward(env): return 1.0")
    assert told("def reward(env): return 1.0") == first
    changed = [one != other for one, other in zip(first, told("def reward(env): return 2.0"))]
    assert changed == [True, True, True, False]


def test_tensors_and_values_of_libraries_have_an_identity() -> None:
    torch = pytest.importorskip("torch")
    values = [torch.zeros(3), torch.ones(3), torch.zeros(4), torch.zeros(3, dtype=torch.bfloat16), torch.nn.ReLU, torch.relu, torch.float32]
    first = [identity(value, "value") for value in values]
    assert len(set(first)) == len(values) and identity(torch.zeros(3), "value") == first[0]


def test_what_has_no_identity_is_named() -> None:
    lock = threading.Lock()
    with pytest.raises(Unstable, match=r"make_agent\.lock is a _thread\.lock"):
        identity(lambda: lock, "make_agent")
    nested: list[Any] = []
    nested.append(nested)
    assert identity(nested, "value") == identity(copy.deepcopy(nested), "value")
    assert len({identity(value, "value") for value in (1, 1.0, True, "1", None, b"1", (1,), [1], {1})}) == 9


def test_what_cannot_be_compared_is_not_kept(acting: calib_rl.ActionModel, tmp_path: Path) -> None:
    lock = threading.Lock()

    def make(env: Any, **setting: Any) -> Always:
        with lock:
            return Always(env, **setting)

    with pytest.warns(calib_rl.CalibWarning, match=r"^folder: the results are not kept, because make_agent\.lock is a _thread\.lock"):
        run(make, {"limit": [10]}, acting, folder=tmp_path)
    assert not list(tmp_path.iterdir())
    guide = Path(__file__).parents[2] / "docs" / "guides" / "tune-your-agent.md"
    assert "\nCalibWarning: folder: the results are not kept, because make_agent.lock is a _thread.lock, " in guide.read_text(encoding="utf-8")
    with pytest.warns(calib_rl.CalibWarning, match="^folder: the results of some settings are not kept, because value="):
        run(Always, {"value": [1, lock]}, acting, folder=tmp_path)
    assert len(list(tmp_path.iterdir())) == 4


def test_the_first_of_the_members_is_recorded(acting: calib_rl.ActionModel, tmp_path: Path) -> None:
    def recorded(members: list[int]) -> list[int]:
        tuned = run(Always, {"limit": [10]}, acting, default=None, members=members, folder=tmp_path / "units")
        page = tuned.report(tmp_path / "page.html").read_text(encoding="utf-8")
        assert f"in the neighbours of ensemble member {members[0]}." in page
        return [one["member"] for one in tuned.runs if one["conduct"] is not None]

    # Whatever other calls have stored.
    assert [recorded(members) for members in ([0, 1], [1, 2], [2, 0], [0])] == [[0], [1], [2], [0]]


def test_a_damaged_result_is_made_again(acting: calib_rl.ActionModel, tmp_path: Path) -> None:
    first = run(Always, {"limit": [10]}, acting, folder=tmp_path)
    kept = sorted(tmp_path.iterdir())
    texts = ["[]", "null", '{"run": 3}', '{"run": {"kind": "neighbors"}, "returns": 4}']
    # A unit whose last steps alone are damaged comes first.
    told = {path: json.loads(path.read_text(encoding="utf-8")) for path in kept}
    kept.sort(key=lambda path: "conduct" not in told[path])
    told[kept[0]]["conduct"]["rewards"][0] = "high"
    texts[0] = json.dumps(told[kept[0]])
    assert len(kept) == len(texts)
    for path, text in zip(kept, texts):
        path.write_text(text, encoding="utf-8")
    with pytest.warns(calib_rl.CalibWarning, match=r"^folder: 4 files are damaged or were edited, such as .*; calib makes their training runs again$"):
        assert run(Always, {"limit": [10]}, acting, folder=tmp_path).runs == first.runs
    assert all("coverage" in json.loads(path.read_text(encoding="utf-8"))["run"] for path in kept)


def _damages() -> list[Callable[[dict[str, Any]], Any]]:
    """Returns functions that damage a stored result."""

    def put(value: Any, *path: str | int) -> Callable[[dict[str, Any]], Any]:
        def damage(told: Any) -> None:
            for key in path[:-1]:
                told = told[key]
            told[path[-1]] = value

        return damage

    return [
        put(10**400, "run", "mean_return"),
        put(10**30, "run", "episodes"),
        put([10**400], "returns"),
        put([], "conduct"),
        put("shut", "conduct", "actions"),
        put(10**30, "conduct", "steps"),
        put({"0": 1}, "conduct", "begins"),
        put([25], "conduct", "begins"),
        put(10**400, "conduct", "rewards", 0),
        put("high", "conduct", "columns", 0, "upper", 0),
        put(None, "conduct", "set", 0, "values"),
        lambda told: told["conduct"]["columns"][0]["taken"].pop(),
        lambda told: told["conduct"]["columns"][0]["steps"].pop(),
        lambda told: told["conduct"]["set"][0]["values"].pop(),
        lambda told: told["conduct"]["columns"][0].pop("column"),
    ]


def test_every_damage_of_a_result_is_found(acting: calib_rl.ActionModel, tmp_path: Path) -> None:
    def tuned() -> calib_rl.Tuned:
        return run(Always, {"limit": [10]}, acting, default=None, members=[0], folder=tmp_path)

    first = tuned()
    (kept,) = tmp_path.iterdir()
    text = kept.read_text(encoding="utf-8")
    for number, damage in enumerate(_damages()):
        told = json.loads(text)
        del told["sha256"]
        damage(told)
        # Sealed again, so that the form alone is wrong.
        write_sealed_json(kept, told)
        with pytest.warns(calib_rl.CalibWarning, match="is damaged or was edited"):
            assert tuned().runs == first.runs, number
        assert kept.read_text(encoding="utf-8") == text, f"damage {number} was not written again"


def test_an_edited_result_is_made_again(acting: calib_rl.ActionModel, tmp_path: Path) -> None:
    def tuned() -> calib_rl.Tuned:
        return run(Always, {"limit": [10]}, acting, default=None, members=[0], folder=tmp_path)

    first = tuned()
    (kept,) = tmp_path.iterdir()
    text = kept.read_text(encoding="utf-8")
    mean = f'"mean_return": {first.runs[0]["mean_return"]}'
    unsealed = text.partition(', "sha256"')[0] + "}"
    for edited in (text.replace(mean, mean.replace(": -", ": -9")), text.replace('"sha256": "', '"sha256": "0'), unsealed, text[:-40], "", text + "\n"):
        assert edited != text
        kept.write_text(edited, encoding="utf-8")
        told = rf"^folder: {re.escape(str(kept))} is damaged or was edited; calib makes its training run again$"
        with pytest.warns(calib_rl.CalibWarning, match=told) as came:
            assert tuned().runs == first.runs
        assert [warning.filename for warning in came] == [__file__]
        assert kept.read_text(encoding="utf-8") == text
    with warnings.catch_warnings():
        warnings.simplefilter("error", calib_rl.CalibWarning)
        assert tuned().runs == first.runs


def test_a_model_that_was_built_again_is_refused(tmp_path: Path) -> None:
    from test_acting import tank

    def built(log: Any) -> calib_rl.ActionModel:
        model: calib_rl.ActionModel = calib_rl.build_model(log, tmp_path / "model", actions=["valve0"], reward="reward", timeout=40)
        return model

    def tuned(model: calib_rl.ActionModel, **arguments: Any) -> calib_rl.Tuned:
        return run(Always, {"action": [0, 2]}, model, folder=tmp_path / "units", **arguments)

    first = built(tank())
    results = tuned(first)
    assert tuned(built(tank())).runs == results.runs == tuned(first).runs, "the same log gives the same model"
    other = built(tank().with_columns(-polars.col("reward")))
    for arguments in ({}, {"processes": 2}):
        with pytest.raises(calib_rl.CalibError, match=r"holds another model than the one that was opened.*ActionModel.open\('.*a folder of its own"):
            tuned(first, **arguments)
    pickled = pickle.dumps(first)
    with pytest.raises(calib_rl.CalibError, match="holds another model than the one that was opened"):
        pickle.loads(pickled)
    again = tuned(other)
    assert again.runs == run(Always, {"action": [0, 2]}, other).runs
    assert [one["mean_return"] for one in again.runs] == pytest.approx([-one["mean_return"] for one in results.runs])


def test_a_model_whose_folder_is_gone_stays_readable(tmp_path: Path) -> None:
    from test_acting import tank

    model = calib_rl.build_model(tank(), tmp_path / "model", actions=["valve0"], reward="reward", timeout=40)
    shutil.rmtree(tmp_path / "model")
    assert len(run(Always, {"action": [0]}, model, folder=tmp_path / "units").runs) == 4
    with pytest.raises(calib_rl.CalibError, match="has no model any more.*build it again, or take processes=1"):
        run(Always, {"action": [0]}, model, processes=2)


def test_an_agent_may_change_the_working_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from test_acting import tank

    class Moves(Always):
        def learn(self, total_timesteps: int) -> None:
            super().learn(total_timesteps)
            os.chdir(tmp_path)

    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    model = calib_rl.build_model(tank(), "model", actions=["valve0"], reward="reward", timeout=40)
    run(Moves, {"action": [0]}, model, folder="units")
    assert len(list((tmp_path / "work" / "units").iterdir())) == 4 and not (tmp_path / "units").exists()
    assert Path.cwd() == tmp_path and model.path.is_dir()
    assert len(run(Always, {"action": [0]}, model, processes=2).runs) == 4, "other processes open the model"


def test_progress_names_what_failed(acting: calib_rl.ActionModel, capsys: pytest.CaptureFixture[str]) -> None:
    run(Always, {"action": [9]}, acting, progress=True)
    assert [line.endswith(", failed") for line in capsys.readouterr().err.splitlines()] == [False, False, True, False]


def test_one_is_singular(acting: calib_rl.ActionModel, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def tuned(**arguments: Any) -> tuple[str, str]:
        page = run(Always, {"limit": [10]}, acting, progress=True, folder=tmp_path / "units", **arguments).report(tmp_path / "page.html")
        return capsys.readouterr().err.splitlines()[0], page.read_text(encoding="utf-8")

    told, page = tuned(default=None, members=[0])
    assert told == "1 setting x 1 ensemble member of neighbors x 1 run of 100 steps, 0 training runs are there already"
    assert "1 setting in 1 ensemble member of 1 kind of models, 1 run each" in page
    told, page = tuned(runs=2, kinds=["neighbors", "increments"])
    assert told == "2 settings x 2 ensemble members of neighbors, increments x 2 runs of 100 steps, 1 training run is there already"
    assert "2 settings in 2 ensemble members of 2 kinds of models, 2 runs each" in page


def test_agents_cannot_change_settings(acting: calib_rl.ActionModel, tmp_path: Path) -> None:
    class Writes(Always):
        def __init__(self, env: Any, options: Any = None) -> None:
            super().__init__(env, len(options["net"]) if options else 1)
            if options:
                options["net"].append("changed")
                options["new"] = 1

    grid = {"options": [{"net": []}, {"net": ["a"]}]}
    before = copy.deepcopy(grid)
    for _ in range(2):
        tuned = run(Writes, grid, acting, folder=tmp_path, default={"options": {"net": []}})
        assert grid == before and tuned.chosen in [{"options": options} for options in before["options"]]
        assert tuned.default == {"options": {"net": []}} and tuned.verdict["default"] == 0
        assert tuned.failures == [] and len(list(tmp_path.iterdir())) == 4


def test_no_two_settings_have_one_name(acting: calib_rl.ActionModel, tmp_path: Path) -> None:
    assert Names([{"a": 0.123412}, {"a": 0.123414}, {"a": 0.5}]).labels == ["a=0.123412", "a=0.123414", "a=0.5"]
    assert Names([{"a": "1"}, {"a": 1}, {"a": "b"}, {}]).labels == ["a='1'", "a=1", "a=b", "the agent's own default"]
    assert len(set(Names([{"a": "1 b=2"}, {"a": 1, "b": 2}]).labels)) == 2
    tuned = run(Always, {"value": ["1", 1], "action": [0, 2]}, acting)
    frame = tuned.frame()
    assert sorted(frame["setting"].to_list()) == [
        "the agent's own default", "value='1' action=0", "value='1' action=2", "value=1 action=0", "value=1 action=2",
    ]  # fmt: skip
    of_setting = dict(zip(frame["setting"], zip(frame["value"], frame["action"])))
    assert of_setting["value='1' action=2"] == ("'1'", 2) and of_setting["the agent's own default"] == (None, None)
    assert set(tuned.runs_frame()["setting"]) == set(frame["setting"]) and "value=&#x27;1&#x27;" in tuned._repr_html_()
    page = tuned.report(tmp_path / "page.html").read_text(encoding="utf-8")
    assert page.count("(chosen)") >= 1
    # A hyperparameter may have the name of a column.
    assert {"uncovered", "uncovered_value"} <= set(run(lambda env, uncovered=1: Always(env), {"uncovered": [3]}, acting).frame().columns)


def test_numbers_of_numpy_and_arrays_are_values(acting: calib_rl.ActionModel) -> None:
    tuned = run(Always, {"action": np.arange(2)}, acting, default=None)
    assert [type(setting["action"]) for setting in tuned.settings] == [int, int] and json.dumps(tuned.chosen)
    arrays = {"value": [np.array([1, 2]), np.array([2, 3])]}
    assert len(run(Always, arrays, acting).settings) == 3
    with pytest.raises(ValueError, match="twice"):
        run(Always, {"value": [np.array([1, 2]), np.array([1, 2])]}, acting)


def test_a_wrong_environment_is_refused_before_any_agent_is_made(acting: calib_rl.ActionModel, tmp_path: Path) -> None:
    wrong: list[tuple[Any, type[Exception], str]] = [
        ({"obs": ["level"]}, ValueError, "environment has 'obs', expected arguments of calib_rl.gym.make: .*observe"),
        ({"observe": ["Level"]}, ValueError, "environment: no column is called 'Level'; the model has level, flow"),
        ({"reward": "flow"}, ValueError, "environment has 'reward'"),
        ({"live": True}, ValueError, "environment: live"),
        ("level", TypeError, "environment is 'level', expected arguments"),
    ]
    made: list[Any] = []
    for environment, error, told in wrong:
        with pytest.raises(error, match=told):
            run(made.append, {"limit": [1]}, acting, environment=environment, folder=tmp_path / "units")
    assert not made and not (tmp_path / "units").exists()


def test_arguments_of_another_kind_are_refused_with_what_was_expected(acting: calib_rl.ActionModel, tmp_path: Path) -> None:
    (tmp_path / "file.py").write_text("", encoding="utf-8")
    grid = {"limit": [10]}
    calls: list[tuple[Callable[[], object], type[Exception], str]] = [
        (lambda: run(grid, Always, acting), TypeError, r"make_agent is a dict, .* the order is tune\(make_agent, grid, model\)"),
        (lambda: run(3, grid, acting), TypeError, r"make_agent is an int, expected a function or a class that tune can call as make_agent\(env, \*\*setting\)"),
        (lambda: run(Always, Always, acting), TypeError, r"grid is Always, expected values of each argument, such as .* the order is"),
        (lambda: run(Always, 3, acting), TypeError, "grid is 3, expected values"),
        (lambda: run(Always, [("limit", 3)], acting), TypeError, r"grid\[0\] is tuple, expected"),
        (lambda: run(Always, {"limit": {"a": 1}}, acting), TypeError, r"grid\['limit'\] is .* expected a list of values"),
        (lambda: run(Always, grid, acting, members=2), TypeError, r"members is 2, expected a list of positions, such as \[0, 1\]"),
        (lambda: run(Always, grid, acting, default="x"), TypeError, "default is 'x', expected a setting, such as"),
        (lambda: run(Always, grid, acting, kinds=3), ValueError, "kinds is 3, expected a list"),
        (lambda: run(Always, grid, acting, most_uncovered=5.0), ValueError, "most_uncovered is 5, expected a share from 0 to 1"),
        (lambda: run(Always, grid, acting, most_uncovered="all"), TypeError, "most_uncovered is 'all', expected a share"),
        (lambda: run(Always, grid, acting, fewest_terminals=0.5), TypeError, "fewest_terminals is 0.5, expected a whole number"),
        (lambda: run(Always, grid, acting, folder=tmp_path / "file.py"), calib_rl.CalibError, "file.py is a file, and results are kept in a folder"),
        (lambda: run(Always, grid, acting).report(tmp_path), calib_rl.CalibError, "is a folder, and the report is a file; name one, such as .*report.html"),
    ]
    for call, error, told in calls:
        with pytest.raises(error, match=told):
            call()


@pytest.mark.parametrize("processes", [1, 2])
def test_an_agent_that_exits_fails_alone(acting: calib_rl.ActionModel, processes: int) -> None:
    def make(env: Any, limit: int = 40) -> Always:
        if limit == 3:
            sys.exit("no licence")
        return Always(env, limit=limit)

    tuned = run(make, {"limit": [3, 10]}, acting, processes=processes)
    assert [(failure.place, failure.error) for failure in tuned.failures] == [("make_agent", "SystemExit: no licence")]
    assert tuned.settings == [{}, {"limit": 10}] and str(tuned.failures[0]).startswith("limit=3 failed")

    def stop(env: Any) -> Always:
        raise KeyboardInterrupt

    if processes == 1:
        with pytest.raises(KeyboardInterrupt):
            run(stop, {"limit": [3]}, acting)


@pytest.mark.parametrize("processes", [1, 2])
def test_an_agent_that_needs_another_action_space_is_told_so(acting: calib_rl.ActionModel, processes: int) -> None:
    def sets(env: Any, limit: int = 40) -> Always:
        if limit < 0:
            raise ValueError("limit")
        return Always(env, env.action_space.low, limit)

    def chooses(env: Any, limit: int = 40) -> Always:
        assert hasattr(env.action_space, "n"), "this agent only supports Discrete"
        return Always(env, env.action_space.n - 1, limit)

    spaces: list[tuple[Any, dict[str, Any], str]] = [(sets, {}, "box"), (chooses, {"action_space": "box"}, "discrete")]
    for make, environment, space in spaces:
        told = run(make, {"limit": [10]}, acting, processes=processes, environment=environment).failures
        assert len(told) == 2
        assert all(str(failure).endswith(f'; take environment={{"action_space": "{space}"}}, with which it can be made') for failure in told)
    for make, limit, environment in [(sets, -1, {"action_space": "box"}), (lambda env, limit=40: 3, 10, {})]:
        (failure, *_) = run(make, {"limit": [limit]}, acting, processes=processes, environment=environment).failures
        assert failure.remedy == "" and str(failure).endswith("; see that make_agent(env, **setting) can be called with it")


def test_processes_leave_no_open_files(acting: calib_rl.ActionModel) -> None:
    import gc

    def make(env: Any, limit: int = 40) -> Always:
        if limit == 3:
            os._exit(5)
        return Always(env, limit=limit)

    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        tuned = run(make, {"limit": [3, 10]}, acting, processes=2)
        gc.collect()
    assert "exit code 5" in tuned.failures[0].error
    assert not [one for one in told if issubclass(one.category, ResourceWarning)]


HANGS = """
import sys, time
import calib_rl
class Hangs:
    def __init__(self, env, **setting): pass
    def learn(self, total_timesteps):
        sys.stderr.write("learning\\n")
        while True: time.sleep(0.1)
model = calib_rl.ActionModel.open(sys.argv[1])
calib_rl.tune(Hangs, {"limit": [1]}, model, total_timesteps=100, processes=2, kinds=["neighbors"])
"""


def test_processes_end_after_a_parent_that_was_killed(acting: calib_rl.ActionModel) -> None:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    parent = subprocess.Popen([sys.executable, "-c", HANGS, str(acting.path)], stderr=subprocess.PIPE, text=True, env=environment)
    assert parent.stderr is not None
    assert [parent.stderr.readline(), parent.stderr.readline()] == ["learning\n"] * 2
    parent.kill()
    # The processes have the same standard error, which ends with the last of them.
    parent.communicate(timeout=60)


def test_a_folder_that_cannot_be_written_to_is_refused_at_once(
    acting: calib_rl.ActionModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[Any] = []

    def make(env: Any, **setting: Any) -> Always:
        made.append(setting)
        return Always(env, **setting)

    def tuned(limit: int) -> calib_rl.Tuned:
        return run(make, {"limit": [limit]}, acting, default=None, members=[0], folder=tmp_path)

    first = tuned(10)

    def refuse(**arguments: Any) -> None:
        raise PermissionError(13, "Permission denied", "/units/tmp0")

    # The superuser may write everywhere.
    monkeypatch.setattr(tempfile, "TemporaryFile", refuse)
    made.clear()
    assert tuned(10).runs == first.runs, "what is there can be read"
    expected = rf"^folder: no file can be written in {tmp_path} \(Permission denied\); name one that you may write to, or leave folder= out$"
    with pytest.raises(calib_rl.CalibError, match=expected):
        tuned(11)
    assert not made
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(calib_rl.CalibError, match=r"/file \(Permission denied\); name a file in a folder that you may write to"):
        first.report(tmp_path / "file" / "page.html")


def test_an_error_ends_the_other_processes(acting: calib_rl.ActionModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def make(env: Any, limit: int = 40) -> Always:
        if limit == 3:
            time.sleep(120)
        return Always(env, limit=limit)

    def full(self: Any, unit: Any, came: Any) -> None:
        raise OSError("no space left on device")

    monkeypatch.setattr(Kept, "write", full)
    began = time.monotonic()
    with pytest.raises(OSError, match="no space left"):
        run(make, {"limit": [3, 10]}, acting, members=[0], default=None, processes=2, folder=tmp_path)
    assert time.monotonic() - began < 60


def test_episodes_are_no_longer_than_an_agent_lives(acting: calib_rl.ActionModel) -> None:
    asked: list[int] = []

    class Native:
        def judge(self, runs: str, settings: Any, fields: Any, default: Any, default_failed: bool, timeout: int, *rest: Any) -> str:
            asked.append(timeout)
            return "{}"

    model: Any = SimpleNamespace(_native=Native(), timeout=40)
    for environment in ({}, {"timeout": 30}):
        work = _Work(Always, model, [{}], None, [0], ["neighbors"], 1, 0, environment, 1, False)
        for steps in (10, 100):
            work.judged([0], {0: []}, {"most_uncovered": None, "fewest_terminals": None}, steps)
    assert asked == [10, 40, 10, 30]


def test_columns_of_the_frame_have_one_type(acting: calib_rl.ActionModel) -> None:
    def values(values: list[Any]) -> list[Any]:
        frame = run(Always, {"value": values}, acting, default=None, members=[0]).frame()
        return sorted(frame["value"].to_list(), key=str)

    assert values([1, 0.5]) == [0.5, 1.0]
    assert values([1, 2]) == [1, 2] and values([True, False]) == [False, True] and values(["a", "b"]) == ["a", "b"]
    assert values([1, "a"]) == ["1", "a"] and values([True, 0.5]) == ["0.5", "True"]


def test_thousands_of_settings_are_told_apart_in_little_time() -> None:
    settings: list[dict[str, Any]] = [{"net": [64, number], "rate": number / 1e5, "act": Always} for number in range(3000)]
    began = time.monotonic()
    found, place = settings_of(settings, settings[-1])
    assert place == 2999 and len(set(Names(found).labels)) == 3000
    assert time.monotonic() - began < 5
    for twice in ([{"a": 1}, {"a": 1.0}], [{"a": [1, (2, None)]}, {"a": [1, (2, None)]}], [{"a": {"b": 1}}, {"a": {"b": True}}], [{"a": Decimal(1)}, {"a": 1}]):
        with pytest.raises(ValueError, match="twice"):
            settings_of(twice, None)
    different = [{"a": [1]}, {"a": (1,)}, {"a": "1"}, {"a": 1}, {}, {"b": 1}, {"a": float("nan")}, {"a": float("nan")}, {"a": np.arange(2)}, {"a": np.arange(3)}]
    assert settings_of(different, None) == (different, None)


def test_settings_that_all_get_the_same_name_a_cause(acting: calib_rl.ActionModel) -> None:
    tuned = run(Always, {"value": [1, 2]}, acting)
    assert not tuned.is_supported and tuned.doubts[0].startswith("all 3 settings got the same returns in every training run")
    assert "total_timesteps=100; raise it above n_steps" in tuned.advice[2] and len(tuned.advice) <= 5
    assert tuned.why()[3] == tuned.advice[2], "after what the headline means"
    assert not any("got the same returns" in doubt for doubt in run(Always, {"action": [0, 2]}, acting).doubts)


def test_settings_that_set_the_same_action_name_its_range(acting: calib_rl.ActionModel, tmp_path: Path) -> None:
    from test_acting import tank

    class AroundZero(Always):
        action: Any

        def learn(self, total_timesteps: int) -> None:
            self.action = np.random.uniform(-1.0, 0.2, 1)
            super().learn(total_timesteps)

    for space in ("box", gymnasium.spaces.Box(0.0, 1.0, (1,))):
        tuned = run(AroundZero, {"value": [1, 2]}, acting, environment={"action_space": space})
        assert "where valve0 goes from 0 to 1: wrap env in gymnasium.wrappers.RescaleAction(env, -1.0, 1.0)" in tuned.doubts[0]
    assert "RescaleAction" not in run(Always, {"value": [1, 2]}, acting).doubts[0]
    around_zero = calib_rl.build_model(
        tank().with_columns(polars.col("valve0") * 2.0 - 1.0), tmp_path, actions=["valve0"], reward="reward", timeout=40
    )
    alike = run(AroundZero, {"value": [1, 2]}, around_zero, environment={"action_space": "box"}).doubts[0]
    assert "got the same returns" in alike and "RescaleAction" not in alike, "such an agent reaches the whole range"


def test_a_default_and_its_twin_are_not_all_settings(acting: calib_rl.ActionModel) -> None:
    def without_0(env: gymnasium.Env[Any, Any], **setting: Any) -> Always:
        if setting.get("action") == 0:
            raise ValueError("0 is too little")
        return Always(env, **setting)

    # Always's default action is 1.
    tuned = run(without_0, {"action": [0, 1]}, acting)
    assert len(tuned.failures) == 1
    assert not any("got the same returns" in doubt for doubt in tuned.doubts), tuned.doubts
    halved = run(Always, {"action": [0, 1, 2]}, acting, halving=3)
    assert not any("got the same returns" in doubt for doubt in halved.doubts), halved.doubts
