"""Which settings of Stable-Baselines3's DQN to deploy, from the log of `calib simulate pole --task cart-pole`: python tune_sb3.py pole FOLDER [STEPS]."""

import sys

from stable_baselines3 import DQN

import calib_rl


def make_agent(env, **setting):
    return DQN("MlpPolicy", env, learning_starts=500, **setting)


log, folder, *steps = sys.argv[1:]
model = calib_rl.build_model(
    log, folder, actions=["action"], reward="reward", terminal="terminal", control={"probability": "probability"}
)
grid = {"learning_rate": [1e-4, 1e-3], "exploration_fraction": [0.1, 0.5]}
steps = int(steps[0]) if steps else 10_000
tuned = calib_rl.tune(make_agent, grid, model, total_timesteps=steps, folder=f"{folder}/units", progress=True)
print(tuned)
print(tuned.report(f"{folder}/report.html"))
