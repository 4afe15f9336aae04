"""An agent in a single file, as CleanRL has them, with nothing but NumPy, and which of its settings to deploy: python tune_numpy.py pole FOLDER [STEPS]."""

import sys

import numpy as np

import calib_rl


class Agent:
    """Linear Q-learning on random features of the state."""

    def __init__(self, env, learning_rate=0.01, epsilon=0.1, gamma=0.99, seed=0):
        self.env, self.learning_rate, self.epsilon, self.gamma = env, learning_rate, epsilon, gamma
        self.rng = np.random.default_rng(seed)
        width = env.observation_space.shape[0]
        self.directions, self.offsets = self.rng.normal(0.0, 3.0, (64, width)), self.rng.uniform(0.0, 2 * np.pi, 64)
        self.weights = np.zeros((env.action_space.n, 64))

    def features(self, seen):
        return np.cos(self.directions @ seen + self.offsets) / 8.0

    def learn(self, total_timesteps):
        here, over = self.features(self.env.reset()[0]), False
        for _ in range(total_timesteps):
            if over:
                here = self.features(self.env.reset()[0])
            values = self.weights @ here
            explores = self.rng.random() < self.epsilon
            action = int(self.rng.integers(len(values)) if explores else values.argmax())
            seen, reward, terminated, truncated, _ = self.env.step(action)
            after, over = self.features(seen), terminated or truncated
            target = reward + (0.0 if terminated else self.gamma * (self.weights @ after).max())
            self.weights[action] += self.learning_rate * (target - values[action]) * here
            here = after


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit("usage: python tune_numpy.py LOG FOLDER [STEPS]")
    log, folder, *steps = sys.argv[1:]
    model = calib_rl.build_model(
        log, folder, actions=["action"], reward="reward", terminal="terminal", control={"probability": "probability"}
    )
    grid = {"learning_rate": [0.001, 0.1, 1.0], "epsilon": [0.02, 0.3]}
    tuned = calib_rl.tune(
        Agent, grid, model, total_timesteps=int(steps[0]) if steps else 10_000, folder=f"{folder}/units"
    )
    print(tuned)
    print(tuned.frame())
    print(tuned.report(f"{folder}/report.html"))
