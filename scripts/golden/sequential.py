"""Boundaries of the sequential t-test for crates/calib-stats/tests/sequential.rs, from NumPy and SciPy.

    python3 -m pip install numpy==2.4.6 scipy==1.17.1
    python3 scripts/golden/sequential.py > crates/calib-stats/tests/sequential.json

Another way than calib's: the distribution of c = Σx / √Σx² is carried from look to look as the masses of 6,000 cells, and
P(c' ≤ y | c) is Student's distribution function at the two angles at which c cos φ + sin φ = y. Then 20 million simulated races say
whether the boundaries are crossed as often as they should be.
"""

import json
import sys

import numpy as np
from scipy import stats

CELLS = 6000
RACES = 20_000_000
CASES = [(3, 0.05), (5, 0.05), (10, 0.05), (10, 0.05 / 8), (15, 0.01)]


def below(n, c, y):
    """P(c' <= y | c): the next observation / √Σx² is tan φ, and √n tan φ has Student's distribution with n degrees of freedom."""
    size = np.sqrt(1 + c * c)
    share = np.clip(y / size, -1, 1)
    top, half = np.arctan2(1, c), np.arccos(share)

    def distribution(angle):
        inside = np.clip(angle, -np.pi / 2, np.pi / 2)
        with np.errstate(divide="ignore", over="ignore"):
            found = stats.t.cdf(np.sqrt(n) * np.tan(inside), n)
        return np.where(angle <= -np.pi / 2, 0.0, np.where(angle >= np.pi / 2, 1.0, found))

    # Above y between top − half and top + half, and a turn earlier.
    above = distribution(top + half) - distribution(top - half)
    above += distribution(top + half - 2 * np.pi) - distribution(top - half - 2 * np.pi)
    return 1 - above


def root(falling, low, high):
    """Where a function falls through 0, by bisection."""
    for _ in range(50):
        middle = (low + high) / 2
        low, high = (middle, high) if falling(middle) > 0 else (low, middle)
    return high


def boundaries(most, error_rate):
    edges = -np.sqrt(3) * np.cos(np.linspace(0, np.pi, CELLS + 1))
    mass = np.diff(edges) / (2 * np.sqrt(3))
    spend, found, total = error_rate / most, [], 1.0
    for n in range(3, most + 1):
        rate = spend * (3 if n == 3 else 1)
        if n == 3:
            c = np.sqrt(3) * (1 - 2 * rate)
        else:
            c = root(lambda y: total - rate - mass @ below(n - 1, middle, y), 0, np.sqrt(n))
        found.append(float(c * np.sqrt((n - 1) / (n - c * c))))
        total -= rate
        if n == most:
            break
        # The cells of c that are left, the last one ending at the boundary.
        edges = -np.sqrt(n) * np.cos(np.linspace(0, np.pi, CELLS + 1))
        edges = np.append(edges[edges < c], c)
        if n == 3:
            mass = np.diff(edges) / (2 * np.sqrt(3))
        else:
            mass = np.diff([mass @ below(n - 1, middle, edge) for edge in edges])
        middle = (edges[1:] + edges[:-1]) / 2
    return found


def check(limits, error_rate, most):
    """The share of races that end at each look, against what is spent there."""
    rng = np.random.default_rng(1)
    crossed, chunk = np.zeros(len(limits)), 1_000_000
    for _ in range(RACES // chunk):
        total, squares, open_ = np.zeros(chunk), np.zeros(chunk), np.ones(chunk, bool)
        for n in range(1, most + 1):
            x = rng.standard_normal(chunk)
            total, squares = total + x, squares + x * x
            if n >= 3:
                t = total / np.sqrt(n) / np.sqrt((squares - total**2 / n) / (n - 1))
                ends = open_ & (t >= limits[n - 3])
                crossed[n - 3] += ends.sum()
                open_ &= ~ends
    spent = np.full(len(limits), error_rate / most)
    spent[0] *= 3
    z = (crossed / RACES - spent) / np.sqrt(spent / RACES)
    print(most, error_rate, "standard errors off:", z.round(1), file=sys.stderr)
    assert np.abs(z).max() < 4.5


if __name__ == "__main__":
    cases = []
    for most, error_rate in CASES:
        limits = boundaries(most, error_rate)
        check(limits, error_rate, most)
        cases.append({"most": most, "error_rate": error_rate, "boundaries": limits})
    json.dump(cases, sys.stdout, indent=1)
    print()
