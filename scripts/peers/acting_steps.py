#!/usr/bin/env python3
"""Steps a second of environments that agents act in, in the same run, on one thread each.

    python3 scripts/peers/acting_steps.py [--rounds N] [--envs N] [--rows N]

Runs with whatever Python has calib_rl, gymnasium, numpy, polars, and stable_baselines3, which is skipped where it is missing. The model is of a log of cart-pole under random
actions, as `calib simulate --task cart-pole` has it. Every round runs every contender once; what is shown is the median of processor seconds, with the smallest and the largest
rate, because machines are shared. At the end, `live=True` is compared with the nearest level, in logs of two lengths of a tank with four columns.
"""

import os

for name in ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "RAYON_NUM_THREADS"):
    os.environ[name] = "1"

import argparse
import statistics
import tempfile
import time

import gymnasium
import numpy as np
import polars

import calib_rl
import calib_rl.gym


def log(rows):
    """Returns a log of cart-pole under random actions."""
    env = gymnasium.make("CartPole-v1")
    rng = np.random.default_rng(0)
    told = {name: [] for name in ("position", "velocity", "angle", "spin", "action", "reward", "over")}
    times, now, over = [], np.datetime64("2024-01-01", "us"), True
    for number in range(rows):
        if over:
            seen, _ = env.reset(seed=number)
            # A gap, as between recorded episodes.
            now, reward = now + np.timedelta64(3_600_000_000, "us"), 0.0
        action = int(rng.integers(2))
        for name, value in zip(told, [*seen, action, reward, float(over and number > 0 and reward != 0.0)]):
            told[name].append(float(value))
        times.append(now)
        now += np.timedelta64(1_000_000, "us")
        seen, reward, over, _, _ = env.step(action)
    return polars.DataFrame({"time": np.array(times), **told})


def tank(rows):
    """Returns a log of a tank whose valve is set at random to any position, with three columns that have nothing to do with it."""
    rng = np.random.default_rng(1)
    valves, level, levels = rng.random(rows), 0.5, []
    for valve in valves:
        levels.append(level)
        level = float(np.clip(level + 0.1 * (valve - 0.5) + rng.normal(0.0, 0.01), 0.0, 1.0))
    times = np.datetime64("2024-01-01", "us") + np.arange(rows) * np.timedelta64(60_000_000, "us")
    others = {f"other{number}": rng.normal(size=rows) for number in range(3)}
    reward = -np.abs(np.array(levels) - 0.6)
    return polars.DataFrame({"time": times, "level": levels, **others, "valve": valves, "reward": reward})


def stepping(env, actions):
    """Returns what steps in an environment so many times."""

    def work(count):
        for number in range(count):
            _, _, end, cut, _ = env.step(actions[number % len(actions)])
            if end or cut:
                env.reset()
        return count

    env.reset(seed=0)
    return work


def measured(contenders, rounds):
    """Prints the steps a processor second of each contender, which are in turn in every round."""
    rates = {name: [] for name in contenders}
    for _ in range(rounds):
        for name, (work, count) in contenders.items():
            begun = time.process_time()
            steps = work(count)
            rates[name].append(steps / (time.process_time() - begun))
    for name, each in rates.items():
        print(f"  {name}: {statistics.median(each):,.0f} ({min(each):,.0f} to {max(each):,.0f})")


class InNumpy:
    """The same model with tables as arrays and all rollouts at once: what a user would write without calib."""

    def __init__(self, model, member, envs, timeout):
        self.neighbors, self.distances = np.array(model.neighbors(member)), np.array(model.distances(member))
        done = model.decisions
        self.rewards, self.terminals = done.rewards, done.terminals
        self.states, self.next = np.array(model.states), np.array(model.sources) + 1
        self.inside = np.flatnonzero(self.neighbors[:, 0, 0] != 4294967295)
        self.rng, self.timeout, self.envs = np.random.default_rng(0), timeout, envs
        self.at, self.steps = self.rng.choice(self.inside, envs), np.zeros(envs, np.int64)

    def step(self, actions):
        neighbors, distances = self.neighbors[self.at, actions], self.distances[self.at, actions]
        weights = 1.0 - distances / np.maximum(distances.sum(axis=1, keepdims=True), 1e-30)
        cumulated = weights.cumsum(axis=1)
        drawn = (self.rng.random((self.envs, 1)) * cumulated[:, -1:] >= cumulated).sum(axis=1).clip(max=neighbors.shape[1] - 1)
        self.at = neighbors[np.arange(self.envs), drawn]
        self.steps += 1
        ended = self.terminals[self.at]
        cut = self.steps >= self.timeout
        rewards, seen = self.rewards[self.at], self.states[self.next[self.at]]
        over = ended | cut
        if over.any():
            self.at = np.where(over, self.rng.choice(self.inside, self.envs), self.at)
            self.steps[over] = 0
        return seen, rewards, ended, cut


class OneInNumpy(gymnasium.Env):
    """One rollout through the same tables, step by step: `SyncVectorEnv` steps several of them one after the other."""

    def __init__(self, model):
        self.of = InNumpy(model, 0, 1, 500)
        self.observation_space = calib_rl.gym.make(model).observation_space
        self.action_space = gymnasium.spaces.Discrete(self.of.neighbors.shape[1])

    def reset(self, *, seed=None, options=None):
        of = self.of
        of.at, of.steps = of.rng.choice(of.inside, 1), np.zeros(1, np.int64)
        return of.states[of.next[of.at[0]]], {}

    def step(self, action):
        of = self.of
        neighbors, distances = of.neighbors[of.at[0], action], of.distances[of.at[0], action]
        weights = 1.0 - distances / max(distances.sum(), 1e-30)
        at = neighbors[min(int((of.rng.random() * weights.sum() >= weights.cumsum()).sum()), len(neighbors) - 1)]
        of.at[0] = at
        of.steps[0] += 1
        return of.states[of.next[at]], float(of.rewards[at]), bool(of.terminals[at]), bool(of.steps[0] >= of.timeout), {}


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--envs", type=int, default=256)
    parser.add_argument("--rows", type=int, default=5000)
    arguments = parser.parse_args()
    envs = arguments.envs
    with tempfile.TemporaryDirectory() as folder:
        model = calib_rl.build_model(
            log(arguments.rows), folder, actions=["action"], reward="reward", terminal="over", timeout=500
        )
        rng = np.random.default_rng(1)
        actions = rng.integers(2, size=(512, envs))
        vector = calib_rl.gym.make_vec(model, envs, members=range(5))
        vector.reset(seed=0)
        numpy = InNumpy(model, 0, envs, 500)
        alone = gymnasium.vector.SyncVectorEnv([lambda: OneInNumpy(model) for _ in range(envs)])
        alone.reset()

        def of_batches(step):
            def work(count):
                for number in range(count):
                    step(actions[number % 512])
                return count * envs

            return work

        contenders = {
            f"make_vec, {envs} walks": (of_batches(vector.step), 2000),
            f"the same model in NumPy, {envs} walks": (of_batches(numpy.step), 500),
            f"SyncVectorEnv of {envs} of one walk in NumPy": (of_batches(alone.step), 20),
            "make, one walk": (stepping(calib_rl.gym.make(model), actions[:, 0].tolist()), 50_000),
        }
        try:
            from stable_baselines3.common.vec_env import DummyVecEnv
        except ImportError as missing:
            print(f"  Stable-Baselines3: skipped, {missing}")
        else:
            world = DummyVecEnv([lambda: gymnasium.make("CartPole-v1") for _ in range(envs)])
            world.reset()
            walks = DummyVecEnv([lambda: calib_rl.gym.make(model) for _ in range(envs)])
            walks.reset()
            contenders[f"DummyVecEnv of {envs} of Gymnasium's CartPole-v1"] = (of_batches(world.step), 40)
            contenders[f"DummyVecEnv of {envs} of make"] = (of_batches(walks.step), 40)
        print(f"steps a second: median ({arguments.rounds} rounds, smallest to largest); {model}")
        measured(contenders, arguments.rounds)
        contenders = {}
        for rows in (5_000, 50_000):
            tank_model = calib_rl.build_model(
                tank(rows), f"{folder}/tank-{rows}", actions=["valve"], reward="reward", levels=7, timeout=100
            )
            values = rng.random((1000, 1)).astype(np.float32)
            for live in (False, True):
                env = calib_rl.gym.make(tank_model, action_space="box", live=live)
                name = f"make with action_space=\"box\"{', live=True' if live else ''}, log of {rows:,} rows"
                contenders[name] = (stepping(env, values), 2000)
        print(f"steps a second with numbers as actions: {tank_model}")
        measured(contenders, arguments.rounds)


if __name__ == "__main__":
    main()
