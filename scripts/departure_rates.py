#!/usr/bin/env python3
"""How often nearest neighbours of a model's states lie at another time, by spacing of the states.

    pip install numpy
    python3 scripts/departure_rates.py MODEL_FOLDER [--neighbors 3] [--queries 1500]

MODEL_FOLDER is the folder `model` that `calib build-model` wrote. The script searches all its states exactly, in the
representation, where there is one, and in the normalised sensors. It searches them again with every sixth state, every
thirtieth, and so on. A departure is a neighbour more than ten states away in time, as in docs/metrics.md. calib has no
part in the numbers: this checks its departure rates independently.
"""

import argparse
import json
from pathlib import Path

import numpy as np

EVERY = (1, 6, 30, 60, 180)
AWAY = 10  # states
CHUNK = 100_000


def departure_rate(states: np.ndarray, neighbors: int, queries: int, rng: np.random.Generator) -> float:
    """Returns the share of nearest neighbours (including the state itself) of random states that lie at another time."""
    rows = len(states) - 1  # the last row has no successor
    asked = rng.choice(rows, min(queries, rows), replace=False)
    lengths = (states * states).sum(axis=1)
    nearest = np.zeros((len(asked), 0), dtype=np.int64)
    distances = np.zeros((len(asked), 0), dtype=np.float32)
    for start in range(0, rows, CHUNK):
        end = min(start + CHUNK, rows)
        squared = lengths[None, start:end] - 2 * states[asked] @ states[start:end].T
        found = np.argpartition(squared, min(neighbors, end - start) - 1, axis=1)[:, :neighbors]
        nearest = np.concatenate([nearest, found + start], axis=1)
        distances = np.concatenate([distances, np.take_along_axis(squared, found, axis=1)], axis=1)
        order = np.argsort(distances, axis=1)[:, :neighbors]
        nearest = np.take_along_axis(nearest, order, axis=1)
        distances = np.take_along_axis(distances, order, axis=1)
    return float((np.abs(nearest - asked[:, None]) > AWAY).mean())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", type=Path)
    parser.add_argument("--neighbors", type=int, default=3)
    parser.add_argument("--queries", type=int, default=1500)
    arguments = parser.parse_args()
    seconds = json.loads((arguments.model / "manifest.json").read_text())["period"] / 1e6
    for name, file in (("representation", "representation.npy"), ("sensors", "states.npy")):
        path = arguments.model / file
        if not path.exists():
            continue
        whole = np.load(path, mmap_mode="r")
        for every in EVERY:
            states = np.ascontiguousarray(whole[::every], dtype=np.float32)
            rate = departure_rate(states, arguments.neighbors, arguments.queries, np.random.default_rng(0))
            spacing = seconds * every
            print(f"{name:15} a state every {spacing:6,.0f} s: {rate:.4f} departures a step, {rate * 3600 / spacing:7.2f} an hour", flush=True)


if __name__ == "__main__":
    main()
