"""A tank whose level a valve should keep at 0.6, while a demand empties it.

    python tank.py tank.csv                  writes a log of 3,000 minutes
    python tank.py tank.csv truth            and lets every setting of tune_sb3.py learn in the tank itself, five times

A plant has no second line: with it you see here what `calib_rl.tune` could not know.
"""

import csv
import itertools
import random
import statistics
import sys
from datetime import datetime, timedelta


def write_log(path, rows=3000):
    random.seed(1)
    level, demand, time = 0.5, 0.5, datetime(2024, 3, 1)
    with open(path, "w", newline="", encoding="utf-8") as file:
        log = csv.writer(file)
        log.writerow(["time", "level", "demand", "valve", "reward"])
        for _ in range(rows):
            # In a fifth of the minutes the level decides, otherwise chance.
            valve = float(level < 0.6) if random.random() < 0.2 else random.choice([0.0, 0.5, 1.0])
            log.writerow([time, level, demand, valve, -abs(level - 0.6)])
            level, demand = after(level, demand, valve)
            time += timedelta(minutes=1)


def after(level, demand, valve):
    level += 0.1 * (valve - demand) + random.gauss(0.0, 0.01)
    demand += 0.1 * (0.5 - demand) + random.gauss(0.0, 0.05)
    return min(max(level, 0.0), 1.0), min(max(demand, 0.0), 1.0)


def truth(settings, steps=5_000, runs=5):
    """Prints the mean return of each setting in the tank itself, learning included."""
    import gymnasium
    import numpy as np
    from stable_baselines3.common.monitor import Monitor
    from tune_sb3 import make_agent

    class Tank(gymnasium.Env):
        observation_space = gymnasium.spaces.Box(0.0, 1.0, (2,), np.float32)
        action_space = gymnasium.spaces.Discrete(3)

        def reset(self, *, seed=None, options=None):
            super().reset(seed=seed)
            # An episode begins where the one before ended, as the plant's next hour does.
            self.level, self.demand = getattr(self, "level", 0.5), getattr(self, "demand", 0.5)
            self.steps = 0
            return self.seen(), {}

        def seen(self):
            return np.array([self.level, self.demand], np.float32)

        def step(self, action):
            self.level, self.demand = after(self.level, self.demand, [0.0, 0.5, 1.0][action])
            self.steps += 1
            return self.seen(), -abs(self.level - 0.6), False, self.steps == 60, {}

    for setting in settings:
        means = []
        for run in range(runs):
            random.seed(run)
            env = Monitor(Tank())
            make_agent(env, seed=run, **setting).learn(steps)
            means.append(statistics.fmean(env.get_episode_rewards()))
        print(setting, round(statistics.fmean(means), 2), [round(mean, 2) for mean in means], flush=True)


if __name__ == "__main__":
    write_log(sys.argv[1])
    if "truth" in sys.argv[2:]:
        from tune_sb3 import GRID

        truth([dict(zip(GRID, values)) for values in itertools.product(*GRID.values())])
