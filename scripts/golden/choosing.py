"""Reference values for crates/calib-stats/tests/it/choosing.rs, from NumPy and SciPy: choices by log errors, also under resampling of
members and runs, and regrets over windows with their bounds. The draws are in the file, in the order in which they are asked for.

    python3 -m pip install numpy==2.4.6 scipy
    python3 scripts/golden/choosing.py > crates/calib-stats/tests/choosing.json
"""

import json
import sys

import numpy as np
from scipy import stats

MEMBERS, WINDOWS, RUNS, CANDIDATES, RESAMPLES = 4, 6, 3, 5, 200
rng = np.random.default_rng(20261)


def errors(units):
    """Returns log errors: a part of the candidate, of the unit and of the run. A few runs diverge for the last candidate."""
    logs = 0.3 * np.abs(np.arange(CANDIDATES) - 1.7) + 0.2 * rng.normal(size=(units, 1, CANDIDATES))
    logs = logs + rng.normal(size=(units, RUNS, 1)) + 0.05 * rng.normal(size=(units, RUNS, CANDIDATES))
    found = np.exp(logs)
    found[..., -1][rng.random((units, RUNS)) < 0.2] = np.inf
    return found


def plain(values):
    return [plain(value) for value in values] if np.ndim(values) else ("inf" if np.isinf(values) else float(values))


def mean_logs(streams):
    return np.log(streams).mean(axis=0)


def around_default(streams, default, streams_per_independent):
    chosen, advantages = default, []
    for candidate in range(CANDIDATES):
        if candidate == default or np.isinf(streams[:, candidate]).any():
            advantages.append(None)
            continue
        d = np.log(streams[:, default]) - np.log(streams[:, candidate])
        error = d.std(ddof=1) / np.sqrt(len(d) / streams_per_independent)
        advantages.append([d.mean(), error])
    better = [at for at, of in enumerate(advantages) if of is not None and of[0] > 0 and of[0] >= of[1]]
    if better:
        chosen = min(better, key=lambda candidate: mean_logs(streams)[candidate])
    return chosen, advantages


def over_windows(logs):
    """Returns mean and t-interval of logarithms over windows; no interval if a value is infinite."""
    mean = logs.mean()
    if np.isinf(logs).any():
        return mean, None
    half = stats.t.ppf(0.975, len(logs) - 1) * logs.std(ddof=1) / np.sqrt(len(logs))
    return mean, [mean - half, mean + half]


def upper_bound(losses):
    """Returns the 95 % upper bound of the mean of losses, assumed to be gamma distributed with a shape of at most a half."""
    n, mean, std = len(losses), losses.mean(), losses.std(ddof=1)
    if np.isinf(losses).any() or n < 4 or np.count_nonzero(losses) < 2 or std == 0:
        return None
    freedom = 2 * n * min(0.5, (n - 1) / n * (mean / std) ** 2)
    return mean * freedom / stats.chi2.ppf(0.05, freedom)


def regret(windows, choice):
    """Returns the regret; `windows` are mean errors, `[window][candidate]`."""
    losses = np.log(windows[:, choice] / windows.min(axis=1))
    upper = upper_bound(losses)
    return np.expm1(losses.mean()), upper and float(np.expm1(upper))


def drawn(units, draws):
    """Resamples units with replacement, and the runs of each with replacement; appends the resamples to draws."""
    found = []
    for _ in range(len(units)):
        unit = int(rng.integers(len(units)))
        draws.append(unit)
        runs = [int(run) for run in rng.integers(RUNS, size=RUNS)]
        draws.extend(runs)
        found.append(units[unit][runs])
    return np.array(found)


members, windows = errors(MEMBERS), errors(WINDOWS)
streams = members.reshape(-1, CANDIDATES)
chosen = int(mean_logs(streams).argmin())
defaults = []
for default in range(CANDIDATES - 1):
    for streams_per_independent in (1.0, 3.0, 6.0):
        choice, advantages = around_default(streams, default, streams_per_independent)
        defaults.append(
            {"default": default, "streams_per_independent": streams_per_independent, "chosen": choice, "advantages": advantages}
        )

draws, counts = [], np.zeros(CANDIDATES, int)
for _ in range(RESAMPLES):
    counts[int(mean_logs(drawn(members, draws).reshape(-1, CANDIDATES)).argmin())] += 1
means = windows.mean(axis=1)
regrets = [regret(means, choice) for choice in range(CANDIDATES)]
mean, interval = over_windows(np.log(means[:, 2] / means[:, 0]))

json.dump(
    {
        "members": plain(members),
        "windows": plain(windows),
        "mean_logs": plain(mean_logs(streams)),
        "chosen": chosen,
        "regrets": plain([value for value, _ in regrets]),
        "bounds": [upper for _, upper in regrets],
        "quotient": plain(np.exp([mean, *interval])),
        "defaults": defaults,
        "resamples": RESAMPLES,
        "draws": draws,
        "counts": counts.tolist(),
    },
    fp=sys.stdout,
)
print()
