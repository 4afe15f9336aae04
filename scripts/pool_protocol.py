"""How well rules over unlike kinds of models choose: the tables of docs/control.md, "Pooling unlike models".

    cargo run --release -p calib-control --example protocol -- DIR 3..9 30 nearest --model pool
    python3 scripts/pool_protocol.py DIR [--logs FIRST END]

`docs/control` has the logs that were made: numbers 3 to 8, and of Puddle World and Cart-pole also 9 and 10. Reads `DIR/truth-TASK.json` and `DIR/pool.jsonl`. Chooses by each rule from the stored returns, in a program of its own, and prints
Markdown: regret in % of a random choice's with 95 % intervals by a bootstrap over logs within cells, tasks weighted equally. Then, for
each reason to refuse, the regret of the pool's choices that have it and of those that have not.

**Intervals without the noise of agents.** Fixed on 27 November 2026, before logs 9 and 10 were made. The jackknife over the B blocks
of the log counts what differs between training runs (B - 1)^2 times, and finds no difference where there is one. Members of K kinds
that lack the same block differ by more than that block: with s^2, the mean square of kind times block, the noise of a block's mean
over kinds is s^2 / K, and the variance of the difference is J - (B - 2) s^2 / K, where J is the jackknife's. The new rule takes the larger of
this and of J / 2, because a difference of estimated variances may come out near 0. With drawn numbers, five blocks and three kinds, the
true difference is then in at least 92.5 % of intervals whatever the noise (J / 4: 89 %; the jackknife: 95 to 100 %), if a block changes
all kinds alike. Other shares were
tried on logs 3 to 8, on the drawn tasks and on the public environments. On logs 9 and 10, every setting is compared with the choice and with every third other setting. The rule
is accepted if it tells more pairs apart, and if at most 2.5 % of those that it tells apart among all pairs are the other way round in
truth:

    cargo run --release -p calib-control --example protocol -- DIR 9..11 30 nearest --model pool
    python3 scripts/pool_protocol.py DIR --logs 9 11
"""

import argparse
import json
import math
import random
from collections import defaultdict
from pathlib import Path

TASKS = ["acrobot", "puddle_world", "cart_pole"]
KINDS = ["neighbors", "increments", "network"]
DRAWS = 10_000
# calib's default among the 54: step size 0.03, no momentum, temperature 10, weights from 0.
DEFAULT = 21


def ranks(returns):
    """Returns competition ranks, 1 for the highest return."""
    return [1 + sum(other > own for other in returns) for own in returns]


def leads(returns):
    """Returns each return as standard deviations of the member above its mean; minus infinity if it diverged."""
    finite = [value for value in returns if value > -math.inf]
    mean = sum(finite) / max(len(finite), 1)
    std = math.sqrt(sum((value - mean) ** 2 for value in finite) / max(len(finite), 1))
    return [-math.inf if value == -math.inf else (value - mean) / std if std else 0.0 for value in returns]


def columns(rows):
    return list(zip(*rows))


def by_worst_rank(members):
    own = columns([ranks(member) for member in members])
    means = [sum(column) for column in columns(members)]
    return min(range(len(own)), key=lambda c: (max(own[c]), sum(own[c]), -means[c]))


def by_mean_rank(members):
    own = columns([ranks(member) for member in members])
    lead = [sum(column) for column in columns([leads(member) for member in members])]
    return min(range(len(own)), key=lambda c: (sum(own[c]), -lead[c]))


def by_lead(members):
    lead = [sum(column) for column in columns([leads(member) for member in members])]
    return max(range(len(lead)), key=lambda c: lead[c])


RULES = {
    "pool, mean rank": (KINDS, by_mean_rank),
    "pool, standard deviations": (KINDS, by_lead),
    "pool, worst rank": (KINDS, by_worst_rank),
    **{f"{kind}, mean rank": ([kind], by_mean_rank) for kind in KINDS},
    **{f"{kind}, worst rank": ([kind], by_worst_rank) for kind in KINDS},
    "increments and network, mean rank": (KINDS[1:], by_mean_rank),
    "neighbors and network, mean rank": ([KINDS[0], KINDS[2]], by_mean_rank),
    "neighbors and increments, mean rank": (KINDS[:2], by_mean_rank),
}
TODAY = "neighbors, worst rank"


def read(folder, numbers):
    truth = {}
    for task in TASKS:
        runs = json.loads((folder / f"truth-{task}.json").read_text())["returns"]
        truth[task] = [sum(run[c] for run in runs) / len(runs) for c in range(len(runs[0]))]
    logs = []
    for line in (folder / "pool.jsonl").read_text().splitlines():
        log = json.loads(line)
        log["task"], log["quality"], log["length"], number = log["name"].split("/")
        for kind in KINDS:
            log[kind]["returns"] = [[-math.inf if value is None else value for value in member] for member in log[kind]["returns"]]
        if int(number) in numbers:
            logs.append(log)
    return truth, logs


def regret(returns, candidate):
    """Returns the regret in % of that of a random choice."""
    return 100 * (max(returns) - returns[candidate]) / (max(returns) - sum(returns) / len(returns))


def mean(values):
    return sum(values) / len(values)


def bootstrap(cells, draws):
    """Returns the mean over tasks of means over logs, and its 95 % interval over logs resampled within cells."""
    generator = random.Random(1)

    def equal(of_cells):
        tasks = defaultdict(list)
        for (task, *_), values in of_cells.items():
            tasks[task].extend(values)
        return mean([mean(values) for values in tasks.values()])

    drawn = sorted(equal({cell: generator.choices(values, k=len(values)) for cell, values in cells.items()}) for _ in range(draws))
    return equal(cells), drawn[int(0.025 * draws)], drawn[int(0.975 * draws)]


def by_cell(logs, values):
    cells = defaultdict(list)
    for log, value in zip(logs, values):
        cells[log["task"], log["quality"], log["length"]].append(value)
    return cells


def of_others(truth, task):
    """Returns the candidate with the best mean percentile over the other tasks."""
    others = [ranks(truth[other]) for other in TASKS if other != task]
    return min(range(len(truth[task])), key=lambda c: sum(own[c] for own in others))


def is_more(kinds, one, other, without_noise):
    """Whether a setting has more than another, `kinds` by `[blocks][settings]`, by an interval over the five blocks of the log."""
    differences = [[block[one] - block[other] for block in kind] for kind in kinds]
    blocks = [mean(block) for block in columns(differences)]
    whole = mean(blocks)
    if not math.isfinite(whole):
        return False
    variance = 4 / 5 * sum((block - whole) ** 2 for block in blocks)
    if without_noise:
        rest = [value - mean(kind) - block + whole for kind in differences for value, block in zip(kind, blocks)]
        noise = sum(value**2 for value in rest) / ((len(kinds) - 1) * 4)
        variance = max(variance - 3 * noise / len(kinds), variance / 2)
    return whole > 2.776 * math.sqrt(variance)


def estimates(log):
    """Returns ranks, of which more is better, and returns, by kind of model."""
    returns = [log[kind]["returns"] for kind in KINDS]
    return [[[-rank for rank in ranks(member)] for member in kind] for kind in returns], returns


def is_ahead(log, chosen, without_noise=False):
    """Whether ranks or returns of the choice are better than the default's."""
    return chosen == DEFAULT or any(is_more(kinds, chosen, DEFAULT, without_noise) for kinds in estimates(log))


def told_apart(truth, logs, chosen):
    """Compares both intervals: how many pairs of settings they tell apart, and how many of these are the other way round in truth."""
    print("\n| pairs | interval | told apart | the other way round | by more than a tenth of a random choice's regret |")
    print("|---|---|---|---|---|")
    for label, pairs_of in (
        ("the choice and another", lambda own, places: [(own, other) for other in places]),
        ("every third and every third", lambda own, places: [(one, other) for one in places[::3] for other in places[::3]]),
    ):
        for name, without_noise in (("jackknife", False), ("without the noise of agents", True)):
            pairs, gains = 0, []
            for log, own in zip(logs, chosen):
                true = truth[log["task"]]
                returns = estimates(log)[1]
                for one, other in pairs_of(own, range(len(true))):
                    if one != other:
                        pairs += 1
                        if is_more(returns, one, other, without_noise):
                            gains.append((true[one] - true[other]) / (max(true) - mean(true)))
            wrong, far = sum(gain < 0 for gain in gains), sum(gain < -0.1 for gain in gains)
            print(
                f"| {label} | {name} | {len(gains)} of {pairs} ({100 * len(gains) / pairs:.0f} %) "
                f"| {wrong} ({100 * wrong / len(gains):.1f} %) | {far} ({100 * far / len(gains):.1f} %) |"
            )


def terminals_per_step(log, chosen):
    """Returns the share of the steps of a setting that end an episode in a terminal, in the median kind of model."""
    return sorted(log[kind]["terminals"][chosen] for kind in KINDS)[1]


def early_ends(logs, chosen, regrets):
    """Says how good choices are whose episodes end in a terminal at least twice as often as the recorded ones."""
    pairs = zip(logs, chosen, regrets)
    early = [regret for log, own, regret in pairs if 0 < 2 * log["terminals"] / sum(log["actions"]) <= terminals_per_step(log, own)]
    told = f"{sum(regret <= 1 for regret in early)} have at most 1 %, and the worst has {max(early):.0f}" if early else "none"
    print(f"\nterminals at least twice as often as recorded: {len(early)} of {len(logs)} choices; {told}")


def reasons(log, chosen):
    """Returns why calib refuses a choice, as in `calib control`, but without the errors of displacements."""
    neighbors, steps = log["neighbors"], sum(log["actions"])
    promised = mean([member[chosen] for kind in KINDS for member in log[kind]["returns"]])
    rate = terminals_per_step(log, chosen)
    lowest, best = log["recorded"]
    all_reasons = {
        "an action was never taken": min(log["actions"]) == 0,
        "more than half of the steps not covered": neighbors["uncovered"][chosen] > 0.5,
        "fewer than ten terminals": log["terminals"] < 10,
        "terminals rarer by an order": rate < log["terminals"] / steps / 10,
        "less than was recorded": promised < lowest,
        "more than any recorded episode": promised > best,
        "moved beyond two ranges": neighbors["moved"][chosen] > 2,
        "not ahead of the default": not is_ahead(log, chosen, without_noise=True),
    }
    return {name for name, holds in all_reasons.items() if holds}


def refusals(logs, chosen, regrets):
    of_logs = [reasons(log, c) for log, c in zip(logs, chosen)]
    print("\n| reason to refuse | logs with it | their regret, mean and worst | logs without it | their regret, mean and worst |")
    print("|---|---|---|---|---|")

    def told(values):
        return f"{mean(values):.1f}, {max(values):.0f}" if values else ""

    for name in [*sorted(set().union(*of_logs)), "any of these"]:
        has = [bool(own) if name == "any of these" else name in own for own in of_logs]
        refused = [regret for regret, it in zip(regrets, has) if it]
        kept = [regret for regret, it in zip(regrets, has) if not it]
        print(f"| {name} | {len(refused)} | {told(refused)} | {len(kept)} | {told(kept)} |")


def ahead(logs, chosen, regrets, of_default):
    """Compares the choice with the default, where it is ahead of it in the models and where it is not."""
    print("\n| the choice is | logs | its regret (95 %), worst | regret of the default |")
    print("|---|---|---|---|")
    by_both = {way: [is_ahead(log, c, way) for log, c in zip(logs, chosen)] for way in (False, True)}
    for name, without_noise, wanted in (
        ("ahead of the default", False, True),
        ("not ahead of it", False, False),
        ("ahead, without the noise of agents", True, True),
        ("not ahead, without the noise of agents", True, False),
    ):
        is_it = by_both[without_noise]
        places = [place for place, it in enumerate(is_it) if it == wanted]
        own, default = [regrets[place] for place in places], [of_default[place] for place in places]
        whole, low, high = bootstrap(by_cell([logs[place] for place in places], own), DRAWS)
        print(f"| {name} | {len(places)} | {whole:.1f} ({low:.1f} to {high:.1f}), {max(own):.0f} | {mean(default):.1f} |")


def kinds_agreement(log):
    """Returns Spearman's correlation between the mean ranks of the candidates by kind of model, as a mean over pairs of kinds."""
    orders = []
    for kind in KINDS:
        means = [mean(column) for column in columns([ranks(member) for member in log[kind]["returns"]])]
        # Average ranks give equal candidates the same rank.
        orders.append([sum(other < own for other in means) + (sum(other == own for other in means) - 1) / 2 for own in means])
    correlations = []
    for place, one in enumerate(orders):
        for other in orders[place + 1 :]:
            left, right = [value - mean(one) for value in one], [value - mean(other) for value in other]
            size = math.sqrt(sum(value**2 for value in left) * sum(value**2 for value in right))
            correlations.append(sum(a * b for a, b in zip(left, right)) / size if size else 0.0)
    return mean(correlations)


def agreements(logs, regrets):
    """Returns the regret of the choice where kinds of models agree on the order of the candidates, and where they do not."""
    print("\n| Spearman between kinds | logs | regret (95 %), worst |")
    print("|---|---|---|")
    found = [kinds_agreement(log) for log in logs]
    for low, high in ((-1, 0.5), (0.5, 0.8), (0.8, 1.01)):
        places = [place for place, value in enumerate(found) if low <= value < high]
        own = [regrets[place] for place in places]
        whole, least, most = bootstrap(by_cell([logs[place] for place in places], own), DRAWS)
        label = f"below {high}" if low == -1 else f"{low} to {high}" if high <= 1 else f"{low} or more"
        print(f"| {label} | {len(places)} | {whole:.1f} ({least:.1f} to {most:.1f}), {max(own):.0f} |")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--logs", type=int, nargs=2, default=[3, 9], metavar=("FIRST", "END"))
    arguments = parser.parse_args()
    truth, logs = read(arguments.folder, range(*arguments.logs))
    chosen = {
        name: [rule([member for kind in kinds for member in log[kind]["returns"]]) for log in logs] for name, (kinds, rule) in RULES.items()
    }
    chosen["calib's default"] = [DEFAULT] * len(logs)
    chosen["default of the other two tasks"] = [of_others(truth, log["task"]) for log in logs]
    regrets = {name: [regret(truth[log["task"]], c) for log, c in zip(logs, choice)] for name, choice in chosen.items()}
    counts = {task: sum(log["task"] == task for log in logs) for task in TASKS}
    print(f"{len(logs)} logs: {', '.join(f'{count} of {task}' for task, count in counts.items())}\n")
    print("| models, rule | Acrobot | Puddle World | Cart-pole | tasks equal (95 %) | less than neighbours by worst rank (95 %) | worst log |")
    print("|---|---|---|---|---|---|---|")
    for name, values in regrets.items():
        of_tasks = [mean([v for v, log in zip(values, logs) if log["task"] == task]) for task in TASKS if counts[task]]
        whole, low, high = bootstrap(by_cell(logs, values), DRAWS)
        less = [today - value for today, value in zip(regrets[TODAY], values)]
        gain, least, most = bootstrap(by_cell(logs, less), DRAWS)
        beside = "" if name == TODAY else f"{gain:.1f} ({least:.1f} to {most:.1f})"
        print(f"| {name} | {' | '.join(f'{of:.1f}' for of in of_tasks)} | {whole:.1f} ({low:.1f} to {high:.1f}) | {beside} | {max(values):.0f} |")
    pool = regrets["pool, mean rank"]
    for length in ["500", "5000"]:
        own = [value for value, log in zip(pool, logs) if log["length"] == length]
        print(f"\nof {length} steps: {mean(own):.1f} over {len(own)} logs")
    refusals(logs, chosen["pool, mean rank"], pool)
    early_ends(logs, chosen["pool, mean rank"], pool)
    agreements(logs, pool)
    ahead(logs, chosen["pool, mean rank"], pool, regrets["calib's default"])
    told_apart(truth, logs, chosen["pool, mean rank"])


if __name__ == "__main__":
    main()
