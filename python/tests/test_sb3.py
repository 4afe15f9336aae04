"""Agents of Stable-Baselines3 and d3rlpy, which need PyTorch: `scripts/sb3.sh` has an environment for them."""

from __future__ import annotations

import functools
import importlib
import re
import shlex
import subprocess
import sys
import warnings
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gymnasium
import numpy as np
import pytest

import calib_rl
import calib_rl.gym
from conftest import command_line
from test_acting import tank
from test_examples import run

stable_baselines3 = pytest.importorskip("stable_baselines3")

GUIDE = Path(__file__).parents[2] / "docs" / "guides" / "tune-your-agent.md"

# What the code of the guide is run with: fewer steps and ensemble members, in one process.
SMALL = """
import functools
import calib_rl

def small(tune, *arguments, **given):
    return tune(*arguments, **{**given, "total_timesteps": 600, "members": [0, 1], "processes": 1})

calib_rl.tune = functools.partial(small, calib_rl.tune)
"""


@pytest.fixture(scope="module")
def pole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("pole") / "pole"
    simulated = command_line("simulate", folder, "--task", "cart-pole", "--policy", "random", "--transitions", 600)
    assert simulated.returncode == 0, simulated.stderr
    return folder


@pytest.fixture(scope="module")
def cart(pole: Path, tmp_path_factory: pytest.TempPathFactory) -> calib_rl.ActionModel:
    return calib_rl.build_model(pole, tmp_path_factory.mktemp("cart"), actions=["action"], reward="reward", terminal="terminal")


@pytest.fixture(scope="module")
def valves(tmp_path_factory: pytest.TempPathFactory) -> calib_rl.ActionModel:
    folder = tmp_path_factory.mktemp("valves")
    return calib_rl.build_model(tank(columns=2), folder, actions=["valve0", "valve1"], reward="reward", levels=3, timeout=40)


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", GUIDE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


def test_the_fifteen_lines_of_the_guide_run(tmp_path: Path) -> None:
    python, script, log = shlex.split(blocks("sh")[0])
    assert (python, script, log) == ("python3", "python/examples/tank.py", "tank.csv")
    run("tank.py", tmp_path / log)
    lines = blocks("python")[0]
    assert "stable_baselines3" in lines and "total_timesteps=5_000" in lines
    done = subprocess.run([sys.executable, "-c", SMALL + lines], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "all reasons: .why()" in done.stdout and "30 of 30" in done.stderr
    assert (tmp_path / "tuned" / "report.html").is_file()


def test_the_read_me_pages_have_the_lines_of_the_guide() -> None:
    lines = blocks("python")[0]
    shortest = lines[: lines.index("print(tuned)")] + "print(tuned)\n"
    for page in ("README.md", "python/README.md"):
        text = (GUIDE.parents[2] / page).read_text(encoding="utf-8")
        assert f"```python\n{shortest}```" in text, page


def test_the_example_runs(tmp_path: Path) -> None:
    run("tank.py", tmp_path / "tank.csv")
    assert "all reasons" in run("tune_sb3.py", tmp_path / "tank.csv", tmp_path / "sb3", 100)


def test_settings_learn_in_the_tank_itself(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.syspath_prepend(GUIDE.parents[2] / "python" / "examples")
    importlib.import_module("tank").truth([{"learning_rate": 1e-3}], steps=120, runs=2)
    line = re.fullmatch(r"(\{.*\}) (-[0-9.]+) (\[.*\])\n", capsys.readouterr().out)
    assert line is not None
    setting, mean, means = line.groups()
    assert setting == "{'learning_rate': 0.001}" and len(means.split(",")) == 2 and -60 * 0.6 < float(mean) < 0.0


def test_an_agent_that_refuses_the_action_space_names_the_one_to_take(cart: calib_rl.ActionModel) -> None:
    def make_agent(env: Any, **setting: Any) -> Any:
        return stable_baselines3.SAC("MlpPolicy", env, buffer_size=100, **setting)

    tuned = calib_rl.tune(make_agent, {"gamma": [0.9]}, cart, total_timesteps=100, members=[0], processes=1, kinds=["neighbors"])
    assert tuned.chosen is None
    assert {failure.remedy for failure in tuned.failures} == {'take environment={"action_space": "box"}, with which it can be made'}


def returns(make_agent: Any, grid: dict[str, list[Any]], model: calib_rl.ActionModel, **given: Any) -> list[Any]:
    """Tunes an agent in one member of each kind of model, and returns the returns of the episodes for each setting and kind."""
    tuned = calib_rl.tune(make_agent, grid, model, members=[0], processes=1, default=None, **given)
    assert not tuned.failures, tuned.failures[0].trace
    assert {one["kind"] for one in tuned.runs} == {"neighbors", "increments", "network"}
    return [one["returns"] for one in sorted(tuned.runs, key=lambda one: one["place"])]


def assert_settings_matter(found: list[Any]) -> None:
    slow, fast = found[: len(found) // 2], found[len(found) // 2 :]
    assert slow != fast, "no setting changes what the agent does"
    assert [one[0] for one in slow] == [one[0] for one in fast], "settings begin with the same seeds, and the first episode is before the first update"


def test_dqn_is_tuned(cart: calib_rl.ActionModel) -> None:
    make_agent = functools.partial(stable_baselines3.DQN, "MlpPolicy", learning_starts=200, exploration_fraction=0.01, device="cpu")
    assert_settings_matter(returns(make_agent, {"learning_rate": [1e-5, 1e-2]}, cart, total_timesteps=500))


def test_ppo_is_tuned(cart: calib_rl.ActionModel) -> None:
    make_agent = functools.partial(stable_baselines3.PPO, "MlpPolicy", n_steps=128, device="cpu")
    assert_settings_matter(returns(make_agent, {"learning_rate": [1e-5, 1e-2]}, cart, total_timesteps=512))


def test_sac_is_tuned_with_values_as_actions(valves: calib_rl.ActionModel) -> None:
    make_agent = functools.partial(stable_baselines3.SAC, "MlpPolicy", learning_starts=50, device="cpu")
    environment = {"action_space": "box"}
    assert_settings_matter(returns(make_agent, {"learning_rate": [1e-5, 1e-2]}, valves, total_timesteps=120, environment=environment))


def agent_of_the_guide(word: str) -> Any:
    """Returns `make_agent` of the block that has this word."""
    names: dict[str, Any] = {}
    exec(next(block for block in blocks("python") if word in block), names)
    return names["make_agent"]


def test_a_dataset_of_episodes_becomes_a_model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    episodes = [
        SimpleNamespace(
            observations=rng.normal(size=(steps + 1, 3)),
            actions=rng.integers(2, size=steps),
            rewards=rng.normal(size=steps),
            # The time limit of the guide ends the longest ones.
            terminations=(np.arange(steps) == steps - 1) & (steps < 500),
        )
        for steps in [*rng.integers(5, 40, size=30), 500, 500]
    ]
    names: dict[str, Any] = {"dataset": SimpleNamespace(iterate_episodes=lambda: iter(episodes))}
    monkeypatch.chdir(tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("error", calib_rl.CalibWarning)
        exec(next(block for block in blocks("python") if "iterate_episodes" in block), names)
    recorded = names["model"].recorded()
    returns = [episode.rewards.sum() for episode in episodes]
    assert recorded.mean == pytest.approx(np.mean(returns), abs=1e-5)
    assert (recorded.best, recorded.worst) == pytest.approx((max(returns), min(returns)), abs=1e-5)


def test_the_agent_of_the_guide_sees_several_states(cart: calib_rl.ActionModel) -> None:
    agent = agent_of_the_guide("FrameStackObservation")(calib_rl.gym.make(cart), stack=3)
    assert agent.learn(50).observation_space.shape == (12,)


def test_the_wrapper_of_the_guide_limits_changes(valves: calib_rl.ActionModel) -> None:
    taken: list[Any] = []

    class Recorded(gymnasium.ActionWrapper[Any, Any, Any]):
        def action(self, action: Any) -> Any:
            taken.append(action)
            return action

    env = Recorded(calib_rl.gym.make(valves, action_space="box"))
    agent_of_the_guide("LimitChanges")(env, most=0.1, learning_starts=100).learn(40)
    changes = np.abs(np.diff(taken, axis=0))
    assert len(taken) == 40 and changes.max() < 0.1 + 1e-6 and (changes > 0.05).any(), "valves go from 0 to 1, in an episode of 40 steps"


@pytest.mark.parametrize("kind", ["discrete", "multi_discrete", "box", "live"])
def test_the_checker_finds_nothing_wrong_with_actions(valves: calib_rl.ActionModel, kind: str) -> None:
    from stable_baselines3.common.env_checker import check_env

    live, space = kind == "live", "box" if kind == "live" else kind
    for units in ("normalised", "physical"):
        env = calib_rl.gym.make(valves, member=2, units=units, action_space=space, live=live)  # type: ignore[call-overload]
        check_env(env, skip_render_check=True)


def test_the_checker_finds_nothing_wrong_without_actions(model: calib_rl.Model) -> None:
    from stable_baselines3.common.env_checker import check_env

    for env in (calib_rl.gym.make(model), calib_rl.gym.make(model, units="physical")):
        check_env(env, skip_render_check=True)


def test_environments_in_processes_are_those_of_this_one(cart: calib_rl.ActionModel) -> None:
    from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv

    make = [functools.partial(calib_rl.gym.make, cart, member=member) for member in range(2)]
    there, here = SubprocVecEnv(make, start_method="spawn"), DummyVecEnv(make)
    try:
        there.seed(5)
        here.seed(5)
        assert (there.reset() == here.reset()).all()
        for number in range(60):
            actions = np.array([number % 2, number // 2 % 2])
            (seen, rewards, over, _), (own, own_rewards, own_over, _) = there.step(actions), here.step(actions)
            assert (seen == own).all() and (rewards == own_rewards).all() and (over == own_over).all()
        stable_baselines3.PPO("MlpPolicy", there, n_steps=32, device="cpu").learn(64)
    finally:
        there.close()


def test_an_agent_that_d3rlpy_trained_on_the_log_learns_on(pole: Path, tmp_path: Path) -> None:
    pytest.importorskip("d3rlpy")
    assert "all reasons" in run("tune_d3rlpy.py", pole, tmp_path / "d3rlpy", 60)
