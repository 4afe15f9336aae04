"""Reference values for crates/calib-agent: 60 TD(0) updates, from PyTorch in double precision.

    python3 -m venv .venv-golden && .venv-golden/bin/pip install torch==2.15.0 numpy==2.4.6
    .venv-golden/bin/python scripts/golden/td0.py

The loss is the mean of delta^2 / 2 with delta = o' + gamma v(s') - v(s) and its target held fixed; o' is column
`cumulant` of s'. Initial weights and the mini-batches (the step at which each transition starts) are given. Update
number n also records v(s_n) before it.

`single_precision` is how far the same run in PyTorch's single precision ends from the one written here:
a scale for the tolerance of a test.
"""

import numpy as np
import torch

import pytorch

UPDATES, BATCH, STEPS, GAMMA, CUMULANT = 60, 16, 60, 0.9, 2
SIZES = {"mlp": [7, 10, 10, 1], "linear": [7, 1]}
CASES = [
    {"value_function": "mlp", "optimiser": "adam", "learning_rate": 3e-3},
    {"value_function": "mlp", "optimiser": "adam", "learning_rate": 3e-3, "weight_decay": 0.1},
    {"value_function": "mlp", "optimiser": "adam", "learning_rate": 3e-3, "beta1": 0.8, "beta2": 0.99, "epsilon": 1e-4},
    {"value_function": "mlp", "optimiser": "adam", "learning_rate": 3e-3, "target_network_period": 25},
    {"value_function": "mlp", "optimiser": "sgd", "learning_rate": 3e-2},
    {"value_function": "mlp", "optimiser": "sgd", "learning_rate": 3e-2, "weight_decay": 0.1},
    {"value_function": "linear", "optimiser": "adam", "learning_rate": 3e-3},
    {"value_function": "linear", "optimiser": "adam", "learning_rate": 3e-3, "target_network_period": 25},
    {"value_function": "linear", "optimiser": "sgd", "learning_rate": 3e-2},
    {"value_function": "linear", "optimiser": "sgd", "learning_rate": 3e-2, "weight_decay": 0.1},
]


def optimiser(case, parameters):
    # Without momentum, decay in the gradient (SGD) and decoupled decay are the same.
    if case["optimiser"] == "sgd":
        return torch.optim.SGD(parameters, lr=case["learning_rate"], weight_decay=case.get("weight_decay", 0.0))
    return torch.optim.AdamW(
        parameters,
        lr=case["learning_rate"],
        betas=(case.get("beta1", 0.9), case.get("beta2", 0.999)),
        eps=case.get("epsilon", 1e-8),
        weight_decay=case.get("weight_decay", 0.0),
    )


def train(case, start, states, batches, dtype):
    """Returns the predictions before each update, and the parameters after the last."""
    sizes = SIZES[case["value_function"]]
    network, states = pytorch.network(sizes, start, dtype), torch.tensor(states, dtype=dtype)
    period = case.get("target_network_period", 0)
    target = pytorch.network(sizes, start, dtype) if period else network
    steps = optimiser(case, network.parameters())
    predictions = []
    for number, batch in enumerate(batches):
        now, after = states[batch], states[batch + 1]
        with torch.no_grad():
            predictions.append(network(states[number]).item())
            goal = after[:, CUMULANT] + GAMMA * target(after)[:, 0]
        loss = (0.5 * (goal - network(now)[:, 0]) ** 2).mean()
        steps.zero_grad()
        loss.backward()
        steps.step()
        if period and (number + 1) % period == 0:
            target.load_state_dict(network.state_dict())
    return predictions, pytorch.flat_of(network)


def main():
    rng = np.random.default_rng(20262)
    # Slow waves with noise, approximately between 0 and 1.
    phases = np.arange(STEPS)[:, None] * 0.05 * (1 + np.arange(SIZES["mlp"][0]))
    states = np.round((0.5 + 0.4 * np.sin(phases) + rng.uniform(-0.1, 0.1, phases.shape)) * 4096) / 4096
    starts = {name: pytorch.parameters(rng, sizes) for name, sizes in SIZES.items()}
    batches = rng.integers(0, STEPS - 1, (UPDATES, BATCH))
    cases = []
    for case in CASES:
        start = starts[case["value_function"]]
        double, single = (train(case, start, states, batches, dtype) for dtype in (torch.float64, torch.float32))
        deviations = [pytorch.deviation(a, b) for a, b in zip(double, single)]
        moved = np.abs(double[1] - start).max()
        print(case, f"moved {moved:.3g}", deviations)
        cases.append({
            "agent": {**case, "hidden_units": SIZES["mlp"][1], "gamma": GAMMA, "batch_size": BATCH},
            "predictions": pytorch.numbers(double[0]),
            "parameters": pytorch.numbers(double[1]),
            "single_precision": max(deviations),
        })
    pytorch.write("crates/calib-agent/tests/golden/td0.json", {
        "about": f"PyTorch {torch.__version__.split('+')[0]}, double precision, by scripts/golden/td0.py",
        "cumulant": CUMULANT,
        "states": pytorch.numbers(states),
        "sizes": SIZES,
        "parameters": {name: pytorch.numbers(start) for name, start in starts.items()},
        "batches": pytorch.numbers(batches),
        "cases": cases,
    })


if __name__ == "__main__":
    main()
