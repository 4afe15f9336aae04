from __future__ import annotations

import json
import os
import pickle
import re
import shutil
import subprocess
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import calib_rl
import calib_rl.gym
from calib_rl._functions import SECTIONS
from calib_rl._tune import _Work
from conftest import command_line

polars = pytest.importorskip("polars")
KINDS = ("neighbors", "increments", "network")


def tank(rows: int = 1200, columns: int = 1, terminal: bool = False) -> Any:
    """Returns the log of a tank whose valves raise or lower its level. The reward asks for a level of 0.6."""
    rng = np.random.default_rng(1)
    level = 0.5
    told: dict[str, list[float]] = {name: [] for name in ("level", "flow", "reward", "over", *(f"valve{n}" for n in range(columns)))}
    for _ in range(rows):
        set_to = rng.integers(3, size=columns) / 2
        told["level"].append(level)
        told["flow"].append(float(rng.normal(5.0, 1.0)))
        told["reward"].append(-abs(level - 0.6))
        told["over"].append(float(level > 0.95))
        for number, value in enumerate(set_to):
            told[f"valve{number}"].append(value)
        level = float(np.clip(level + 0.1 * (set_to.mean() - 0.5) + rng.normal(0.0, 0.01), 0.0, 1.0))
        if terminal and told["over"][-1]:
            level = 0.5
    if not terminal:
        del told["over"]
    times = np.datetime64("2024-03-01", "us") + np.arange(rows) * np.timedelta64(60_000_000, "us")
    return polars.DataFrame({"time": times, **told})


@pytest.fixture(scope="module")
def acting(tmp_path_factory: pytest.TempPathFactory) -> calib_rl.ActionModel:
    folder = tmp_path_factory.mktemp("acting")
    return calib_rl.build_model(tank(), folder, actions=["valve0"], reward="reward", timeout=40)


@pytest.fixture(scope="module")
def continuous(tmp_path_factory: pytest.TempPathFactory) -> calib_rl.ActionModel:
    folder = tmp_path_factory.mktemp("continuous")
    return calib_rl.build_model(tank(columns=2), folder, actions=["valve0", "valve1"], reward="reward", levels=3, timeout=40)


def test_a_frame_with_actions_becomes_a_model_with_actions(acting: calib_rl.ActionModel) -> None:
    assert acting.columns == ["level", "flow"] and [action.name for action in acting.actions] == ["valve0=0", "valve0=0.5", "valve0=1"]
    done = acting.decisions
    assert [int((done.actions == number).sum()) for number in range(3)] == [action.transitions for action in acting.actions]
    neighbors, distances = acting.neighbors(2), acting.distances(2)
    assert neighbors.shape == distances.shape == (1199, 3, 3) and not neighbors.flags.writeable
    there = neighbors[:, 1] != 4294967295
    assert (done.actions[neighbors[:, 1][there]] == 1).all(), "neighbours for an action have it"
    again = calib_rl.ActionModel.open(acting.path)
    assert (again.neighbors(2) == neighbors).all() and repr(pickle.loads(pickle.dumps(acting))) == repr(acting)
    assert str(acting.times[1] - acting.times[0]) == "60000000 microseconds" and acting.recorded().mean < 0


def test_pieces_of_recorded_episodes_count_in_the_mean_alone(tmp_path: Path) -> None:
    # Forty steps of -1, and then gaps after every second step of -10.
    log = tank().with_row_index("row").with_columns(reward=polars.when(polars.col("row") <= 40).then(-1.0).otherwise(-10.0))
    log = log.filter((polars.col("row") < 41) | (polars.col("row") % 4 > 0)).drop("row")
    with pytest.warns(calib_rl.CalibWarning, match="are no transitions"):
        model = calib_rl.build_model(log, tmp_path, actions=["valve0"], reward="reward", timeout=40)
    recorded = model.recorded()
    assert recorded.best == recorded.worst == -40.0
    pieces = len(model.decisions.rewards) - 40
    assert pieces > 200 and recorded.mean == pytest.approx((-40.0 - 10.0 * pieces) / (1 + pieces / 40))


def test_a_decision_takes_several_rows(acting: calib_rl.ActionModel, tmp_path: Path) -> None:
    model = calib_rl.build_model(tank(), tmp_path, actions=["valve0"], reward="reward", timeout=40, control={"every": 4})
    assert model.period == 4 * acting.period and len(model.decisions.actions) == 1199 // 4
    rewards = acting.decisions.rewards[: 4 * len(model.decisions.rewards)].reshape(-1, 4).sum(axis=1)
    np.testing.assert_allclose(model.decisions.rewards, rewards, rtol=1e-5)
    assert (model.decisions.actions == acting.decisions.actions[::4][:299]).all()
    env = calib_rl.gym.make(model)
    _, info = env.reset(seed=3)
    assert model.times[info["row"]] == np.datetime64(info["time"], "us")
    begun = np.datetime64(info["time"], "us")
    assert (begun - acting.times[0]) % np.timedelta64(240, "s") == np.timedelta64(0, "s")


def test_a_step_goes_where_a_recorded_transition_went(acting: calib_rl.ActionModel) -> None:
    env = calib_rl.gym.make(acting, member=1, units="physical", observe=["level"])
    done, sources = acting.decisions, acting.sources
    seen, before = env.reset(seed=3)
    moved, total = 0.0, None
    for number in range(40):
        at = float(seen[0])
        seen, reward, terminated, truncated, info = env.step(number % 3)
        transition = int(np.flatnonzero(sources == info["row"] - 1)[0])
        assert done.actions[transition] == number % 3 and done.rewards[transition] == np.float32(reward)
        source = acting.physical(acting.states[info["row"] - 1])[0]
        moved += source - at
        assert abs(info["displacement"][0] - moved) < 1e-4 and info["covered"] in (True, False) and not terminated
        total = truncated
    assert total, "it is cut after the timeout of the model"
    with pytest.raises(gymnasium.error.ResetNeeded, match=r"^the episode is over: call reset\(\) before step"):
        env.step(0)


def test_a_step_without_an_episode_says_why(acting: calib_rl.ActionModel) -> None:
    env = calib_rl.gym.make(acting, timeout=5)
    with pytest.raises(gymnasium.error.ResetNeeded, match=r"^no episode has begun: call reset\(\) first$"):
        env.step(0)
    twice = gymnasium.vector.SyncVectorEnv([lambda: env] * 2)
    twice.reset(seed=0)
    with pytest.raises(gymnasium.error.ResetNeeded, match="a vector environment does not use one env twice"):
        for _ in range(5):
            twice.step(np.zeros(2, np.int64))


@pytest.mark.parametrize("kind", ["discrete", "multi_discrete", "box", "live"])
def test_checkers_find_nothing_wrong(continuous: calib_rl.ActionModel, kind: str) -> None:
    live, space = kind == "live", "box" if kind == "live" else kind
    for units in ("normalised", "physical"):
        env = calib_rl.gym.make(continuous, member=2, units=units, action_space=space, live=live)  # type: ignore[call-overload]
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            check_env(env, skip_render_check=True)
        assert not [str(of.message) for of in told if "symmetric" not in str(of.message)]


def test_action_spaces_agree(continuous: calib_rl.ActionModel) -> None:
    rng = np.random.default_rng(4)
    envs = {
        kind: calib_rl.gym.make(continuous, member=1, action_space="box" if kind == "live" else kind, live=kind == "live")  # type: ignore[call-overload]
        for kind in ("discrete", "multi_discrete", "box", "live")
    }
    for env in envs.values():
        env.reset(seed=9)
    for _ in range(39):
        level = int(rng.integers(9))
        values = continuous.actions[level].values
        actions = {"discrete": level, "multi_discrete": [int(2 * value) for value in values], "box": values, "live": values}
        rows = {kind: env.step(np.array(actions[kind]))[4]["row"] for kind, env in envs.items()}
        assert len(set(rows.values())) == 1, rows


def test_many_walkers_are_single_ones(acting: calib_rl.ActionModel) -> None:
    vector = calib_rl.gym.make_vec(acting, 6, members=[0, 3], timeout=7)
    seen, _ = vector.reset(seed=5)
    singles = [calib_rl.gym.make(acting, member=[0, 3][number % 2], timeout=7) for number in range(6)]
    alone = [env.reset(seed=5 + number)[0] for number, env in enumerate(singles)]
    assert (np.array(alone) == seen).all()
    rng = np.random.default_rng(0)
    for step in range(30):
        actions = rng.integers(3, size=6)
        seen, rewards, terminated, truncated, info = vector.step(actions)
        for number, env in enumerate(singles):
            if step % 8 == 7:
                observed, _ = env.reset()
                assert rewards[number] == 0.0
            else:
                observed, reward, end, cut, told = env.step(int(actions[number]))
                assert (reward, end, cut) == (rewards[number], terminated[number], truncated[number])
                assert told["row"] == info["row"][number] and told["covered"] == info["covered"][number]
            assert (observed == seen[number]).all()
    there = pickle.loads(pickle.dumps(vector))
    assert (there.step(np.zeros(6, np.int64))[0] == vector.step(np.zeros(6, np.int64))[0]).all()


@pytest.mark.parametrize("kind", ["increments", "network"])
def test_walks_that_leave_recorded_rows(acting: calib_rl.ActionModel, kind: Any) -> None:
    env = calib_rl.gym.make(acting, member=1, units="physical", kind=kind)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of bounds that are not from -1 to 1
        check_env(env, skip_render_check=True)
    recorded = {float(np.float32(value)) for value in tank()["level"]}
    many = calib_rl.gym.make_vec(acting, 4, members=[1, 2], units="physical", kind=kind)
    seen, info = env.reset(seed=7)
    all_seen, _ = many.reset(seed=[7, 8, 9, 10])
    assert (seen == all_seen[0]).all()
    others = 0
    for number in range(30):
        before = float(seen[0])
        seen, reward, terminated, truncated, info = env.step(number % 3)
        all_seen, rewards, *_ = many.step(np.full(4, number % 3))
        assert (seen == all_seen[0]).all() and reward == rewards[0]
        assert env.observation_space.contains(seen) and (info["displacement"] == 0).all()
        others += float(seen[0]) not in recorded
        # The level moves from its place by the effect of the valve.
        expected = np.clip(before + 0.1 * ((number % 3) / 2 - 0.5), 0.0, 1.0)
        assert abs(float(seen[0]) - expected) < 0.08, (before, number % 3, seen)
        if number == 12:
            twin = pickle.loads(pickle.dumps(env))
            one, other = twin.step(1), env.step(1)
            assert (one[0] == other[0]).all() and one[1] == other[1]
            many.step(np.ones(4, int))
            seen = other[0]
    assert others > 20


def test_networks_are_trained_once(acting: calib_rl.ActionModel, tmp_path: Path) -> None:
    folder = tmp_path / "control-model"
    shutil.copytree(acting.path, folder, ignore=shutil.ignore_patterns("network-*"))

    def walk() -> list[float]:
        env = calib_rl.gym.make(calib_rl.ActionModel.open(folder), member=1, kind="network")
        env.reset(seed=1)
        return [float(env.step(number % 3)[0][0]) for number in range(10)]

    first = walk()
    networks = sorted(folder.glob("network-*"))
    assert [path.name for path in networks] == [f"network-{member}.safetensors" for member in range(5)]
    before, whole = [path.stat().st_mtime_ns for path in networks], networks[1].read_bytes()
    assert walk() == first and [path.stat().st_mtime_ns for path in networks] == before
    networks[1].write_bytes(whole[:-1] + bytes([whole[-1] ^ 1]))
    assert walk() == first and networks[1].read_bytes() == whole
    assert networks[0].stat().st_mtime_ns == before[0]


def test_networks_that_cannot_be_stored_are_used(acting: calib_rl.ActionModel, tmp_path: Path) -> None:
    folder = tmp_path / "control-model"
    shutil.copytree(acting.path, folder, ignore=shutil.ignore_patterns("network-*"))
    # No file can be put in the place of a folder.
    (folder / "network-3.safetensors" / "in the way").mkdir(parents=True)
    model = calib_rl.ActionModel.open(folder)
    with pytest.warns(calib_rl.CalibWarning, match=r"networks were not stored: .*network-3\.safetensors") as told:
        env = calib_rl.gym.make(model, member=3, kind="network")
    assert [one.filename for one in told if one.category is calib_rl.CalibWarning] == [__file__]
    env.reset(seed=1)
    env.step(1)
    few: dict[str, Any] = {"total_timesteps": 50, "members": [0, 1], "kinds": ["network"]}
    with pytest.raises(calib_rl.CalibError, match="take processes=1"):
        calib_rl.tune(Sarsa, {"step_size": [0.3]}, model, processes=2, **few)
    with pytest.warns(calib_rl.CalibWarning, match="not stored"):
        assert not calib_rl.tune(Sarsa, {"step_size": [0.3]}, model, processes=1, **few).failures


def test_arguments_of_a_model_with_actions_are_named_as_in_python(tmp_path: Path) -> None:
    for given, told in {
        "neighbours": "did you mean control={'model': {'neighbors': ...}}?",
        "members": "did you mean control={'model': {'members': ...}}?",
        "level": "did you mean levels=?",
        "every": "did you mean control={'every': ...}?",
        "preproces": "did you mean preprocess=?",
        "zzz": "sections of a study are seed, output, ",
    }.items():
        sections: dict[str, Any] = {given: 3}
        with pytest.raises(TypeError) as refused:
            calib_rl.build_model(tank(60), tmp_path / "new", actions=["valve0"], reward="reward", **sections)
        assert str(refused.value).startswith(f"build_model() got an unexpected argument '{given}'; {told}"), refused.value
    predicting: dict[str, Any] = {"neighbours": 3}
    with pytest.raises(TypeError, match="did you mean model={'neighbors': ...}"):
        calib_rl.build_model(tank(60), tmp_path / "new", **predicting)
    with pytest.raises(ValueError, match="^levels is 1, expected a whole number of at least 2"):
        calib_rl.build_model(tank(60), tmp_path / "new", actions=["valve0"], reward="reward", levels=1)
    with pytest.raises(TypeError, match="^timeout is 'x', expected a whole number"):
        calib_rl.build_model(tank(60), tmp_path / "new", actions=["valve0"], reward="reward", timeout="x")
    assert not (tmp_path / "new").exists()


def test_a_folder_that_is_a_file_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "log.csv").write_text("", encoding="utf-8")
    with pytest.raises(calib_rl.CalibError, match=r"^folder: .*log\.csv is a file, and models are kept in a folder; name another one$"):
        calib_rl.build_model(tank(), tmp_path / "log.csv", actions=["valve0"], reward="reward")
    with pytest.raises(calib_rl.CalibError, match=r"^folder: .*log\.csv/model cannot be made \(Not a directory\); name one that can be written to$"):
        calib_rl.build_model(tank(), tmp_path / "log.csv" / "model", actions=["valve0"], reward="reward")

    def refuse(path: Path, content: bytes) -> None:
        raise PermissionError(13, "Permission denied", f"{path}.tmp")

    # The superuser may write everywhere.
    monkeypatch.setattr(Path, "write_bytes", refuse)
    with pytest.raises(calib_rl.CalibError, match=r"^folder: .*study\.toml cannot be written \(Permission denied\); name a folder that you may write to$"):
        calib_rl.build_model(tank(), tmp_path, actions=["valve0"], reward="reward")


def test_sections_are_those_of_a_study(tmp_path: Path) -> None:
    with pytest.raises(calib_rl.StudyError) as refused:
        calib_rl.Study({"nosuch": 1}, path=tmp_path / "study.toml")
    known = str(refused.value).partition("(known keys: ")[2].removesuffix(")").split(", ")
    assert sorted(known) == sorted(SECTIONS)


def test_an_action_that_stands_out_makes_no_levels(tmp_path: Path) -> None:
    log = tank(600).with_columns(valve0=polars.Series([1e6 if row == 300 else row * 37 % 100 / 100 for row in range(600)]))
    model = calib_rl.build_model(log, tmp_path, actions=["valve0"], reward="reward", levels=5, timeout=40)
    assert model.action_columns == {"valve0": (0.0, 0.99)}
    assert all(action.transitions > 20 for action in model.actions)


def test_what_an_environment_refuses(acting: calib_rl.ActionModel, continuous: calib_rl.ActionModel) -> None:
    plain = calib_rl.build_model(np.random.default_rng(0).random((300, 2)))
    arguments: Any
    for arguments, told in [
        ({"timeout": 5}, "timeout is for models with actions"),
        ({"action_space": gymnasium.spaces.Discrete(3)}, "has no actions"),
    ]:
        with pytest.raises(ValueError, match=told):
            calib_rl.gym.make(plain, **arguments)
    for of, arguments, told in [
        (acting, {"reward": 0}, "those of its log"),
        (acting, {"max_steps": 5}, "timeout"),
        (acting, {"action_space": gymnasium.spaces.Discrete(4)}, r"Discrete\(3\)"),
        (acting, {"action_space": "box", "live": True}, "levels="),
        (acting, {"observe": ["nothing"]}, "level, flow"),
        (continuous, {"live": True}, "action_space='box'"),
    ]:
        with pytest.raises(ValueError, match=told):
            calib_rl.gym.make(of, **arguments)
    worst: Any
    for worst in (float("nan"), float("inf"), "a", "-3", [1.0]):
        expected = r"^worst_return is .*, expected a finite number, such as -10\.0"
        with pytest.raises(ValueError, match=expected):
            calib_rl.gym.make(acting, pessimism="minimum_return", worst_return=worst)
        with pytest.raises(ValueError, match=expected):
            calib_rl.gym.make_vec(acting, 2, worst_return=worst)
    env = calib_rl.gym.make(acting)
    env.reset()
    with pytest.raises(ValueError, match="from 0 to 2"):
        env.step(3)
    with pytest.raises(TypeError, match="expected a list"):
        calib_rl.build_model(tank(), "nowhere", actions="valve0", reward="reward")
    for reward in (["reward"], [], {"column": "reward"}, 3):
        with pytest.raises(TypeError, match="^reward is .*, expected the name of a column, or terms"):
            calib_rl.build_model(tank(), "nowhere", actions=["valve0"], reward=reward)


def test_pessimism_ends_episodes(acting: calib_rl.ActionModel) -> None:
    careful = calib_rl.gym.make(acting, pessimism="minimum_return", worst_return=-77.0, timeout=10_000)
    careful.reset(seed=0)
    terminated, reward = False, 0.0
    for _ in range(10_000):
        _, reward, terminated, _, info = careful.step(2)
        assert terminated == (not info["covered"])
        if terminated:
            break
    assert terminated and reward == -77.0


def test_only_whole_numbers_are_actions_by_number(acting: calib_rl.ActionModel, continuous: calib_rl.ActionModel) -> None:
    env = calib_rl.gym.make(acting)
    env.reset(seed=1)
    for action in (0.5, float("nan"), float("inf"), "up", None):
        with pytest.raises(ValueError, match=f"an action is {action}, expected a whole number"):
            env.step(action)
    rows = set()
    for one in (1, 1.0, np.int64(1), np.float32(1.0), np.array([1]), True):
        env.reset(seed=1)
        rows.add(env.step(one)[4]["row"])
    assert len(rows) == 1, rows
    many = calib_rl.gym.make_vec(acting, 3)
    many.reset(seed=1)
    with pytest.raises(ValueError, match="an action is 0.5, expected a whole number"):
        many.step([0, 0.5, 1])
    both = calib_rl.gym.make(continuous, action_space="multi_discrete")
    both.reset(seed=1)
    with pytest.raises(ValueError, match="an action is 1.5, expected a whole number"):
        both.step([0, 1.5])


@pytest.mark.parametrize("live", [False, True])
def test_an_action_has_a_number_for_each_column(continuous: calib_rl.ActionModel, live: bool) -> None:
    columns = len(continuous.action_columns)
    box = calib_rl.gym.make(continuous, action_space="box", live=live)
    for action, shape in ((np.zeros(columns + 1), f"({columns + 1},)"), (0.0, "()"), (np.zeros((1, columns)), f"(1, {columns})")):
        box.reset(seed=1)
        with pytest.raises(ValueError, match=re.escape(f"an action has the shape {shape}, expected ({columns},)")):
            box.step(action)
    many = calib_rl.gym.make_vec(continuous, 3, action_space="box", live=live)
    many.reset(seed=1)
    with pytest.raises(ValueError, match=re.escape(f"expected ({columns},)")):
        many.step(np.zeros((3, columns + 1)))


def test_an_action_without_a_range_is_named(tmp_path: Path) -> None:
    fixed = tank(columns=2).with_columns(polars.lit(0.5).alias("valve1"))
    model = calib_rl.build_model(fixed, tmp_path, actions=["valve0", "valve1"], reward="reward", timeout=40)
    env = calib_rl.gym.make(model, action_space="box")
    env.reset(seed=1)
    with pytest.raises(ValueError, match="valve1 has one value in the log.*leave it out of actions="):
        env.step([0.5, np.nan])
    for action in ([np.nan, 0.5], [np.nan, np.nan]):
        with pytest.raises(ValueError, match="which is no number: the agent has diverged"):
            env.step(action)


@pytest.mark.parametrize("place", [-1, 1_000])
def test_a_place_in_multi_discrete_is_one_of_its_levels(continuous: calib_rl.ActionModel, place: int) -> None:
    both = calib_rl.gym.make(continuous, action_space="multi_discrete")
    both.reset(seed=1)
    action = [0] * (len(continuous.action_columns) - 1) + [place]
    with pytest.raises(ValueError, match=re.escape(f"an action is {action}, expected numbers from 0 to [")):
        both.step(action)


def test_one_name_observes_one_column(acting: calib_rl.ActionModel) -> None:
    assert calib_rl.gym.make(acting, observe="level").observation_space.shape == (1,)
    assert calib_rl.gym.make_vec(acting, 2, observe="level").observation_space.shape == (2, 1)
    with pytest.raises(ValueError, match="no column is called 'pressure'; the model has level, flow"):
        calib_rl.gym.make(acting, observe="pressure")


def test_what_is_no_model_is_refused_with_what_is(acting: calib_rl.ActionModel) -> None:
    path: Any = str(acting.path)
    calls: list[Callable[[], object]] = [
        lambda: calib_rl.tune(Sarsa, GRID, path, total_timesteps=10),
        lambda: calib_rl.ControlAgent(path),
        lambda: calib_rl.ControlAgent(acting).train(path, 10),
    ]
    for call in calls:
        with pytest.raises(TypeError, match="^model is '.*control-model', expected a calib_rl.ActionModel: .*ActionModel.open"):
            call()
    makes: list[Callable[[], object]] = [lambda: calib_rl.gym.make(path), lambda: calib_rl.gym.make_vec(path, 2)]
    for make in makes:
        with pytest.raises(TypeError, match="^model is '.*', expected a calib_rl.Model or a calib_rl.ActionModel"):
            make()


def _alone(lines: str) -> str:
    """Returns the output of a Python process that imports nothing else."""
    return subprocess.run([sys.executable, "-c", lines], check=True, capture_output=True, text=True).stdout.strip()


def test_modules_are_imported_at_their_first_use(acting: calib_rl.ActionModel) -> None:
    assert _alone("import sys, calib_rl; print('gymnasium' in sys.modules, calib_rl.gym.make.__name__, calib_rl.agents.Sweep.__name__)") == "False make Sweep"
    made = f"import gymnasium; print(gymnasium.make('calib_rl.gym:calib/Model-v0', path={str(acting.path)!r}).action_space)"
    assert _alone(made) == "Discrete(3)"
    without = "import sys; sys.modules['gymnasium'] = None\nimport calib_rl\ntry: calib_rl.gym\nexcept ImportError as error: print(error)"
    assert _alone(without).startswith("calib_rl.gym needs the package gymnasium: pip install gymnasium")
    with pytest.raises(AttributeError, match="module 'calib_rl' has no attribute 'gymm'"):
        getattr(calib_rl, "gymm")


def test_gymnasium_makes_it_by_name(acting: calib_rl.ActionModel) -> None:
    env = gymnasium.make("calib/Model-v0", path=acting.path, timeout=5, observe=["level"])
    assert env.reset(seed=1)[0].shape == (1,) and env.action_space == gymnasium.spaces.Discrete(3)
    vector = gymnasium.make_vec("calib/Model-v0", 4, vectorization_mode="vector_entry_point", path=acting.path)
    assert vector.reset(seed=1)[0].shape == (4, 2)


def test_actions_that_cannot_be(tmp_path: Path) -> None:
    arguments: Any
    for number, (frame, arguments, told) in enumerate(
        [
            (tank(), {"actions": ["none"], "reward": "reward"}, "none"),
            (tank(), {"actions": ["valve0"], "reward": "nothing"}, "nothing"),
            (tank().with_columns(reward=polars.lit(float("nan"))), {"actions": ["valve0"], "reward": "reward"}, "reward"),
            (tank().with_columns(valve0=polars.Series(np.arange(1200.0))), {"actions": ["valve0"], "reward": "reward"}, "levels"),
        ]
    ):
        with pytest.raises((calib_rl.CalibError, ValueError), match=told):
            calib_rl.build_model(frame, tmp_path / str(number), **arguments)


def test_a_log_with_one_action_is_refused(acting: calib_rl.ActionModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    idle = tank(60).with_columns(valve0=polars.lit(0.5))
    told = r"control\.actions: it is valve0=0\.5 in every row, so there is nothing to choose"
    for levels in (None, 3):
        folder = tmp_path / str(levels)
        with pytest.raises(calib_rl.CalibError, match=told):
            calib_rl.build_model(idle, folder, actions=["valve0"], reward="reward", levels=levels)
        assert not list(folder.glob("*/control-model")), "nothing is begun"
    # Stands for a model that an earlier version of calib built of such a log.
    earlier = calib_rl.ActionModel.open(acting.path)
    monkeypatch.setattr(earlier, "_native", SimpleNamespace(only_action="it is valve0=0.5 in every row"))
    with pytest.raises(calib_rl.CalibError, match=r"valve0=0\.5 in every row"):
        calib_rl.tune(Sarsa, GRID, earlier, total_timesteps=10)


class Sarsa:
    """A small agent that needs only NumPy: Q-learning in tiles of the level."""

    def __init__(self, env: gymnasium.Env[Any, Any], step_size: float = 0.1, epsilon: float = 0.1, seed: int = 0) -> None:
        if step_size > 5:
            raise ValueError("step_size is too large")
        self.env, self.step_size, self.epsilon = env, step_size, epsilon
        self.values = np.zeros((21, env.action_space.n))  # type: ignore[attr-defined]
        self.rng = np.random.default_rng(seed)

    def learn(self, total_timesteps: int) -> None:
        over, place = True, 0
        for _ in range(total_timesteps):
            if over:
                place = int(self.env.reset()[0][0] * 20)
            values = self.values[place]
            action = int(self.rng.integers(len(values))) if self.rng.random() < self.epsilon else int(values.argmax())
            seen, reward, terminated, truncated, _ = self.env.step(action)
            after = int(seen[0] * 20)
            target = float(reward) + (0.0 if terminated else 0.9 * self.values[after].max())
            self.values[place, action] += self.step_size * (target - self.values[place, action])
            over, place = terminated or truncated, after


GRID = {"step_size": [0.001, 0.3], "epsilon": [0.05, 1.0]}


@pytest.fixture(scope="module")
def tuned(acting: calib_rl.ActionModel) -> calib_rl.Tuned:
    return calib_rl.tune(Sarsa, GRID, acting, total_timesteps=3000, processes=1)


def test_settings_are_ranked(tuned: calib_rl.Tuned) -> None:
    assert tuned.chosen == {"step_size": 0.3, "epsilon": 0.05} and len(tuned.settings) == 5 and tuned.default == {}
    assert tuned.failures == [] and len(tuned.runs) == 75 and {len(run["returns"]) for run in tuned.runs} == {75}
    frame = tuned.frame()
    assert frame["setting"][0] == "step_size=0.3 epsilon=0.05" and frame["mean_rank"][0] <= 2
    assert [kind["kind"] for kind in tuned.verdict["kinds"]] == ["neighbors", "increments", "network"]
    assert {(run["kind"], run["member"]) for run in tuned.runs} == {(kind, member) for kind in KINDS for member in range(5)}
    why = "\n".join(tuned.why())
    assert "Over a random setting: +" in why and tuned.advice[0].startswith(("Deploy ", "Keep the default: "))
    assert tuned.why()[:2] == tuned.advice[:2] and len(tuned.advice) <= 5 and "first by mean rank: " in tuned.advice[1]
    assert str(tuned).startswith(tuned.advice[0]) and ".why()" in str(tuned) and "Over a random setting" not in str(tuned)
    assert "<table>" in tuned._repr_html_()
    said = tuned.verdict["decision"]["support"]
    assert tuned.is_supported == (said == "supported") and tuned.verdict["is_ahead_of_default"] == (said != "keep_default")
    # No agent is needed where one action is always right. Here each setting learns when to take which action.
    constant = tuned.verdict["constant"]
    assert constant["over"]["mean"] > 0 and "Best constant action: always " in why
    assert [kind["kind"] for kind in constant["kinds"]] == ["neighbors", "increments", "network"]


def test_what_was_found_is_a_page(tuned: calib_rl.Tuned, tmp_path: Path) -> None:
    path = tuned.report(tmp_path / "tuned.html")
    page = path.read_text(encoding="utf-8")
    headline = tuned.verdict["decision"]["headline"]
    for text in [headline, "neighbors", "increments", "network", "the agent&#39;s own default", "step_size=0.3", "Return in the models"]:
        assert text in page or text.replace("&#39;", "'") in page, text
    assert 'src="http' not in page, "the page loads nothing"
    failed = calib_rl.Tuned([], None, {}, ["Deploy nothing: every setting failed."], [], [], [], {}, [])
    with pytest.raises(ValueError, match="every setting failed"):
        failed.report(tmp_path / "failed.html")
    assert tuned.report(tmp_path / "new" / "tuned.html").read_text(encoding="utf-8") != page, "it names itself"
    with pytest.raises(calib_rl.CalibError):
        tuned.report(tmp_path)


def test_processes_and_a_stop_change_nothing(acting: calib_rl.ActionModel, tuned: calib_rl.Tuned, tmp_path: Path) -> None:
    def call(**arguments: Any) -> calib_rl.Tuned:
        return calib_rl.tune(Sarsa, GRID, acting, total_timesteps=3000, folder=tmp_path / "units", **arguments)

    assert call(processes=2).verdict == tuned.verdict
    kept = sorted((tmp_path / "units").iterdir())
    assert len(kept) == 75
    before = {path: path.stat().st_mtime_ns for path in kept}
    for path in kept[:4]:
        os.unlink(path)
    again = call(processes=1)
    assert again.verdict == tuned.verdict and again.runs == tuned.runs
    assert all(path.stat().st_mtime_ns == before[path] for path in kept[4:]), "what was there was not made again"


def test_a_setting_that_fails_is_told_and_the_others_go_on(acting: calib_rl.ActionModel) -> None:
    class Ends:
        """An agent that fails; each mode is another way to fail."""

        def __init__(self, env: Any, mode: str = "well") -> None:
            self.env, self.mode = env, mode
            if mode == "dies":
                os._exit(3)

        def learn(self, total_timesteps: int) -> None:
            over = True
            if self.mode == "lazy":
                return
            for step in range(total_timesteps * (1000 if self.mode == "endless" else 1)):
                if over:
                    self.env.reset()
                _, _, end, cut, _ = self.env.step(float("nan") if self.mode == "nan" and step > 5 else 1)
                over = end or cut

    modes = ["nan", "lazy", "endless", "dies"]
    tuned = calib_rl.tune(Ends, {"mode": modes}, acting, total_timesteps=200, members=[0, 1], processes=2)
    failed = {failure.setting["mode"]: failure for failure in tuned.failures}
    assert sorted(failed) == sorted(modes) and tuned.chosen == {}
    assert "nan" in failed["nan"].error.lower() and failed["nan"].place == "learn"
    assert "after 0 steps" in failed["lazy"].error and "does not stop" in failed["endless"].error
    assert failed["dies"].place == "process" and "exit code 3" in failed["dies"].error
    raised = calib_rl.tune(Sarsa, {"step_size": [0.1, 9.0]}, acting, total_timesteps=200, members=[0, 1], processes=1).failures
    assert [failure.place for failure in raised] == ["make_agent"] and "too large" in str(raised[0])


def test_a_default_that_fails_was_tried(acting: calib_rl.ActionModel) -> None:
    def call(default: dict[str, Any] | None) -> calib_rl.Tuned:
        grid = {"step_size": [0.1, 0.3]}
        return calib_rl.tune(Sarsa, grid, acting, total_timesteps=200, members=[0, 1], kinds=["neighbors"], processes=1, default=default)

    failed = call({"step_size": 9.0})
    assert failed.advice[0].startswith("Deploy nothing") and not failed.is_supported
    assert any("the default was tried, and failed" in doubt for doubt in failed.doubts), failed.doubts
    assert "No default" not in "\n".join(failed.why()) and len(failed.failures) == 1
    none = call(None)
    assert "No default was compared." in none.why() and not any("default was tried" in doubt for doubt in none.doubts)


def test_one_member_supports_nothing(acting: calib_rl.ActionModel) -> None:
    tuned = calib_rl.tune(Sarsa, GRID, acting, total_timesteps=1000, members=[0], processes=1, default=None)
    assert tuned.advice[0].startswith("Deploy nothing") and not tuned.is_supported
    assert any("one ensemble member gives no interval" in line for line in tuned.advice), tuned.advice


def test_policies_that_learn_nothing_walk_often(acting: calib_rl.ActionModel) -> None:
    # A hundred episodes of 40 steps need rollouts of 200 steps, and three constant actions together have about as many.
    assert acting._native.fixed_walks(1, 200, 40) == (20, 7)
    assert acting._native.fixed_walks(50, 200, 40) == (50, 50)
    work = _Work(Sarsa, acting, [{}], None, [3, 1], ["neighbors"], 1, 0, {}, 1, False)
    (found,) = work.constants(200)
    assert [len(found["members"]), len(found["random"])] == [2, 2] and {len(own) for own in found["members"]} == {3}
    # Of 200 calls of `step` four begin an episode.
    assert [own["steps"] for own in found["coverage"]] == [196 * 2 * 7] * 3
    assert work.constants(200) == [found], "of named seeds"
    # Another seed is other walks, and says the same of actions at random.
    others = [_Work(Sarsa, acting, [{}], None, [3, 1], ["neighbors"], 1, seed, {}, 1, False).constants(200)[0] for seed in (1, 2, 3)]
    spread = np.std([other["random"][0] for other in others])
    assert 0 < spread < 0.15 * abs(found["random"][0])


def test_halving_keeps_the_best_and_the_default(acting: calib_rl.ActionModel) -> None:
    tuned = calib_rl.tune(Sarsa, GRID, acting, total_timesteps=1800, members=[0, 1], processes=1, halving=2)
    (first, left), (second, left_later) = tuned.halved
    assert (first, second) == (450, 900) and len(left) + len(left_later) + len(tuned.settings) == 5 and {} in tuned.settings


def test_what_tune_refuses(acting: calib_rl.ActionModel) -> None:
    for grid, told in [({}, "no setting"), ([{"a": 1}, {"a": 1}], "twice")]:
        with pytest.raises(ValueError, match=told):
            calib_rl.tune(Sarsa, grid, acting, total_timesteps=10)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="members is"):
        calib_rl.tune(Sarsa, GRID, acting, total_timesteps=10, members=[9])
    for kinds in ([], ["neighbors", "neighbors"], "network", ["tables"]):
        with pytest.raises(ValueError, match="kinds is"):
            calib_rl.tune(Sarsa, GRID, acting, total_timesteps=10, kinds=kinds)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="kinds="):
        calib_rl.tune(Sarsa, GRID, acting, total_timesteps=10, environment={"kind": "network"})


def test_an_agent_learns_in_a_model_is_kept_and_goes_on(acting: calib_rl.ActionModel, tmp_path: Path) -> None:
    for settings in (
        {"algorithm": "expected_sarsa", "temperature": 0.05, "step_size": 0.3},
        {"algorithm": "q_learning", "step_size": 0.3},
        {"algorithm": "deep_q_learning", "step_size": 0.001, "hidden_width": 16},
    ):
        agent = calib_rl.ControlAgent(acting, gamma=0.9, seed=3, **settings)
        first = agent.train(acting, 400)
        later = [agent.train(acting, 2_000, member=member, seed=member) for member in range(5)]
        assert first.episodes == 10 and later[-1].mean_return > first.mean_return, settings
        # Below the wanted level the agent opens the valve, above it the agent closes it.
        low, high = ({"level": level, "flow": 5.0} for level in (0.3, 0.9))
        assert agent.values(low).argmax() > agent.values(high).argmax(), settings
        path = tmp_path / "agent.safetensors"
        agent.save(path)
        again = calib_rl.ControlAgent.load(path)
        assert (again.values(low) == agent.values(low)).all() and again.settings == agent.settings
        assert again.columns == ["level", "flow"] and again.actions[2] == calib_rl.AgentAction("valve0=1", (1.0,))
        other = calib_rl.ControlAgent.load(path)
        told: list[tuple[int | None, int | None]] = [(again.begin([0.5, 5.0]), other.begin([0.5, 5.0]))]
        told += [(again.step(-0.1, [level, 5.0]), other.step(-0.1, [level, 5.0])) for level in (0.4, 0.5, 0.6)]
        assert all(one == two for one, two in told), "what is loaded twice does the same"
        before = agent.values(low)
        agent.begin(low)
        agent.step(5.0, high, learn=False)
        assert (agent.values(low) == before).all()


def test_an_agent_refuses_what_it_cannot_use(acting: calib_rl.ActionModel, continuous: calib_rl.ActionModel, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="step_size"):
        calib_rl.ControlAgent(acting, step_size=np.float64(-1.0))
    with pytest.raises(ValueError, match="unknown setting `stepsize`; did you mean `step_size`"):
        calib_rl.ControlAgent(acting, stepsize=1.0)
    agent = calib_rl.ControlAgent(acting)
    with pytest.raises(ValueError, match="call begin"):
        agent.step(0.0, [0.5, 5.0])
    with pytest.raises(ValueError, match="level is NaN"):
        agent.begin([np.nan, 5.0])
    with pytest.raises(ValueError, match="expected 2"):
        agent.begin([0.5])
    with pytest.raises(ValueError, match="no 'flow'"):
        agent.begin({"level": 0.5})
    agent.begin([0.5, 5.0])
    with pytest.raises(ValueError, match="reward is inf"):
        agent.step(np.inf, [0.5, 5.0])
    assert agent.step(0.0, [0.5, 5.0], terminal=True) is None
    with pytest.raises(ValueError, match="the model has other actions than the agent"):
        agent.train(continuous, 10)
    with pytest.raises(IndexError):
        agent.train(acting, 10, member=5)
    bad = tmp_path / "bad.safetensors"
    bad.write_bytes(b"nothing")
    with pytest.raises(calib_rl.CalibError):
        calib_rl.ControlAgent.load(bad)
    agent.save(tmp_path / "agent.safetensors")
    damaged = (tmp_path / "agent.safetensors").read_bytes().replace(b'"weights"', b'"weightz"')
    bad.write_bytes(damaged)
    with pytest.raises(calib_rl.CalibError, match="damaged"):
        calib_rl.ControlAgent.load(bad)
    # This is beyond single precision, so the agent's values are not finite.
    agent.begin([0.5, 5.0])
    assert agent.step(1e300, [0.5, 5.0], terminal=True) is None
    with pytest.raises(calib_rl.CalibError, match="has diverged.* was not written; train a new one"):
        agent.save(tmp_path / "diverged.safetensors")
    assert not (tmp_path / "diverged.safetensors").exists()


def test_a_network_that_has_diverged_is_not_written(acting: calib_rl.ActionModel, tmp_path: Path) -> None:
    agent, path = calib_rl.ControlAgent(acting, algorithm="deep_q_learning", step_size=1e30), tmp_path / "diverged.safetensors"
    with pytest.raises(calib_rl.CalibError, match="has diverged"):
        agent.train(acting, 2000)
    # The weights are large finite numbers, and their products are infinite.
    with pytest.raises(calib_rl.CalibError, match="has diverged.* was not written; train a new one"):
        agent.save(path)
    assert not path.exists()


def test_an_agent_learns_in_a_model_of_other_ranges(acting: calib_rl.ActionModel, tmp_path: Path) -> None:
    low = tank().with_columns(polars.col("level") / 2, polars.col("flow") - 1.0)
    halved = calib_rl.build_model(low, tmp_path / "low", actions=["valve0"], reward="reward", timeout=40)
    settings: dict[str, Any] = {"temperature": 0.05, "step_size": 0.3, "gamma": 0.9}
    own = calib_rl.ControlAgent(halved, **settings)
    other = calib_rl.ControlAgent(acting, **settings)
    for agent in (own, other):
        for member in range(5):
            agent.train(halved, 4_000, member=member)
        # 0.15 stands for 0.3 of the tank, below the wanted level, and 0.45 for 0.9.
        assert agent.values([0.15, 4.0]).argmax() > agent.values([0.45, 4.0]).argmax()
    renamed = calib_rl.build_model(low.rename({"flow": "inflow"}), tmp_path / "names", actions=["valve0"], reward="reward")
    with pytest.raises(ValueError, match="the columns of the model are level, inflow, and those of the agent level, flow"):
        other.train(renamed, 10)


@pytest.mark.parametrize(
    "settings",
    [
        {"algorithm": "expected_sarsa", "temperature": 0.05, "step_size": 0.3},
        {"algorithm": "q_learning", "step_size": 0.3, "pairs": False, "tilings": 5, "tiles": 11},
        {"algorithm": "deep_q_learning", "step_size": 0.001, "hidden_width": 16},
    ],
)
def test_a_runtime_of_onnx_computes_the_values_of_the_agent(acting: calib_rl.ActionModel, tmp_path: Path, settings: dict[str, Any]) -> None:
    onnxruntime = pytest.importorskip("onnxruntime")
    agent = calib_rl.ControlAgent(acting, gamma=0.9, seed=3, **settings)
    agent.train(acting, 3000)
    path, saved = tmp_path / "agent.onnx", tmp_path / "agent.safetensors"
    agent.to_onnx(path)
    agent.save(saved)
    session = onnxruntime.InferenceSession(str(path))
    # This goes beyond the recorded ranges too.
    states = np.random.default_rng(1).uniform([-0.2, 1.0], [1.2, 9.0], (1000, 2)).astype(np.float32)
    (values,) = session.run(["values"], {"state": states})
    expected = np.array([agent.values(state.astype(np.float64)) for state in states])
    assert values.shape == (1000, 3) and values.dtype == np.float32 and len(np.unique(expected)) > 100
    np.testing.assert_allclose(values, expected, rtol=1e-5, atol=1e-5)
    told = session.get_modelmeta().custom_metadata_map
    assert [column["name"] for column in json.loads(told["columns"])] == agent.columns
    assert json.loads(told["actions"])[2] == {"name": "valve0=1", "values": [1.0]}
    assert json.loads(told["settings"]) == agent.settings and told["fingerprint"] in saved.read_bytes().decode("latin-1")


def test_an_agent_that_cannot_become_onnx(acting: calib_rl.ActionModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("onnx")
    agent, path = calib_rl.ControlAgent(acting), tmp_path / "agent.onnx"
    path.write_text("what was there")
    with pytest.raises(calib_rl.CalibError, match="has diverged.* was not written; train a new one"):
        calib_rl.ControlAgent(acting, initial_weight=1e300).to_onnx(path)
    for place in (tmp_path, tmp_path / "nowhere" / "agent.onnx"):
        with pytest.raises(calib_rl.CalibError, match="cannot be written"):
            agent.to_onnx(place)
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(ImportError, match="pip install onnx"):
        agent.to_onnx(path)
    assert path.read_text() == "what was there" and list(tmp_path.iterdir()) == [path]


def test_the_chosen_agent_comes_out(tmp_path: Path) -> None:
    model = calib_rl.build_model(tank(), tmp_path, actions=["valve0"], reward="reward", timeout=40)
    path = model.path.parents[1] / "study.toml"
    sets = ("control.grid={ step_size = [0.01, 0.3] }", "control.steps=400", "control.agent.temperature=0.05")
    study = calib_rl.Study(path, set=sets)
    with pytest.raises(calib_rl.CalibError, match="calib control"):
        calib_rl.ControlAgent.of(study)
    done = command_line("control", path, *(part for text in sets for part in ("--set", text)), "--json")
    assert done.returncode in (0, 1), done.stderr
    agent = calib_rl.ControlAgent.of(study)
    assert agent.settings == json.loads(done.stdout)["choice"]
    assert agent.settings["temperature"] == 0.05 and agent.columns == model.columns
    assert agent.begin([0.5, 5.0]) in range(3)
    other: list[calib_rl.Study | str | os.PathLike[str]] = [calib_rl.Study(path), path, str(path)]
    for given in other:
        with pytest.raises(calib_rl.CalibError, match="other values than the study has"):
            calib_rl.ControlAgent.of(given)
    assert calib_rl.ActionModel.of(path).columns == calib_rl.ActionModel.of(str(path)).columns == model.columns
    with pytest.raises(calib_rl.StudyError, match="nothing.toml"):
        calib_rl.ControlAgent.of(tmp_path / "nothing.toml")
    with pytest.raises(TypeError, match="^a study is a calib_rl.Study or the path of its file; got ActionModel$"):
        calib_rl.ControlAgent.of(model)  # type: ignore[arg-type]
