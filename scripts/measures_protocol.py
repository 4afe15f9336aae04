#!/usr/bin/env python3
"""Which measure of a calibration model says how well it chooses hyperparameters?

    pip install numpy polars
    python3 scripts/measures_protocol.py DIR [--plants FIRST END]     # it can be stopped and run again
    python3 scripts/measures_protocol.py DIR --report                 # only the tables

The protocol, as it was fixed before its runs:

- *Plants.* 20 simulated plants, numbers 0 to 19: seed 1400 + number, 24 channels, a row every minute, two weeks of training range
  and two weeks held out. Drift and noise are drawn from 0.3 to 3, storms from 1 to 20 a day (logarithms evenly), and the month in
  which the log begins, as in configs/validity/protocol.toml. One plant of another seed, 1303, was looked at while this was written.
- *Tasks.* One a plant: an agent from scratch, Adam or SGD, linear, 2 x 16 or 2 x 32 units, gamma 0.8, 0.9 or 0.95, batches of 4
  to 64, runs of 800 to 1,500 steps. Sensors PIT300, TIT101 and TUIT101. Eleven rates from 1e-5 to 1.
- *Models*, ten of each plant:
  - `k-1`, `k-3`, `k-10`: Euclidean neighbours, with calib's weights;
  - `k-140-rank`: about the square root of n neighbours, with weights 1/rank (Lall and Sharma 1996);
  - `laplacian`: three neighbours in a small representation;
  - `network`: a feed-forward network as a conditional mean, of the size of configs/validity/networks-simulated.toml;
    `network-residual`, `network-block`: the same network with recorded residuals, single ones or in blocks;
  - `blocks-36`, `blocks-360`: the stationary bootstrap of the log, runs of 36 and 360 rows on average. It is a neighbour model
    in an imported representation that says nothing about the plant: the rows lie in random order on a square grid with
    distances of 1. A state is its own neighbour, and four others are drawn so rarely that runs are as long as they should be.
- *Errors.* Of each run the logarithm of the error, at most that of ten times the best rate's of the same run. What diverged counts
  as that, and a run in which all rates diverged does not count. The error of a rate is the mean over runs.
- *Regret.* A model chooses by its own runs alone: five ensemble members x three, or 15 rollouts of a network. The choice is judged
  by eight held-out windows x two runs: its error minus the best rate's. A model whose rollouts all leave the finite numbers makes
  no choice, and counts as a random rate. *Not capped* is the same regret with means that are infinite where a run diverged.
- *Quality*, secondary: Spearman's correlation, over the eleven rates, between a model's errors and the held-out ones.
- *Measures.* Of each sensor; smaller is said to be better. None but one sees the deployment.
  - From `calib rollout`, 15 rollouts of 1,500 steps from random states against the *training* record after the same states, over
    the first 1,000 steps: `dtw` in four step patterns, `wasserstein` of values and of `increments`, `autocorrelation`,
    `spectral`, `time_warp_edit`, as calib reports them: rollouts that end before are left out. A distance that no rollout has is
    infinite. `frozen` is the share of rollouts that freeze, `broken` of those that freeze or end far outside of the record.
  - From `calib build-model`, for neighbours only and the same for all sensors: `mixing_steps` (mean logarithm over members),
    `departures` (share of steps that jump to another time), `few_rows` (minus the logarithm of the effective rows).
  - Forecasts, ten from each of 100 states of the last tenth of the *training* range, which neither networks learned from nor the
    ensemble member of neighbours that is rolled out (networks choose their epoch by it, and take residuals from it):
    `one_step`, the error of the mean of the ten forecasts after one step by that of no change, less what the mean owes to having
    ten forecasts only; `energy_1`, `energy_16`, `energy_128`, the energy score after so many steps, in the form that does not
    depend on the number of forecasts (Ferro 2014). Networks without noise have ten equal forecasts.
  - `spectrum`: root mean square difference in dB between the power spectra of all rollouts and of all of the *training* record, in
    segments of 256 rows.
  - `curve`: root mean square difference between the agents' logarithmic learning curves in rollouts and in 15 windows of the
    replayed log (the *training* record), over rates and ten points of time, each centred over both; errors are capped as above, in
    each point. `profile`: the same of the errors of whole runs.
  - `one_step_deployment`: calib's one-step error by that of no change, on the *held-out* record. It looks at the deployment, so
    nothing is decided by it. Bootstraps have none.
- *Statistic.* In each plant and sensor Spearman's correlation over models between a measure and the regret, with average ranks;
  its mean over sensors; mean and interval by Student's t over plants. A measure that is equal for all models counts as 0. Where the
  regret is equal for all models there is no correlation: the pair is left out and counted. *Pooled*: ranks within all pairs
  correlated at once, as `accuracy` of docs/metrics.md, with the regret not capped and the jackknife over plants.
- *What a user gets*: the regret of the model with the smallest measure (the mean over those that tie), beside the mean over models,
  the best model in hindsight, log replay and a random rate.
- *What is decided.* A measure is useful if the lower end of its correlation is above 0.3 and it is better than DTW (`dtw
  symmetric2`, over the same models): the lower end of the difference between their correlations, plant by plant, is above 0. The
  useful measure with the largest mean is put first in calib's report. If none is useful, the documents say so. Since one of many
  is picked, it has to pass again, alone, on plants 20 to 39: `--plants 20 40`, in another folder.
- *Second*: the correlation with minus the quality. Both without the bootstraps, which go on anywhere from a state that their log
  lacks, and both without the networks, some of which leave the range of the record by orders, which any measure sees.
"""

import json
import math
import random
import shutil
import subprocess
from collections import defaultdict
from datetime import datetime, timedelta
from pathlib import Path

import protocols
from protocols import CAP, day, even_in_logarithm, head, interval, mean, quotient, row, smallest, typical_regret

SENSORS = ["PIT300", "TIT101", "TUIT101"]
RATES = 11
CHANNELS = 24
PERIOD_SECS = 60
TRAINING_DAYS = 14
HELD_OUT_DAYS = 14
STEPS = (800, 1500)
MODELS = [
    "blocks-36", "blocks-360", "k-1", "k-10", "k-140-rank", "k-3", "laplacian", "network", "network-block", "network-residual",
]
# Networks by what their rollouts add to each prediction (`dynamics.noise`).
NOISES = {"none": "network", "residual": "network-residual", "block": "network-block"}
FEWER = {
    "without the bootstraps": [name for name in MODELS if not name.startswith("blocks")],
    "without the networks": [name for name in MODELS if not name.startswith("network")],
}
PATTERNS = ["symmetric2", "asymmetric", "symmetricP1", "rabinerJuang:6c"]
# Columns of measures.parquet of `calib rollout`.
DISTANCES = {
    "wasserstein": "wasserstein",
    "increments": "wasserstein_increments",
    "autocorrelation": "autocorrelation_distance",
    "spectral": "spectral_distance",
    "time_warp_edit": "time_warp_edit",
}
HORIZONS = [1, 16, 128]
FORECASTS = 10
STARTS = 100
DTW = "dtw symmetric2"
HINDSIGHT = "one_step_deployment"
MEASURES = [
    *(f"dtw {pattern}" for pattern in PATTERNS), *DISTANCES, "frozen", "broken", "mixing_steps", "departures", "few_rows",
    "one_step", *(f"energy_{horizon}" for horizon in HORIZONS), "spectrum", "curve", "profile", HINDSIGHT,
]
# Rows per segment of the spectra: a quarter of the shortest training rollouts, rounded to a power of two.
SEGMENT = 256
# Power of a normalised sensor that counts as zero, as in calib's spectral distance.
NO_POWER = 1e-12
# Stands for the mixing time of rollouts that need more than a million steps.
NO_MIXING = 2**21

# The log and the held-out data of a plant, also for jump_protocol.py.
PLANT = """[simulate]
start = {start}
days = {days}
channels = {channels}
period_secs = {period_secs}
drift = {drift}
noise = {noise}
storms_per_day = {storms}
seed = {seed}

[data]
path = "plant"
train = {{ start = {start}, end = {end} }}
held_out = {{ start = {end} }}

[preprocess]
fill_limit = 30
"""

STUDY = """seed = {seed}
output = "results"
compare = {models}

{plant}
[models.k-1.model]
neighbors = 1

[models.k-3]

[models.k-10.model]
neighbors = 10

[models.k-140-rank.model]
neighbors = 140
weights = "rank"

[models.laplacian.representation]
kind = "laplacian"
dimension = 16
hidden_units = 64
zeta = [0.05, 0.2]
steps = 3000

[models.network.model]
kind = "nn"
[models.network.rollout]
rollouts = {network_rollouts}

[models.network-residual.model]
kind = "nn"
[models.network-residual.dynamics]
noise = "residual"
[models.network-residual.rollout]
rollouts = {network_rollouts}

[models.network-block.model]
kind = "nn"
[models.network-block.dynamics]
noise = "block"
[models.network-block.rollout]
rollouts = {network_rollouts}

[models.blocks-36.representation]
kind = "import"
path = "order.parquet"
timestamp = "timestamp"
[models.blocks-36.model]
neighbors = 5
weights = "softmax"
temperature = {temperature_36}

[models.blocks-360.representation]
kind = "import"
path = "order.parquet"
timestamp = "timestamp"
[models.blocks-360.model]
neighbors = 5
weights = "softmax"
temperature = {temperature_360}

[dynamics]
hidden_units = 128
epochs = 20

[rollout]
{rollout}

[agent]
{agent}
learning_rate = 1e-3

[sweep]
sensors = {sensors}
steps = {steps}
online_windows = 8
online_runs = 16
member_runs = 3
network_runs = 15
log_replay_runs = 15
curve_points = 10

[sweep.grid]
learning_rate = {{ from = 1e-5, to = 1, per_decade = 2 }}
"""


def temperature(rows: int) -> float:
    """Returns the temperature of softmax weights with which the mean length of runs is `rows` rows.

    A state itself has distance 0, and four others have distance 1; the ensemble member lacks a fifth of these.
    """
    return 1 / math.log(0.8 * 4 * (rows - 1))


class Plant:
    def __init__(self, number: int, folder: Path, calib: str):
        self.number = number
        self.folder = folder
        self.calib = calib
        draw = random.Random(1400 + number)

        def even_log(low: float, high: float) -> float:
            return even_in_logarithm(draw, low, high)

        self.start = datetime(2022, draw.randint(1, 12), 1)
        self.plant = {"drift": even_log(0.3, 3), "noise": even_log(0.3, 3), "storms": even_log(1, 20)}
        self.task = {
            "optimiser": draw.choice(["adam", "sgd"]),
            "gamma": draw.choice([0.8, 0.9, 0.95]),
            "batch_size": round(even_log(4, 64)),
        } | draw.choice([{"value_function": "linear"}, {"hidden_units": 16}, {"hidden_units": 32}])
        self.steps = round(even_log(*STEPS))

    def outcome(self) -> dict:
        self.write_order()
        models = MODELS
        rollout = "steps = 1500\nrollouts = 3\ndtw_steps = 1000"
        study = self.write("study", models, rollout, 15)
        protocols.run(self.calib, study, "simulate")
        try:
            protocols.run(self.calib, study, "represent")
        except subprocess.CalledProcessError:
            # No candidate of the representation maps different states to different points.
            models = [name for name in MODELS if name != "laplacian"]
            study = self.write("study", models, rollout, 15)
            protocols.run(self.calib, study, "represent")
        protocols.run(self.calib, study, "build-model", "rollout")
        record = Record(self.folder / "results/models/k-3/model")
        measures = {name: self.of_rollouts(name, record) for name in models}
        rows = record.starts()
        count = FORECASTS * len(rows)
        forecast = f'steps = {max(HORIZONS)}\nrollouts = {count}\nstart = "rows"\nrows = {rows}\ndtw_steps = 0'
        protocols.run(self.calib, self.write("forecasts", models, forecast, count), "rollout")
        for name in models:
            measures[name] |= self.of_forecasts(name, record)
        protocols.run(self.calib, study, "sweep")
        outcome = self.of_sweeps(models, measures)
        shutil.rmtree(self.folder / "plant")
        shutil.rmtree(self.folder / "results")
        return outcome

    def write(self, name: str, models: list[str], rollout: str, network_rollouts: int) -> Path:
        path = self.folder / f"{name}.toml"
        path.write_text(STUDY.format(
            seed=1400 + self.number, models=json.dumps(models), plant=self.plant_text(), sensors=json.dumps(SENSORS),
            steps=self.steps, agent=self.task_text(), rollout=rollout, network_rollouts=network_rollouts,
            temperature_36=temperature(36), temperature_360=temperature(360),
        ))
        return path

    def plant_text(self) -> str:
        return PLANT.format(
            seed=1400 + self.number, start=day(self.start), end=day(self.start + timedelta(days=TRAINING_DAYS)),
            days=TRAINING_DAYS + HELD_OUT_DAYS, channels=CHANNELS, period_secs=PERIOD_SECS, **self.plant,
        )

    def task_text(self) -> str:
        return "\n".join(f"{key} = {json.dumps(value)}" for key, value in self.task.items())

    def write_order(self) -> None:
        """Writes the representation of the bootstraps: a random place on a square grid for each time of the training range."""
        import numpy as np
        import polars

        count = TRAINING_DAYS * 86400 // PERIOD_SECS
        times = [self.start + timedelta(seconds=PERIOD_SECS * place) for place in range(count)]
        order = np.random.default_rng(1400 + self.number).permutation(count)
        side = math.ceil(math.sqrt(count))
        frame = polars.DataFrame({"timestamp": times, "x": (order // side).astype(float), "y": (order % side).astype(float)})
        frame.write_parquet(self.folder / "order.parquet")

    def of_rollouts(self, name: str, record: "Record") -> dict[str, list[float]]:
        """Returns the measures of rollouts from random start states, and of their model, by sensor."""
        import polars

        folder = self.folder / "results/models" / name
        warping = polars.read_parquet(folder / "rollout/dtw.parquet")
        distances = polars.read_parquet(folder / "rollout/measures.parquet")
        trajectories = polars.read_parquet(folder / "rollout/trajectories.parquet")
        manifest = json.loads((folder / "rollout/manifest.json").read_text())
        collapse = {sensor["sensor"]: sensor for sensor in manifest["collapse"]["sensors"]}
        rollouts = trajectories.partition_by("member", "rollout")
        one_step = folder / "rollout/one_step.json"
        own_steps = json.loads(one_step.read_text())["sensors"] if one_step.exists() else []
        relative = {sensor["sensor"]: sensor["relative"] for sensor in own_steps}
        found = defaultdict(list)
        for sensor in SENSORS:
            of_sensor = warping.filter(polars.col("sensor") == sensor)
            for pattern in PATTERNS:
                values = of_sensor.filter(polars.col("step_pattern") == pattern)["normalized_distance"]
                found[f"dtw {pattern}"].append(mean_of_finite(values))
            for measure, column in DISTANCES.items():
                found[measure].append(mean_of_finite(distances.filter(polars.col("sensor") == sensor)[column]))
            frozen, escaped = collapse[sensor]["collapsed"], collapse[sensor]["escaped"]
            found["frozen"].append(frozen / len(rollouts))
            found["broken"].append(min(1.0, (frozen + escaped) / len(rollouts)))
            values = [rollout[f"{sensor}.normalised"].to_numpy() for rollout in rollouts]
            found["spectrum"].append(record.spectrum_distance(sensor, values))
            if relative:
                found[HINDSIGHT].append(math.inf if relative[sensor] is None else relative[sensor])
        members = json.loads((folder / "model/manifest.json").read_text())["members"]
        if "recurrence" in members[0]:
            mixing = [math.log(member["recurrence"].get("mixing_steps") or NO_MIXING) for member in members]
            few_rows = [-math.log(member["recurrence"].get("effective_rows") or 1) for member in members]
            departures = [member["jumps"]["departure_rate"] for member in members]
            for measure, values in {"mixing_steps": mixing, "few_rows": few_rows, "departures": departures}.items():
                found[measure] = [mean(values)] * len(SENSORS)
        return dict(found)

    def of_forecasts(self, name: str, record: "Record") -> dict[str, list[float]]:
        """Returns the measures of rollouts that start in listed rows, by sensor."""
        import numpy as np
        import polars

        folder = self.folder / "results/models" / name
        table = polars.scan_parquet(folder / "rollout/trajectories.parquet")
        if not name.startswith("network"):
            table = table.filter(polars.col("member") == record.last_block)
        columns = [polars.col(f"{sensor}.normalised").cast(polars.Float64) for sensor in SENSORS]
        table = table.filter(polars.col("step").is_in(HORIZONS)).select("wanted_row", "step", *columns).collect()
        found = {}
        for horizon in HORIZONS:
            scores = [[] for _ in SENSORS]
            squares = [[] for _ in SENSORS]
            changes = [[] for _ in SENSORS]
            for start in record.starts():
                own = table.filter((polars.col("step") == horizon) & (polars.col("wanted_row") == start))
                for place, sensor in enumerate(SENSORS):
                    # Rollouts that ended because a value was not finite have fewer rows.
                    values = own[f"{sensor}.normalised"].to_numpy()
                    truth = record.value(sensor, start + horizon)
                    whole = len(values) == FORECASTS and np.isfinite(values).all()
                    scores[place].append(energy_score(values, truth) if whole else math.inf)
                    noise = values.var(ddof=1) / FORECASTS if whole else 0.0
                    squares[place].append((values.mean() - truth) ** 2 - noise if whole else math.inf)
                    changes[place].append((record.value(sensor, start) - truth) ** 2)
            found[f"energy_{horizon}"] = [float(np.mean(own)) for own in scores]
            if horizon == 1:
                found["one_step"] = [
                    math.sqrt(max(sum(own), 0.0) / sum(change)) if sum(change) else 0.0 for own, change in zip(squares, changes)
                ]
        return found

    def of_sweeps(self, models: list[str], measures: dict) -> dict:
        import numpy as np
        import polars

        def read(name: str, table: str):
            return polars.read_parquet(self.folder / "results/models" / name / "sweep" / f"{table}.parquet")

        is_online = polars.col("environment") == "online"
        is_replay = polars.col("environment") == "log-replay"
        is_model = polars.col("environment").str.starts_with("member:")
        runs, curves = read("k-3", "runs"), read("k-3", "curves")
        replayed = mean_errors(runs.filter(is_replay))
        found = {}
        for name in models:
            own_runs, own_curves = read(name, "runs"), read(name, "curves")
            own = mean_errors(own_runs.filter(is_model))
            own_measures = measures[name] | {"curve": [], "profile": []}
            for place, sensor in enumerate(SENSORS):
                in_model = own_curves.filter(is_model & (polars.col("sensor") == sensor))
                on_log = curves.filter(is_replay & (polars.col("sensor") == sensor))
                curve = centred_difference(capped_means(in_model, "rmse"), capped_means(on_log, "rmse"))
                own_measures["curve"].append(curve)
                own_measures["profile"].append(centred_difference(own[place], replayed[place]))
            found[name] = {
                "errors": [None if errors is None else np.round(errors, 5).tolist() for errors in own],
                "measures": own_measures,
            }
        return {
            "task": self.plant | self.task | {"steps": self.steps, "start": day(self.start)},
            "windows": runs.filter(is_online)["start_row"].n_unique(),
            "truth": [np.round(errors, 5).tolist() for errors in mean_errors(runs.filter(is_online))],
            "not_capped": protocols.errors(runs.filter(is_online), SENSORS, RATES),
            "replay": [np.round(errors, 5).tolist() for errors in replayed],
            "models": found,
        }


class Record:
    """The training range of a plant, normalised."""

    def __init__(self, model: Path):
        import numpy as np
        import polars

        rows = polars.read_parquet(model / "rows.parquet")
        self.states = np.load(model / "states.npy")
        self.segments = rows["segment"].to_numpy()
        self.last_block = rows["block"].max()
        names = [column["name"] for column in json.loads((model / "manifest.json").read_text())["normaliser"]]
        self.columns = {sensor: names.index(sensor) for sensor in SENSORS}

    def value(self, sensor: str, place: int) -> float:
        return float(self.states[place, self.columns[sensor]])

    def starts(self) -> list[int]:
        """Returns evenly spaced states of the last tenth from which the record continues without gaps to the last horizon."""
        count = len(self.segments)
        last = max(HORIZONS)
        possible = [
            place for place in range(math.ceil(0.9 * count) + 1, count - last)
            if self.segments[place] == self.segments[place + last]
        ]
        chosen = min(STARTS, len(possible))
        return [possible[place * len(possible) // chosen] for place in range(chosen)]

    def spectrum_distance(self, sensor: str, rollouts: list) -> float:
        import numpy as np

        breaks = np.flatnonzero(np.diff(self.segments)) + 1
        recorded = spectrum(np.split(self.states[:, self.columns[sensor]], breaks))
        rolled = spectrum(rollouts)
        if rolled is None:
            return math.inf
        decibels = 10 * np.log10((rolled + NO_POWER) / (recorded + NO_POWER))
        return float(np.sqrt(np.mean(decibels**2)))


def mean_of_finite(values) -> float:
    """Returns the mean of the finite values; infinite if there are none."""
    finite = [value for value in values.to_list() if value is not None and math.isfinite(value)]
    return sum(finite) / len(finite) if finite else math.inf


def energy_score(values, truth: float) -> float:
    """Returns the continuous ranked probability score of one number, in the form that does not depend on the number of forecasts."""
    import numpy as np

    count = len(values)
    apart = np.abs(values[:, None] - values[None, :]).sum() / (2 * count * (count - 1))
    return float(np.abs(values - truth).mean() - apart)


def spectrum(series: list):
    """Returns the mean power by frequency over segments that overlap by half (Welch); None if all series are shorter than a segment."""
    import numpy as np

    window = np.hanning(SEGMENT + 1)[:-1]
    powers = []
    for values in series:
        values = np.asarray(values, dtype=float)
        for begin in range(0, len(values) - SEGMENT + 1, SEGMENT // 2):
            part = values[begin : begin + SEGMENT]
            powers.append(np.abs(np.fft.rfft((part - part.mean()) * window)[1:]) ** 2 / (window**2).sum())
    return np.mean(powers, axis=0) if powers else None


def capped_means(frame, column: str):
    """Returns the mean logarithm of the error over runs, `[rate, point]`, each at most `CAP` above the best rate's of its run and point.

    Runs have one point, and curves have the requested number. A point without any rate does not count; None if there is no other.
    """
    import numpy as np

    steps = {step: place for place, step in enumerate(sorted(set(frame["step"])))} if column == "rmse" else None
    places = {}
    for key in zip(frame["environment"], frame["run"]):
        places.setdefault(key, len(places))
    table = np.full((len(places), RATES, len(steps) if steps else 1), np.inf)
    points = frame["step"] if steps else [None] * len(frame)
    for environment, run, candidate, point, error in zip(
        frame["environment"], frame["run"], frame["candidate"], points, frame[column]
    ):
        if error is not None and math.isfinite(error):
            table[places[environment, run], candidate, steps[point] if steps else 0] = math.log(error)
    best = table.min(axis=1, keepdims=True)
    table = np.where(np.isfinite(best), np.minimum(table, best + CAP), np.nan)
    if not len(table) or np.isnan(table).all(axis=0).any():
        return None
    return np.nanmean(table, axis=0)


def mean_errors(runs) -> list:
    """Returns the mean logarithm of the error of each rate by sensor, of some rows of runs.parquet; None if every rate diverged in each run."""
    import polars

    tables = [capped_means(runs.filter(polars.col("sensor") == sensor), "nrmse") for sensor in SENSORS]
    return [None if table is None else table[:, 0] for table in tables]


def centred_difference(one, other) -> float:
    import numpy as np

    if one is None or other is None or one.shape != other.shape:
        return math.inf
    return float(np.sqrt(np.mean(((one - one.mean()) - (other - other.mean())) ** 2)))


def ranks(values: list[float]) -> list[float]:
    """Returns ranks from 1; ties share the average."""
    return [sum(other < value for other in values) + (sum(other == value for other in values) + 1) / 2 for value in values]


def spearman(one: list[float], other: list[float]) -> float:
    """Returns Spearman's correlation; 0 if one of the lists is constant."""
    left = [rank - (len(one) + 1) / 2 for rank in ranks(one)]
    right = [rank - (len(one) + 1) / 2 for rank in ranks(other)]
    size = math.sqrt(sum(value**2 for value in left) * sum(value**2 for value in right))
    return sum(a * b for a, b in zip(left, right)) / size if size else 0.0


class Pair:
    """A plant and a sensor, and the choices of its models."""

    def __init__(self, plant: dict, sensor: int):
        self.plant = plant["plant"]
        self.sensor = sensor
        truth = plant["truth"][sensor]
        not_capped = plant["not_capped"][sensor]
        self.models = plant["models"]
        self.random = mean(truth) - min(truth)
        self.replay = truth[smallest(plant["replay"][sensor])] - min(truth)
        self.regrets, self.not_capped, self.quality = {}, {}, {}
        for name, model in self.models.items():
            errors = model["errors"][sensor]
            if errors is None:
                self.regrets[name], self.not_capped[name], self.quality[name] = self.random, math.inf, 0.0
                continue
            chosen = smallest(errors)
            self.regrets[name] = truth[chosen] - min(truth)
            # If every rate diverged once, all rates are equally bad.
            is_known = math.isfinite(not_capped[chosen])
            self.not_capped[name] = not_capped[chosen] - min(not_capped) if is_known else math.inf
            self.quality[name] = spearman(errors, truth)

    def measured(self, measure: str, among: list[str] = MODELS) -> dict[str, float]:
        """Returns the measure by model, for the models that have it."""
        return {
            name: model["measures"][measure][self.sensor]
            for name, model in self.models.items()
            if measure in model["measures"] and name in among
        }

    def correlation(self, measure: str, badness: dict[str, float], among: list[str] = MODELS) -> float | None:
        """Returns the correlation; None if all models are equally bad, or fewer than four have the measure."""
        values = self.measured(measure, among)
        own = [badness[name] for name in values]
        if len(values) < 4 or len(set(own)) == 1:
            return None
        return spearman(list(values.values()), own)

    def of_smallest(self, measure: str) -> float | None:
        """Returns the regret of the model with the smallest measure."""
        values = self.measured(measure)
        if not values:
            return None
        return mean([self.regrets[name] for name, value in values.items() if value == min(values.values())])


def by_plant(pairs: list[Pair], value) -> dict[int, float]:
    """Returns the mean of `value(pair)` over the sensors for which it is not None."""
    found = defaultdict(list)
    for pair in pairs:
        own = value(pair)
        if own is not None:
            found[pair.plant].append(own)
    return {plant: mean(values) for plant, values in found.items()}


def pooled(pairs: list[Pair], measure: str) -> float:
    """Returns the correlation, over all pairs, of ranks within pairs with the regret that is not capped."""
    products = squares = other_squares = 0.0
    for pair in pairs:
        values = pair.measured(measure)
        own = [pair.not_capped[name] for name in values]
        if len(values) < 4 or len(set(own)) == 1:
            continue
        for one, other in zip(ranks(list(values.values())), ranks(own)):
            x, y = one / (len(own) + 1) - 0.5, other / (len(own) + 1) - 0.5
            products, squares, other_squares = products + x * y, squares + x * x, other_squares + y * y
    size = math.sqrt(squares * other_squares)
    return products / size if size else 0.0


def jackknife(pairs: list[Pair], measure: str) -> list[float]:
    """Returns the pseudo-values of `pooled`, by plant."""
    plants = sorted({pair.plant for pair in pairs})
    whole = pooled(pairs, measure)
    return [
        len(plants) * whole - (len(plants) - 1) * pooled([pair for pair in pairs if pair.plant != plant], measure)
        for plant in plants
    ]


def told(values) -> str:
    """Formats mean and interval of correlations."""
    if not values:
        return ""
    middle, low, high = interval(list(values))
    return f"{middle:.2f} ({low:.2f} to {high:.2f})"


def report(plants: list[dict]) -> None:
    pairs = [Pair(plant, sensor) for plant in plants for sensor in range(len(SENSORS))]
    equal = sum(len(set(pair.regrets.values())) == 1 for pair in pairs)
    unchosen = sum(model["errors"][pair.sensor] is None for pair in pairs for model in pair.models.values())
    print(f"{len(plants)} plants. In {equal} of {len(pairs)} pairs of plant and sensor all models have the same regret.")
    print(f"{unchosen} times a model made no choice. Held-out windows: {min(plant['windows'] for plant in plants)} or more.")

    def correlations(measure: str, among: list[str] = MODELS) -> dict[int, float]:
        return by_plant(pairs, lambda pair: pair.correlation(measure, pair.regrets, among))

    def with_quality(measure: str, among: list[str] = MODELS) -> dict[int, float]:
        return by_plant(pairs, lambda pair: pair.correlation(measure, {name: -own for name, own in pair.quality.items()}, among))

    useful = {}
    print("\nSpearman's correlation over models (95 % over plants): 1 where the model with the smaller measure always chooses better:\n")
    head("measure", "with regret", "minus that of DTW", "with minus the quality", "pooled, regret not capped", "models", "useful")
    for measure in MEASURES:
        own = correlations(measure)
        of_dtw = by_plant(pairs, lambda pair: pair.correlation(DTW, pair.regrets, list(pair.measured(measure))))
        beside = [value - of_dtw[plant] for plant, value in own.items()]
        is_candidate = measure not in (DTW, HINDSIGHT) and len(beside) > 1
        is_useful = is_candidate and interval(list(own.values()))[1] > 0.3 and interval(beside)[1] > 0
        if is_useful:
            useful[measure] = mean(list(own.values()))
        row(
            measure, told(own.values()), "" if measure == DTW else told(beside), told(with_quality(measure).values()),
            told(jackknife(pairs, measure)), max(len(pair.measured(measure)) for pair in pairs), "yes" if is_useful else "",
        )
    print(f"\nFirst in the report: {max(useful, key=useful.get)}" if useful else "\nNo measure is useful.")

    print("\nThe same with fewer models:\n")
    head("measure", *(f"{name}, {what}" for name in FEWER for what in ("with regret", "with minus the quality")))
    for measure in MEASURES:
        cells = [told(way(measure, among).values()) for among in FEWER.values() for way in (correlations, with_quality)]
        row(measure, *cells)

    print("\nTypical regret in % (95 % over plants), and the quotient of errors to those of the model with the smallest DTW:\n")
    head("choice of", "regret", "error / that by DTW")
    ways = {f"the model with the smallest {measure}": lambda pair, measure=measure: pair.of_smallest(measure) for measure in MEASURES}
    ways |= {
        "a random model": lambda pair: mean(list(pair.regrets.values())),
        "the best model in hindsight": lambda pair: min(pair.regrets.values()),
        "log replay": lambda pair: pair.replay,
        "a random rate": lambda pair: pair.random,
    }
    by_dtw = by_plant(pairs, lambda pair: pair.of_smallest(DTW))
    for name, way in ways.items():
        own = by_plant(pairs, way)
        row(name, typical_regret(list(own.values())), quotient([value - by_dtw[plant] for plant, value in own.items()]))

    print("\nModels, with medians of some measures over plants and sensors:\n")
    shown = [DTW, "frozen", "one_step", "energy_1", "energy_128", "spectrum", "curve"]
    head("model", "regret in %", "quality", *shown)
    for name in MODELS:
        own = [pair for pair in pairs if name in pair.models]
        if not own:
            continue
        medians = [sorted(pair.measured(measure)[name] for pair in own)[len(own) // 2] for measure in shown]
        regret = typical_regret(list(by_plant(own, lambda pair: pair.regrets[name]).values()))
        quality = told(by_plant(own, lambda pair: pair.quality[name]).values())
        row(name, regret, quality, *(f"{value:.3g}" for value in medians))
    report_noises(pairs)


def report_noises(pairs: list[Pair]) -> None:
    print("\nShares of a network's rollouts that freeze or escape, by its noise, in %: means over plants and sensors:\n")
    head("noise", "freeze", "escape", "freeze or escape", "plants where some escape")
    for noise, name in NOISES.items():
        own = [pair for pair in pairs if name in pair.models]
        if not own:
            continue
        frozen, broken = ([pair.measured(measure)[name] for pair in own] for measure in ("frozen", "broken"))
        escaped = [both - one for both, one in zip(broken, frozen)]
        plants = {pair.plant for pair, share in zip(own, escaped) if share > 0}
        shares = (f"{100 * mean(values):.1f}" for values in (frozen, escaped, broken))
        row(noise, *shares, f"{len(plants)} of {len({pair.plant for pair in own})}")


if __name__ == "__main__":
    protocols.make_and_report(
        __doc__, "measures.jsonl", 20, lambda number, folder, calib: Plant(number, folder, calib).outcome(), report
    )
