"""Steps a second of calib's tasks, models with actions and agents beside Gymnasium's tasks and Stable-Baselines3, in processor seconds of one thread.

    python3 -m venv .venv-peers && .venv-peers/bin/pip install gymnasium stable-baselines3
    cargo build --release -p calib-control --example steps
    .venv-peers/bin/python scripts/peers/control_steps.py target/release/examples/steps

All of them in turn, five times; the median is shown, and the smallest and the largest. Gymnasium and Stable-Baselines3's `DummyVecEnv` of 64 tasks take random
actions, too, drawn before; episodes end where they end and after 500 steps. *agent-DQN* is Stable-Baselines3's DQN that learns in `DummyVecEnv` of one task, with a
network of 2 × 64 units and a step of gradient on a batch of 32 each four steps; *deep-task* is
calib's of the same size, which learns each step. *join* makes the tables of a model of 50,000 transitions, in rows a second, and *join-passive* those without actions.
"""

import os
import random
import resource
import statistics
import subprocess
import sys
import time

import gymnasium
import numpy
import stable_baselines3
import torch
from stable_baselines3.common.env_util import make_vec_env

TASKS = {"acrobot": "Acrobot-v1", "cart_pole": "CartPole-v1", "puddle_world": None}
ROUNDS = 5
STEPS = {"task": 3_000_000, "model": 3_000_000, "agent-task": 200_000, "agent-model": 200_000, "deep-task": 20_000, "join": 50_000, "join-passive": 50_000}


def gym(name, steps=100_000):
    env = gymnasium.make(name, max_episode_steps=500)
    actions = [random.Random(1).randrange(env.action_space.n) for _ in range(steps)]
    env.reset(seed=1)
    begun = time.process_time()
    for action in actions:
        _, _, terminal, cut, _ = env.step(action)
        if terminal or cut:
            env.reset()
    return steps / (time.process_time() - begun)


def vector(name, count=64, steps=2_000):
    envs = make_vec_env(name, count, seed=1, env_kwargs={"max_episode_steps": 500})
    actions = numpy.random.default_rng(1).integers(0, envs.action_space.n, (steps, count))
    envs.reset()
    begun = time.process_time()
    for of_all in actions:
        envs.step(of_all)
    return steps * count / (time.process_time() - begun)


def dqn(name, steps=10_000):
    torch.set_num_threads(1)
    agent = stable_baselines3.DQN("MlpPolicy", make_vec_env(name, 1, seed=1), learning_starts=100, batch_size=32, seed=1, device="cpu")
    begun = time.process_time()
    agent.learn(steps)
    return steps / (time.process_time() - begun)


def spent(binary, task, what, steps):
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([binary, task, what, str(steps)], check=True, env={**os.environ, "RAYON_NUM_THREADS": "1"})
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main():
    binary = sys.argv[1]
    found = {}
    for _ in range(ROUNDS):
        for task, name in TASKS.items():
            if name:
                for peer, rate in {"Gymnasium": gym, "DummyVecEnv": vector, "agent-DQN": dqn}.items():
                    found.setdefault((task, peer), []).append(rate(name))
            for what, steps in STEPS.items():
                idle = spent(binary, task, what, 0)
                found.setdefault((task, what), []).append(steps / max(1e-9, spent(binary, task, what, steps) - idle))
    for (task, what), rates in found.items():
        print(f"| {task} | {what} | {statistics.median(rates):,.0f} | {min(rates):,.0f} to {max(rates):,.0f} |")


if __name__ == "__main__":
    main()
