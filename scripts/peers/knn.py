"""Neighbour tables: calib-knn's exact join beside other packages, on the same arrays in the same run.

    python3 scripts/peers/knn.py [--data NAME ...] [--contenders NAME ...] [--budget SECS] [--limit SECS] [--plot FILE.svg]
    python3 scripts/peers/knn.py --kept FILE.json [--prepare | --within SECS | --show]     # piece by piece

The job is that of a calibration model: for every next state of a member the k = 3 nearest source states of the member,
other than the state itself. calib does it for all five members; a peer does it for member 0 alone (four fifths of the log),
so peers have the smaller job. calib-graph has the peers' job: the neighbours of member 0 alone. Every contender runs in a process of its own with --threads threads (scikit-learn's tree
has one).

Peers that would take longer than --budget seconds answer a sample of the queries; their query time is then extrapolated
and marked with ~. A contender that is not done after --limit seconds is ended and says so. Approximate peers are tuned
on the sample first (outside the measured time) to the cheapest setting of a doubling sequence with a recall of at least
0.99, or to the one from which on recall hardly grows (pynndescent: to the first whose graph takes more than --budget).

With --kept what was measured is written to a file as it comes and not measured again, so that a run can be stopped, cut into
pieces (--within) and shown (--show). --prepare makes the data sets and the truth only.

recall@3 is by true distances: of --sample queries, the share of neighbours that are no farther than the true third
neighbour, found by brute force in double precision. Memory is the peak of the whole process (VmHWM), with the states
mapped or loaded in it.

Data sets are made once and kept in --cache:
    plant-N     N rows x 142 sensors of the simulated plant, one every 10 s
    wells       raw sensors of wells (wants CALIB_DATA)        wells-traces  the same with exponential traces
    gaussian    independent, 100,000 x 142
    quantised   plant rows on a coarse grid, 30 % of them exact copies of others
    embedding   a smooth random map of plant rows to 64 dimensions, like a learned representation
    switching   binary, coarse and slow channels without common causes: neighbours in time are the nearest
"""

import argparse
import json
import os
import pathlib
import platform
import statistics
import subprocess
import sys
import time

import common
from knn_data import HERE, Data, step
from knn_plot import plot

PINNED = {
    "numpy": "2.4.6",
    "faiss-cpu": "1.15.1",
    "scikit-learn": "1.9.1",
    "hnswlib": "0.8.0",
    "pynndescent": "0.7.0",
}
K = 3
CONTENDERS = {
    "calib": "exact, five members",
    "calib-graph": "exact, one member, as all below",
    "faiss-flat": "exact",
    "faiss-ivf": "approximate",
    "faiss-hnsw": "approximate",
    "hnswlib": "approximate",
    "pynndescent": "approximate",
    "sklearn-kdtree": "exact, one thread",
    "kiddo": "exact",
}
NEEDS = {
    "faiss-flat": "faiss-cpu", "faiss-ivf": "faiss-cpu", "faiss-hnsw": "faiss-cpu", "hnswlib": "hnswlib",
    "pynndescent": "pynndescent", "sklearn-kdtree": "scikit-learn",
}
DATA = ("plant-400000", "plant-3200000", "wells", "wells-traces", "gaussian", "quantised", "embedding", "switching")


def run(contender, python, program, path, rows, queries, truth, options):
    """Returns one contender's result, or a text with the reason why there is none."""
    out = pathlib.Path(options.cache) / f"found-{contender}.npy"
    own = {"calib": "calib", "calib-graph": "graph", "kiddo": "kiddo"}.get(contender)
    if own:
        command = [program, own, path, rows, queries, out, K]
        command += [options.budget] if own == "kiddo" else []
    else:
        command = [python, HERE / "knn_peers.py", contender, path, rows, queries, out, options.budget, options.threads, truth]
    try:
        done = subprocess.run(
            [str(part) for part in command], env=common.threads(options.threads), capture_output=True, text=True,
            timeout=options.limit,
        )
    except subprocess.TimeoutExpired:
        return f"not done after {options.limit:g} s"
    if done.returncode != 0:
        return (done.stderr.strip().splitlines() or [f"exit {done.returncode}"])[-1]
    result = json.loads(next(line for line in done.stdout.splitlines() if line.startswith("{")))
    result["recall"] = float(step(python, "recall", path, rows, queries, truth, out)[0])
    out.unlink()
    whole = rows - 1 - ((rows - 1) // 5 + 1)  # transitions of ensemble member 0 of five
    result["sampled"] = result["answered"] < whole
    result["whole"] = result["query"] * whole / min(result["answered"], whole)
    result["total"] = result["build"] + result["whole"]
    return result


def table(name, shape, results):
    """Prints one line per contender, with medians over the rounds."""
    print(f"\n{name}: {shape[0]:,} x {shape[1]}")
    print(f"  {'':16}{'build s':>9}{'query s':>11}{'total s':>11}{'recall@3':>10}{'peak MB':>9}{'x calib':>9}  what")
    ours = [result["total"] for result in results.get("calib", []) if not isinstance(result, str)]
    times = {}
    for contender, runs in results.items():
        failed = next((result for result in runs if isinstance(result, str)), None)
        if failed:
            print(f"  {contender:16}{failed}")
            continue
        middle = {key: statistics.median(result[key] for result in runs) for key in ("build", "whole", "total", "recall")}
        times[contender] = middle["total"]
        peak = max(result["peak_kib"] for result in runs) / 1024
        ratio = statistics.median(r["total"] / mine for r, mine in zip(runs, ours)) if ours else float("nan")
        mark = "~" if runs[0]["sampled"] else ""
        setting = runs[0].get("setting")
        what = CONTENDERS[contender] + (f", at {setting}" if setting else "") + (
            f", {runs[0]['answered']:,} queries extrapolated" if mark else "")
        print(f"  {contender:16}{middle['build']:9.2f}{mark + format(middle['whole'], '.2f'):>11}"
              f"{mark + format(middle['total'], '.2f'):>11}{middle['recall']:10.4f}{peak:9.0f}{ratio:9.1f}  {what}")
    sys.stdout.flush()
    return times


class Kept:
    """Measurements by data set, contender and round, in a file if one is given."""

    def __init__(self, path, within):
        self.path, self.end = path and pathlib.Path(path), time.monotonic() + within
        self.rows = json.loads(self.path.read_text()) if self.path and self.path.exists() else {}

    def get(self, key, measure):
        """Returns the result of this key; None if it is unknown and no time is left."""
        if key not in self.rows:
            if time.monotonic() > self.end:
                return None
            print(f"measuring {key}", file=sys.stderr)
            self.rows[key] = {"result": measure(), "commit": common.commit(), "machine": common.machine()}
            if self.path:
                part = self.path.with_suffix(".part")
                part.write_text(json.dumps(self.rows, indent=1))
                part.rename(self.path)
        return self.rows[key]["result"]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", nargs="+", default=list(DATA), metavar="NAME", help=f"default: {' '.join(DATA)}; plant-N for any N")
    parser.add_argument("--rows", type=int, help="only as many rows of every set")
    parser.add_argument("--contenders", nargs="+", default=list(CONTENDERS), choices=list(CONTENDERS), metavar="NAME", help=", ".join(CONTENDERS))
    parser.add_argument("--budget", type=float, default=60, help="seconds of queries after which a peer's are extrapolated (60)")
    parser.add_argument("--limit", type=float, default=1800, help="seconds after which a contender is ended (1800)")
    parser.add_argument("--rounds", type=int, default=1, help="rounds of all contenders, of which medians are shown (1)")
    parser.add_argument("--threads", type=int, default=os.cpu_count(), help="threads of every contender (all)")
    parser.add_argument("--sample", type=int, default=400, help="queries that recall is measured on (400)")
    parser.add_argument("--cache", default=str(common.target() / "peers" / "knn-data"), help="folder of the data sets")
    parser.add_argument("--calib", default=str(common.target() / "release" / "calib"), help="the program that reads the wells' logs")
    parser.add_argument("--plot", metavar="FILE.svg", help="draw time against rows of the plant sets")
    parser.add_argument("--kept", metavar="FILE.json", help="keep what was measured there, and measure only what it lacks")
    parser.add_argument("--within", type=float, default=float("inf"), help="begin no measurement after so many seconds")
    parser.add_argument("--prepare", action="store_true", help="only make data sets and truth")
    parser.add_argument("--show", action="store_true", help="only show what is kept")
    options = parser.parse_args()
    program = common.build("calib-knn", "knn_peers")
    python, installed = common.environment("knn", PINNED)
    data = Data(python, options.cache, options.calib)
    contenders = [name for name in options.contenders if NEEDS.get(name, "numpy") in installed]
    print(f"{common.machine()}, {options.threads} threads a contender, {options.rounds} rounds, commit {common.commit()}")
    print(", ".join(f"{name} {PINNED[name]}" for name in installed) + f", Python {platform.python_version()}, kiddo as in Cargo.lock")
    print("calib: tables of all five members; peers: those of one. ~: extrapolated from a sample of the queries")
    # The longest plant comes first, because shorter ones are its beginning.
    plants = sorted((name for name in options.data if name.startswith("plant-")), key=lambda name: -int(name.split("-")[1]))
    for name in plants:
        data.get(name, options.rows)
    curves, kept = {}, Kept(options.kept, 0 if options.show else options.within)
    for name in options.data:
        try:
            path, rows = data.get(name, options.rows)
        except LookupError as error:
            print(f"\n{name}: skipped: {error}")
            continue
        queries, truth = data.truth(path, rows, options.sample)
        if options.prepare:
            continue
        results = {contender: [] for contender in contenders}
        for number in range(options.rounds):
            for contender in contenders:
                if any(isinstance(result, str) for result in results[contender]):
                    continue
                measure = lambda: run(contender, python, program, path, rows, queries, truth, options)
                result = kept.get(f"{name}/{rows}/{options.threads}/{contender}/{number}", measure)
                results[contender] += [] if result is None else [result]
        results = {contender: runs for contender, runs in results.items() if runs}
        times = table(name, (rows, int(step(python, "shape", path)[1])), results)
        if name in plants:
            for contender, seconds in times.items():
                curves.setdefault(contender, []).append((rows, seconds))
    if options.plot:
        plot(options.plot, curves)
        print(f"\nwrote {options.plot}")
    return None


if __name__ == "__main__":
    sys.exit(main())
