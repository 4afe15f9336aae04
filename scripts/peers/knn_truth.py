"""What the neighbour tables of knn.py are made from and held to; runs where NumPy is.

    python3 knn_truth.py STEP ARGUMENT ...
"""

import sys

import numpy as np

K = 3
RECALL = 0.99


def member_sources(rows):
    """Returns the sources of ensemble member 0 of five; the row after each source is a query."""
    return (rows - 1) // 5 + 1, rows - 1


def recall(states, queries, found, true_squared):
    """Returns the share of true neighbours among the K found rows per query. A row counts once, and never as its own neighbour."""
    hits = 0
    for query, rows, worst in zip(queries, found, true_squared):
        rows = {int(row) for row in rows[:K] if row >= 0 and row != query}
        lo, hi = member_sources(len(states))
        near = states[sorted(row for row in rows if lo <= row < hi)].astype(np.float64)
        squared = ((near - states[query].astype(np.float64)) ** 2).sum(1)
        hits += int((squared <= worst * (1 + 1e-6) + 1e-12).sum())
    return hits / (K * len(queries))


def prepare(step, arguments):
    """Steps that need NumPy, in the peers' environment."""
    if step == "gaussian":
        out, rows, columns = arguments
        rng = np.random.default_rng(3)
        np.save(out, rng.standard_normal((int(rows), int(columns)), dtype=np.float32))
    elif step == "switching":
        out, rows = arguments
        rows, rng, columns = int(rows), np.random.default_rng(6), []
        for channel in range(142):
            if channel < 40:  # on or off, for ten minutes to a day at one row per ten seconds
                holds = rng.exponential(rng.choice([60, 600, 8640]), rows // 20 + 20).astype(np.int64) + 1
                columns.append(np.repeat(np.arange(len(holds)) % 2, holds)[:rows] if holds.sum() >= rows else np.resize(np.repeat([0, 1], 300), rows))
                continue
            slow = 1 - 10 ** rng.uniform(-4, -2)  # an autoregression, on a coarse grid for 60 of them
            noise, value, own = rng.normal(0, (1 - slow**2) ** 0.5, rows), rng.normal(), np.empty(rows)
            for row in range(rows):
                value = slow * value + noise[row]
                own[row] = value
            own = np.clip((own + 4) / 8, 0, 1)
            columns.append(np.round(own * 32) / 32 if channel < 100 else own)
        np.save(out, np.stack(columns, 1).astype(np.float32))
    elif step == "quantised":
        plant, out, rows = arguments
        rng, states = np.random.default_rng(4), np.load(plant, mmap_mode="r")[: int(rows)].copy()
        states = np.round(states * 64) / np.float32(64)
        copies = np.flatnonzero(rng.random(len(states)) < 0.3)
        copies = copies[copies > 0]
        for row in copies:  # a copy of a row of the hour before, as in a stuck period
            states[row] = states[row - rng.integers(1, min(row, 360) + 1)]
        np.save(out, states)
    elif step == "embedding":
        plant, out, rows = arguments
        states, rng = np.load(plant, mmap_mode="r")[: int(rows)], np.random.default_rng(5)
        inner = rng.normal(size=(states.shape[1], 256)).astype(np.float32) / np.float32(states.shape[1] ** 0.5)
        outer = rng.normal(size=(256, 64)).astype(np.float32) / np.float32(16)
        mean, spread = states[::97].mean(0), states[::97].std(0) + np.float32(1e-3)
        parts = [np.tanh(2 * np.tanh((part - mean) / spread @ inner) @ outer) for part in np.array_split(states, 64)]
        np.save(out, np.concatenate(parts).astype(np.float32))
    elif step == "wells":
        model, out = arguments
        np.save(out, np.load(model, mmap_mode="r"))
    elif step == "truth":
        file, rows, queries, out, sample = arguments
        rows = int(rows)
        states, (lo, hi) = np.load(file, mmap_mode="r")[:rows], member_sources(rows)
        rng = np.random.default_rng(6)
        order = lo + 1 + rng.permutation(hi - lo)
        chosen = order[: int(sample)]
        points = states[chosen].astype(np.float64)
        nearest = np.full((len(chosen), K), np.inf)
        for start in range(lo, hi, 50_000):
            part = states[start : min(start + 50_000, hi)].astype(np.float64)
            squared = (points**2).sum(1)[:, None] + (part**2).sum(1)[None, :] - 2 * points @ part.T
            own = chosen - start
            inside = np.flatnonzero((own >= 0) & (own < len(part)))
            squared[inside, own[inside]] = np.inf
            for row, near in enumerate(np.argpartition(squared, min(K + 8, len(part) - 1), axis=1)[:, : K + 8]):
                near = near[near + start != chosen[row]]
                exact = ((part[near] - points[row]) ** 2).sum(1)
                nearest[row] = np.sort(np.concatenate([nearest[row], exact]))[:K]
        np.save(queries, order[:, None].astype("<u4"))
        np.save(out, nearest[:, -1])
    elif step == "recall":
        file, rows, queries, truth, found = arguments
        states, truth, found = np.load(file, mmap_mode="r")[: int(rows)], np.load(truth), np.load(found)
        count = min(len(truth), len(found))
        print(recall(states, np.load(queries)[:count, 0].astype(np.int64), found[:count].astype(np.int64), truth[:count]))
    elif step == "shape":
        print(*np.load(arguments[0], mmap_mode="r").shape)


if __name__ == "__main__":
    prepare(sys.argv[1], sys.argv[2:])
