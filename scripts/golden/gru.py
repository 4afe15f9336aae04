"""Reference values for the dynamics models (NN and GRU), from PyTorch in double precision.

    python3 -m venv .venv-golden && .venv-golden/bin/pip install torch==2.15.0 numpy==2.4.6
    .venv-golden/bin/python scripts/golden/gru.py

The loss is the mean over transitions and columns of the squared error of the next state; a GRU starts each sequence from
zero and every step of it counts (burn-in 0). Gradients of that loss, and parameters after 20 steps of Adam on the same
batch. Tensors of the GRU are named and laid out as PyTorch has them: gru.weight_ih_l0 [3 hidden, inputs], the gates in
the order reset, update, new. Parameters of the NN are flat as in pytorch.py.

`single_precision` is how far PyTorch's single precision is from the double written here: a scale for tolerances.
"""

import numpy as np
import torch

import pytorch

COLUMNS, HIDDEN, LAYERS, SEQUENCES, LENGTH, STEPS = 5, 6, 2, 4, 7, 20
RULE = {"lr": 1e-2, "betas": (0.9, 0.999), "eps": 1e-8}
SIZES = [COLUMNS, 7, 7, COLUMNS]


class Gru(torch.nn.Module):
    def __init__(self, tensors, dtype):
        super().__init__()
        self.gru = torch.nn.GRU(COLUMNS, HIDDEN, LAYERS, batch_first=True, dtype=dtype)
        self.head = torch.nn.Linear(HIDDEN, COLUMNS, dtype=dtype)
        self.load_state_dict({name: torch.tensor(values, dtype=dtype) for name, values in tensors.items()})

    def forward(self, states):
        hidden, _ = self.gru(states)
        return self.head(hidden)


def learn(model, predict, states, targets):
    """Returns predictions, loss and gradients at the start, then trains with Adam."""
    adam = torch.optim.Adam(model.parameters(), **RULE)
    first = None
    for _ in range(STEPS):
        predictions = predict(states)
        loss = ((predictions - targets) ** 2).mean()
        adam.zero_grad()
        loss.backward()
        first = first or (predictions.detach().clone(), loss.item(), [p.grad.clone() for p in model.parameters()])
        adam.step()
    return first, ((predict(states) - targets) ** 2).mean().item()


def gru(tensors, states, dtype):
    model = Gru(tensors, dtype)
    states = torch.tensor(states, dtype=dtype)
    (predictions, loss, gradients), final = learn(model, model, states[:, :-1], states[:, 1:])
    names = [name for name, _ in model.named_parameters()]
    return {
        "predictions": pytorch.numbers(predictions), "loss": pytorch.numbers(loss),
        "gradients": {name: pytorch.numbers(values.reshape(-1)) for name, values in zip(names, gradients)},
        "tensors_after": {name: pytorch.numbers(values.reshape(-1)) for name, values in model.named_parameters()},
        "loss_after": pytorch.numbers(final),
    }


def nn(start, states, dtype):
    model, states = pytorch.network(SIZES, start, dtype), torch.tensor(states, dtype=dtype).reshape(-1, LENGTH + 1, COLUMNS)
    now, after = states[:, :-1].reshape(-1, COLUMNS), states[:, 1:].reshape(-1, COLUMNS)
    (predictions, loss, _), final = learn(model, model, now, after)
    gradient_model = pytorch.network(SIZES, start, dtype)
    ((gradient_model(now) - after) ** 2).mean().backward()
    return {
        "predictions": pytorch.numbers(predictions), "loss": pytorch.numbers(loss),
        "gradients": pytorch.numbers(pytorch.flat_of(gradient_model, gradient=True)),
        "parameters_after": pytorch.numbers(pytorch.flat_of(model)), "loss_after": pytorch.numbers(final),
    }


def flat(value):
    if isinstance(value, dict):
        return np.concatenate([flat(part) for part in value.values()])
    return np.asarray(value, dtype=float).reshape(-1)


def both(compute, *arguments):
    double, single = (compute(*arguments, dtype) for dtype in (torch.float64, torch.float32))
    deviations = {key: pytorch.deviation(flat(double[key]), flat(single[key])) for key in double}
    print(compute.__name__, double["loss"], "->", double["loss_after"], deviations)
    return {**double, "single_precision": deviations}


def main():
    rng = np.random.default_rng(20263)
    phases = np.arange(LENGTH + 1)[None, :, None] * 0.3 * (1 + np.arange(COLUMNS)) + rng.uniform(0, 6, (SEQUENCES, 1, 1))
    states = np.round((0.5 + 0.4 * np.sin(phases)) * 4096) / 4096
    shapes = {}
    for layer in range(LAYERS):
        inputs = HIDDEN if layer else COLUMNS
        shapes |= {
            f"gru.weight_ih_l{layer}": (3 * HIDDEN, inputs), f"gru.weight_hh_l{layer}": (3 * HIDDEN, HIDDEN),
            f"gru.bias_ih_l{layer}": (3 * HIDDEN,), f"gru.bias_hh_l{layer}": (3 * HIDDEN,),
        }
    shapes |= {"head.weight": (COLUMNS, HIDDEN), "head.bias": (COLUMNS,)}
    tensors = {name: pytorch.uniform(rng, HIDDEN**-0.5, *shape) for name, shape in shapes.items()}
    start = pytorch.parameters(rng, SIZES)
    pytorch.write("crates/calib-dynamics/tests/golden/dynamics.json", {
        "about": f"PyTorch {torch.__version__.split('+')[0]}, double precision, by scripts/golden/gru.py",
        "columns": COLUMNS, "hidden": HIDDEN, "layers": LAYERS, "sequences": SEQUENCES, "length": LENGTH, "steps": STEPS,
        "adam": {"learning_rate": RULE["lr"], "beta1": 0.9, "beta2": 0.999, "epsilon": 1e-8},
        "states": pytorch.numbers(states),
        "shapes": {name: list(shape) for name, shape in shapes.items()},
        "tensors": {name: pytorch.numbers(values.reshape(-1)) for name, values in tensors.items()},
        "gru": both(gru, tensors, states),
        "nn_sizes": SIZES,
        "nn_parameters": pytorch.numbers(start),
        "nn": both(nn, start, states),
    })


if __name__ == "__main__":
    main()
