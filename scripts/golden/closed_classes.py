"""Models without traps, recomputed with NumPy and SciPy: neighbours, closed classes, what is left out, and how far walks get.

    python3 -m pip install numpy==2.4.6 scipy==1.17.1
    python3 scripts/golden/closed_classes.py

Neighbours are searched by sorting all distances, closed classes are strongly connected components that no edge leaves, and traps (closed
classes of less than a tenth of the candidates) are left out in global rounds: all at once, then everything is searched again. Of the last
graph follow, by linear algebra, the stationary distribution and the expected steps until a walk is in a closed class.
"""

import sys
from pathlib import Path

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

import layout

OUT = Path(__file__).parents[2] / "crates/calib-model/tests/golden/closed_classes.json"
TENTH = 10
# Neighbours of every tenth transition of a member are kept.
SHOWN_EVERY = 10
rng = np.random.default_rng(6)


def walk(rows, columns, memory):
    """Returns an autoregressive random walk."""
    states, state = [], np.zeros(columns)
    for _ in range(rows):
        state = memory * state + np.sqrt(1 - memory**2) * rng.normal(size=columns)
        states.append(state)
    return np.array(states, dtype=np.float32)


def loops(rows, period, noise, still):
    """Returns cycles of a plant that repeats itself and is constant for a part of each cycle."""
    phase = np.arange(rows) * 2 * np.pi / period
    slow = walk(rows, 2, 0.98)
    states = np.stack([np.cos(phase), np.sin(phase)], axis=1) * (1 + noise * slow[:, :1]) + noise * slow
    if still:
        states[rows // 3 : rows // 2] = states[rows // 3]
    return states.astype(np.float32)


def case(name, lengths, states, members=3, neighbors=3, theiler=0, weights="linear"):
    return {"name": name, "lengths": lengths, "states": states, "members": members, "neighbors": neighbors, "theiler": theiler, "weights": weights}


# Not a case, and drawn so that the cases stay what they were.
walk(400, 3, 0.96)
CASES = [
    case("two neighbours", [400], walk(400, 3, 0.9), members=5, neighbors=2),
    case("window", [200, 250], walk(450, 2, 0.99), theiler=3, weights="uniform"),
    case("standstill", [450], loops(450, 29.9, 0.15, still=True)),
]


class Member:
    """One ensemble member: the transitions whose rows both lie outside its block."""

    def __init__(self, case, member):
        self.case, self.states = case, case["states"].astype(np.float64)
        starts = np.cumsum([0, *case["lengths"]])
        self.segment = np.repeat(np.arange(len(case["lengths"])), case["lengths"])
        self.source = np.concatenate([np.arange(a, b - 1) for a, b in zip(starts, starts[1:])])
        count, members = len(self.source), case["members"]
        block = np.arange(member * count // members, (member + 1) * count // members)
        rows = np.union1d(self.source[block], self.source[block] + 1)
        self.inside = np.flatnonzero(~np.isin(self.source, rows) & ~np.isin(self.source + 1, rows))
        self.count = count

    def table(self, left_out):
        """Returns neighbours and distances (f32, as stored) of the member's transitions."""
        candidates = self.inside[~np.isin(self.inside, left_out)]
        k, window = self.case["neighbors"], self.case["theiler"]
        neighbors, distances = [], []
        for node in self.inside:
            row, sources = self.source[node] + 1, self.source[candidates]
            squared = np.zeros(len(candidates))
            for column in range(self.states.shape[1]):
                squared += (self.states[row, column] - self.states[sources, column]) ** 2
            if window > 0:
                near = (self.segment[sources] == self.segment[row]) & (np.abs(sources - row) <= window)
                squared[near] = np.inf
            order = np.lexsort((candidates, squared))[:k]
            neighbors.append(candidates[order])
            distances.append(np.sqrt(squared[order]).astype(np.float32))
        return np.array(neighbors), np.array(distances)

    def steps(self, neighbors, distances):
        """Returns the probabilities of steps between transitions, by position in the member."""
        weights = np.ones(distances.shape)
        if self.case["weights"] == "linear":
            far = distances.astype(np.float64)
            total = far.sum(axis=1, keepdims=True)
            weights = np.where(total > 0, 1 - far / np.where(total > 0, total, 1), 1)
        weights /= weights.sum(axis=1, keepdims=True)
        size, k = neighbors.shape
        to = np.searchsorted(self.inside, neighbors)
        steps = csr_matrix((weights.ravel(), (np.repeat(np.arange(size), k), to.ravel())), shape=(size, size))
        steps.eliminate_zeros()
        return steps

    def closed(self, steps):
        """Returns the closed classes as positions, the largest first."""
        count, of = connected_components(steps, directed=True, connection="strong")
        edges = steps.tocoo()
        open_ = np.unique(of[edges.row[of[edges.row] != of[edges.col]]])
        classes = [np.flatnonzero(of == each) for each in np.setdiff1d(np.arange(count), open_)]
        return sorted(classes, key=len, reverse=True)

    def without_traps(self):
        left_out, before = np.array([], dtype=int), None
        while True:
            neighbors, distances = self.table(left_out)
            steps = self.steps(neighbors, distances)
            classes = self.closed(steps)
            before = before or [len(of) for of in classes]
            traps = [of for of in classes if TENTH * len(of) < len(self.inside)]
            if not traps:
                break
            left_out = np.union1d(left_out, self.inside[np.concatenate(traps)])
        still = [node for node in left_out if self.stands_still(node)]
        lost = len(left_out) - len(still)
        if TENTH * lost > len(self.inside):
            sys.exit(f"{self.case['name']}: {lost} of {len(self.inside)} are lost, which calib would lead out of")
        return {
            "before": before,
            "after": [len(of) for of in classes],
            "left_out": left_out.tolist(),
            "lost": lost,
            "neighbors": neighbors[::SHOWN_EVERY].tolist(),
            **self.walks(steps, classes),
        }

    def stands_still(self, node):
        """Whether the same state comes once more, and can be a neighbour."""
        row = self.source[node]
        goes_on = node + 1 in self.inside and self.source[node + 1] == row + 1
        return goes_on and (self.states[row] == self.states[row + 1]).all()

    def walks(self, steps, classes):
        """Returns where rollouts from a uniformly drawn transition end, and the steps until they enter a closed class."""
        dense = steps.toarray()
        ends = np.isin(np.arange(len(dense)), np.concatenate(classes))
        inner = dense[~ends][:, ~ends]
        left = np.eye(len(inner)) - inner
        expected = np.linalg.solve(left, np.ones(len(inner)))
        squared = np.linalg.solve(left, 1 + 2 * inner @ expected)
        mean = expected.sum() / len(dense)
        # Mean of very many steps from anywhere, for periodic chains too: half
        # steps have the same stationary distribution.
        lazy = np.linalg.matrix_power((dense + np.eye(len(dense))) / 2, 1 << 24)
        stationary = lazy.mean(axis=0)
        deviation = np.sqrt(squared.sum() / len(dense) - mean**2)
        return {"steps_to_end": mean, "deviation": deviation, "effective_rows": 1 / (stationary**2).sum()}


def shortest(states):
    """Returns the rows with as few digits as single precision needs."""
    return [[float(str(value)) for value in row] for row in states]


cases = []
for case in CASES:
    members = [Member(case, member).without_traps() for member in range(case["members"])]
    cases.append({**case, "states": shortest(case["states"]), "shown_every": SHOWN_EVERY, "expected": members})
    for member in members:
        print(case["name"], member["before"], member["after"], len(member["left_out"]), member["lost"], member["steps_to_end"], member["effective_rows"])
layout.write(OUT, cases)
