"""Agents of two more libraries in a calibration model: River and JAX. Those that are not installed are skipped.

python more_agents.py STUDY          # such as the one of first_verdict.py
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

import calib_rl
from calib_rl.agents import Sweep, Task

Floats = NDArray[np.float32]


def river_td(task: Task, learning_rate: float) -> Any:
    """River's linear regression, which learns from one pair at a time, with the target of TD(0)."""
    from river import linear_model, optim

    class RiverTd:
        def __init__(self) -> None:
            self.model = linear_model.LinearRegression(optim.SGD(learning_rate), intercept_lr=learning_rate)

        @staticmethod
        def named(observation: Floats) -> dict[int, float]:
            return dict(enumerate(observation.tolist()))

        def predict(self, observation: Floats) -> float:
            return float(self.model.predict_one(self.named(observation)))

        def update(self, observation: Floats, reward: float, next_observation: Floats) -> None:
            self.model.learn_one(self.named(observation), reward + task.gamma * self.predict(next_observation))

        def state_dict(self) -> Mapping[str, Any]:
            return {"weights": dict(self.model.weights), "intercept": self.model.intercept}

    return RiverTd()


def jax_td(task: Task, learning_rate: float) -> Any:
    """Semi-gradient TD(0) of a small network, prediction and update compiled once for all agents."""
    import jax

    predict, update = _compiled()

    class JaxTd:
        def __init__(self) -> None:
            first, second = jax.random.split(jax.random.key(task.seed % 2**32))
            self.parameters = {
                "hidden": jax.random.normal(first, (task.columns, 16)) / np.sqrt(task.columns),
                "bias": np.zeros(16, np.float32),
                "out": jax.random.normal(second, (16,)) / 4,
            }

        def predict(self, observation: Floats) -> float:
            return float(predict(self.parameters, observation))

        def update(self, observation: Floats, reward: float, next_observation: Floats) -> None:
            self.parameters = update(self.parameters, observation, reward, next_observation, task.gamma, learning_rate)

        def state_dict(self) -> Mapping[str, Any]:
            return {name: np.asarray(values) for name, values in self.parameters.items()}

    return JaxTd()


_COMPILED: list[tuple[Any, Any]] = []


def _compiled() -> tuple[Any, Any]:
    if not _COMPILED:
        import jax
        import jax.numpy as jnp

        def value(parameters: Any, observation: Any) -> Any:
            return jnp.tanh(observation @ parameters["hidden"] + parameters["bias"]) @ parameters["out"]

        def step(parameters: Any, observation: Any, reward: Any, following: Any, gamma: Any, rate: Any) -> Any:
            now, gradient = jax.value_and_grad(value)(parameters, observation)
            error = reward + gamma * value(parameters, following) - now
            return jax.tree.map(lambda weights, slope: weights + rate * error * slope, parameters, gradient)

        _COMPILED.append((jax.jit(value), jax.jit(step)))
    return _COMPILED[0]


def main() -> None:
    study = calib_rl.Study(sys.argv[1])
    for factory in (river_td, jax_td):
        try:
            runs = Sweep(study, study.results / "agents" / factory.__name__, progress=False).run(
                factory, {"learning_rate": [1e-3, 1e-2, 1e-1]}
            )
        except ImportError as missing:
            print(f"{factory.__name__}: skipped, {missing}")
            continue
        print(f"{factory.__name__}: {runs.evaluate().advice[0][0]}")


if __name__ == "__main__":
    main()
