"""What `calib validity` says, computed again by NumPy and pandas: regrets, choices, defaults, quotients, power.

    python3 -m pip install numpy==2.4.6 scipy==1.17.1 pandas==3.1.1 pyarrow==26.0.1
    python3 scripts/golden/validity.py > crates/calib-validity/tests/golden.json    # pairs that are drawn here
    python3 scripts/golden/validity.py FOLDER                                       # a judgement that is there

With a folder that `calib validity` wrote for a protocol (…/draw-1), everything begins with the runs of the sweeps
(studies/PLANT-results/**/sweep/runs.parquet): errors, windows, regrets, the choice of every rule and baseline, and all that
follows, are compared with pairs.parquet and validity.json. Nothing of calib is used.
"""

import json
import sys
from pathlib import Path

import numpy as np
import pandas as pd
from scipy import stats

CAP, MARGIN, GOOD, FEWEST_PLANTS = 10.0, 0.01, 0.05, 8
RULES = ["worst_rank", "mean_rank", "mean_error", "mean_log_error", "pooled", "one_standard_error"]


# From runs to pairs


def losses(online):
    """Returns the mean over windows of ln(error / best error of the window), [values]; `online` is {window: [runs, values]}."""
    return np.mean(each_loss(online), axis=0)


def each_loss(online):
    each = []
    for runs in online.values():
        errors = runs.mean(axis=0)
        if np.isfinite(errors.min()):
            each.append([0.0 if e == errors.min() else np.log(e / errors.min()) for e in errors])
    return np.array(each)


def first_of_least(*keys):
    """Returns the position of the smallest key; further keys, then the order, break ties."""
    return min(range(len(keys[0])), key=lambda v: (*[key[v] for key in keys], v))


def choice(rule, members, log, default):
    """Returns the choice of a rule; `members` is a list of [runs, values], `log` is [windows, values]."""
    errors = np.array([runs.mean(axis=0) for runs in members])
    ranks = np.array([stats.rankdata(row, method="min") for row in errors])
    worst, mean_rank, mean_error = ranks.max(axis=0), ranks.mean(axis=0), errors.mean(axis=0)
    if rule == "worst_rank":
        return first_of_least(worst, mean_rank, mean_error)
    if rule == "mean_rank":
        return first_of_least(mean_rank, mean_error)
    if rule == "mean_error":
        return first_of_least(mean_error, mean_rank)
    streams = np.concatenate(members if rule == "mean_log_error" else [*members, log])
    logs = np.log(streams)
    best = first_of_least(logs.mean(axis=0))
    if rule != "one_standard_error":
        return best
    with np.errstate(invalid="ignore"):
        difference = logs[:, best] - logs[:, default]
    if not np.isfinite(difference).all():
        return best if np.isneginf(difference).any() else default
    error = difference.std(ddof=1) / np.sqrt(len(difference) / 3)
    return best if difference.mean() < -error else default


def pairs_of(folder, part, chosen_rule):
    """Returns every pair of every plant in the folder, by the errors over `part` of the runs."""
    pairs = []
    for results in sorted(Path(folder, "studies").glob("*-results")):
        plant = results.name.removesuffix("-results")
        sweeps = {path.parts[-3]: path for path in sorted(results.glob("models/*/sweep/runs.parquet"))}
        tables = {model: pd.read_parquet(path) for model, path in sweeps.items()}
        if not tables:
            continue
        for sensor in next(iter(tables.values())).sensor.unique():
            pairs.append(pair_of(plant, sensor, tables, part, chosen_rule))
    return pairs


def pair_of(plant, sensor, tables, part, chosen_rule):
    def grid(runs):
        wide = runs.pivot(index="run", columns="candidate", values="error").sort_index()
        return wide.to_numpy()

    pair = {"plant": plant, "sensor": sensor, "models": {}}
    for model, table in tables.items():
        own = table[table.sensor == sensor].copy()
        own["error"] = np.where(own.diverged, np.inf, own[f"rmse_{part}"] / own.error_scale)
        members = [grid(of) for name, of in own.groupby("environment") if name.startswith("member:")]
        log = grid(own[own.environment == "log-replay"])
        if "regrets" not in pair:
            online = own[own.environment == "online"]
            online = {start: grid(of) for start, of in online.groupby("start_row")}
            rates = own.groupby("candidate").learning_rate.first()
            each = each_loss(online)
            best = each.argmin(axis=1)
            others = [each[w, best[v]] for v in range(len(each)) for w in range(len(each)) if w != v]
            others = [loss for loss in others if np.isfinite(loss)]
            pair |= {
                "optimiser": own.optimiser.iloc[0],
                "regrets": np.expm1(losses(online)),
                "default": int((rates - 1e-3).abs().argmin()),
                "log_replay": first_of_least(log.mean(axis=0)),
                "latest_window": first_of_least(log[0]),
                "another_window": np.expm1(np.mean(others)) if others else None,
            }
        if np.isinf(np.mean([of.mean(axis=0) for of in members], axis=0)).all():
            continue
        rules = {rule: choice(rule, members, log, pair["default"]) for rule in RULES}
        pair["models"][model] = {"chosen": rules[chosen_rule], "rules": rules}
    return pair


# From pairs to the judgement


def best_default(pairs):
    if not pairs:
        return None
    logs = [np.log1p(np.minimum(pair["regrets"], CAP)) for pair in pairs]
    return first_of_least(np.sum(logs, axis=0))


def methods(pairs):
    """Returns {method: [pairs] of (value or None, regret or None)}."""
    def by_value(value):
        chosen = [value(pair) for pair in pairs]
        return [(v, None if v is None else pair["regrets"][v]) for v, pair in zip(chosen, pairs)]

    def others(pair, alike):
        return [
            other for other in pairs
            if other["plant"] != pair["plant"] and (not alike or other["optimiser"] == pair["optimiser"])
        ]

    found = {}
    for model in sorted({model for pair in pairs for model in pair["models"]}):
        found[f"model:{model}"] = by_value(lambda pair: pair["models"].get(model, {}).get("chosen"))
        for rule in RULES:
            rules = lambda pair: pair["models"].get(model, {}).get("rules", {}).get(rule)
            found[f"model:{model}:{rule}"] = by_value(rules)
    for name in ["log_replay", "latest_window", "default"]:
        found[name] = by_value(lambda pair: pair[name])
    everywhere = best_default(pairs)
    found["best_default"] = by_value(lambda pair: everywhere)
    found["best_default_of_other_plants"] = by_value(lambda pair: best_default(others(pair, False)))
    if len({pair["optimiser"] for pair in pairs}) > 1:
        own = {
            optimiser: best_default([pair for pair in pairs if pair["optimiser"] == optimiser])
            for optimiser in {pair["optimiser"] for pair in pairs}
        }
        found["best_default_of_optimiser"] = by_value(lambda pair: own[pair["optimiser"]])
        alike = lambda pair: best_default(others(pair, True))
        found["best_default_of_other_plants_with_optimiser"] = by_value(alike)
    without = lambda regret: [(None, regret(pair)) for pair in pairs]
    found["random"] = without(lambda pair: np.minimum(pair["regrets"], CAP).mean())
    found["hindsight"] = without(lambda pair: pair["regrets"].min())
    found["another_window"] = without(lambda pair: pair["another_window"])
    return {name: of for name, of in found.items() if any(regret is not None for _, regret in of)}


def jackknife(pairs, values):
    """Returns the mean of `values` (None if missing) and its standard error, by leaving out plants; no error for few plants."""
    known = [(pair["plant"], value) for pair, value in zip(pairs, values) if value is not None]
    plants = sorted({plant for plant, _ in known})
    mean = np.mean([value for _, value in known])
    if len(plants) < FEWEST_PLANTS:
        return mean, None, len(plants)
    without = np.array([np.mean([value for plant, value in known if plant != left_out]) for left_out in plants])
    squares = np.sum((without - without.mean()) ** 2)
    return mean, np.sqrt((len(plants) - 1) / len(plants) * squares), len(plants)


def bounds(pairs, of):
    """Returns the upper bound of the mean regret, and the interval of the typical one."""
    regrets = [None if regret is None else min(regret, CAP) for _, regret in of]
    mean, error, plants = jackknife(pairs, regrets)
    log_mean, log_error, _ = jackknife(pairs, [None if regret is None else np.log1p(regret) for regret in regrets])
    if not error:
        return {"upper": None, "typical_interval": None}
    low = max(0.0, log_mean - stats.t.ppf(0.975, plants - 1) * log_error)
    high = log_mean + np.sqrt(19) * log_error
    return {"upper": mean + np.sqrt(19) * error, "typical_interval": [np.expm1(low), np.expm1(high)]}


def summary(of):
    regrets = np.array([regret for _, regret in of if regret is not None], dtype=float)
    counted = np.minimum(regrets, CAP)
    worst = np.sort(counted)[-max(1, (len(counted) + 5) // 10) :]
    return {
        "pairs": len(regrets),
        "diverged": int(np.isinf(regrets).sum()),
        "capped": int((regrets > CAP).sum()),
        "mean": counted.mean(),
        "typical": np.expm1(np.log1p(counted).mean()),
        "worst_tenth": np.expm1(np.log1p(worst).mean()),
        "median": np.median(counted),
        "good": (regrets <= GOOD).mean(),
    }


def quotients(pairs, own, other):
    """Returns {plant: [ln of the ratio of errors]} where both have a choice."""
    by_plant = {}
    for pair, (_, a), (_, b) in zip(pairs, own, other):
        if a is not None and b is not None:
            logs = np.log1p(min(a, CAP)) - np.log1p(min(b, CAP))
            by_plant.setdefault(pair["plant"], []).append(logs)
    return by_plant


def comparison(pairs, own, other):
    by_plant = quotients(pairs, own, other)
    logs = np.concatenate([*by_plant.values()])
    both = [(a, b) for (_, a), (_, b) in zip(own, other) if a is not None and b is not None]
    means = np.array([np.mean(of) for of in by_plant.values()])
    found = {
        "pairs": len(logs),
        "wins": sum(a < b for a, b in both),
        "ties": sum(a == b for a, b in both),
        "losses": sum(a > b for a, b in both),
        "difference": np.mean([min(a, CAP) - min(b, CAP) for a, b in both]),
        "error_ratio": np.exp(logs.mean()),
        "plants": len(means),
        "std": None,
        "visible": None,
        "needed": [None] * 3,
        "error_ratio_interval": None,
    }
    log_ratios = [
        None if a is None or b is None else np.log1p(min(a, CAP)) - np.log1p(min(b, CAP)) for (_, a), (_, b) in zip(own, other)
    ]
    mean, error, plants = jackknife(pairs, log_ratios)
    if error is not None:
        half = stats.t.ppf(0.975, plants - 1) * error
        found["error_ratio_interval"] = [np.exp(mean - half), np.exp(mean + half)]
    if len(means) > 1:
        std = means.std(ddof=1)
        found |= {"std": std, "visible": np.expm1(visible(std, len(means)))}
        found["needed"] = [needed(std, np.log1p(of)) for of in (0.01, 0.02, 0.05)]
    return found


def visible(std, n):
    return (stats.t.ppf(0.975, n - 1) + stats.t.ppf(0.8, n - 1)) * std / np.sqrt(n)


def needed(std, difference):
    few, enough = 1, 1_000_000
    if visible(std, enough) > difference:
        return None
    while enough - few > 1:
        between = (few + enough) // 2
        few, enough = (few, between) if visible(std, between) <= difference else (between, enough)
    return enough


# Golden pairs, and comparisons with calib's results


def plain(value):
    if isinstance(value, dict):
        return {name: plain(of) for name, of in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [plain(of) for of in value]
    if isinstance(value, (float, np.floating)):
        return "inf" if np.isinf(value) else float(value)
    return int(value) if isinstance(value, np.integer) else value


def golden():
    rng = np.random.default_rng(20261)
    pairs = []
    for plant in range(9):
        for sensor in range(1 + plant % 3):
            regrets = np.round(rng.lognormal(-1, 1.5, 5), 3)
            regrets[rng.random(5) < 0.15] = np.inf
            regrets[rng.integers(5)] = 0.0
            models = {}
            for model in ["a", "b"][: 1 + (plant != 2)]:
                rules = {rule: int(rng.integers(5)) for rule in RULES}
                models[model] = {"chosen": rules["worst_rank"], "rules": rules}
            pairs.append({
                "plant": f"plant {plant}",
                "sensor": f"sensor {sensor}",
                "optimiser": ["adam", "sgd"][plant % 2],
                "regrets": regrets,
                "default": 2,
                "log_replay": int(rng.integers(5)),
                "latest_window": int(rng.integers(5)),
                "another_window": None if plant == 3 else round(float(rng.lognormal(-2, 1)), 3),
                "models": models,
            })
    found = methods(pairs)
    models = [name for name in found if name.count(":") == 1]
    others = [name for name in found if name.count(":") == 0]
    return {
        "pairs": pairs,
        "best_default": best_default(pairs),
        "summaries": {name: summary(of) | bounds(pairs, of) for name, of in found.items()},
        "comparisons": [
            {"method": own, "against": other} | comparison(pairs, found[own], found[other])
            for own in models for other in others
        ],
    }


def check(folder):
    judgement = json.loads(Path(folder, "validity.json").read_text())
    stored = pd.read_parquet(Path(folder, "pairs.parquet"))
    worst = {"regret": 0.0, "summary": 0.0, "quotient": 0.0, "power": 0.0, "interval": 0.0}

    def close(what, ours, theirs, where):
        if ours is None or theirs is None:
            assert ours is None and theirs is None, (where, ours, theirs)
            return
        difference = 0.0 if ours == theirs else abs(ours - theirs) / max(1.0, abs(ours))
        worst[what] = max(worst[what], difference)
        # Quantiles of t agree to eight digits.
        assert difference < (1e-7 if what == "interval" else 1e-9), (where, ours, theirs)

    def ends(what, ours, theirs, where):
        for place, end in enumerate(("low", "high")):
            close(what, ours and ours[place], theirs and theirs[end], (*where, end))

    for score in judgement["scores"]:
        part = score["part"]
        own = stored[stored.scored == part]
        rows = {(r.plant, r.sensor, r.method): r for r in own.itertuples()}
        # The rule of the studies is the one with the same choices as the models.
        chosen_rule = rule_of(score)
        pairs = [
            pair for pair in pairs_of(folder, part, chosen_rule)
            if any(key[:2] == (pair["plant"], pair["sensor"]) for key in rows)
        ]
        # In the order of calib's pairs, which only affects rounding of sums.
        found = methods(pairs)
        seen = set()
        for name, of in found.items():
            if name.count(":") == 2:
                continue
            for pair, (value, regret) in zip(pairs, of):
                key = (pair["plant"], pair["sensor"], name)
                assert (key in rows) == (regret is not None), key
                if regret is None:
                    continue
                seen.add(key)
                theirs = rows[key]
                close("regret", regret, theirs.regret, key)
                if value is not None:
                    assert value == int(theirs.candidate), (key, value, theirs.candidate)
        left = {key for key in rows if key not in seen and key[2] not in ("most_accurate_model", "least_warped_model")}
        assert not left, left
        assert best_default(pairs) == score["best_default"]
        for theirs in [*score["methods"], *score["rules"]]:
            if theirs["method"] in found:
                for name, ours in summary(found[theirs["method"]]).items():
                    close("summary", ours, theirs[name], (part, theirs["method"], name))
                ours = bounds(pairs, found[theirs["method"]])
                close("interval", ours["upper"], theirs["upper"], (part, theirs["method"], "upper"))
                ends("interval", ours["typical_interval"], theirs["typical_interval"], (part, theirs["method"]))
        for theirs, power in zip(score["comparisons"], score["power"]):
            names = theirs["method"], theirs["against"]
            if any(name not in found for name in names):
                continue
            ours = comparison(pairs, *[found[name] for name in names])
            for name in ["pairs", "wins", "ties", "losses", "difference", "error_ratio"]:
                close("quotient", ours[name], theirs[name], (part, *names, name))
            for name in ["plants", "std", "visible"]:
                close("power", ours[name], power[name], (part, *names, name))
            for ours_needed, theirs_needed in zip(ours["needed"], power["needed"]):
                close("power", ours_needed, theirs_needed, (part, *names, "needed"))
            ends("interval", ours["error_ratio_interval"], theirs["error_ratio_interval"], (part, *names))
        print(f"{part}: {len(pairs)} pairs, {len(found)} methods, {len(score['comparisons'])} comparisons agree")
    print("largest differences:", {name: float(f"{value:.2g}") for name, value in worst.items()})


def rule_of(score):
    for model in score["models"]:
        by_name = {of["method"]: of for of in [*score["methods"], *score["rules"]]}
        own = by_name[f"model:{model}"]["mean"]
        alike = [rule for rule in RULES if by_name[f"model:{model}:{rule}"]["mean"] == own]
        if len(alike) == 1:
            return alike[0]
    return "worst_rank"


if __name__ == "__main__":
    if len(sys.argv) > 1:
        check(sys.argv[1])
    else:
        json.dump(plain(golden()), sys.stdout, indent=1)
        print()
