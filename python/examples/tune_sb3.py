"""Which settings of Stable-Baselines3's DQN to deploy, from the log of tank.py: python tune_sb3.py tank.csv FOLDER [STEPS]."""

import sys

from stable_baselines3 import DQN

import calib_rl

GRID = {"learning_rate": [1e-4, 1e-3], "target_update_interval": [200, 10_000]}


def make_agent(env, **setting):
    return DQN("MlpPolicy", env, learning_starts=500, **setting)


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit("usage: python tune_sb3.py LOG FOLDER [STEPS]")
    log, folder, *steps = sys.argv[1:]
    model = calib_rl.build_model(log, folder, actions=["valve"], reward="reward", timeout=60)
    steps = int(steps[0]) if steps else 5_000
    tuned = calib_rl.tune(make_agent, GRID, model, total_timesteps=steps, folder=f"{folder}/units", progress=True)
    print(tuned)
    print(tuned.report(f"{folder}/report.html"))
