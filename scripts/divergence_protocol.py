#!/usr/bin/env python3
"""Do many cheap rollouts keep calib from learning rates that fail now and then?

    pip install numpy polars
    python3 scripts/divergence_protocol.py DIR [--plants FIRST END]     # it can be stopped and run again
    python3 scripts/divergence_protocol.py DIR --report                 # only the tables

A rate that fails in one stream of fifty passes fifteen windows of the log in three cases of four (0.98^15 = 0.74). It passes 150
rollouts in one case of twenty. The protocol, as it was fixed before its runs:

- *Plants.* 48 simulated plants, numbers 0 to 47, and more in the second pass: seed 900 + number, 64 channels, a row every minute, 75 days, of which the first 27
  are the log. `random.Random(900 + number)` draws drift, noise, storms and the first day from the ranges of
  configs/validity/protocol.toml. The historian has no outages, so that every window is whole.
- *Agents.* SGD from scratch, eleven rates from 1e-5 to 1, for PIT300, TIT101 and TUIT101. Drawn for each plant: a linear agent or
  two layers of 16, 32 or 48 units; gamma of 0.8, 0.9, 0.95 or 0.99; batches of 4 to 64; runs of 300 to 800 steps, scored as a whole.
- *Evidence.* 15 windows of the log, and 30 rollouts in each of five members of the Euclidean neighbours. A rule of choice that looks
  at rollouts sees the first three of each member, as in docs/validity.md. A screen sees all 150.
- *Truth.* 40 held-out windows that do not overlap, one run each.
- *A run fails* if it diverged, or if its error is more than twice that of the default rate, 1e-3, in the same window, or in the same
  rollout of the same member. Where the default itself diverged, only runs that diverged fail.
- *A rate's cost* is the mean over the 40 windows of the logarithm of its error by the least error of any rate in that window. It is
  at most log 10, which is also what a run that fails counts. The regret of a choice is its cost minus the smallest cost of a rate.
- *A disaster* is a choice that fails in more than 5 % of the 40 windows, that is, in three or more.
- *Rules*:
  - `log`: calib's `log_replay`, the smallest mean logarithm of the error over the windows of the log. calib never chooses a rate that
    diverged there, unless all did. Then it takes one that diverged least often.
  - `pooled`: calib's default, the same over the 15 windows and 15 rollouts. Every run counts the same.
  - `log, soft`: the smallest mean over the windows of the log of the logarithm by the least error in that window, at most log 10,
    which is also what a run that diverged counts.
- *Screens*, each before each rule, which then chooses among the rates that are left:
  - `15 windows`: no run fails in the 15 windows of the log. (Their upper bound is 18 % even then.)
  - `150 rollouts`: the one-sided 95 % upper bound of the share of runs that fail (Clopper and Pearson) is at most 5 %. That allows
    two of 150. Rollouts of one member resemble each other, so the bound is a threshold rather than a confidence.
  - `both`.
  If no rate is left, those count that have the fewest failing runs in what the screen looks at.
- *Beside them* stand the `default`; `hindsight`, the rate with the least cost over all plants, for that sensor; the `best rate` of
  the plant and sensor; and `random`, the mean over all rates.
- *The unit of every interval is the plant*: mean over sensors of the logarithm, Student's t over plants. Disasters are compared by
  McNemar's exact test on pairs of plant and sensor. Sensors of a plant are not independent, so a sign test on plants stands beside it.
- *What is decided.* The screen by 150 rollouts becomes a part of `log_replay`, and of `pooled`, each by its own comparison with the
  rule without a screen, if disasters are at most half as many, McNemar's test has p < 0.05, and the upper end of the quotient of
  errors is at most 1.01. If the screen by 15 windows fulfils the same and has no more disasters, it is taken instead, because it
  needs no model.

The second pass was fixed when 38 plants of the first were made. There `log` made three disasters, and none with the screen by 150
rollouts: too few for McNemar's test. It also asks for a rival that needs no model, more windows of the same log:

- *Plants* 48 to 111, drawn and run in the same way, with the seven rates from 1e-3 to 1 (smaller ones never failed).
- *Evidence.* 150 windows of the log, which overlap. `log` looks at every tenth of them, `log, 150 windows` at all.
- *Screens*: those of the first pass, and `150 windows`, which has the bound of `150 rollouts`.
- *What is decided*, by plants 48 to 111 alone. `log, 150 windows` replaces `log` where time allows if it fulfils the three conditions
  against `log`. A screen becomes a part of calib if it fulfils them against `log`, and if its quotient of errors by
  `log, 150 windows` without a screen has an upper end below 1, or disasters are at most half of that rule's with McNemar's p < 0.05.
"""

import json
import math
import random
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import protocols
from protocols import CAP, even_in_logarithm, head, interval, quotient, row, smallest, typical_regret

SENSORS = ["PIT300", "TIT101", "TUIT101"]
RATES = [1e-5, 3.16e-5, 1e-4, 3.16e-4, 1e-3, 3.16e-3, 1e-2, 3.16e-2, 0.1, 0.316, 1]
DEFAULT_RATE = 1e-3
# First plant of the second pass, and its rates.
SECOND = 48
SECOND_RATES = [rate for rate in RATES if rate >= DEFAULT_RATE]
WINDOWS = 40
# Largest accepted share of failing runs, and the error probability of its upper bound.
SHARE = 0.05
LEVEL = 0.05
# A run fails if its error is more than this many times the default's.
FACTOR = 2

STUDY = """seed = {seed}
output = "results"

[simulate]
start = {start}
days = 75
channels = 64
period_secs = 60
seed = {seed}
drift = {drift}
noise = {noise}
storms_per_day = {storms_per_day}
gaps_per_day = 0

[data]
path = "plant"
train_fraction = 0.36

[preprocess]
fill_limit = 30

[agent]
optimiser = "sgd"
{values}
gamma = {gamma}
batch_size = {batch_size}
learning_rate = 1e-3

[sweep]
sensors = {sensors}
steps = {steps}
online_windows = {windows}
online_runs = {windows}
member_runs = 30
log_replay_runs = {log_windows}
curve_points = 0

[sweep.grid]
learning_rate = {rates}
"""


def draw(seed: int) -> dict:
    """Returns the keys of a plant and of its task."""
    generator = random.Random(seed)

    def between(low: float, high: float) -> float:
        return even_in_logarithm(generator, low, high)

    return {
        "drift": float(f"{between(0.3, 3):.3g}"),
        "noise": float(f"{between(0.3, 3):.3g}"),
        "storms_per_day": float(f"{between(1, 20):.3g}"),
        "start": f"2022-{generator.randint(1, 12):02}-01",
        "values": generator.choice(['value_function = "linear"'] + [f"hidden_units = {units}" for units in (16, 32, 48)]),
        "gamma": generator.choice([0.8, 0.9, 0.95, 0.99]),
        "batch_size": round(between(4, 64)),
        "steps": round(between(300, 800)),
    }


def make(number: int, folder: Path, calib: str) -> dict:
    import polars

    seed = 900 + number
    drawn = draw(seed)
    study = folder / "study.toml"
    rates, log_windows = (RATES, 15) if number < SECOND else (SECOND_RATES, 150)
    text = STUDY.format(
        seed=seed, sensors=json.dumps(SENSORS), windows=WINDOWS, log_windows=log_windows, rates=json.dumps(rates), **drawn
    )
    study.write_text(text)
    protocols.run(calib, study, "simulate", "build-model", "sweep")
    results = folder / "results"
    table = polars.read_parquet(results / "sweep" / "runs.parquet")
    (results / "sweep" / "runs.parquet").replace(folder / "runs.parquet")
    shutil.rmtree(folder / "plant")
    shutil.rmtree(results)
    in_member = polars.col("environment").str.starts_with("member:")
    online = polars.col("environment") == "online"
    replay = polars.col("environment") == "log-replay"
    sources = {
        "log": replay & (polars.col("run") % (log_windows // 15) == 0),
        "few rollouts": in_member & (polars.col("run") < 3),
        "rollouts": in_member,
        "truth": online,
    }
    if number >= SECOND:
        sources["windows"] = replay
    return {
        "drawn": drawn,
        "windows": table.filter(online)["start_row"].n_unique(),
        "sensors": [
            {name: summary(table.filter(which & (polars.col("sensor") == sensor)), rates) for name, which in sources.items()}
            for sensor in SENSORS
        ],
    }


def summary(table, rates: list[float]) -> dict:
    """Summarises each candidate over the runs of one sensor: number of runs, diverged and failed runs, and means of logarithms.

    `mean` is the mean logarithm of the error over the runs that did not diverge. `excess` is that of the error divided by the least error
    of the same run, at most `CAP`; a diverged run counts `CAP`. In `cost` a failed run counts `CAP` as well.
    """
    ordered = table.sort("environment", "run", "candidate")
    logs = [
        math.inf if diverged or not math.isfinite(error) else math.log(error)
        for error, diverged in ordered.select("nrmse", "diverged").iter_rows()
    ]
    count, default = len(rates), rates.index(DEFAULT_RATE)
    if ordered["candidate"].to_list() != list(range(count)) * (len(logs) // count):
        raise ValueError("runs.parquet does not have one row for each candidate of every run")
    streams = [logs[first : first + count] for first in range(0, len(logs), count)]
    kept = {"runs": len(streams), "diverged": [], "failed": [], "mean": [], "excess": [], "cost": []}
    for candidate in range(count):
        own = [stream[candidate] for stream in streams]
        finite = [value for value in own if value < math.inf]
        failed = [fails(stream, candidate, default) for stream in streams]
        # If all candidates diverged, infinity minus infinity is not a number.
        excess = [CAP if value == math.inf else min(value - min(stream), CAP) for value, stream in zip(own, streams)]
        cost = [CAP if failing else value for value, failing in zip(excess, failed)]
        kept["diverged"].append(len(own) - len(finite))
        kept["failed"].append(sum(failed))
        kept["mean"].append(rounded_mean(finite) if finite else math.inf)
        kept["excess"].append(rounded_mean(excess))
        kept["cost"].append(rounded_mean(cost))
    return kept


def fails(stream: list[float], candidate: int, default: int) -> bool:
    """Whether a candidate diverged, or has more than `FACTOR` times the default's error. Errors are logarithms."""
    return stream[candidate] == math.inf or stream[candidate] > stream[default] + math.log(FACTOR)


def rounded_mean(values: list[float]) -> float:
    return round(sum(values) / len(values), 5)


# A rule returns a key per candidate, and chooses the smallest key. It uses the summaries of one plant and sensor, as screens do.


def least_error(*sources: dict) -> Callable[[int], tuple]:
    """Prefers candidates that never diverged, then a small mean logarithm of the error. Every run counts the same."""

    def key(candidate: int) -> tuple:
        diverged = sum(source["diverged"][candidate] for source in sources)
        counts = [source["runs"] - source["diverged"][candidate] for source in sources]
        means = [source["mean"][candidate] for source in sources]
        total = sum(mean * count for mean, count in zip(means, counts) if count)
        return diverged, total / sum(counts) if sum(counts) else math.inf

    return key


ALL_WINDOWS = "log, 150 windows"
RULES = {
    "log": lambda pair: least_error(pair["log"]),
    ALL_WINDOWS: lambda pair: least_error(pair["windows"]),
    "pooled": lambda pair: least_error(pair["log"], pair["few rollouts"]),
    "log, soft": lambda pair: lambda candidate: (pair["log"]["excess"][candidate],),
}
# Summaries that each screen uses.
SCREENS = {"15 windows": ["log"], "150 rollouts": ["rollouts"], "both": ["log", "rollouts"], "150 windows": ["windows"]}


def at_most(count: int, trials: int, share: float) -> float:
    """Returns the probability of at most `count` successes."""
    return sum(math.comb(trials, k) * share**k * (1 - share) ** (trials - k) for k in range(count + 1))


def passes(pair: dict, screen: str, candidate: int) -> bool:
    for name in SCREENS[screen]:
        failed, runs = pair[name]["failed"][candidate], pair[name]["runs"]
        # Clopper and Pearson's upper bound is at most SHARE if a rate of SHARE would make so few failures this unlikely.
        accepted = failed == 0 if name == "log" else at_most(failed, runs, SHARE) <= LEVEL
        if not accepted:
            return False
    return True


def choose(pair: dict, rule: str, screen: str | None) -> int:
    left = list(range(len(pair["truth"]["cost"])))
    if screen:
        failed = [sum(pair[name]["failed"][candidate] for name in SCREENS[screen]) for candidate in left]
        passed = [candidate for candidate in left if passes(pair, screen, candidate)]
        left = passed or [candidate for candidate in left if failed[candidate] == min(failed)]
    return min(left, key=RULES[rule](pair))


@dataclass
class Judged:
    """Results of a selection method, `[plant][sensor]`: ln(error / error of the best rate), and shares of failing windows."""

    regrets: list[list[float]]
    failing: list[list[float]]

    def over_sensors(self) -> list[float]:
        return [sum(plant) / len(plant) for plant in self.regrets]

    def disasters(self) -> list[list[bool]]:
        return [[share > SHARE for share in plant] for plant in self.failing]


def judge(plants: list[dict], chosen: Callable[[dict, int], int]) -> Judged:
    """Returns the results of the choices `chosen(pair, sensor)`."""
    judged = Judged([], [])
    for plant in plants:
        places = [(pair["truth"], chosen(pair, sensor)) for sensor, pair in enumerate(plant["sensors"])]
        judged.regrets.append([truth["cost"][choice] - min(truth["cost"]) for truth, choice in places])
        judged.failing.append([truth["failed"][choice] / truth["runs"] for truth, choice in places])
    return judged


def flat(table: list[list]) -> list:
    return [value for line in table for value in line]


def sign_test(fewer: int, more: int) -> float:
    """Returns the p-value of the exact, two-sided sign test. For pairs in which one of two changed it is McNemar's test."""
    return min(1, 2 * at_most(min(fewer, more), fewer + more, 0.5))


def percent(logarithm: float) -> str:
    return f"{(math.exp(logarithm) - 1) * 100:.1f}"


def report(plants: list[dict]) -> None:
    for name, own, rates in [
        ("First pass", [plant for plant in plants if plant["plant"] < SECOND], RATES),
        ("Second pass", [plant for plant in plants if plant["plant"] >= SECOND], SECOND_RATES),
    ]:
        if own:
            print(f"\n## {name}\n")
            report_pass(own, rates)


def report_pass(plants: list[dict], rates: list[float]) -> None:
    few = [str(plant["plant"]) for plant in plants if plant["windows"] < WINDOWS]
    if few:
        print(f"Fewer than {WINDOWS} different held-out windows: plants {', '.join(few)}.\n")
    is_second = rates is SECOND_RATES
    rules = [rule for rule in RULES if is_second or rule != ALL_WINDOWS]
    screens = [screen for screen, sources in SCREENS.items() if is_second or "windows" not in sources]
    judged = {
        (rule, screen): judge(plants, lambda pair, _: choose(pair, rule, screen)) for rule in rules for screen in [None, *screens]
    }
    print_choosers(plants, judged, rates)
    print("\nEach screen against the same rule without it. Errors are quotients (95 % over plants):\n")
    head("chooser", "by", "disasters", "avoided / new", "McNemar's p", "plants with fewer / more", "sign test's p",
         "quotient of errors", "half, p < 0.05, quotient")
    for rule in rules:
        for screen in screens:
            compare(judged, (rule, screen), (rule, None))
    if is_second:
        for chooser in [(ALL_WINDOWS, None), (ALL_WINDOWS, "150 windows"), (ALL_WINDOWS, "150 rollouts")]:
            compare(judged, chooser, ("log", None))
        for screen in screens:
            compare(judged, ("log", screen), (ALL_WINDOWS, None))
    print_accuracy(plants, screens, rates)
    print_choices(plants, rules, screens)


def print_choosers(plants: list[dict], judged: dict[tuple, Judged], rates: list[float]) -> None:
    default = rates.index(DEFAULT_RATE)
    fixed = [
        smallest([sum(plant["sensors"][sensor]["truth"]["cost"][rate] for plant in plants) for rate in range(len(rates))])
        for sensor in range(len(SENSORS))
    ]
    named = {named_chooser(chooser): own for chooser, own in judged.items()}
    named["default"] = judge(plants, lambda pair, sensor: default)
    named["hindsight"] = judge(plants, lambda pair, sensor: fixed[sensor])
    named["best rate"] = judge(plants, lambda pair, sensor: smallest(pair["truth"]["cost"]))
    every = [judge(plants, lambda pair, sensor: rate) for rate in range(len(rates))]

    pairs = len(plants) * len(SENSORS)
    print(f"{len(plants)} plants, {pairs} pairs of plant and sensor. Typical regret in % (95 % over plants):\n")
    head("chooser", "typical regret", "of the worst tenth of pairs", "worst", "disasters", "choices with a failing window")
    for name, own in named.items():
        worst = sorted(flat(own.regrets), reverse=True)
        tenth = worst[: max(1, round(len(worst) / 10))]
        failing = sum(share > 0 for share in flat(own.failing))
        row(name, typical_regret(own.over_sensors()), percent(sum(tenth) / len(tenth)), percent(worst[0]),
            sum(flat(own.disasters())), failing)
    regrets = [sum(values) / len(values) for values in zip(*(own.over_sensors() for own in every))]
    disasters = sum(sum(flat(own.disasters())) for own in every) / len(rates)
    failing = sum(sum(share > 0 for share in flat(own.failing)) for own in every) / len(rates)
    row("random", typical_regret(regrets), "", "", f"{disasters:.1f}", f"{failing:.1f}")


def named_chooser(chooser: tuple[str, str | None]) -> str:
    rule, screen = chooser
    return rule if screen is None else f"{rule}, screened by {screen}"


def compare(judged: dict[tuple, Judged], chooser: tuple[str, str | None], other: tuple[str, str | None]) -> None:
    after, before = judged[chooser], judged[other]
    old, new = before.disasters(), after.disasters()
    avoided = sum(a and not b for a, b in zip(flat(old), flat(new)))
    added = sum(b and not a for a, b in zip(flat(old), flat(new)))
    fewer = sum(sum(b) < sum(a) for a, b in zip(old, new))
    more = sum(sum(b) > sum(a) for a, b in zip(old, new))
    changes = [b - a for a, b in zip(before.over_sensors(), after.over_sensors())]
    mcnemar = sign_test(avoided, added)
    holds = [2 * sum(flat(new)) <= sum(flat(old)), mcnemar < 0.05, math.exp(interval(changes)[2]) <= 1.01]
    row(named_chooser(chooser), named_chooser(other), f"{sum(flat(old))} to {sum(flat(new))}", f"{avoided} / {added}",
        f"{mcnemar:.3f}", f"{fewer} / {more}", f"{sign_test(fewer, more):.3f}", quotient(changes),
        ", ".join("yes" if condition else "no" for condition in holds))


def print_accuracy(plants: list[dict], screens: list[str], rates: list[float]) -> None:
    print("\nAll rates of all pairs, by the share of held-out windows that fail, and how many of them each screen refuses:\n")
    head("windows that fail", "rates", *screens, "mean share of rollouts that fail")
    bounds = {"none": (-1, 0), "up to 5 %": (0, SHARE), "5 to 20 %": (SHARE, 0.2), "more": (0.2, 1)}
    for name, (above, until) in bounds.items():
        places = [
            (pair, rate)
            for plant in plants
            for pair in plant["sensors"]
            for rate in range(len(rates))
            if above < pair["truth"]["failed"][rate] / pair["truth"]["runs"] <= until
        ]
        refused = [sum(not passes(pair, screen, rate) for pair, rate in places) for screen in screens]
        shares = [pair["rollouts"]["failed"][rate] / pair["rollouts"]["runs"] for pair, rate in places]
        row(name, len(places), *refused, f"{sum(shares) / len(shares) * 100:.1f} %" if shares else "")


def print_choices(plants: list[dict], rules: list[str], screens: list[str]) -> None:
    pairs = [pair for plant in plants for pair in plant["sensors"]]
    print("\nHow often a screen leaves no rate, and how often it changes the choice:\n")
    head("screen", "leaves no rate", *(f"changes `{rule}`" for rule in rules))
    for screen in screens:
        empty = sum(not any(passes(pair, screen, rate) for rate in range(len(pair["truth"]["cost"]))) for pair in pairs)
        changed = [sum(choose(pair, rule, screen) != choose(pair, rule, None) for pair in pairs) for rule in rules]
        row(screen, empty, *changed)


if __name__ == "__main__":
    protocols.make_and_report(__doc__, "divergence.jsonl", 112, make, report)
