#!/usr/bin/env python3
"""Do networks freeze and choose badly because of noise, or because of many columns?

    pip install numpy polars
    python3 scripts/columns_protocol.py DIR [--plants FIRST END]     # it can be stopped and run again
    python3 scripts/columns_protocol.py DIR --report                 # only the tables

The protocol, as it was fixed before its runs:

- *Plants.* 27 simulated plants, numbers 0 to 26: seed 1700 + number, a row every minute, ten days of training range and ten days held
  out. They have 12, 48 or 192 channels, and a third, once or three times the noise of instruments: three plants of each of the nine
  cells, in turn. Plants of a cell differ in seed and in the month in which the log begins. Channels beyond the first are more of the
  same kinds of sensors, so that more columns show the same plant.
- *Tasks.* From scratch, Adam, gamma 0.9, batches of 16, 1,000 steps, 2 x 16 units in every plant, so that only columns and noise differ. Eleven rates
  from 1e-5 to 1. They predict PIT300, TIT101 and TUIT101.
- *Models.* Three Euclidean neighbours; the feed-forward network of configs/validity/networks-simulated.toml as a conditional mean,
  with recorded residuals, and with residuals in blocks. Rollouts with noise are cut to the range of the log.
- *Errors, choice, regret* are those of scripts/measures_protocol.py. A model chooses by its own runs alone: five members x three, or
  15 rollouts. Eight held-out windows x two runs judge.
- *Rollouts*, 15 of 1,500 steps from random states of the training range: DTW (symmetric2) from the record after the same state over
  the first 1,000 steps, and the share that freezes.
- *Tables*: means over the plants and sensors of each cell, of DTW geometric ones. For columns, and for noise, the mean over sensors is
  regressed over all plants on the logarithms of both (to base 4 and 3, so that a step is one cell), with Student's t over the residuals.
  Plant 0 was seen before, with arithmetic means of DTW: there the network without noise runs away, and has 2,210.
- *What is decided*: nothing about calib. The documents say whether freezing and regret of each network grow with noise, with columns,
  or with neither, by the intervals of the two slopes.

Added after the runs, and part of the report: how much more error the choices of one model have than those of another.
"""

import json
import math
import random
import shutil
from datetime import datetime, timedelta
from pathlib import Path

import protocols
from measures_protocol import PLANT, SENSORS, mean_errors, mean_of_finite
from protocols import day, head, mean, regret_of_choice, row

CHANNELS = [12, 48, 192]
NOISE = [1 / 3, 1.0, 3.0]
PLANTS_A_CELL = 3
DAYS = 10
MODELS = ["neighbours", "network", "network-residual", "network-block"]
MEASURES = ["regret", "dtw", "frozen"]
# Choices that are compared with those of another model, or of the replayed log.
COMPARED = [
    ("network-residual", "network"), ("network-block", "network"), ("network-block", "network-residual"),
    ("network-block", "neighbours"), ("network-block", "log replay"),
]  # fmt: skip

STUDY = """seed = {seed}
output = "results"
compare = {models}

{plant}
[models.neighbours]

[models.network.model]
kind = "nn"
[models.network.rollout]
rollouts = 15

[models.network-residual.model]
kind = "nn"
[models.network-residual.dynamics]
noise = "residual"
[models.network-residual.rollout]
rollouts = 15

[models.network-block.model]
kind = "nn"
[models.network-block.dynamics]
noise = "block"
[models.network-block.rollout]
rollouts = 15

[dynamics]
hidden_units = 128
epochs = 20

[rollout]
steps = 1500
rollouts = 3
dtw_steps = 1000

[agent]
hidden_units = 16
gamma = 0.9
batch_size = 16
learning_rate = 1e-3

[sweep]
sensors = {sensors}
steps = 1000
online_windows = 8
online_runs = 16
member_runs = 3
network_runs = 15
log_replay_runs = 15
curve_points = 0

[sweep.grid]
learning_rate = {{ from = 1e-5, to = 1, per_decade = 2 }}
"""


def make(number: int, folder: Path, calib: str) -> dict:
    import polars

    seed, cell = 1700 + number, number % (len(CHANNELS) * len(NOISE))
    channels, noise = CHANNELS[cell % len(CHANNELS)], NOISE[cell // len(CHANNELS)]
    start = datetime(2022, random.Random(seed).randint(1, 12), 1)
    plant = PLANT.format(
        seed=seed, start=day(start), end=day(start + timedelta(days=DAYS)), days=2 * DAYS, channels=channels, period_secs=60,
        drift=1.0, noise=noise, storms=5,
    )  # fmt: skip
    study = folder / "study.toml"
    study.write_text(STUDY.format(seed=seed, models=json.dumps(MODELS), plant=plant, sensors=json.dumps(SENSORS)))
    protocols.run(calib, study, "simulate", "build-model", "rollout", "sweep")

    def errors(name: str, environment) -> list:
        return mean_errors(polars.read_parquet(folder / "results/models" / name / "sweep/runs.parquet").filter(environment))

    truth = errors("neighbours", polars.col("environment") == "online")
    replay = errors("neighbours", polars.col("environment") == "log-replay")
    is_model = polars.col("environment").str.starts_with("member:")
    found = {"log replay": {"regret": list(map(regret_of_choice, truth, replay))}}
    for name in MODELS:
        rollouts = folder / "results/models" / name / "rollout"
        warping = polars.read_parquet(rollouts / "dtw.parquet").filter(polars.col("step_pattern") == "symmetric2")
        manifest = json.loads((rollouts / "manifest.json").read_text())
        collapse = {sensor["sensor"]: sensor["collapsed"] for sensor in manifest["collapse"]["sensors"]}
        found[name] = {
            "regret": list(map(regret_of_choice, truth, errors(name, is_model))),
            "dtw": [mean_of_finite(warping.filter(polars.col("sensor") == sensor)["normalized_distance"]) for sensor in SENSORS],
            "frozen": [collapse[sensor] / 15 for sensor in SENSORS],
        }
    columns = len(json.loads((folder / "results/models/neighbours/model/manifest.json").read_text())["normaliser"])
    shutil.rmtree(folder / "plant")
    shutil.rmtree(folder / "results")
    random_rate = [float(own.mean() - own.min()) for own in truth]
    return {"channels": channels, "noise": noise, "columns": columns, "random": random_rate, "models": found}


def report(plants: list[dict]) -> None:
    print(f"{len(plants)} plants of {len(CHANNELS) * len(NOISE)} cells. Means over plants and sensors:\n")
    of_model = {
        "regret": lambda values: f"{100 * math.expm1(mean(values)):.1f} %",
        "dtw": lambda values: f"{math.exp(mean(map(math.log, values))):.3f}",
        "frozen": lambda values: f"{100 * mean(values):.0f} %",
    }
    for measure in MEASURES:
        print(f"{measure}:\n")
        models = [name for name in ("log replay", *MODELS) if measure in plants[0]["models"][name]]
        head("channels (columns)", "noise", *models, *(["a random rate"] if measure == "regret" else []))
        for channels in CHANNELS:
            for noise in NOISE:
                own = [plant for plant in plants if plant["channels"] == channels and plant["noise"] == noise]
                if own:
                    cells = [of_model[measure]([value for plant in own for value in plant["models"][name][measure]]) for name in models]
                    if measure == "regret":
                        cells.append(of_model[measure]([value for plant in own for value in plant["random"]]))
                    columns = f"{mean(plant['columns'] for plant in own):.0f}"
                    row(f"{channels} ({columns})", f"{noise:.2g}", *cells)
        print()
    print("Slopes for four times the columns and three times the noise (95 % over plants):\n")
    head("model", "measure", "columns", "noise")
    for name in MODELS:
        for measure in MEASURES:
            values = [mean(map(math.log if measure == "dtw" else float, plant["models"][name][measure])) for plant in plants]
            row(name, {"regret": "ln(error / best)", "dtw": "ln(DTW)"}.get(measure, measure), *slopes(plants, values))
    print("\nError of one choice by that of another (95 % over plants):\n")
    head("choice in", "by that in", "quotient")
    for name, other in COMPARED:
        less = [mean(plant["models"][name]["regret"]) - mean(plant["models"][other]["regret"]) for plant in plants]
        row(name, other, protocols.quotient(less))


def slopes(plants: list[dict], values: list[float]) -> list[str]:
    """Formats the slopes over columns and noise, in steps of one cell, with intervals by least squares."""
    import numpy as np

    design = np.array([[1.0, math.log(plant["channels"], 4), math.log(plant["noise"], 3)] for plant in plants])
    if len(plants) < 6 or np.linalg.matrix_rank(design) < 3:
        return ["", ""]
    inverse = np.linalg.inv(design.T @ design)
    weights = inverse @ design.T @ np.array(values)
    rest = np.array(values) - design @ weights
    freedom = len(plants) - 3
    spread = np.sqrt(rest @ rest / freedom * np.diag(inverse))
    half = protocols.quantile(freedom) * spread
    return [f"{weights[place]:.3f} ({weights[place] - half[place]:.3f} to {weights[place] + half[place]:.3f})" for place in (1, 2)]


if __name__ == "__main__":
    protocols.make_and_report(__doc__, "columns.jsonl", len(CHANNELS) * len(NOISE) * PLANTS_A_CELL, make, report)
