"""What dividing a sweep costs: plan, start, merge; predicted against actual cost; two workers against one; a shard's start on a large model.

    python3 scripts/cluster/measure.py [CALIB] [--only NAME] [--days DAYS] [--period SECONDS]

Times are processor times of calib where the machine may have other work, and wall times are said to be such.
"""

import argparse
import json
import resource
import statistics
import subprocess
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

STUDY = """
seed = 3
[simulate]
days = {days}
channels = {channels}
period_secs = {period}
[data]
path = "data"
train_fraction = 0.9
[preprocess]
fill_limit = 5
[agent]
value_function = "{function}"
hidden_units = {units}
gamma = 0.9
batch_size = {batch}
[sweep]
sensors = ["PIT300", "TIT101"]
steps = {steps}
online_runs = {online}
member_runs = {members}
log_replay_runs = {online}
curve_points = 10
[sweep.grid]
learning_rate = [1e-4, 1e-3, 1e-2]
"""
SMALL = dict(days=3, channels=12, period=60, function="linear", units=32, batch=16, steps=60, online=250, members=900)
# Agents with nine tenths of the size of the paper's, in a plant with fewer channels.
AGENTS = dict(days=3, channels=64, period=60, function="mlp", units=256, batch=256, steps=700, online=4, members=2)


class Calib:
    def __init__(self, program, folder):
        self.program, self.folder = program, Path(folder)

    def study(self, **of):
        (self.folder / "study.toml").write_text(STUDY.format(**of))
        self("simulate", "study.toml")
        self("build-model", "study.toml")

    def __call__(self, *words):
        """Runs the command; returns processor seconds, wall seconds, and its output."""
        before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
        done = subprocess.run([self.program, "-q", *words], cwd=self.folder, capture_output=True, text=True)
        if done.returncode not in (0, 1):
            raise SystemExit(f"calib {' '.join(words)}: {done.returncode}\n{done.stderr}")
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        used = (after.ru_utime + after.ru_stime) - (before.ru_utime + before.ru_stime)
        return used, time.monotonic() - begun, done.stdout

    def plan(self, name, shards):
        used, wall, told = self("cluster", "plan", "study.toml", "--shards", str(shards), "-o", name, "--json")
        return used, wall, json.loads(told)

    def shard(self, plan, number):
        return self("--threads", "1", "cluster", "run", plan, "--shard", str(number))


def overhead(calib):
    calib.study(**SMALL)
    planned, wall, told = calib.plan("plan", 20)
    print(f"{told['units']} units in {told['shards']} shards: plan {planned:.1f} s of a processor ({wall:.1f} s wall, with timing some steps)")
    runs = [calib.shard("plan", number)[0] for number in range(told["shards"])]
    again = [calib.shard("plan", number)[0] for number in range(5)]
    merged, wall, _ = calib("cluster", "merge", "plan")
    print(f"shards {sum(runs):.1f} s in all with {told['units']} runs of 60 steps; a start that finds all done {statistics.median(again):.3f} s; merge {merged:.1f} s ({wall:.1f} s wall)")
    print(f"plan, shards and merge without any credit for the runs: {(planned + sum(runs) + merged) / told['units'] * 1000:.1f} ms a unit")


def prediction(calib):
    calib.study(**AGENTS)
    _, _, told = calib.plan("plan", 8)
    for number in range(told["shards"]):
        calib.shard("plan", number)
    errors, ratios = [], []
    for path in sorted((calib.folder / "plan/shards").glob("*.attempts/*.json")):
        for made in json.loads(path.read_text())["made"]:
            ratios.append(made["predicted_secs"] / made["secs"])
            errors.append(abs(ratios[-1] - 1))
    print(f"{len(errors)} passes: predicted / actual, median {statistics.median(ratios):.2f}; median error {100 * statistics.median(errors):.0f} %")


def workers(calib):
    calib.study(**AGENTS)
    used = {}
    for rounds in range(2):
        for count in (1, 2):
            name = f"plan-{rounds}-{count}"
            _, _, told = calib.plan(name, 8)
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            begun = time.monotonic()
            with ThreadPoolExecutor(count) as pool:
                list(pool.map(lambda number: calib.shard(name, number), range(told["shards"])))
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            secs = (after.ru_utime + after.ru_stime) - (before.ru_utime + before.ru_stime)
            used.setdefault(count, []).append(secs)
            print(f"{count} workers: {secs:.1f} s of processors, {time.monotonic() - begun:.1f} s wall")
    print(f"the same work takes {sum(used[2]) / sum(used[1]):.2f} x the processor time with two workers")


def start(calib, days, period):
    calib.study(**{**AGENTS, "days": days, "channels": 480, "period": period, "steps": 300, "online": 1, "members": 1})
    manifest = json.loads((calib.folder / "study-results/model/manifest.json").read_text())
    _, _, told = calib.plan("plan", 1000)
    size = sum(path.stat().st_size for path in (calib.folder / "plan/inputs/0").rglob("*") if path.is_file())
    print(f"a model of {manifest['rows']} rows, {size / 1e9:.1f} GB of inputs, {told['shards']} shards")
    for number in range(4):
        used, wall, _ = calib.shard("plan", number)
        [path] = (calib.folder / f"plan/shards/{number:04d}.attempts").glob("*.json")
        [made] = json.loads(path.read_text())["made"]
        print(f"shard {number}: {used:.2f} s of a processor, {wall:.2f} s wall, of which {made['secs']:.2f} s its pass: start and end {wall - made['secs']:.2f} s")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    root = Path(__file__).resolve().parents[2]
    parser.add_argument("calib", nargs="?", default=root / "target/release/calib", type=Path)
    parser.add_argument("--only")
    parser.add_argument("--days", type=float, default=365)
    parser.add_argument("--period", type=int, default=60, help="seconds between rows of the year")
    options = parser.parse_args()
    for measure in (overhead, prediction, workers, lambda calib: start(calib, options.days, options.period)):
        name = getattr(measure, "__name__", "")
        name = "start" if name == "<lambda>" else name
        if options.only in (None, name):
            with tempfile.TemporaryDirectory() as folder:
                print(f"== {name}")
                measure(Calib(options.calib.resolve(), folder))


if __name__ == "__main__":
    main()
