"""Agents of your own in a calibration model: plain NumPy, scikit-learn's SGDRegressor, and PyTorch where it is installed.

python own_agents.py STUDY          # such as the one of first_verdict.py
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

import calib_rl
from calib_rl.agents import Sweep, Task


class LinearTd:
    """TD(λ) of a linear value function."""

    def __init__(self, task: Task, learning_rate: float, trace: float = 0.0) -> None:
        self.gamma, self.learning_rate, self.trace = task.gamma, learning_rate, trace
        self.weights = np.zeros(task.columns + 1)
        self.eligibility = np.zeros(task.columns + 1)

    def begin(self) -> None:
        """A trace does not reach over a gap."""
        self.eligibility[:] = 0

    def predict(self, observation: NDArray[np.float32]) -> float:
        return float(self.weights[:-1] @ observation + self.weights[-1])

    def update(self, observation: NDArray[np.float32], reward: float, next_observation: NDArray[np.float32]) -> None:
        error = reward + self.gamma * self.predict(next_observation) - self.predict(observation)
        self.eligibility *= self.gamma * self.trace
        self.eligibility[:-1] += observation
        self.eligibility[-1] += 1
        self.weights += self.learning_rate * error * self.eligibility

    def state_dict(self) -> Mapping[str, Any]:
        return {"weights": self.weights}


class SklearnTd:
    """The same target for an estimator that learns from pairs."""

    def __init__(self, task: Task, learning_rate: float) -> None:
        from sklearn.linear_model import SGDRegressor

        self.gamma = task.gamma
        self.model: Any = SGDRegressor(learning_rate="constant", eta0=learning_rate, alpha=0.0, random_state=task.seed % 2**32)
        self.model.partial_fit(np.zeros((1, task.columns)), [0.0])

    def predict(self, observation: NDArray[np.float32]) -> float:
        return float(observation @ self.model.coef_ + self.model.intercept_[0])

    def update(self, observation: NDArray[np.float32], reward: float, next_observation: NDArray[np.float32]) -> None:
        self.model.partial_fit(observation[None].astype(np.float64), [reward + self.gamma * self.predict(next_observation)])

    def state_dict(self) -> Mapping[str, Any]:
        return {"coef": self.model.coef_, "intercept": self.model.intercept_}


def torch_td(task: Task, learning_rate: float) -> Any:
    """Semi-gradient TD(0) of a small network."""
    import torch

    class TorchTd:
        def __init__(self) -> None:
            torch.manual_seed(task.seed % 2**63)
            self.network = torch.nn.Sequential(
                torch.nn.Linear(task.columns, 16), torch.nn.Tanh(), torch.nn.Linear(16, 1)
            )
            self.optimiser = torch.optim.SGD(self.network.parameters(), learning_rate)

        def predict(self, observation: NDArray[np.float32]) -> float:
            with torch.no_grad():
                return float(self.network(torch.from_numpy(observation)))

        def update(
            self, observation: NDArray[np.float32], reward: float, next_observation: NDArray[np.float32]
        ) -> None:
            target = reward + task.gamma * self.predict(next_observation)
            loss = (self.network(torch.from_numpy(observation)) - target).square().sum() / 2
            self.optimiser.zero_grad()
            loss.backward()
            self.optimiser.step()

        def state_dict(self) -> Mapping[str, Any]:
            return {name: values.numpy() for name, values in self.network.state_dict().items()}

    return TorchTd()


def main() -> None:
    study = calib_rl.Study(sys.argv[1])
    compared: list[tuple[Any, dict[str, list[float]]]] = [
        (LinearTd, {"learning_rate": [1e-3, 1e-2, 1e-1], "trace": [0.0, 0.8]}),
        (SklearnTd, {"learning_rate": [1e-3, 1e-2, 1e-1]}),
        (torch_td, {"learning_rate": [1e-3, 1e-2, 1e-1]}),
    ]
    for factory, values in compared:
        try:
            runs = Sweep(study, study.results / "agents" / factory.__name__, progress=False).run(factory, values)
        except ImportError as missing:
            print(f"{factory.__name__}: skipped, {missing}")
            continue
        print(f"{factory.__name__}: {runs.evaluate().advice[0][0]}")


if __name__ == "__main__":
    main()
