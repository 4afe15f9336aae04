"""Intervals over start states and comparisons of models, recomputed with NumPy and SciPy from what a small run wrote.

    python3 -m pip install numpy==2.4.6 scipy==1.17.1 polars==2.1.0
    python3 scripts/golden/clusters.py target/release/calib > crates/calib-stats/tests/clusters.json

The run is one of two neighbour models and a network on a simulated plant with two deployments. Every mean, interval and difference that it
wrote is compared with the recomputed one; a difference ends the script with an error. What it prints are some of them, with the
distances they follow from: reference values for crates/calib-stats/tests/it/clusters.rs.
"""

import json
import pathlib
import subprocess
import sys
import tempfile

import numpy as np
import polars as pl
from scipy import stats

STUDY = """
seed = 3
simulate = { days = 3, channels = 12, period_secs = 60, gaps_per_day = 2 }
data = { path = "data", train = { end = 2022-11-03 } }
preprocess = { fill_limit = 5 }
model = { members = 3, exclude_self = true }
rollout = { steps = 400, rollouts = 6, start = "nearest", dtw_steps = 300 }
agent = { value_function = "linear", gamma = 0.9, batch_size = 16 }

[sweep]
sensors = ["PIT300", "TIT101"]
steps = 500
online_runs = 1
member_runs = 1
log_replay_runs = 1
grid = { learning_rate = [1e-3, 1e-2] }

[models]
one = { model = { neighbors = 1 } }
three = {}
network = { model = { kind = "nn" }, dynamics = { hidden_units = 16, epochs = 2 } }

[deployments]
near = { start = 2022-11-03, end = 2022-11-03T12:00:00 }
far = { start = 2022-11-03T12:00:00, end = 2022-11-04 }
"""
MEASURES = ["wasserstein", "wasserstein_increments", "autocorrelation_distance", "spectral_distance", "time_warp_edit"]
MODELS, DEPLOYMENTS, SENSORS = ["network", "one", "three"], ["near", "far"], ["PIT300", "TIT101"]
BLOCKS = 16
checked = 0


def close(got, expected, what):
    """Whether both are missing, or equal except for rounding."""
    global checked
    checked += 1
    if (got is None) != (expected is None):
        sys.exit(f"{what}: calib wrote {got}, NumPy has {expected}")
    if got is not None and not np.isclose(got, expected, rtol=1e-9, atol=1e-12):
        sys.exit(f"{what}: calib wrote {got}, NumPy has {expected}")


def t_interval(means):
    """Returns SciPy's t-interval of the mean; None for fewer than two values."""
    if len(means) < 2:
        return None
    error = stats.sem(means)
    if error == 0:
        return [means.mean()] * 2
    return [float(end) for end in stats.t.interval(0.95, len(means) - 1, loc=means.mean(), scale=error)]


def means_of(starts, values):
    """Returns the mean of each start state's values."""
    return np.array([values[starts == start].mean() for start in np.unique(starts)])


def check_interval(written, expected, what):
    ends = (None, None) if expected is None else expected
    got = (None, None) if written is None else (written["low"], written["high"])
    for number in range(2):
        close(got[number], ends[number], f"{what}, interval")


def check_summary(written, starts, values, what):
    """Checks the mean over start states of the means over their rollouts."""
    means = means_of(starts, values)
    assert (written["runs"], written["clusters"]) == (len(values), len(means)), what
    close(written["mean"], means.mean(), what)
    close(written["std"], means.std(ddof=1) if len(means) > 1 else None, what)
    check_interval(written["interval"], t_interval(means), what)
    return {"mean": means.mean(), "interval": t_interval(means)}


def paired(one, other, members):
    """Returns one difference per start state: between equal members, or between means over members."""
    differences = []
    for start in sorted(set(one["start"]) & set(other["start"])):
        own, others = (of.filter(pl.col("start") == start) for of in (one, other))
        same = own.join(others, on=["member", "rollout"], suffix="_other")
        if members and len(same):
            differences.append((same["value"] - same["value_other"]).mean())
        else:
            differences.append(own["value"].mean() - others["value"].mean())
    return np.array(differences)


def check_difference(written, one, other, members, what):
    differences = paired(one, other, members)
    close(written["mean"], differences.mean(), what)
    check_interval(written["interval"], t_interval(differences), what)
    assert written["clusters"] == [len(differences)] * 2, what
    assert written["smaller"] == [int((differences < 0).sum()), int((differences > 0).sum())], what
    return {"mean": differences.mean(), "interval": t_interval(differences), "smaller": written["smaller"]}


def ratio_of(x, y):
    """Returns RMSE of x / RMSE of y, with the interval of its logarithm over stretches of time."""
    ratio = np.sqrt(x.sum() / y.sum())
    cuts = [number * len(x) // BLOCKS for number in range(BLOCKS + 1)]
    z = np.array([0.5 * BLOCKS * (x[a:b].sum() / x.sum() - y[a:b].sum() / y.sum()) for a, b in zip(cuts, cuts[1:])])
    half = stats.t.ppf(0.975, BLOCKS - 1) * z.std(ddof=1) / np.sqrt(BLOCKS)
    return ratio, [ratio * np.exp(-half), ratio * np.exp(half)]


def check_ratio(written, x, y, what):
    ratio, interval = ratio_of(x, y)
    close(written["ratio"], ratio, what)
    check_interval(written["interval"], interval, what)
    assert written["smaller"] == [int((x < y).sum()), int((x > y).sum())], what
    return {"ratio": ratio, "interval": interval, "smaller": written["smaller"]}


def distances(results, model, deployments, sensor):
    """Returns one table per kind of distance, with its name in summaries: start, member, rollout, value. Missing values are left out."""
    found = {}
    for deployment in deployments:
        directory = results / "models" / model / "deployments" / deployment / "rollout"
        dtw, others = pl.read_parquet(directory / "dtw.parquet"), pl.read_parquet(directory / "measures.parquet")
        for (pattern,), rows in dtw.filter(sensor=sensor).group_by("step_pattern", maintain_order=True):
            for kind in ("distance", "normalized_distance"):
                found.setdefault((pattern, kind), []).append(rows.rename({kind: "value"}))
        for measure in MEASURES:
            found.setdefault((measure, "value"), []).append(others.filter(sensor=sensor).rename({measure: "value"}))
    columns = [pl.col("wanted_timestamp").alias("start"), "member", "rollout", "value"]
    return {name: pl.concat([rows.select(columns) for rows in all]).drop_nulls("value") for name, all in found.items()}


def written_of(sensor):
    """Returns all numbers of a sensor's entry, by the same names."""
    of = {(entry["step_pattern"], kind): entry[kind] for entry in sensor["dtw"] for kind in ("distance", "normalized_distance")}
    return of | {(entry["measure"], "value"): entry["value"] for entry in sensor["measures"]}


def by_name(entries, sensor):
    return next(entry for entry in entries if entry["sensor"] == sensor)


def steps_of(results, model, deployment, sensor):
    directory = results / "models" / model / "deployments" / deployment / "rollout"
    steps = pl.read_parquet(directory / "one_step.parquet")
    own = steps.filter(pl.col("sensor").is_null() if sensor is None else pl.col("sensor") == sensor)
    return own["squared_error"].to_numpy(), own["no_change_squared_error"].to_numpy()


def check_model(results, model, deployment, golden):
    directory = results / "models" / model / "deployments" / deployment / "rollout"
    comparison = json.loads((directory / "manifest.json").read_text())["comparison"]
    for sensor in SENSORS:
        tables, of = distances(results, model, [deployment], sensor), written_of(by_name(comparison["sensors"], sensor))
        assert of.keys() == tables.keys()
        for name, table in tables.items():
            starts, values = table["start"].to_numpy(), table["value"].to_numpy()
            what = f"{model}, {deployment}, {sensor}, {name}"
            expected = check_summary(of[name], starts, values, what)
            if name == ("symmetric2", "distance"):
                places = [int(place) for place in np.unique(starts, return_inverse=True)[1]]
                golden["summaries"].append({"clusters": places, "runs": values.tolist()} | expected)
    one_step = json.loads((directory / "one_step.json").read_text())
    for sensor, entry in [(None, one_step["all_columns"])] + [(entry["sensor"], entry) for entry in one_step["sensors"]]:
        errors, of_no_change = steps_of(results, model, deployment, sensor)
        what = f"{model}, {deployment}, {sensor}, one step"
        close(entry["rmse"], np.sqrt(errors.mean()), what)
        ratio, interval = ratio_of(errors, of_no_change)
        close(entry["relative"], ratio, what)
        check_interval(entry["relative_interval"], interval, what)


def check_pair(results, entry, golden):
    models, members = entry["models"], "network" not in entry["models"]
    for sensor in SENSORS:
        one, other = (distances(results, model, entry["deployments"], sensor) for model in models)
        of = written_of(by_name(entry["sensors"], sensor))
        for name in one:
            what = f"{models}, {entry['deployments']}, {sensor}, {name}"
            expected = check_difference(of[name], one[name], other[name], members, what)
            if name == ("symmetric2", "distance") and members and len(entry["deployments"]) == 1:
                both = one[name].join(other[name], on=["start", "member", "rollout"], suffix="_other")
                places = [int(place) for place in np.unique(both["start"].to_numpy(), return_inverse=True)[1]]
                x, y = both["value"].to_list(), both["value_other"].to_list()
                golden["differences"].append({"clusters": places, "x": x, "y": y} | expected)


def check_errors(results, entry, golden):
    (deployment,) = entry["deployments"]
    ratios = [(None, entry["all_columns"])] + [(of["sensor"], of["ratio"]) for of in entry["sensors"]]
    for sensor, written in ratios:
        x, y = (steps_of(results, model, deployment, sensor)[0] for model in entry["models"])
        check_ratio(written, x, y, f"{entry['models']}, {deployment}, {sensor}, one step")
        if sensor is None and deployment == "near":
            x, y = x[::7], y[::7]
            ratio, interval = ratio_of(x, y)
            golden["ratios"].append({"x": x.tolist(), "y": y.tolist(), "ratio": ratio, "interval": interval})


def main(calib):
    golden = {"summaries": [], "differences": [], "welch": [], "ratios": []}
    with tempfile.TemporaryDirectory() as place:
        study = pathlib.Path(place) / "study.toml"
        study.write_text(STUDY)
        ran = subprocess.run([calib, "run", "-q", study], stdout=subprocess.DEVNULL)
        assert ran.returncode in (0, 1)
        results = study.parent / "study-results"
        summary = json.loads((results / "evaluate" / "summary.json").read_text())
        for model in MODELS:
            for deployment in DEPLOYMENTS:
                check_model(results, model, deployment, golden)
        # Three pairs of models in each deployment and in both together;
        # one-step errors in each deployment.
        assert len(summary["comparisons"]["rollouts"]) == 9 and len(summary["comparisons"]["one_step"]) == 6
        for entry in summary["comparisons"]["rollouts"]:
            check_pair(results, entry, golden)
        for entry in summary["comparisons"]["one_step"]:
            check_errors(results, entry, golden)
    # Samples without common start states, by SciPy's test with unequal variances.
    summaries = golden["summaries"]
    for x, y in zip(summaries, summaries[2:]):
        means = [means_of(np.array(of["clusters"]), np.array(of["runs"])) for of in (x, y)]
        interval = stats.ttest_ind(*means, equal_var=False).confidence_interval(0.95)
        golden["welch"].append({"mean": means[0].mean() - means[1].mean(), "interval": [interval.low, interval.high]})
    print(f"{checked} numbers agree", file=sys.stderr)
    json.dump(golden, sys.stdout, indent=1)
    print()


main(pathlib.Path(sys.argv[1]).resolve())
