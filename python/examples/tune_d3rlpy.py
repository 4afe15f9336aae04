"""How fast d3rlpy's DQN, which was trained on a log, should learn on at the plant: python tune_d3rlpy.py pole FOLDER [STEPS]."""

import sys

import d3rlpy
import numpy as np
import polars as pl

import calib_rl

if len(sys.argv) < 3:
    sys.exit("usage: python tune_d3rlpy.py LOG FOLDER [STEPS]")
log, folder, *steps = sys.argv[1:]
steps = int(steps[0]) if steps else 5_000

# What was recorded, as d3rlpy wants it. In the log a reward stands in the row that a step led to, so it moves up by one.
columns = ["place", "speed", "angle", "angular_speed"]
frame = pl.read_parquet(f"{log}/*.parquet").sort("timestamp")
after = pl.col("reward", "terminal").shift(-1).name.suffix("_after")
taken = frame.with_columns(after, pl.col("action").shift(-1).is_null().alias("is_last")).filter(pl.col("action").is_not_null())
recorded = d3rlpy.dataset.MDPDataset(
    observations=taken[columns].to_numpy().astype(np.float32),
    actions=taken["action"].to_numpy().astype(np.int32),
    rewards=taken["reward_after"].fill_null(0).to_numpy().astype(np.float32),
    terminals=(taken["terminal_after"].fill_null(0) != 0).to_numpy().astype(np.float32),
    timeouts=(taken["is_last"] & (taken["terminal_after"].fill_null(0) == 0)).to_numpy().astype(np.float32),
)
quiet = {"show_progress": False, "logger_adapter": d3rlpy.logging.NoopAdapterFactory()}


class FineTuned:
    """DQN that was trained on the log, and learns on in an environment."""

    def __init__(self, env, learning_rate=6.25e-5, epsilon=0.05):
        self.env, self.explorer = env, d3rlpy.algos.ConstantEpsilonGreedy(epsilon)
        self.agent = d3rlpy.algos.DQNConfig(learning_rate=learning_rate).create()
        self.agent.build_with_env(env)
        # Not load_model: that would bring the learning rate of training along.
        self.agent.copy_q_function_from(d3rlpy.load_learnable(f"{folder}/trained.d3"))

    def learn(self, total_timesteps):
        self.agent.fit_online(self.env, explorer=self.explorer, n_steps=total_timesteps, n_steps_per_epoch=total_timesteps, **quiet)


model = calib_rl.build_model(
    log, folder, actions=["action"], reward="reward", terminal="terminal", control={"probability": "probability"}
)
trained = d3rlpy.algos.DQNConfig().create()
trained.fit(recorded, n_steps=2_000, n_steps_per_epoch=2_000, **quiet)
trained.save(f"{folder}/trained.d3")
grid = {"learning_rate": [1e-5, 1e-4, 1e-3], "epsilon": [0.02, 0.1]}
print(
    calib_rl.tune(
        FineTuned, grid, model, total_timesteps=steps, folder=f"{folder}/units", progress=True,
        environment={"observe": columns, "units": "physical"},
    )
)
