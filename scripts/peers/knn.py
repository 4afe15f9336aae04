"""Neighbour tables: calib-knn's exact join beside other packages, on the same arrays in the same run.

    python3 scripts/peers/knn.py [--data NAME ...] [--contenders NAME ...] [--budget SECS] [--limit SECS] [--plot FILE.svg]

The job is that of a calibration model: for every next state of a member the k = 3 nearest source states of the member,
other than the state itself. calib does it for all five members; a peer does it for member 0 alone (four fifths of the log),
so peers have the smaller job. Every contender runs in a process of its own with --threads threads (scikit-learn's tree
has one).

Peers that would take longer than --budget seconds answer a sample of the queries; their query time is then extrapolated
and marked with ~. A contender that is not done after --limit seconds is ended and says so. Approximate peers are tuned
on the sample first (outside the measured time) to the cheapest setting of a doubling sequence with a recall of at least
0.99, or to the one from which on recall hardly grows (pynndescent: to the last whose graph takes less than --budget).

recall@3 is by true distances: of --sample queries, the share of neighbours that are no farther than the true third
neighbour, found by brute force in double precision. Memory is the peak of the whole process (VmHWM), with the states
mapped or loaded in it.

Data sets are made once and kept in --cache:
    plant-N     N rows x 142 sensors of the simulated plant, one every 10 s
    wells       raw sensors of wells (wants CALIB_DATA)        wells-traces  the same with exponential traces
    gaussian    independent, 100,000 x 142
    quantised   plant rows on a coarse grid, 30 % of them exact copies of others
    embedding   a smooth random map of plant rows to 64 dimensions, like a learned representation
"""

import argparse
import json
import os
import pathlib
import platform
import shutil
import statistics
import subprocess
import sys
import time

import common

PINNED = {
    "numpy": "2.4.6",
    "faiss-cpu": "1.15.1",
    "scikit-learn": "1.9.1",
    "hnswlib": "0.8.0",
    "pynndescent": "0.7.0",
}
K = 3
RECALL = 0.99
CONTENDERS = {
    "calib": "exact, five members",
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
DATA = ("plant-400000", "plant-3200000", "wells", "wells-traces", "gaussian", "quantised", "embedding")


# ---- peers, each in a process of its own --------------------------------------------------------


def member_sources(rows):
    """Member 0 of five: its sources; each one's next row is a query."""
    return (rows - 1) // 5 + 1, rows - 1


def recall(states, queries, found, true_squared):
    """Share of true neighbours among K found rows a query; a row counts once, and never as its own."""
    import numpy as np

    hits = 0
    for query, rows, worst in zip(queries, found, true_squared):
        rows = {int(row) for row in rows[:K] if row >= 0 and row != query}
        lo, hi = member_sources(len(states))
        near = states[sorted(row for row in rows if lo <= row < hi)].astype(np.float64)
        squared = ((near - states[query].astype(np.float64)) ** 2).sum(1)
        hits += int((squared <= worst * (1 + 1e-6) + 1e-12).sum())
    return hits / (K * len(queries))


class Flat:
    settings = (None,)

    def build(self, sources, threads):
        import faiss

        faiss.omp_set_num_threads(threads)
        self.index = faiss.IndexFlatL2(sources.shape[1])
        self.index.add(sources)

    def tune(self, setting):
        pass

    def search(self, queries):
        return self.index.search(queries, K + 1)[1]


class Ivf(Flat):
    settings = tuple(2**power for power in range(11))

    def build(self, sources, threads):
        import faiss

        faiss.omp_set_num_threads(threads)
        lists = max(16, int(4 * len(sources) ** 0.5))
        self.quantizer = faiss.IndexFlatL2(sources.shape[1])
        self.index = faiss.IndexIVFFlat(self.quantizer, sources.shape[1], lists)
        self.index.cp.min_points_per_centroid = 1
        self.index.cp.niter = 10
        self.index.train(sources[:: max(1, len(sources) // (40 * lists))])
        self.index.add(sources)

    def tune(self, setting):
        self.index.nprobe = setting


class FaissHnsw(Flat):
    settings = tuple(2**power for power in range(4, 12))

    def build(self, sources, threads):
        import faiss

        faiss.omp_set_num_threads(threads)
        self.index = faiss.IndexHNSWFlat(sources.shape[1], 32)
        self.index.hnsw.efConstruction = 100
        self.index.add(sources)

    def tune(self, setting):
        self.index.hnsw.efSearch = setting


class Hnswlib:
    settings = tuple(2**power for power in range(4, 12))

    def build(self, sources, threads):
        import hnswlib

        self.threads = threads
        self.index = hnswlib.Index(space="l2", dim=sources.shape[1])
        self.index.init_index(max_elements=len(sources), ef_construction=200, M=32)
        self.index.add_items(sources, num_threads=threads)

    def tune(self, setting):
        self.index.set_ef(setting)

    def search(self, queries):
        return self.index.knn_query(queries, k=K + 1, num_threads=self.threads)[0]


class Tree:
    settings = (None,)

    def build(self, sources, threads):
        from sklearn.neighbors import KDTree

        self.tree = KDTree(sources)

    def tune(self, setting):
        pass

    def search(self, queries):
        return self.tree.query(queries, k=K + 1, return_distance=False)


class Descent:
    """Its graph of all rows is the answer: nothing is left to search."""

    settings = (15, 30, 60)

    def build(self, sources, threads):
        pass

    def graph(self, rows, neighbors, threads):
        from pynndescent import NNDescent

        return NNDescent(rows, n_neighbors=neighbors, n_jobs=threads, random_state=1).neighbor_graph[0]


PEERS = {
    "faiss-flat": Flat, "faiss-ivf": Ivf, "faiss-hnsw": FaissHnsw, "hnswlib": Hnswlib, "sklearn-kdtree": Tree,
}


def answer(peer, states, base, queries, budget):
    """Answers in the order of `queries`, in growing batches, until all are done or the budget is spent."""
    import numpy as np

    found, seconds, done, batch = [], 0.0, 0, 256
    while done < len(queries) and seconds < budget:
        rows = np.sort(queries[done : done + batch])
        states_of = np.ascontiguousarray(states[rows])
        clock = time.perf_counter()
        ids = peer.search(states_of)
        seconds += time.perf_counter() - clock
        answers = np.empty((len(rows), K), np.int64)
        for row, (ids_of, query) in enumerate(zip(ids, rows)):
            others = ids_of[(ids_of >= 0) & (ids_of + base != query)][:K]
            answers[row] = np.pad(others + base, (0, K - len(others)), constant_values=-1)
        order = np.argsort(np.argsort(queries[done : done + batch], kind="stable"), kind="stable")
        found.append(answers[order])
        done += len(rows)
        fits = int((budget - seconds) * done / max(seconds, 1e-9))
        batch = max(64, min(max(2 * batch, 1 << 16 if done > 4096 else 0), fits))
    return np.concatenate(found), seconds


def tune(peer, states, base, sample, truth, budget):
    """The cheapest setting with the recall that is asked for, or the one from which on recall hardly grows."""
    best, kept = -1.0, None
    for setting in peer.settings:
        peer.tune(setting)
        if setting is None:
            return None
        found = answer(peer, states, base, sample, budget)[0]
        reached = recall(states, sample[: len(found)], found, truth)
        if reached < best + 1e-3 and best > 0.9:
            break
        best, kept = reached, setting
        if reached >= RECALL:
            break
    peer.tune(kept)
    return kept


def worker(name, file, rows, queries, out, budget, threads, truth):
    import numpy as np

    states = np.load(file, mmap_mode="r")[:rows]
    queries, truth = np.load(queries)[:, 0].astype(np.int64), np.load(truth)
    sample = queries[: len(truth)]
    lo, hi = member_sources(rows)
    if name == "pynndescent":
        peer = Descent()
        peer.graph(np.random.default_rng(1).normal(size=(2000, states.shape[1])).astype(np.float32), 15, threads)  # compiles
        table = np.ascontiguousarray(states[lo : hi + 1])
        for setting in peer.settings:
            clock = time.perf_counter()
            graph = peer.graph(table, setting, threads)
            build = time.perf_counter() - clock
            found = np.array([[i + lo for i in graph[query - lo] if i + lo not in (query, hi)][:K] for query in sample])
            if recall(states, sample, found, truth) >= RECALL or build > budget:
                break
        result = {"build": build, "query": 0.0, "answered": hi - lo, "setting": setting}
    else:
        peer = PEERS[name]()
        sources = np.ascontiguousarray(states[lo:hi])
        clock = time.perf_counter()
        peer.build(sources, threads)
        build = time.perf_counter() - clock
        del sources
        setting = tune(peer, states, lo, sample, truth, budget)
        found, query = answer(peer, states, lo, queries, budget)
        result = {"build": build, "query": query, "answered": len(found), "setting": setting}
    np.save(out, found[: len(sample)].astype(np.int64))
    print(json.dumps({**result, "peak_kib": common.peak_kib()}), flush=True)


# ---- data ---------------------------------------------------------------------------------------


def prepare(step, arguments):
    """Steps that need NumPy, in the peers' environment."""
    import numpy as np

    if step == "gaussian":
        out, rows, columns = arguments
        rng = np.random.default_rng(3)
        np.save(out, rng.standard_normal((int(rows), int(columns)), dtype=np.float32))
    elif step == "quantised":
        plant, out, rows = arguments
        rng, states = np.random.default_rng(4), np.load(plant, mmap_mode="r")[: int(rows)].copy()
        states = np.round(states * 64) / np.float32(64)
        copies = np.flatnonzero(rng.random(len(states)) < 0.3)
        copies = copies[copies > 0]
        for row in copies:  # of one of the hour before, as in a stuck period
            states[row] = states[row - rng.integers(1, min(row, 360) + 1)]
        np.save(out, states)
    elif step == "embedding":
        plant, out, rows = arguments
        states, rng = np.load(plant, mmap_mode="r")[: int(rows)], np.random.default_rng(5)
        inner = rng.normal(size=(states.shape[1], 256)).astype(np.float32) / np.float32(states.shape[1] ** 0.5)
        outer = rng.normal(size=(256, 64)).astype(np.float32) / np.float32(16)
        mean, spread = states[::97].mean(0), states[::97].std(0) + np.float32(1e-3)
        parts = [np.tanh(2 * np.tanh((part - mean) / spread @ inner) @ outer) for part in np.array_split(states, 64)]
        np.save(out, np.concatenate(parts).astype(np.float32))
    elif step == "wells":
        model, out = arguments
        np.save(out, np.load(model, mmap_mode="r"))
    elif step == "truth":
        file, rows, queries, out, sample = arguments
        rows = int(rows)
        states, (lo, hi) = np.load(file, mmap_mode="r")[:rows], member_sources(rows)
        rng = np.random.default_rng(6)
        order = lo + 1 + rng.permutation(hi - lo)
        chosen = order[: int(sample)]
        points = states[chosen].astype(np.float64)
        nearest = np.full((len(chosen), K), np.inf)
        for start in range(lo, hi, 50_000):
            part = states[start : min(start + 50_000, hi)].astype(np.float64)
            squared = (points**2).sum(1)[:, None] + (part**2).sum(1)[None, :] - 2 * points @ part.T
            own = chosen - start
            inside = np.flatnonzero((own >= 0) & (own < len(part)))
            squared[inside, own[inside]] = np.inf
            for row, near in enumerate(np.argpartition(squared, min(K + 8, len(part) - 1), axis=1)[:, : K + 8]):
                near = near[near + start != chosen[row]]
                exact = ((part[near] - points[row]) ** 2).sum(1)
                nearest[row] = np.sort(np.concatenate([nearest[row], exact]))[:K]
        np.save(queries, order[:, None].astype("<u4"))
        np.save(out, nearest[:, -1])
    elif step == "recall":
        file, rows, queries, truth, found = arguments
        states, truth, found = np.load(file, mmap_mode="r")[: int(rows)], np.load(truth), np.load(found)
        count = min(len(truth), len(found))
        print(recall(states, np.load(queries)[:count, 0].astype(np.int64), found[:count].astype(np.int64), truth[:count]))
    elif step == "shape":
        print(*np.load(arguments[0], mmap_mode="r").shape)


def step(python, *arguments):
    done = subprocess.run(
        [python, __file__, "--prepare", *map(str, arguments)], check=True, capture_output=True, text=True
    )
    return done.stdout.split()


class Data:
    """Arrays in the cache."""

    def __init__(self, python, cache, calib):
        self.python, self.cache, self.calib = python, pathlib.Path(cache), calib
        self.cache.mkdir(parents=True, exist_ok=True)

    def once(self, name, make):
        path = self.cache / f"{name}.npy"
        if not path.exists():
            print(f"making {path.name}", file=sys.stderr)
            part = self.cache / f"part-{name}.npy"
            make(part)
            part.rename(path)
        return path

    def plant(self, rows):
        """The first rows of one simulation, so that a longer log is more of the same."""
        larger = [path for path in self.cache.glob("plant-*.npy") if int(path.stem.split("-")[1]) >= rows]
        if larger:
            return min(larger, key=lambda path: int(path.stem.split("-")[1]))
        program = common.build("calib-knn", "plant_tables")
        return self.once(
            f"plant-{rows}", lambda out: subprocess.run([program, "simulate", str(rows), "10", out], check=True, stdout=2)
        )

    def wells(self, name, overrides):
        if "CALIB_DATA" not in os.environ:
            raise LookupError("CALIB_DATA does not name the folder with the wells' logs")

        def make(out):
            model = self.cache / f"{name}-model"
            command = [self.calib, "build-model", common.ROOT / "configs/wells.toml", "--set", f"output={str(model)!r}"]
            for override in overrides:
                command += ["--set", override]
            done = subprocess.run(command, capture_output=True, text=True)
            if done.returncode != 0:
                raise SystemExit(f"{name}: {done.stderr.strip()}")
            step(self.python, "wells", next(model.rglob("states.npy")), out)
            shutil.rmtree(model)

        return self.once(name, make)

    def get(self, name, rows):
        """A file and how many of its rows."""
        kind = name.split("-")[0]
        if kind == "plant":
            rows = min(rows or sys.maxsize, int(name.split("-")[1]))
            return self.plant(rows), rows
        if kind == "gaussian":
            rows = rows or 100_000
            path = self.once(f"gaussian-{rows}", lambda out: step(self.python, "gaussian", out, rows, 142))
            return path, rows
        if kind in ("quantised", "embedding"):
            rows = rows or {"quantised": 200_000, "embedding": 400_000}[kind]
            path = self.once(f"{kind}-{rows}", lambda out: step(self.python, kind, self.plant(rows), out, rows))
            return path, rows
        if name == "wells":
            path = self.wells(name, ["preprocess.subsample=1"])
        elif name == "wells-traces":
            decays = [round(1 - 2.0**-power, 6) for power in range(1, 12)]
            path = self.wells(name, ["preprocess.subsample=1", f"preprocess.traces={decays}"])
        else:
            raise LookupError(f"no such data: {name}")
        whole = int(step(self.python, "shape", path)[0])
        return path, min(rows or whole, whole)

    def truth(self, path, rows, sample):
        stem = f"truth-{path.stem}-{rows}-{sample}"
        queries, truth = self.cache / f"{stem}-queries.npy", self.cache / f"{stem}.npy"
        if not truth.exists():
            step(self.python, "truth", path, rows, queries, truth, sample)
        return queries, truth


# ---- measuring ----------------------------------------------------------------------------------


def run(contender, python, program, path, rows, queries, truth, options):
    """One contender's result, or a text that says why there is none."""
    out = pathlib.Path(options.cache) / f"found-{contender}.npy"
    if contender in ("calib", "kiddo"):
        command = [program, contender, path, rows, queries, out, K]
        command += [] if contender == "calib" else [options.budget]
    else:
        command = [python, __file__, "--worker", contender, path, rows, queries, out, options.budget, options.threads, truth]
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
    lo, hi = member_sources(rows)
    result["sampled"] = result["answered"] < hi - lo
    result["whole"] = result["query"] * (hi - lo) / result["answered"]
    result["total"] = result["build"] + result["whole"]
    return result


def table(name, shape, results):
    """One line a contender, medians over the rounds."""
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


# ---- figure -------------------------------------------------------------------------------------

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#666666", "#8c5a2b")


def plot(path, curves):
    """Time against rows, both logarithmic, as SVG. `curves`: contender -> [(rows, seconds)]."""
    from math import ceil, floor, log10

    points = [point for curve in curves.values() for point in curve]
    if not points:
        raise SystemExit("nothing to plot: --plot wants plant data")
    x0, x1 = (log10(f(point[0] for point in points)) for f in (min, max))
    y0, y1 = floor(log10(min(point[1] for point in points))), ceil(log10(max(point[1] for point in points)))
    x0, x1, y1 = x0 - 0.05, max(x1, x0 + 0.3) + 0.05, max(y1, y0 + 1)
    left, top, width, height = 70, 20, 480, 360
    x = lambda rows: left + width * (log10(rows) - x0) / (x1 - x0)
    y = lambda seconds: top + height * (1 - (log10(seconds) - y0) / (y1 - y0))
    text = lambda at, up, words, more="": f'<text x="{at:.1f}" y="{up:.1f}" {more}>{words}</text>'
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 720 440" font-family="sans-serif" font-size="12">',
        "<title>Time to build neighbour tables against the number of rows</title>",
        '<rect width="720" height="440" fill="#fff"/>',
        f'<rect x="{left}" y="{top}" width="{width}" height="{height}" fill="none" stroke="#999"/>',
    ]
    for power in range(y0, y1 + 1):
        parts.append(f'<path d="M{left} {y(10.0**power):.1f}h{width}" stroke="#ddd"/>')
        parts.append(text(left - 6, y(10.0**power) + 4, f"{10.0**power:g}", 'text-anchor="end"'))
    for rows in sorted({rows for rows, _ in points}):
        parts.append(f'<path d="M{x(rows):.1f} {top}v{height}" stroke="#eee"/>')
        label = f"{rows / 1e6:g}M" if rows >= 1e6 else f"{rows / 1e3:g}k"
        parts.append(text(x(rows), top + height + 18, label, 'text-anchor="middle"'))
    parts.append(text(left + width / 2, top + height + 40, "rows x 142 (simulated plant)", 'text-anchor="middle"'))
    parts.append(text(16, top + height / 2, "seconds", f'text-anchor="middle" transform="rotate(-90 16 {top + height / 2})"'))
    for index, (contender, curve) in enumerate(curves.items()):
        colour, curve = COLOURS[index % len(COLOURS)], sorted(curve)
        line = "L".join(f"{x(rows):.1f} {y(seconds):.1f}" for rows, seconds in curve)
        thick = 3 if contender == "calib" else 1.5
        parts.append(f'<path d="M{line}" fill="none" stroke="{colour}" stroke-width="{thick}"/>')
        parts += [f'<circle cx="{x(r):.1f}" cy="{y(s):.1f}" r="3" fill="{colour}"/>' for r, s in curve]
        up = top + 14 + 20 * index
        parts.append(f'<path d="M{left + width + 14} {up - 4}h20" stroke="{colour}" stroke-width="{thick}"/>')
        parts.append(text(left + width + 40, up, contender))
    pathlib.Path(path).write_text("\n".join([*parts, "</svg>"]) + "\n")


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
    parser.add_argument("--worker", nargs=8, help=argparse.SUPPRESS)
    parser.add_argument("--prepare", nargs="+", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        name, file, rows, queries, out, budget, threads, truth = options.worker
        return worker(name, file, int(rows), queries, out, float(budget), int(threads), truth)
    if options.prepare:
        return prepare(options.prepare[0], options.prepare[1:])

    program = common.build("calib-knn", "knn_peers")
    python, installed = common.environment("knn", PINNED)
    data = Data(python, options.cache, options.calib)
    contenders = [name for name in options.contenders if NEEDS.get(name, "numpy") in installed]
    print(f"{common.machine()}, {options.threads} threads a contender, {options.rounds} rounds, commit {common.commit()}")
    print(", ".join(f"{name} {PINNED[name]}" for name in installed) + f", Python {platform.python_version()}, kiddo as in Cargo.lock")
    print("calib: tables of all five members; peers: those of one. ~: extrapolated from a sample of the queries")
    # Plants from the longest on: shorter ones are its beginning.
    plants = sorted((name for name in options.data if name.startswith("plant-")), key=lambda name: -int(name.split("-")[1]))
    for name in plants:
        data.get(name, options.rows)
    curves = {}
    for name in options.data:
        try:
            path, rows = data.get(name, options.rows)
        except LookupError as error:
            print(f"\n{name}: skipped: {error}")
            continue
        queries, truth = data.truth(path, rows, options.sample)
        results = {contender: [] for contender in contenders}
        for _ in range(options.rounds):
            for contender in contenders:
                if not any(isinstance(result, str) for result in results[contender]):
                    results[contender].append(run(contender, python, program, path, rows, queries, truth, options))
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
