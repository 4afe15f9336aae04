"""Which settings of RLlib's PPO to deploy, from the log of `calib simulate pole --task cart-pole`: python tune_rllib.py pole FOLDER [STEPS]."""

import sys

import gymnasium
from ray.rllib.algorithms.ppo import PPO, PPOConfig

import calib_rl


class Agent:
    """PPO, which takes its steps in this process."""

    def __init__(self, env, seed=0, **setting):
        # A class, because Ray copies a function with the environment in it, and calib counts the steps of its own.
        given = type("Given", (gymnasium.Env,), {"__new__": lambda cls, config: env})
        config = PPOConfig().environment(given).env_runners(num_env_runners=0).debugging(seed=seed)
        self.algorithm = PPO(config.training(train_batch_size_per_learner=500, minibatch_size=100, **setting))

    def learn(self, total_timesteps):
        while self.algorithm.train()["env_runners"]["num_env_steps_sampled_lifetime"] < total_timesteps:
            pass
        self.algorithm.stop()


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit("usage: python tune_rllib.py LOG FOLDER [STEPS]")
    log, folder, *steps = sys.argv[1:]
    model = calib_rl.build_model(
        log, folder, actions=["action"], reward="reward", terminal="terminal", control={"probability": "probability"}
    )
    grid = {"lr": [1e-4, 1e-3], "num_epochs": [5, 30]}
    steps = int(steps[0]) if steps else 10_000
    tuned = calib_rl.tune(Agent, grid, model, total_timesteps=steps, folder=f"{folder}/units", progress=True)
    print(tuned)
    print(tuned.report(f"{folder}/report.html"))
