"""The table and the figure of docs/control.md, from what the protocol of control left in a folder.

    cargo run --release -p calib-control --example protocol -- docs/control LOGS TRUTH_RUNS [--model euclidean|laplacian|network]
    python3 scripts/control_protocol.py docs/control [docs/control.svg]

Prints Markdown: for each task, behaviour and length of log, the true mean return of what each model chooses, of what fitted Q
evaluation chooses, and both regrets beside that of a random choice, with 95 % t-intervals over logs; then the models beside each other,
log by log, over those logs that all of them have.
"""

import json
import math
import sys
from pathlib import Path

TASKS = ["acrobot", "puddle_world", "cart_pole"]
QUALITIES = ["near_optimal", "medium", "random"]
LENGTHS = [500, 5000]
# Models in which agents learned. Lines of the first model do not contain its name.
MODELS = ["euclidean", "laplacian", "network"]
COLOURS = {"euclidean": "#06c", "laplacian": "#808", "network": "#096", "fitted": "#c50"}
# Two-sided 95 % quantiles of Student's t by degrees of freedom.
T = [12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179, 2.160, 2.145, 2.131,
     2.120, 2.110, 2.101, 2.093, 2.086, 2.080, 2.074, 2.069, 2.064, 2.060, 2.056, 2.052, 2.048, 2.045, 2.042]
# calib's default among the 54: step size 0.03, no momentum, temperature 10, weights from 0.
DEFAULT = 21


def interval(values):
    """Returns the mean and half the width of its 95 % t-interval."""
    mean = sum(values) / len(values)
    if len(values) < 2:
        return mean, math.nan
    std = math.sqrt(sum((value - mean) ** 2 for value in values) / (len(values) - 1))
    return mean, T[min(len(values) - 2, len(T) - 1)] * std / math.sqrt(len(values))


def told(values):
    mean, half = interval(values)
    return f"{mean:.0f}" if math.isnan(half) else f"{mean:.0f} ± {half:.0f}"


def percentile(truth, chosen):
    own = truth[chosen]
    below = sum(of < own for of in truth) + 0.5 * (sum(of == own for of in truth) - 1)
    return below / (len(truth) - 1)


def read(folder):
    truth = {}
    for task in TASKS:
        runs = json.loads((folder / f"truth-{task}.json").read_text())["returns"]
        truth[task] = [sum(run[c] for run in runs) / len(runs) for c in range(len(runs[0]))]
    logs = {}
    for line in (folder / "logs.jsonl").read_text().splitlines():
        log = json.loads(line)
        log["model_kind"] = log.get("model_kind", MODELS[0])
        log["task"], log["quality"], length, _ = log["name"].split("/")
        log["transitions"] = int(length)
        logs[log["name"], log["rule"], log["model_kind"]] = log
    return truth, list(logs.values())


def of_model(logs, model):
    return [log for log in logs if log["model_kind"] == model]


def together(logs, rule):
    """Returns the choice of each selection method for each log that all models have, by name: the models, and fitted Q evaluation."""
    of = {model: {log["name"]: log for log in of_model(logs, model) if log["rule"] == rule} for model in MODELS}
    of = {model: own for model, own in of.items() if own}
    names = set.intersection(*map(set, of.values())) if of else set()
    order = [log for log in next(iter(of.values()), {}).values() if log["name"] in names]
    return {
        log["name"]: {"log": log, "fitted": log["fitted"]} | {model: own[log["name"]]["chosen"] for model, own in of.items()}
        for log in order
    }


def best_single(truth):
    """Returns the candidate with the best mean percentile over all tasks: the default with full knowledge of the truth."""
    count = len(truth[TASKS[0]])
    return max(range(count), key=lambda c: sum(percentile(truth[task], c) for task in TASKS))


def cells(truth, logs, rule):
    for task in TASKS:
        for quality in QUALITIES:
            for length in LENGTHS:
                own = [log for log in logs if (log["task"], log["quality"], log["transitions"]) == (task, quality, length) and log["rule"] == rule]
                if own:
                    yield task, quality, length, own


def refused(log):
    """Whether calib refuses the choice with its default limits; the line may have been written with older ones."""
    others = [doubt for doubt in log["doubts"] if doubt["reason"] != "uncovered"]
    return bool(others) or log["uncovered"] > 0.5 or log["terminals"] < 10


def table(truth, logs, rule):
    single = best_single(truth)
    print("| task | behaviour | steps | logs | model | fitted Q | behaviour's own | model's percentile | model over random | model over fitted Q |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    for task, quality, length, own in cells(truth, logs, rule):
        of = truth[task]
        random = sum(of) / len(of)
        model = [of[log["chosen"]] for log in own]
        fitted = [of[log["fitted"]] for log in own]
        ranks = [percentile(of, log["chosen"]) for log in own]
        print(
            f"| {task} | {quality} | {length:,} | {len(own)} | {told(model)} | {told(fitted)} "
            f"| {sum(log['behaviour'] for log in own) / len(own):.0f} | {100 * sum(ranks) / len(ranks):.0f} % "
            f"| {told([m - random for m in model])} | {told([m - f for m, f in zip(model, fitted)])} |"
        )
    print()
    print("| task | best | best single default | calib's default | random choice |")
    print("|---|---|---|---|---|")
    for task in TASKS:
        of = truth[task]
        print(f"| {task} | {max(of):.0f} | {of[single]:.0f} | {of[DEFAULT]:.0f} | {sum(of) / len(of):.0f} |")
    print()
    for name, keep in [("all logs", lambda log: True), ("supported", lambda log: not refused(log)), ("refused", refused)]:
        own = [log for log in logs if log["rule"] == rule and keep(log)]
        if own:
            of = {key: [100 * percentile(truth[log["task"]], log[key]) for log in own] for key in ["chosen", "fitted"]}
            over = [a - b for a, b in zip(of["chosen"], of["fitted"])]
            default = [100 * percentile(truth[log["task"]], DEFAULT) for log in own]
            print(
                f"{name}: {len(own)} logs, mean percentile of the model's choice {told(of['chosen'])} (worst {min(of['chosen']):.0f}), "
                f"of fitted Q's {told(of['fitted'])}, model over fitted Q {told(over)}; calib's default {sum(default) / len(default):.0f}"
            )


def regrets(truth, logs, rule):
    """Prints the regret of choices in % of that of a random choice, over groups of logs."""

    def share(log, choice):
        returns = truth[log["task"]]
        return 100 * (max(returns) - returns[choice]) / (max(returns) - sum(returns) / len(returns))

    groups = {"all logs": lambda log: True, "supported": lambda log: not refused(log), "refused": refused}
    groups |= {task: lambda log, task=task: log["task"] == task for task in TASKS}
    groups |= {f"{length:,} steps": lambda log, length=length: log["transitions"] == length for length in LENGTHS}
    for name, keep in groups.items():
        own = [log for log in logs if log["rule"] == rule and keep(log)]
        if own:
            shares = [share(log, log["chosen"]) for log in own]
            others = [share(log, log["fitted"]) for log in own]
            both = [b - a for a, b in zip(shares, others)]
            print(f"{name}: regret in % of a random choice's: model {told(shares)}, fitted Q {told(others)}, fitted Q − model {told(both)}")


def beside(truth, logs, rule):
    """Compares the models pairwise, log by log: percentiles of the grid by true return, and differences of true returns."""
    chosen = together(logs, rule)
    ways = [way for way in [*MODELS, "fitted"] if all(way in of for of in chosen.values())]
    if not chosen or len(ways) < 3:
        return
    single = best_single(truth)
    fixed = {"best single default": single, "calib's default": DEFAULT}

    def of(way, own, value):
        """Returns the value of the choice, log by log; for a random choice, the mean over candidates."""
        for one in own:
            returns = truth[one["log"]["task"]]
            if way == "random":
                yield sum(value(returns, c) for c in range(len(returns))) / len(returns)
            else:
                yield value(returns, fixed.get(way, one.get(way)))

    def regret(returns, choice):
        """Returns the regret in % of that of a random choice, which makes tasks comparable."""
        return 100 * (max(returns) - returns[choice]) / (max(returns) - sum(returns) / len(returns))

    others = [*ways, "random", *fixed]
    groups = [(task, [one for one in chosen.values() if one["log"]["task"] == task]) for task in TASKS]
    groups = [group for group in groups if group[1]] + [("all", list(chosen.values()))]
    print(f"Logs that all models have: {len(chosen)}. Percentile of the grid by true return:\n")
    print("| task | logs | " + " | ".join(others) + " |")
    print("|---" * (len(others) + 2) + "|")
    for task, own in groups:
        told_of = [told([100 * rank for rank in of(way, own, percentile)]) for way in others]
        print(f"| {task} | {len(own)} | " + " | ".join(told_of) + " |")
    print("\nRegret in % of that of a random choice, and by how much less the first has, log by log:\n")
    pairs = [(model, other) for model in ways[:-1] for other in others if other != model and (other not in MODELS or MODELS.index(other) > MODELS.index(model))]
    print("| task | logs | " + " | ".join(others) + " |")
    print("|---" * (len(others) + 2) + "|")
    for task, own in groups:
        print(f"| {task} | {len(own)} | " + " | ".join(told(list(of(way, own, regret))) for way in others) + " |")
    print()
    print("| one | other | " + " | ".join(f"{task} ({len(own)} logs)" for task, own in groups) + " |")
    print("|---" * (len(groups) + 2) + "|")
    for one, other in pairs:
        less = [[b - a for a, b in zip(of(one, own, regret), of(other, own, regret))] for _, own in groups]
        print(f"| {one} | {other} | " + " | ".join(map(told, less)) + " |")
    print()


def cell_table(truth, logs, rule):
    """Prints one column per model: the true mean return of the choice, cell by cell."""
    chosen = together(logs, rule)
    ways = [way for way in [*MODELS, "fitted"] if all(way in of for of in chosen.values())]
    if not chosen or len(ways) < 3:
        return
    print("| task | behaviour | steps | logs | " + " | ".join(ways) + " | " + " | ".join(f"{way} over fitted" for way in ways[:-1]) + " |")
    print("|---" * (4 + len(ways) + len(ways) - 1) + "|")
    for task, quality, length, own in cells(truth, [of["log"] for of in chosen.values()], rule):
        of = truth[task]
        returns = {way: [of[chosen[log["name"]][way]] for log in own] for way in ways}
        over = [told([a - b for a, b in zip(returns[way], returns["fitted"])]) for way in ways[:-1]]
        print(f"| {task} | {quality} | {length:,} | {len(own)} | " + " | ".join([*map(told, returns.values()), *over]) + " |")
    print()


def cell_of(logs, rule, one):
    """Returns the logs of the same task, behaviour and length."""
    keys = ["task", "quality", "transitions"]
    return [log for log in logs if log["rule"] == rule and all(log[key] == one[key] for key in keys)]


def svg(truth, logs, rule):
    width, height, left, top = 330, 260, 56, 34
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{3 * width + 20}" height="{height + 125}" font-family="sans-serif" font-size="11">',
        '<rect width="100%" height="100%" fill="white"/>',
    ]
    single = best_single(truth)
    models = [model for model in MODELS if any(log["rule"] == rule for log in of_model(logs, model))]
    for number, task in enumerate(TASKS):
        of = truth[task]
        low, high = min(of), max(of)
        x0 = number * width + left
        y = lambda value: top + (high - value) / (high - low) * height
        parts.append(f'<text x="{x0 + 125}" y="18" text-anchor="middle" font-size="13">{task.replace("_", " ")}</text>')
        parts.append(f'<rect x="{x0}" y="{top}" width="260" height="{height}" fill="none" stroke="#999"/>')
        for share in range(5):
            value = low + (high - low) * share / 4
            parts.append(f'<text x="{x0 - 5}" y="{y(value) + 4:.1f}" text-anchor="end">{value:.0f}</text>')
        for value, colour, dash in [(high, "#222", ""), (of[single], "#2a7", "6 3"), (sum(of) / len(of), "#999", "2 3")]:
            parts.append(f'<line x1="{x0}" x2="{x0 + 260}" y1="{y(value):.1f}" y2="{y(value):.1f}" stroke="{colour}" stroke-dasharray="{dash}"/>')
        names = {log["name"]: log for log in of_model(logs, MODELS[0]) if log["rule"] == rule}
        for place, (own_task, quality, length, own) in enumerate([cell for cell in cells(truth, list(names.values()), rule) if cell[0] == task]):
            x = x0 + 25 + 42 * place
            boxes = [(model, [log["chosen"] for log in cell_of(of_model(logs, model), rule, own[0])]) for model in models]
            boxes.append(("fitted", [log["fitted"] for log in own]))
            for number_of, (way, choices) in enumerate(boxes):
                if not choices:
                    continue
                shift = (number_of - (len(boxes) - 1) / 2) * 9
                mean, half = interval([of[choice] for choice in choices])
                half = 0 if math.isnan(half) else half
                up, down = y(min(high, mean + half)), y(max(low, mean - half))
                colour = COLOURS[way]
                parts.append(f'<line x1="{x + shift}" x2="{x + shift}" y1="{up:.1f}" y2="{down:.1f}" stroke="{colour}" stroke-width="2"/>')
                parts.append(f'<circle cx="{x + shift}" cy="{y(mean):.1f}" r="3.5" fill="{colour}"/>')
            parts.append(f'<text x="{x}" y="{top + height + 16}" text-anchor="middle">{length}</text>')
            if length == LENGTHS[0]:
                parts.append(f'<text x="{x + 21}" y="{top + height + 32}" text-anchor="middle">{quality.replace("_", "-")}</text>')
    y = top + height + 58
    told_as = {"euclidean": "chosen in the model", "laplacian": "Laplacian model", "network": "network model"}
    legend = [(COLOURS[model], told_as[model]) for model in models]
    legend += [(COLOURS["fitted"], "fitted Q evaluation"), ("#222", "best"), ("#2a7", "best single default"), ("#999", "random choice")]
    x = 60
    for colour, text in legend:
        parts.append(f'<rect x="{x}" y="{y - 9}" width="12" height="10" fill="{colour}"/><text x="{x + 17}" y="{y}">{text}</text>')
        x += 35 + 6 * len(text)
    parts.append(f'<text x="60" y="{y + 22}">True mean return an episode of what was chosen, with 95 % t-intervals over logs; by behaviour and length of the log in steps.</text>')
    parts.append("</svg>")
    return "\n".join(parts) + "\n"


def main():
    folder = Path(sys.argv[1])
    truth, logs = read(folder)
    for rule in ["nearest", "minimum_return"]:
        if any(log["rule"] == rule for log in logs):
            print(f"### {rule}\n")
            table(truth, of_model(logs, MODELS[0]), rule)
            regrets(truth, of_model(logs, MODELS[0]), rule)
            print()
            cell_table(truth, logs, rule)
            beside(truth, logs, rule)
    if len(sys.argv) > 2:
        Path(sys.argv[2]).write_text(svg(truth, logs, "nearest"))


if __name__ == "__main__":
    main()
