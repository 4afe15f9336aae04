"""How well calib chooses where no default can be known: the table of docs/control.md, "Tasks that are drawn".

    cargo run --release -p calib-control --example protocol -- DIR 0..10 --model drawn
    python3 scripts/drawn_protocol.py DIR

Reads `DIR/drawn.jsonl`. Prints Markdown: regret in % of a random choice's, with 95 % intervals by a bootstrap over tasks (the two logs of
a task stay together), kinds of tasks weighted equally.
"""

import json
import math
import random
import sys
from collections import defaultdict
from pathlib import Path

from pool_protocol import DEFAULT, KINDS, by_mean_rank, mean, ranks, regret

DRAWS = 10_000
# Tasks that were used to choose the default in units of the spread
# of returns. The other tasks test it.
PILOT = range(3)


def read(path):
    logs = []
    for line in path.read_text().splitlines():
        log = json.loads(line)
        kind, number, length = log["name"].split("/")
        log |= {"kind": kind, "number": int(number), "length": int(length)}
        log["members"] = [
            [-math.inf if value is None else value for value in member] for model in KINDS for member in log[model]["returns"]
        ]
        logs.append(log)
    return logs


def bootstrap(logs, values):
    """Returns the mean over kinds of tasks, and its 95 % interval over resampled tasks."""
    tasks = defaultdict(lambda: defaultdict(list))
    for log, value in zip(logs, values):
        tasks[log["kind"]][log["number"]].append(value)
    kinds = [[mean(own) for own in numbers.values()] for numbers in tasks.values()]
    generator = random.Random(1)
    drawn = sorted(mean([mean(generator.choices(kind, k=len(kind))) for kind in kinds]) for _ in range(DRAWS))
    return mean([mean(kind) for kind in kinds]), drawn[int(0.025 * DRAWS)], drawn[int(0.975 * DRAWS)]


def scaled_regret(log, setting):
    """Returns the scaled regret of a setting that need not be in the grid, against the best of the grid. Below 0 it is better."""
    truth = log["truth"]
    return 100 * (max(truth) - log["truth_of_scaled"][setting]) / (max(truth) - mean(truth))


def may_be_no_better_than_random(log, setting):
    """Whether calib refuses the choice as no better than random, by the jackknife over the five blocks of the log."""
    blocks = [mean([log[kind]["returns"][block][setting] - log["random_actions"][kind][block] for kind in KINDS]) for block in range(5)]
    error = math.sqrt(4 / 5 * sum((block - mean(blocks)) ** 2 for block in blocks))
    return not mean(blocks) > 2.776 * error


def best_of_others(logs, log):
    """Returns the setting of the grid with the best mean percentile over all other tasks."""
    others = {(other["kind"], other["number"]): ranks(other["truth"]) for other in logs if other["name"].rsplit("/", 1)[0] != log["name"].rsplit("/", 1)[0]}
    return min(range(len(log["truth"])), key=lambda setting: sum(own[setting] for own in others.values()))


def main():
    logs = read(Path(sys.argv[1]) / "drawn.jsonl")
    pilot = [log for log in logs if log["number"] in PILOT]
    settings = logs[0]["scaled"]
    of_pilot = [bootstrap(pilot, [scaled_regret(log, setting) for log in pilot])[0] for setting in range(len(settings))]
    chosen = min(range(len(settings)), key=lambda setting: of_pilot[setting])
    print("| step size, temperature, first value, in spreads | regret in the pilot |\n|---|---|")
    for setting, value in zip(settings, of_pilot):
        print(f"| {', '.join(f'{part:g}' for part in setting)} | {value:.1f} |")
    tested = [log for log in logs if log["number"] not in PILOT]
    ways = {
        "calib: pool, mean rank": [regret(log["truth"], by_mean_rank(log["members"])) for log in tested],
        "the default before, in units of its own": [regret(log["truth"], DEFAULT) for log in tested],
        "the best setting of the other tasks": [regret(log["truth"], best_of_others(logs, log)) for log in tested],
        f"{', '.join(f'{part:g}' for part in settings[chosen])} in spreads of returns": [scaled_regret(log, chosen) for log in tested],
    }
    choice = next(iter(ways.values()))
    kinds = sorted({log["kind"] for log in tested})
    print(f"\n{len(tested)} logs of {len({(log['kind'], log['number']) for log in tested})} tasks:\n")
    print(f"| way to choose | {' | '.join(kinds)} | all (95 %) | more than calib's choice (95 %) | worst log |")
    print(f"|---|{'---|' * len(kinds)}---|---|---|")
    for name, values in ways.items():
        own = [mean([value for log, value in zip(tested, values) if log["kind"] == kind]) for kind in kinds]
        whole, low, high = bootstrap(tested, values)
        more, least, most = bootstrap(tested, [value - other for value, other in zip(values, choice)])
        beside = "" if values is choice else f"{more:.1f} ({least:.1f} to {most:.1f})"
        print(f"| {name} | {' | '.join(f'{value:.1f}' for value in own)} | {whole:.1f} ({low:.1f} to {high:.1f}) | {beside} | {max(values):.0f} |")
    default, scaled = list(ways.values())[1], list(ways.values())[3]
    less, least, most = bootstrap(tested, [before - now for before, now in zip(default, scaled)])
    print(f"\nThe default in spreads has {less:.1f} ({least:.1f} to {most:.1f}) less than the default before.")
    doubted = [may_be_no_better_than_random(log, by_mean_rank(log["members"])) for log in tested]
    for name, wanted in (("may be no better than random actions", True), ("is better than random actions", False)):
        own = [value for value, it in zip(choice, doubted) if it == wanted]
        print(f"\nThe choice {name} in {len(own)} logs: regret {mean(own):.1f}, at most {max(own):.0f}" if own else f"\nThe choice {name} in no log.")
    for length in sorted({log["length"] for log in tested}):
        own = [value for log, value in zip(tested, choice) if log["length"] == length]
        print(f"\nof {length:,} steps: {mean(own):.1f} over {len(own)} logs")


if __name__ == "__main__":
    main()
