"""What the PyTorch scripts of this folder share: numbers that single precision holds exactly, and networks.

A network's parameters are one flat list, layer after layer: weights [inputs, outputs] row after row (the
transpose of PyTorch's Linear.weight), then biases. That is how calib-nn keeps them.
"""

import pathlib

import numpy as np
import torch

import layout

ROOT = pathlib.Path(__file__).resolve().parents[2]
PRECISIONS = {"double": torch.float64, "single": torch.float32}


def uniform(rng, bound, *shape):
    """Returns multiples of 2^-12 in +-bound: exact in single precision, short in a file."""
    return np.round(rng.uniform(-bound, bound, shape) * 4096) / 4096


def parameters(rng, sizes):
    """Returns uniform values in +-1/sqrt(inputs): weights and biases of each layer."""
    layers = zip(sizes, sizes[1:])
    return np.concatenate([uniform(rng, inputs**-0.5, (inputs + 1) * outputs) for inputs, outputs in layers])


def network(sizes, flat, dtype):
    """Returns linear layers with ReLU between them."""
    layers, at = [], 0
    for inputs, outputs in zip(sizes, sizes[1:]):
        layer = torch.nn.Linear(inputs, outputs, dtype=dtype)
        weights, at = flat[at : at + inputs * outputs], at + inputs * outputs
        bias, at = flat[at : at + outputs], at + outputs
        with torch.no_grad():
            layer.weight.copy_(torch.tensor(weights.reshape(inputs, outputs).T))
            layer.bias.copy_(torch.tensor(bias))
        layers += [layer, torch.nn.ReLU()]
    return torch.nn.Sequential(*layers[:-1])


def flat_of(layers, gradient=False):
    """Returns the parameters or their gradients, in the order of `parameters`."""
    of = (lambda tensor: tensor.grad) if gradient else (lambda tensor: tensor.detach())
    linear = [layer for layer in layers if isinstance(layer, torch.nn.Linear)]
    return torch.cat([part.reshape(-1) for layer in linear for part in (of(layer.weight).T, of(layer.bias))]).numpy()


def numbers(values, digits=9):
    """Returns the nested lists of a tensor or an array. Nine digits are more than single precision has."""
    values = np.asarray(values.detach() if isinstance(values, torch.Tensor) else values)
    if values.ndim:
        return [numbers(value, digits) for value in values]
    return int(values) if values.dtype.kind == "i" else float(f"{float(values):.{digits}g}")


def deviation(double, single):
    """Returns the greatest difference between the same numbers in both precisions."""
    return float(f"{np.max(np.abs(np.asarray(double, dtype=float) - np.asarray(single, dtype=float))):.2g}")


def write(path, golden):
    layout.write(ROOT / path, golden)
