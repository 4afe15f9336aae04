from __future__ import annotations

import copy
import multiprocessing
import pickle
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import calib_rl
import calib_rl.gym


def test_gymnasium_finds_nothing_wrong(model: calib_rl.Model) -> None:
    for units in ("normalised", "physical"):
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            check_env(calib_rl.gym.make(model, member=2, units=units), skip_render_check=True)
        assert not [str(of.message) for of in told if "action" not in str(of.message).lower()]


def test_a_model_without_actions_takes_no_action_space(model: calib_rl.Model) -> None:
    box = gymnasium.spaces.Box(-1, 1, (2,), np.float32)
    for make in (lambda: calib_rl.gym.make(model, action_space=box), lambda: calib_rl.gym.make_vec(model, 2, action_space=box)):
        with pytest.raises(ValueError, match="has no actions.*calib control"):
            make()


@pytest.mark.parametrize("built", [False, True])
def test_environments_are_pickled_where_they_are(model: calib_rl.Model, built: bool) -> None:
    of = calib_rl.build_model(np.random.default_rng(1).random((300, 3)), segments=[200, 100]) if built else model
    env = calib_rl.gym.make(of, member=1, reward=2, observe=[0, 2], max_steps=50)
    env.reset(seed=5)
    vector = calib_rl.gym.make_vec(of, 3, members=[0, 2], max_steps=9)
    vector.reset(seed=5)
    for _ in range(7):
        env.step(0)
        vector.step(np.zeros(3))
    there, vector_there = pickle.loads(pickle.dumps(env)), pickle.loads(pickle.dumps(vector))
    for _ in range(60):
        here, seen = env.step(0), there.step(0)
        assert (here[0] == seen[0]).all() and here[1:4] == seen[1:4] and here[4]["row"] == seen[4]["row"]
        all_here, all_seen = vector.step(np.zeros(3)), vector_there.step(np.zeros(3))
        assert all((one == other).all() for one, other in zip(all_here[:4], all_seen[:4]))
    assert env.reset()[1] == there.reset()[1]
    assert copy.deepcopy(env).step(0)[4] == env.step(0)[4]


def test_environments_go_to_other_processes(model: calib_rl.Model) -> None:
    env = calib_rl.gym.make(model, max_steps=30)
    expected = [int(env.reset(seed=3)[1]["row"]), *(int(env.step(0)[4]["row"]) for _ in range(20))]
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        assert pool.map(_walked, [calib_rl.gym.make(model, max_steps=30)]) == [expected]


def _walked(env: calib_rl.gym.CalibrationEnv) -> list[int]:
    return [int(env.reset(seed=3)[1]["row"]), *(int(env.step(0)[4]["row"]) for _ in range(20))]


def test_a_seed_is_a_walk(model: calib_rl.Model) -> None:
    env = calib_rl.gym.make(model, member=1, observe=["PIT300"], reward="PIT300")

    def walk(seed: int) -> list[float]:
        seen = [env.reset(seed=seed)[0]]
        seen += [env.step(0)[0] for _ in range(60)]
        return [float(of[0]) for of in seen]

    assert walk(4) == walk(4) != walk(5)
    first = [env.reset(seed=4)[1]["row"], env.reset()[1]["row"], env.reset()[1]["row"]]
    assert len(set(first)) == 3, "a reset without a seed goes on"


def test_what_is_seen_is_recorded(model: calib_rl.Model) -> None:
    env = calib_rl.gym.make(model, reward="PIT300", max_steps=40)
    column = model.columns.index("PIT300")
    seen, info = env.reset(seed=1)
    before = info["row"]
    for step in range(40):
        seen, reward, terminated, truncated, info = env.step(0)
        assert (seen == model.states[info["row"]]).all() and reward == seen[column]
        assert model.times is not None and info["time"] == model.times[info["row"]].astype(np.int64)
        taken = model.states[info["row"] - 1]
        assert info["distance"] == pytest.approx(np.linalg.norm(model.states[before] - taken), abs=1e-5)
        assert not terminated and truncated == (step == 39)
        before = info["row"]
    physical = calib_rl.gym.make(model, units="physical")
    physical.reset(seed=1)
    seen, reward, *_, info = physical.step(0)
    assert np.allclose(seen, model.physical(model.states[info["row"]]), rtol=1e-6)


def test_a_vector_is_its_walks(model: calib_rl.Model) -> None:
    vector = calib_rl.gym.make_vec(model, 6, members=range(5), max_steps=7)
    singles = [calib_rl.gym.make(model, member=number % 5, max_steps=7) for number in range(6)]
    seen, info = vector.reset(seed=11)
    expected = [env.reset(seed=11 + number) for number, env in enumerate(singles)]
    assert (seen == np.stack([of for of, _ in expected])).all()
    actions = np.zeros(6, np.int64)
    over = np.zeros(6, bool)
    for step in range(30):
        seen, rewards, terminated, truncated, info = vector.step(actions)
        for number, env in enumerate(singles):
            if over[number]:
                one, told = env.reset()
                reward = 0.0
            else:
                one, reward, _, _, told = env.step(0)
            assert (seen[number] == one).all() and rewards[number] == reward
            assert info["row"][number] == told["row"]
        assert not terminated.any() and (truncated == (step % 8 == 6)).all()
        over = truncated
    mask = np.array([True, False, False, False, False, False])
    again, _ = vector.reset(options={"reset_mask": mask})
    assert (again[1:] == seen[1:]).all() and (again[0] != seen[0]).any()


def test_a_vector_goes_where_gymnasium_goes(model: calib_rl.Model) -> None:
    vector = calib_rl.gym.make_vec(model, 3, units="physical", max_steps=5)
    recorded = gymnasium.wrappers.vector.RecordEpisodeStatistics(vector)
    recorded.reset(seed=2)
    for _ in range(6):
        seen, *_, info = recorded.step(recorded.action_space.sample())
        assert recorded.observation_space.contains(seen)
    endless = calib_rl.gym.make_vec(model, 2, max_steps=None)
    endless.reset(seed=[1, None])
    assert not any(endless.step(np.zeros(2))[3].any() for _ in range(2000))


def test_mistakes_are_named(model: calib_rl.Model) -> None:
    with pytest.raises(ValueError, match="no column is called 'P'"):
        calib_rl.gym.make(model, reward="P")
    with pytest.raises(ValueError, match="column 99"):
        calib_rl.gym.make(model, observe=[99])
    with pytest.raises(IndexError, match="member 9"):
        calib_rl.gym.make(model, member=9)
    with pytest.raises(ValueError, match="max_steps"):
        calib_rl.gym.make(model, max_steps=0)
    for wrong, told in [(0, "at least 1"), (-2, "num_envs is -2"), (2**80, "at most")]:
        with pytest.raises(ValueError, match=told):
            calib_rl.gym.make_vec(model, wrong)
    with pytest.raises(MemoryError, match="1099511627776 walks.*lower num_envs"):
        calib_rl.gym.make_vec(model, 2**40)
    with pytest.raises(ValueError, match="names no member"):
        calib_rl.gym.make_vec(model, 3, members=[])
    with pytest.raises(IndexError, match="members is -1"):
        calib_rl.gym.make_vec(model, 3, members=[0, -1])
    with pytest.raises(TypeError, match="max_steps is 1.5, expected a whole number"):
        calib_rl.gym.make(model, max_steps=1.5)  # type: ignore[call-overload]
    with pytest.raises(TypeError, match="a column is 0.5"):
        calib_rl.gym.make(model, observe=[0.5])  # type: ignore[list-item]
    with pytest.raises(ValueError, match="units"):
        calib_rl.gym.make(model, units="SI")  # type: ignore[call-overload]
