"""Reference values for crates/calib-stats/tests/it/golden.rs, from SciPy and NumPy.

    python3 -m pip install numpy==2.4.6 scipy==1.17.1
    python3 scripts/golden/stats.py > crates/calib-stats/tests/golden.json
"""

import json
import sys

import numpy as np
from scipy import stats

rng = np.random.default_rng(20251)
INF = "inf"


def plain(values):
    return [INF if np.isinf(v) else float(v) for v in values]


intervals = []
for n in (2, 3, 5, 10, 30):
    runs = rng.lognormal(-1.5, 0.4, n)
    low, high = stats.t.interval(0.95, n - 1, loc=runs.mean(), scale=stats.sem(runs))
    intervals.append(
        {"runs": plain(runs), "mean": runs.mean(), "std": runs.std(ddof=1), "low": low, "high": high}
    )

correlations = []
for n, ties, infinities in [(5, False, 0), (8, True, 0), (12, True, 2), (20, False, 3), (7, True, 1)]:
    x, y = rng.normal(size=n), rng.normal(size=n)
    y = y + x
    if ties:
        x, y = np.round(x), np.round(y)
    y[:infinities] = np.inf
    # Ranks replace the values, so that infinities have an order and tie with each other.
    rx, ry = stats.rankdata(x), stats.rankdata(y)
    correlations.append(
        {
            "x": plain(x),
            "y": plain(y),
            "spearman": float(stats.spearmanr(rx, ry).statistic),
            "kendall_tau_b": float(stats.kendalltau(rx, ry, variant="b").statistic),
        }
    )

quantiles = []
for n in (1, 2, 7, 20):
    values = rng.normal(size=n)
    for p in (0.0, 0.05, 0.5, 0.95, 1.0):
        quantiles.append({"values": plain(values), "p": p, "quantile": float(np.quantile(values, p))})

scores = np.array([0.31, 0.2, 0.31, 0.2, np.inf, 0.9, np.inf])
ranks = {
    "scores": plain(scores),
    "competition": [int(r) for r in stats.rankdata(scores, method="min")],
    "average": [float(r) for r in stats.rankdata(scores, method="average")],
}

json.dump(
    {"intervals": intervals, "correlations": correlations, "quantiles": quantiles, "ranks": ranks},
    fp=sys.stdout,
    indent=1,
)
print()
