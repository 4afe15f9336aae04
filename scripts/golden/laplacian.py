"""Reference values for crates/calib-represent, from PyTorch in double precision.

    python3 -m venv .venv-golden && .venv-golden/bin/pip install torch==2.15.0 numpy==2.4.6
    .venv-golden/bin/python scripts/golden/laplacian.py

With n rows of u, v and x, and the pairs i = j (positions, not rows of the data) left out:

    form A: c mean |psi(u) - psi(v)|^2 + beta mean_{i != j} [(psi(x_i) psi(x_j))^2 - zeta |psi(x_i)|^2 - zeta |psi(x_j)|^2]
    form B:   mean |psi(u) - psi(v)|^2 + mean_{i != j} [beta (psi(x_i) psi(x_j))^2 - zeta |psi(x_i)|^2 - zeta |psi(x_j)|^2]

losses:    loss and gradients for given outputs psi(u), psi(v), psi(x), rows x dimension.
trainings: 20 steps of Adam on a small network from given parameters and batches (row numbers of `states`),
           the loss before each step, and the parameters after the first and the last.

`single_precision` is how far the same run in PyTorch's single precision ends from the one written here:
a scale for the tolerance of a test.
"""

import numpy as np
import torch

import pytorch

BETA, ZETA = 5.0, 0.05
CASES = [("A", 1.0), ("A", 0.5), ("B", 1.0)]


def laplacian(form, c, u, v, x):
    n = x.shape[0]
    attraction = ((u - v) ** 2).sum(1).mean()
    squared = (x @ x.T) ** 2
    norms = (x**2).sum(1)
    others = ~torch.eye(n, dtype=torch.bool)
    orthogonality = squared[others].mean()
    spread = (norms[:, None] + norms[None, :])[others].mean()
    if form == "A":
        return c * attraction + BETA * (orthogonality - ZETA * spread)
    return attraction + BETA * orthogonality - ZETA * spread


def loss_and_gradients(form, c, outputs, dtype):
    outputs = [torch.tensor(values, dtype=dtype, requires_grad=True) for values in outputs]
    loss = laplacian(form, c, *outputs)
    loss.backward()
    return loss.item(), [values.grad for values in outputs]


def train(form, c, sizes, start, states, batches, rule, dtype):
    network, states = pytorch.network(sizes, start, dtype), torch.tensor(states, dtype=dtype)
    adam = torch.optim.Adam(network.parameters(), **rule)
    losses, first = [], None
    for u, v, x in batches:
        loss = laplacian(form, c, *(network(states[rows]) for rows in (u, v, x)))
        adam.zero_grad()
        loss.backward()
        adam.step()
        losses.append(loss.item())
        first = pytorch.flat_of(network).copy() if first is None else first
    return losses, first, pytorch.flat_of(network)


def main():
    rng = np.random.default_rng(20261)
    rows, dimension = 8, 5
    outputs = [pytorch.uniform(rng, 1.0, rows, dimension) for _ in range(3)]
    losses = []
    for form, c in CASES:
        loss, gradients = loss_and_gradients(form, c, outputs, torch.float64)
        single, single_gradients = loss_and_gradients(form, c, outputs, torch.float32)
        pairs = zip([loss, *gradients], [single, *single_gradients])
        losses.append({
            "form": form, "c": c, "beta": BETA, "zeta": ZETA, "loss": pytorch.numbers(loss),
            **{f"gradient_{name}": pytorch.numbers(values) for name, values in zip("uvx", gradients)},
            "single_precision": max(pytorch.deviation(a, b) for a, b in pairs),
        })

    sizes, count, batch, steps = [6, 9, 9, 4], 40, 16, 20
    rule = {"lr": 3e-3, "betas": (0.9, 0.999), "eps": 1e-8}
    # A slow signal, so that u and v a few rows apart are similar.
    phases = np.arange(count)[:, None] * 0.1 * (1 + np.arange(sizes[0])) / 2
    states = np.round((0.5 + 0.4 * np.sin(phases) + rng.uniform(-0.1, 0.1, (count, sizes[0]))) * 4096) / 4096
    start = pytorch.parameters(rng, sizes)
    batches = []
    for _ in range(steps):
        u = rng.integers(0, count - 5, batch)
        batches.append((u, u + rng.integers(1, 6, batch), rng.integers(0, count, batch)))
    trainings = []
    for form, c in CASES:
        double, single = (
            train(form, c, sizes, start, states, batches, rule, dtype) for dtype in (torch.float64, torch.float32)
        )
        trainings.append({
            "form": form, "c": c, "beta": BETA, "zeta": ZETA,
            "losses": pytorch.numbers(double[0]),
            "parameters_after_first": pytorch.numbers(double[1]),
            "parameters_after_last": pytorch.numbers(double[2]),
            "single_precision": {
                name: pytorch.deviation(a, b)
                for name, a, b in zip(("losses", "parameters_after_first", "parameters_after_last"), double, single)
            },
        })
        print(form, c, "loss", double[0][0], "->", double[0][-1], trainings[-1]["single_precision"], losses[len(trainings) - 1]["single_precision"])

    pytorch.write("crates/calib-represent/tests/golden/laplacian.json", {
        "about": f"PyTorch {torch.__version__.split('+')[0]}, double precision, by scripts/golden/laplacian.py",
        "rows": rows, "dimension": dimension,
        **{name: pytorch.numbers(values) for name, values in zip("uvx", outputs)},
        "losses": losses,
        "sizes": sizes, "batch": batch, "steps": steps,
        "adam": {"learning_rate": rule["lr"], "beta1": 0.9, "beta2": 0.999, "epsilon": 1e-8, "weight_decay": 0.0},
        "states": pytorch.numbers(states),
        "parameters": pytorch.numbers(start),
        **{f"batches_{name}": [pytorch.numbers(b[at]) for b in batches] for at, name in enumerate("uvx")},
        "trainings": trainings,
    })


if __name__ == "__main__":
    main()
