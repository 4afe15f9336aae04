#!/usr/bin/env python3
"""Does a walk that follows the log, and now and then jumps to the nearest state of another time, choose better than the log does?

    pip install numpy polars ./python
    python3 scripts/jump_protocol.py DIR [--plants FIRST END]     # it can be stopped and run again
    python3 scripts/jump_protocol.py DIR --report                 # only the tables

The protocol, as it was fixed before its runs:

- *Plants and tasks* are those of scripts/measures_protocol.py, numbers 0 to 19: two weeks of training range with a row every minute,
  two weeks held out, eleven rates from 1e-5 to 1, agents from scratch that predict PIT300, TIT101 and TUIT101.
- *Jumping walks* are a matched-block bootstrap of the log (Carlstein et al. 1998; one neighbour of Lall and Sharma 1996). A walk goes
  from a row to the next one. At each step it jumps with probability 1/360, 1/120, 1/36 or 1/12. It then goes on from the row after
  the nearest row that is at least 36 minutes away in time. Near is Euclidean, over all columns, normalised as calib does. A row
  without a next row, at the end of the log or before a gap, is never that nearest row. A walk that reaches one jumps. So every step is a
  step of the record, or one from a row to the successor of the nearest. With probability 0 the walk is log replay, except at gaps.
- *Choosers*, 24 runs each, by the mean logarithm of the error, cut as in scripts/measures_protocol.py:
  - `log replay`: 24 windows of the log, the latest and others evenly spread;
  - `neighbours`: calib's Euclidean neighbours with k = 3, five members x five runs, without the last run;
  - `1/360` to `1/12`: 24 jumping walks as long as a stream. Each starts where a window of log replay does, and is learned with the
    same random numbers. All probabilities share the random numbers of the walks.
- *Truth.* Eight held-out windows x two runs, as in scripts/measures_protocol.py. The report compares both.
- *Outcomes.* First, the error of the choice by that of log replay. Also by that of neighbours; the regret; the regret of a choice by
  one run alone, as the mean over the 24; Spearman's correlation of a chooser's errors with the truth over rates. `jumps` is the share
  of steps that jump in the 24 walks, and those at gaps count.
- *Measures* of 15 rollouts of 1,500 steps, as in scripts/measures_protocol.py: DTW (symmetric2) from the record after the same row over
  the first 1,000 steps, and the share that freezes. Jumping walks start in the same 15 rows as the rollouts of neighbours. The share
  of `log replay` is that of the record after these rows, where it is as long.
- *The unit of every interval is the plant*: mean over sensors of the logarithm, Student's t over plants.
- *What is decided.* The first ten plants fix the probability, as the one with the smallest mean regret, and the smallest of equal
  ones. Jumping becomes a kind of model of calib if, over the last ten plants, the error of its choice by that of log replay is at most
  0.99, with an upper end below 1. Otherwise nothing is shipped, and the documents say so.

What was known when it was fixed: docs/validity/measures.jsonl has the same plants. There log replay with 15 windows has a regret of
1.0 % (0.3 to 1.7) over the last ten, and neighbours 0.9 % (0.3 to 1.5). So even the best rate has a quotient of 0.990 (0.983 to 0.997)
to that log replay, and the protocol leaves hardly any room. The regret by one run alone has more, but decides nothing. One plant of
another seed, 1303 (number -97), was made while this was written. Log replay chose the best rates there. Plant 0 was
made with the probability 0 only: 20 of 24 runs equalled those of log replay to the bit, and the other four have gaps.
"""

import json
import math
import random
import shutil
from datetime import timedelta
from pathlib import Path

import measures_protocol
import protocols
from measures_protocol import PERIOD_SECS, RATES, SENSORS, TRAINING_DAYS, spearman
from protocols import day, head, interval, mean, quotient, row, smallest, typical_regret

# Jump probabilities per step, by name.
JUMPS = {"1/360": 1 / 360, "1/120": 1 / 120, "1/36": 1 / 36, "1/12": 1 / 12}
SELECTION = ["log replay", "neighbours", *JUMPS]
RUNS = 24
# Nearest rows are at least so far away in time.
THEILER_ROWS = 36
ROLLOUT_STEPS = 1500
DTW_STEPS = 1000
# calib compares no stretch of so few steps by DTW.
LEAST_STEPS = 20
MEASURES = Path(__file__).parent.parent / "docs" / "validity" / "measures.jsonl"

# What the study of a plant and those of walks share.
AGENT = """
[agent]
{agent}
learning_rate = 1e-3

[sweep.grid]
learning_rate = {{ from = 1e-5, to = 1, per_decade = 2 }}

[sweep]
sensors = {sensors}
steps = {steps}
log_replay_runs = {runs}
curve_points = 0
"""

STUDY = """seed = {seed}
output = "results"

{plant}
[rollout]
steps = {rollout_steps}
rollouts = 3
dtw_steps = {dtw_steps}
{agent}
online_windows = 8
online_runs = 16
member_runs = 5
"""

STUDY_OF_WALKS = """seed = {seed}
output = "{name}"

[data]
path = "{name}.parquet"
period_secs = {period_secs}
train = {{ start = {start}, end = {end} }}

[preprocess]
fill_limit = 30
outliers = "keep"

[model]
kind = "none"
period = {{ start = {begin}, end = {end} }}
{agent}
"""


class Log:
    """The training range of a plant, normalised, and walks that follow it."""

    def __init__(self, model: Path):
        import numpy as np
        import polars

        rows = polars.read_parquet(model / "rows.parquet")
        self.states = np.load(model / "states.npy").astype(float)
        self.times = rows["timestamp"].to_numpy().astype("datetime64[us]")
        self.columns = [column["name"] for column in json.loads((model / "manifest.json").read_text())["normaliser"]]
        segments = rows["segment"].to_numpy()
        self.has_next = np.append(segments[1:] == segments[:-1], False)
        self.squares = (self.states**2).sum(axis=1)

    def nearest(self, at: int) -> int:
        """Returns the row with a next row that is nearest to row `at`, outside of the Theiler window."""
        import numpy as np

        away = self.squares - 2 * self.states @ self.states[at]
        apart = abs(self.times - self.times[at])
        away[~self.has_next | (apart < np.timedelta64(THEILER_ROWS * PERIOD_SECS, "s"))] = np.inf
        return int(away.argmin())

    def walk(self, generator: random.Random, start: int, length: int, probability: float):
        """Returns the rows of a walk that jumps with this probability per step, and where the record does not go on."""
        import numpy as np

        rows = [start]
        while len(rows) < length:
            at = rows[-1]
            jumps = generator.random() < probability
            rows.append((self.nearest(at) if jumps or not self.has_next[at] else at) + 1)
        return np.array(rows)

    def recorded_steps(self, start: int, most: int) -> int:
        """Returns how many rows follow the row `start` without a gap, at most `most`."""
        steps = 0
        while steps < most and self.has_next[start + steps]:
            steps += 1
        return steps


class Plant(measures_protocol.Plant):
    def outcome(self) -> dict:
        import polars

        study = self.write_study()
        protocols.run(self.calib, study, "simulate", "build-model", "rollout", "sweep")
        log = Log(self.folder / "results/model")
        runs = polars.read_parquet(self.folder / "results/sweep/runs.parquet")
        replay = runs.filter(polars.col("environment") == "log-replay")
        in_model = runs.filter(polars.col("environment").str.starts_with("member:"))
        is_last = (polars.col("environment") == in_model["environment"].max()) & (polars.col("run") == in_model["run"].max())
        online = runs.filter(polars.col("environment") == "online")
        truth = mean_errors(online)
        selection = {"log replay": of_runs(replay, truth), "neighbours": of_runs(in_model.filter(~is_last), truth)}
        rolled, starts = self.of_rollouts()
        for name, measures in rolled.items():
            selection[name] |= measures
        for name, probability in JUMPS.items():
            selection[name] = self.of_walks(log, replay, truth, probability) | self.of_long_walks(log, starts, probability)
        shutil.rmtree(self.folder)
        return {
            "task": self.plant | self.task | {"steps": self.steps, "start": day(self.start)},
            "windows": online["start_row"].n_unique(),
            "truth": truth,
            "selection": selection,
        }

    def of_rollouts(self) -> tuple[dict, list[int]]:
        """Returns measures of rollouts of neighbours and of the record after the same rows, and these start rows."""
        import polars

        folder = self.folder / "results/rollout"
        warping = polars.read_parquet(folder / "dtw.parquet").filter(polars.col("step_pattern") == "symmetric2")
        manifest = json.loads((folder / "manifest.json").read_text())["collapse"]
        collapse = {sensor["sensor"]: sensor for sensor in manifest["sensors"]}
        own = [collapse[sensor] for sensor in SENSORS]
        measures = {
            "neighbours": {
                "dtw": [warping.filter(polars.col("sensor") == sensor)["normalized_distance"].mean() for sensor in SENSORS],
                "frozen": [sensor["collapsed"] / manifest["rollouts"] for sensor in own],
            },
            # The record may have no such long stretches.
            "log replay": {
                "frozen": [sensor["recorded_collapsed"] / sensor["recorded"] if sensor["recorded"] else None for sensor in own]
            },
        }
        trajectories = polars.read_parquet(folder / "trajectories.parquet", columns=["member", "rollout", "step", "wanted_row"])
        starts = trajectories.filter(polars.col("step") == 0).sort("member", "rollout")["wanted_row"].to_list()
        return measures, starts

    def generator(self, kind: str, number: int) -> random.Random:
        """Returns the random numbers of a walk, the same for all jump probabilities."""
        return random.Random(f"jump {self.number} {kind} {number}")

    def of_long_walks(self, log: Log, starts: list[int], probability: float) -> dict:
        """Returns the measures of walks from these rows, each compared with the record after its row."""
        import calib_rl
        import numpy as np

        found = {"dtw": [], "frozen": []}
        walks = [
            log.walk(self.generator("rollout", number), start, ROLLOUT_STEPS + 1, probability) for number, start in enumerate(starts)
        ]
        lengths = [log.recorded_steps(start, DTW_STEPS) + 1 for start in starts]
        for sensor in SENSORS:
            values = log.states[:, log.columns.index(sensor)]
            distances = [
                calib_rl.dtw(values[walk[:length]], values[start : start + length]).normalized
                for walk, start, length in zip(walks, starts, lengths)
                if length > LEAST_STEPS
            ]
            # As calib judges that a rollout freezes.
            last_quarters = [values[walk[-(len(walk) // 4) :]] for walk in walks]
            found["dtw"].append(round(mean(distances), 6) if distances else math.inf)
            found["frozen"].append(float(np.mean([last.var() < 0.01 * values.var() for last in last_quarters])))
        return found

    def of_walks(self, log: Log, replay, truth: list[list[float]], probability: float) -> dict:
        """Returns what comes of runs on walks that start where the windows of log replay do.

        The walks follow the recorded log, from which calib takes the normaliser. They stand in the reversed order of the runs,
        because the first run of log replay has the last window.
        """
        import numpy as np
        import polars

        starts = [replay.filter(polars.col("run") == run)["start_row"][0] for run in range(RUNS)]
        # The latest window ends with the log.
        length = len(log.states) - starts[0]
        walks = [log.walk(self.generator("stream", run), start, length, probability) for run, start in enumerate(starts)]
        rows = np.concatenate(walks[::-1])
        end = self.start + timedelta(days=TRAINING_DAYS)
        begin = end + timedelta(days=1)
        added = np.datetime64(begin, "us") + np.arange(len(rows)) * np.timedelta64(PERIOD_SECS, "s")
        states = np.concatenate([log.states, log.states[rows]])
        columns = {column: states[:, place] for place, column in enumerate(log.columns)}
        file = f"walks-{round(1 / probability)}" if probability else "walks-0"
        polars.DataFrame({"timestamp": np.concatenate([log.times, added])} | columns).write_parquet(self.folder / f"{file}.parquet")
        path = self.folder / f"{file}.toml"
        path.write_text(STUDY_OF_WALKS.format(
            seed=1400 + self.number, name=file, period_secs=PERIOD_SECS, start=self.start.isoformat(), begin=begin.isoformat(),
            end=(begin + timedelta(seconds=PERIOD_SECS * len(rows))).isoformat(), agent=self.agent(),
        ))
        protocols.run(self.calib, path, "sweep")
        runs = polars.read_parquet(self.folder / file / "sweep/runs.parquet")
        if set(runs["start_row"]) != {length * number for number in range(RUNS)}:
            raise SystemExit(f"{path}: the windows of log replay are not the walks")
        jumped = np.concatenate([np.diff(walk) != 1 for walk in walks])
        return of_runs(runs, truth) | {"jumps": round(float(jumped.mean()), 5)}

    def agent(self) -> str:
        return AGENT.format(agent=self.task_text(), sensors=json.dumps(SENSORS), steps=self.steps, runs=RUNS)

    def write_study(self) -> Path:
        path = self.folder / "study.toml"
        path.write_text(STUDY.format(
            seed=1400 + self.number, plant=self.plant_text(), rollout_steps=ROLLOUT_STEPS, dtw_steps=DTW_STEPS, agent=self.agent(),
        ))
        return path


def mean_errors(runs) -> list[list[float]]:
    """Returns the mean logarithm of the error, `[sensor][rate]`, of some rows of runs.parquet."""
    import numpy as np

    # If every rate diverged in every run, all rates are equally bad.
    own = measures_protocol.mean_errors(runs)
    return [[0.0] * RATES if errors is None else np.round(errors, 5).tolist() for errors in own]


def of_runs(runs, truth: list[list[float]]) -> dict:
    """Returns the errors of runs, and by sensor the mean true error of what each run alone would choose."""
    single = [mean_errors(run) for run in runs.partition_by("environment", "run")]
    if len(single) != RUNS:
        raise SystemExit(f"there are {len(single)} runs, not {RUNS}")
    alone = [
        round(mean(true[smallest(errors[sensor])] for errors in single), 5) for sensor, true in enumerate(truth)
    ]
    return {"errors": mean_errors(runs), "alone": alone}


def over_sensors(value) -> float:
    """Returns the mean of `value(sensor)` over the sensors."""
    return mean(value(sensor) for sensor in range(len(SENSORS)))


def cost(plant: dict, name: str) -> float:
    """Returns the logarithm of the error of the choice."""
    own = plant["selection"][name]["errors"]
    return over_sensors(lambda sensor: plant["truth"][sensor][smallest(own[sensor])])


def least_cost(plant: dict) -> float:
    return over_sensors(lambda sensor: min(plant["truth"][sensor]))


def quotients(plants: list[dict], one: str, other: str) -> list[float]:
    return [cost(plant, one) - cost(plant, other) for plant in plants]


def regrets(plants: list[dict], name: str) -> list[float]:
    return [cost(plant, name) - least_cost(plant) for plant in plants]


def report(plants: list[dict]) -> None:
    parts = {"0 to 9": range(10), "10 to 19": range(10, 20)}
    parts = {name: [plant for plant in plants if plant["plant"] in numbers] for name, numbers in parts.items()}
    print(f"{len(plants)} plants, with {min(plant['windows'] for plant in plants)} held-out windows or more. {beside_measures(plants)}")

    print("\nTypical regret in %, and quotients of errors (95 % over plants):\n")
    columns = [*(f"plants {part}" for part in parts), "error / log replay's", "error / neighbours'", "by one run alone"]
    head("selection method", "regret", *columns)
    for name in SELECTION:
        alone = [mean(plant["selection"][name]["alone"]) - least_cost(plant) for plant in plants]
        row(
            name, typical_regret(regrets(plants, name)), *(typical_regret(regrets(own, name)) if own else "" for own in parts.values()),
            *(quotient(quotients(plants, name, other)) for other in SELECTION[:2]), typical_regret(alone),
        )
    random_rate = [over_sensors(lambda sensor, truth=plant["truth"]: mean(truth[sensor])) - least_cost(plant) for plant in plants]
    best = [quotient([-value for value in regrets(plants, name)]) for name in SELECTION[:2]]
    row("the best rate, known afterwards", "0", *("0" for _ in parts), *best, "0")
    row("a random rate", typical_regret(random_rate), *("" for _ in parts), "", "", "")

    print("\nBy one run alone, quotients of errors to those by one window of the log (95 % over plants):\n")
    head("selection method", "error / log replay's")
    for name in SELECTION[1:]:
        alone = [mean(plant["selection"][name]["alone"]) - mean(plant["selection"]["log replay"]["alone"]) for plant in plants]
        row(name, quotient(alone))

    print("\nMeans over plants of the correlation of errors with the truth, the share of steps that jump, DTW, and rollouts that freeze:\n")
    head("selection method", "correlation", "jumps", *(f"{what}, {sensor}" for what in ("DTW", "frozen in %") for sensor in SENSORS))
    for name in SELECTION:
        own = [plant["selection"][name] for plant in plants]
        correlation = mean(
            over_sensors(lambda sensor, plant=plant: spearman(plant["selection"][name]["errors"][sensor], plant["truth"][sensor]))
            for plant in plants
        )
        jumps = f"{mean(one['jumps'] for one in own):.4f}" if "jumps" in own[0] else ""
        warping = [f"{mean(one['dtw'][sensor] for one in own):.4f}" if "dtw" in own[0] else "" for sensor in range(len(SENSORS))]
        frozen = []
        for sensor in range(len(SENSORS)):
            shares = [one["frozen"][sensor] for one in own if one["frozen"][sensor] is not None]
            frozen.append(f"{100 * mean(shares):.1f}" if shares else "")
        row(name, f"{correlation:.3f}", jumps, *warping, *frozen)
    decide(*parts.values())


def beside_measures(plants: list[dict]) -> str:
    """Tells how far the truth is from that of docs/validity/measures.jsonl."""
    others = {plant["plant"]: plant for plant in map(json.loads, MEASURES.read_text().splitlines())}
    apart = [
        abs(one - other)
        for plant in plants
        if plant["plant"] in others
        for own, recorded in zip(plant["truth"], others[plant["plant"]]["truth"])
        for one, other in zip(own, recorded)
    ]
    return f"Truth: at most {max(apart):.5f} from {MEASURES.name}." if apart else ""


def decide(first: list[dict], last: list[dict]) -> None:
    if len(first) < 10 or len(last) < 10:
        print("\nNothing is decided before all 20 plants are made.")
        return
    chosen = min(JUMPS, key=lambda name: mean(regrets(first, name)))
    found = quotients(last, chosen, "log replay")
    middle, _, high = interval(found)
    print(f"\nDecision: the first ten plants fix {chosen}. Over the last ten its error by that of log replay is {quotient(found)},")
    print(f"by that of neighbours {quotient(quotients(last, chosen, 'neighbours'))}, and that of the best rate by that of log replay")
    print(f"{quotient([-value for value in regrets(last, 'log replay')])}.")
    print(f"Jumping becomes a kind of model: {'yes' if middle <= math.log(0.99) and high < 0 else 'no'}.")


if __name__ == "__main__":
    protocols.make_and_report(
        __doc__, "jump.jsonl", 20, lambda number, folder, calib: Plant(number, folder, calib).outcome(), report
    )
