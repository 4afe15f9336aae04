"""Agents that act, written as ONNX files. Users call `calib_rl.ControlAgent.to_onnx`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._calib import __version__
from ._errors import CalibError
from ._files import write_whole

# Runtimes of 2022 and later read these versions.
_OPSET, _IR_VERSION = 17, 8

Arrays = dict[str, NDArray[np.float32]]


def written(agent: Path, path: Path) -> None:
    """Write the agent that was saved in the file ``agent`` as ONNX to ``path``."""
    try:
        import onnx
    except ImportError as missing:
        raise ImportError("to_onnx needs the package onnx: pip install onnx") from missing
    arrays, texts = _saved(agent)
    described = json.loads(texts["agent"])
    graph = _Graph(onnx)
    scaled = _scaled(graph, described["columns"])
    if "weights" in arrays:
        values = _tile_values(graph, scaled, arrays["weights"], described["settings"], len(described["columns"]))
    else:
        values = _network_values(graph, scaled, arrays)
    graph.nodes.append(onnx.helper.make_node("Identity", [values], ["values"]))
    kinds = {
        "columns": [{"name": name, "offset": offset, "scale": scale} for name, offset, scale in described["columns"]],
        "actions": [{"name": name, "values": set_to} for name, set_to in described["actions"]],
        "settings": described["settings"],
    }
    model = graph.model(len(described["columns"]), len(described["actions"]))
    onnx.helper.set_model_props(model, {name: json.dumps(told) for name, told in kinds.items()} | {"fingerprint": texts["fingerprint"]})
    onnx.checker.check_model(model)
    try:
        write_whole(path, model.SerializeToString())
    except OSError as error:
        raise CalibError(f"{path} cannot be written: {error.strerror}; name another place") from error


def _saved(path: Path) -> tuple[Arrays, dict[str, str]]:
    """Returns the arrays and texts of a safetensors file that calib wrote."""
    content = path.read_bytes()
    start = 8 + int.from_bytes(content[:8], "little")
    header = json.loads(content[8:start])
    texts: dict[str, str] = json.loads(header.pop("__metadata__")["calib"])
    arrays: Arrays = {}
    for name, array in header.items():
        shape, (first, _) = array["shape"], array["data_offsets"]
        arrays[name] = np.frombuffer(content, "<f4", int(np.prod(shape)), start + first).reshape(shape)
    return arrays, texts


class _Graph:
    """Nodes and constants in the order of their computation, each known by the name of its result."""

    def __init__(self, onnx: Any) -> None:
        self.onnx = onnx
        self.nodes: list[Any] = []
        self.constants: list[Any] = []

    def constant(self, values: Any) -> str:
        name = f"constant_{len(self.constants)}"
        self.constants.append(self.onnx.numpy_helper.from_array(np.ascontiguousarray(values), name))
        return name

    def node(self, operator: str, *inputs: str, **attributes: Any) -> str:
        name = f"{operator.lower()}_{len(self.nodes)}"
        self.nodes.append(self.onnx.helper.make_node(operator, inputs, [name], **attributes))
        return name

    def cast(self, values: str, kind: type[np.generic]) -> str:
        return self.node("Cast", values, to=self.onnx.helper.np_dtype_to_tensor_dtype(np.dtype(kind)))

    def model(self, columns: int, actions: int) -> Any:
        helper, kind = self.onnx.helper, self.onnx.TensorProto.FLOAT
        state = helper.make_tensor_value_info("state", kind, ["batch", columns])
        values = helper.make_tensor_value_info("values", kind, ["batch", actions])
        graph = helper.make_graph(self.nodes, "agent", [state], [values], self.constants)
        opset = helper.make_opsetid("", _OPSET)
        return helper.make_model(
            graph, opset_imports=[opset], ir_version=_IR_VERSION, producer_name="calib", producer_version=__version__
        )


def _scaled(graph: _Graph, columns: list[tuple[str, float, float]]) -> str:
    """Adds the state in shares of the columns' ranges, ``float32 [batch, columns]``. It divides in double precision as the agent does, for equal tiles."""
    _, offsets, scales = zip(*columns)
    above = graph.node("Sub", graph.cast("state", np.float64), graph.constant(np.array(offsets, np.float64)))
    return graph.cast(graph.node("Div", above, graph.constant(np.array(scales, np.float64))), np.float32)


def _tile_values(graph: _Graph, scaled: str, weights: NDArray[np.float32], settings: dict[str, Any], columns: int) -> str:
    """Adds the sums of the weights of a state's tiles, ``float32 [batch, actions]``. Features have the order of calib's tile coding."""
    tilings, tiles = settings["tilings"], settings["tiles"] + 1
    tiling, column = np.indices((tilings, columns))
    shifts = ((1 + 2 * column) * tiling % tilings).astype(np.float32) / np.float32(tilings)
    rows = graph.node("Unsqueeze", scaled, graph.constant(np.array([1])))
    place = graph.node("Mul", rows, graph.constant(np.float32(settings["tiles"])))
    place = graph.node("Add", place, graph.constant(shifts))
    place = graph.node("Max", place, graph.constant(np.float32(0)))
    place = graph.node("Min", place, graph.constant(np.float32(tiles - 1)))
    tile = graph.cast(graph.node("Floor", place), np.int64)  # [batch, tilings, columns]

    first, second = np.triu_indices(columns, 1) if settings["pairs"] else (np.arange(0), np.arange(0))
    starts = np.arange(tilings)[:, None] * (columns * tiles + len(first) * tiles**2)
    features = graph.node("Add", tile, graph.constant(starts + np.arange(columns) * tiles))
    if len(first):
        row = graph.node("Gather", tile, graph.constant(first), axis=2)
        within = graph.node("Gather", tile, graph.constant(second), axis=2)
        pair = graph.node("Add", graph.node("Mul", row, graph.constant(np.int64(tiles))), within)
        pair = graph.node("Add", pair, graph.constant(starts + columns * tiles + np.arange(len(first)) * tiles**2))
        features = graph.node("Concat", features, pair, axis=2)
    features = graph.node("Flatten", features, axis=1)
    active = graph.node("Gather", graph.constant(weights.T), features, axis=0)  # [batch, features, actions]
    total = graph.node("ReduceSum", graph.cast(active, np.float64), graph.constant(np.array([1])), keepdims=0)
    return graph.cast(total, np.float32)


def _network_values(graph: _Graph, values: str, arrays: Arrays) -> str:
    """Adds the outputs of the network that gives the agent's values, ``float32 [batch, actions]``."""
    layers = sum(name.startswith("online.") and name.endswith(".weight") for name in arrays)
    for layer in range(layers):
        if layer > 0:
            values = graph.node("Relu", values)
        weight, bias = (graph.constant(arrays[f"online.layers.{layer}.{part}"]) for part in ("weight", "bias"))
        values = graph.node("Gemm", values, weight, bias, transB=1)
    return values
