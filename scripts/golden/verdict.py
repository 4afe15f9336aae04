"""Golden numbers of scores and verdicts: crates/calib-sweep/tests/golden/verdict.json.

    python3 scripts/golden/verdict.py        # wants NumPy and SciPy

Written from docs/metrics.md alone, not from calib's code:

- a linear TD(0) agent without replay on a noisy wave in two pieces, and its errors over the parts of the run;
- a race by halving over runs of members and windows of the log: which values each of them trains;
- runs over members, windows of the log and held-out windows: choices of all rules, regrets with bounds over windows, what others
  choose, and shares of choices under the hierarchical bootstrap, from many more resamples than calib draws.
"""

import math
from pathlib import Path

import layout
import numpy as np
from scipy import stats

OUT = Path(__file__).resolve().parents[2] / "crates/calib-sweep/tests/golden/verdict.json"
RESAMPLES = 40_000


def scores():
    """Returns the errors of an agent that predicts column 0 from both columns and a bias, from given weights."""
    rng = np.random.default_rng(5)
    rows, gamma, rate, steps = 260, 0.7, 0.2, 240
    phase = np.arange(rows) * 0.13
    states = np.stack([0.5 + 0.4 * np.sin(phase), 0.5 + 0.4 * np.cos(phase)], axis=1)
    states = (states + 0.02 * rng.standard_normal(states.shape)).astype(np.float32)
    pieces = [(0, 90), (90, rows)]
    weights = np.array([0.25, -0.5, 0.125], dtype=np.float32)
    features = np.concatenate([states.astype(float), np.ones((rows, 1))], axis=1)
    w = weights.astype(float)
    horizon = max(1, math.ceil(math.log(0.01) / math.log(gamma)))
    returns, known, predicted = np.zeros(rows), np.zeros(rows, bool), np.zeros(rows)
    for start, end in pieces:
        for t in range(end - 2, start - 1, -1):
            returns[t] = features[t + 1, 0] + gamma * (returns[t + 1] if t + 1 < end - 1 else 0.0)
        known[start : max(start, end - horizon)] = True
        for t in range(start, end - 1):
            if t >= steps:
                continue
            predicted[t] = features[t] @ w
            delta = features[t + 1, 0] + gamma * (features[t + 1] @ w) - features[t] @ w
            w = w + rate * delta * features[t]
    expected = {}
    for name, before in [("whole_run", 0.0), ("after_first_quarter", 0.25), ("final_quarter", 0.75)]:
        first = math.floor(steps * before + 0.5)
        scored = known & (np.arange(rows) >= first) & (np.arange(rows) < steps)
        expected[name] = {
            "scored_steps": int(scored.sum()),
            "rmse": float(np.sqrt(np.mean((predicted - returns)[scored] ** 2))),
            "mean_return": float(returns[scored].mean()),
            "return_std": float(returns[scored].std()),
        }
    return {
        "states": states.tolist(), "lengths": [e - s for s, e in pieces], "gamma": gamma, "learning_rate": rate,
        "steps": steps, "weights": weights.tolist(), "scores": expected,
    }


def ranks(errors):
    return np.array([1 + int(np.sum(errors < e)) for e in errors])


def lexicographic(*keys):
    """Returns the first index with the smallest keys."""
    return min(range(len(keys[0])), key=lambda i: (*[k[i] for k in keys], i))


def choose(rule, members, log, default):
    """Returns the choice of a rule; members: [member][run][value]; log: [window][value]."""
    means = np.array([np.mean(runs, axis=0) for runs in members])
    of_members = np.array([ranks(row) for row in means])
    worst, mean_rank, mean_error = of_members.max(0), of_members.mean(0), means.mean(0)
    if rule == "worst_rank":
        return lexicographic(worst, mean_rank, mean_error)
    if rule == "mean_rank":
        return lexicographic(mean_rank, mean_error)
    if rule == "mean_error":
        return lexicographic(mean_error, mean_rank)
    streams = [] if rule == "log_replay" else [run for runs in members for run in runs]
    if rule != "mean_log_error":
        streams += list(log)
    logs = np.log(np.array(streams))
    best = lexicographic(logs.mean(0))
    if rule != "one_standard_error":
        return best
    difference = logs[:, best] - logs[:, default]
    error = difference.std(ddof=1) / math.sqrt(len(difference) / 3)
    return best if difference.mean() < -error else default


def losses(windows):
    """Returns the mean over windows of ln(error / best error of the window), one per value."""
    each = np.array([np.mean(runs, axis=0) for runs in windows])
    return np.log(each / each.min(1, keepdims=True))


def verdict():
    rng = np.random.default_rng(11)
    values, default = 5, 1
    level = np.array([0.45, 0.3, 0.28, 0.31, 0.6])
    draw = lambda spread: (level * np.exp(spread * rng.standard_normal(values))).round(4)
    members = [[draw(0.25) for _ in range(3)] for _ in range(4)]
    log = [draw(0.3) for _ in range(5)]
    windows = []
    for _ in range(4):
        own = np.exp(0.2 * rng.standard_normal(values))
        windows.append([(draw(0.05) * own).round(4) for _ in range(2)])
    rules = ["worst_rank", "mean_rank", "mean_error", "mean_log_error", "pooled", "log_replay", "one_standard_error"]
    chosen = {rule: choose(rule, members, log, default) for rule in rules}
    loss = losses(windows)
    regrets = np.expm1(loss.mean(0))
    others = [loss[v, int(np.argmin(loss[w]))] for w in range(4) for v in range(4) if v != w]
    choice = chosen["worst_rank"]
    counts = np.zeros(values)
    for _ in range(RESAMPLES):
        own = [[members[m][r] for r in rng.integers(0, 3, 3)] for m in rng.integers(0, 4, 4)]
        counts[choose("worst_rank", own, [log[i] for i in rng.integers(0, 5, 5)], default)] += 1

    def upper_bound(losses):
        n, mean, std = len(losses), losses.mean(), losses.std(ddof=1)
        freedom = 2 * n * min(0.5, (n - 1) / n * (mean / std) ** 2)
        return mean * freedom / stats.chi2.ppf(0.05, freedom)

    def interval(of_windows):
        return np.array(stats.t.interval(0.95, len(of_windows) - 1, of_windows.mean(), stats.sem(of_windows)))

    return {
        "default": default,
        "members": [[run.tolist() for run in runs] for runs in members],
        "log": [run.tolist() for run in log],
        "windows": [[run.tolist() for run in runs] for runs in windows],
        "chosen": chosen,
        "regrets": regrets.tolist(),
        "another_window": math.expm1(np.mean(others)),
        "hindsight": float(regrets.min()),
        "random": float(regrets.mean()),
        "log_replay": int(np.argmin(np.mean(log, axis=0))),
        "latest_window": int(np.argmin(log[0])),
        "regret_bound": math.expm1(upper_bound(loss[:, choice])),
        "against_default": float(np.exp((loss[:, choice] - loss[:, default]).mean())),
        "against_default_interval": np.exp(interval(loss[:, choice] - loss[:, default])).tolist(),
        "shares": (counts / RESAMPLES).tolist(),
    }


def race():
    """Successive halving over six runs of each of four members and six windows of the log: the values that each of 30 runs trains."""
    rng = np.random.default_rng(23)
    level, runs, members = np.array([0.5, 0.3, 0.36, 0.28, 0.9]), 6, 4
    streams = [
        [(level * np.exp(0.15 * rng.standard_normal(5))).round(4).tolist() for _ in range(members + 1)]
        for _ in range(runs)
    ]
    # The best value diverges in the first run.
    streams[0][0][3] = None
    # Kinds alternate in proportion, members first. Windows are spread:
    # the bits of their numbers are reversed.
    windows = sorted(range(runs), key=lambda window: f"{window:03b}"[::-1])
    places = [(k / (runs * members), (k // members, k % members)) for k in range(runs * members)]
    places += [(k / runs, (window, members)) for k, window in enumerate(windows)]
    order = [stream for _, stream in sorted(places, key=lambda place: place[0])]
    trained = [[[] for _ in range(members + 1)] for _ in range(runs)]
    left, logs, start, end = list(range(5)), [], 0, math.ceil(len(order) / 2 ** math.ceil(math.log2(5)))
    while len(left) > 1:
        for run, stream in order[start:end]:
            trained[run][stream] = list(left)
            logs.append([math.inf if error is None else math.log(error) for error in streams[run][stream]])
        table = np.array(logs)
        diverged = np.isinf(table)
        means = np.where(diverged, 0, table).sum(0) / (~diverged).sum(0)
        left = sorted(sorted(left, key=lambda v: (diverged[:, v].sum(), means[v]))[: math.ceil(len(left) / 2)])
        start, end = end, 2 * end
    return {"streams": streams, "trained": trained}


layout.write(OUT, {"scores": scores(), "verdict": verdict(), "race": race()})
