"""Steps a second of calib's tasks, models with actions and agents beside Gymnasium's tasks, in processor seconds of one thread.

    python3 -m venv .venv-peers && .venv-peers/bin/pip install gymnasium==1.4.0
    cargo build --release -p calib-control --example steps
    .venv-peers/bin/python scripts/peers/control_steps.py target/release/examples/steps

All of them in turn, five times; the median is shown, and the smallest and the largest. Gymnasium takes random actions, too, drawn before;
its episodes end where they end and after 500 steps. Processor time, so that what else the machine does matters little.
"""

import os
import random
import resource
import statistics
import subprocess
import sys
import time

import gymnasium

TASKS = {"acrobot": "Acrobot-v1", "cart_pole": "CartPole-v1", "puddle_world": None}
ROUNDS = 5
STEPS = {"task": 3_000_000, "model": 3_000_000, "agent-task": 200_000, "agent-model": 200_000}


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
                found.setdefault((task, "Gymnasium"), []).append(gym(name))
            for what, steps in STEPS.items():
                idle = spent(binary, task, what, 0)
                found.setdefault((task, what), []).append(steps / max(1e-9, spent(binary, task, what, steps) - idle))
    for (task, what), rates in found.items():
        print(f"| {task} | {what} | {statistics.median(rates):,.0f} | {min(rates):,.0f} to {max(rates):,.0f} |")


if __name__ == "__main__":
    main()
