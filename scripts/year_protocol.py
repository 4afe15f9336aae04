#!/usr/bin/env python3
"""What makes neighbours of a year replay the log: spacing, k, states left out around a state, or the representation?

    pip install numpy polars
    python3 scripts/year_protocol.py DIR [--plants FIRST END]     # it can be stopped and run again
    python3 scripts/year_protocol.py DIR --report                 # only the tables

The protocol, as it was fixed before its runs:

- *Plants.* Numbers 0 to 3: a simulated year as in configs/paper/twelve-months.toml (seeds 0 and 1, 24 channels), with a row every two
  minutes (even numbers) or every ten minutes (odd numbers), and its deployments in April, May and July.
- *Models.* Five ensemble members each. Euclidean neighbours with k = 1, 3 and 10; with k = 3 and no state within one hour (a Theiler
  window); Laplacian ones with the same four; and Laplacian ones, k = 3, with a tenth of the training steps and with a tenth of the step size.
- *What is measured*: the share of steps that jump to another time of the log, and how often an hour; steps until a walk mixes (median
  over members); rollouts that freeze, which escape, and DTW (symmetric2), of rollouts of two days from the nearest states of ten start
  states per deployment and member; the one-step error by that of no change.
- *The choice* is that of agents from scratch, Adam, gamma 0.9, batches of 16, 2 x 16 units, runs of two days, six rates from 1e-5 to 3e-2, by the
  ensemble members alone: two runs in each. Its regret is over the deployments and sensors, as the error by that of the best rate,
  capped as in scripts/measures_protocol.py. Log replay chooses beside it.
- *Not kept*, unlike what is said above: which rollouts escape.
- *What is decided*: nothing by itself. The documents say which of these move the jumps an hour, and whether DTW and choices go with it.
"""

import json
import math
import shutil
from pathlib import Path

import protocols
from measures_protocol import SENSORS, mean_errors
from protocols import head, mean, regret_of_choice, row

SPACINGS = [120, 600]
DAY_SECS = 86_400
HOUR_SECS = 3_600
MODELS = [
    "euclidean-1", "euclidean-3", "euclidean-10", "euclidean-hour", "laplacian-1", "laplacian-3", "laplacian-10", "laplacian-hour",
    "laplacian-short", "laplacian-slow",
]
DEPLOYMENTS = ["april", "may", "july"]
PSI_STEPS = 15_000
PSI_RATE = 3e-4

STUDY = """seed = {seed}
output = "results"
compare = {models}

[simulate]
start = 2022-03-31
days = 472
channels = 24
period_secs = {period}
seed = {seed}

[data]
path = "plant"
train = {{ start = 2022-03-31, end = 2023-03-31 }}

[deployments]
april = {{ start = 2023-04-07, end = 2023-04-21 }}
may = {{ start = 2023-05-01, end = 2023-05-15 }}
july = {{ start = 2023-07-01, end = 2023-07-15 }}

[preprocess]
max_missing = 0.1
fill_limit = {fill_limit}

{variants}
[rollout]
start = "nearest"
rollouts = 10
steps = {steps}
dtw_steps = {steps}

[agent]
hidden_units = 16
gamma = 0.9
batch_size = 16
learning_rate = 1e-3

[sweep]
sensors = {sensors}
steps = {steps}
online_runs = 5
member_runs = 2
log_replay_runs = 10
start = "recent"
curve_points = 0

[sweep.grid]
learning_rate = [1e-5, 1e-4, 1e-3, 3e-3, 1e-2, 3e-2]
"""


def variant(name: str, period: int) -> str:
    """Returns the sections of a model."""
    kind, what = name.split("-")
    neighbors = int(what) if what.isdigit() else 3
    theiler = HOUR_SECS // period if what == "hour" else 0
    lines = [f"[models.{name}.model]", f"neighbors = {neighbors}", f"theiler = {theiler}"]
    if kind == "laplacian":
        lines += [
            f"[models.{name}.representation]", 'kind = "laplacian"', "hidden_units = 128", "dimension = 32", "trajectory = 20", "kappa = 0.95",
            "beta = 5", "zeta = 0.05", f"steps = {PSI_STEPS // 10 if what == 'short' else PSI_STEPS}",
            f"learning_rate = {PSI_RATE / 10 if what == 'slow' else PSI_RATE}",
        ]  # fmt: skip
    return "\n".join([*lines, ""])


def make(number: int, folder: Path, calib: str) -> dict:
    seed, period = number // len(SPACINGS), SPACINGS[number % len(SPACINGS)]
    study = folder / "study.toml"
    study.write_text(STUDY.format(
        seed=seed, models=json.dumps(MODELS), period=period, fill_limit=600 // period, steps=2 * DAY_SECS // period,
        sensors=json.dumps(SENSORS), variants="\n".join(variant(name, period) for name in MODELS),
    ))  # fmt: skip
    protocols.run(calib, study, "simulate", "represent", "build-model", "rollout", "sweep")
    found = {name: of_model(folder / "results/models" / name) for name in MODELS}
    shutil.rmtree(folder / "plant")
    shutil.rmtree(folder / "results")
    return {"seed": seed, "period": period, "models": found}


def of_model(folder: Path) -> dict:
    import polars

    members = json.loads((folder / "model/manifest.json").read_text())["members"]
    mixing = sorted(member["recurrence"].get("mixing_steps") or math.inf for member in members)
    found = {"departures": mean(member["jumps"]["departure_rate"] for member in members), "mixing": mixing[len(mixing) // 2]}
    frozen, rollouts, warping, relative, regrets, replayed = 0, 0, [], [], [], []
    for deployment in DEPLOYMENTS:
        own = folder / "deployments" / deployment
        manifest = json.loads((own / "rollout/manifest.json").read_text())
        rollouts += manifest["collapse"]["rollouts"] * len(SENSORS)
        frozen += sum(sensor["collapsed"] for sensor in manifest["collapse"]["sensors"])
        table = polars.read_parquet(own / "rollout/dtw.parquet").filter(polars.col("step_pattern") == "symmetric2")
        warping += [table.filter(polars.col("sensor") == sensor)["normalized_distance"].mean() for sensor in SENSORS]
        relative += [sensor["relative"] for sensor in json.loads((own / "rollout/one_step.json").read_text())["sensors"]]
        runs = polars.read_parquet(own / "sweep/runs.parquet")
        environment = polars.col("environment")
        truth = mean_errors(runs.filter(environment == "online"))
        regrets += map(regret_of_choice, truth, mean_errors(runs.filter(environment.str.starts_with("member:"))))
        replayed += map(regret_of_choice, truth, mean_errors(runs.filter(environment == "log-replay")))
    return found | {
        "frozen": frozen / rollouts, "dtw": mean(warping), "one_step": mean(relative), "regret": mean(regrets), "replay": mean(replayed),
    }  # fmt: skip


def report(plants: list[dict]) -> None:
    for period in SPACINGS:
        own = [plant for plant in plants if plant["period"] == period]
        if not own:
            continue
        replay = mean(plant["models"][MODELS[0]]["replay"] for plant in own)
        print(f"\nA row every {period // 60} minutes, {len(own)} plants; log replay has {100 * math.expm1(replay):.1f} % of regret:\n")
        head("model", "jumps to another time", "an hour", "mix in steps", "freeze", "DTW", "one step / no change", "regret")
        for name in MODELS:
            found = [plant["models"][name] for plant in own]
            departures = mean(one["departures"] for one in found)
            mixing = [">1e6" if math.isinf(one["mixing"]) else f"{one['mixing']:,.0f}" for one in found]
            row(
                name, f"{100 * departures:.2g} %" if departures < 0.1 else f"{100 * departures:.0f} %", f"{departures * HOUR_SECS / period:.2g}", ", ".join(mixing),
                f"{100 * mean(one['frozen'] for one in found):.0f} %", f"{mean(one['dtw'] for one in found):.4f}",
                f"{mean(one['one_step'] for one in found):.1f}", f"{100 * math.expm1(mean(one['regret'] for one in found)):.1f} %",
            )  # fmt: skip


if __name__ == "__main__":
    protocols.make_and_report(__doc__, "year.jsonl", 4, make, report)
