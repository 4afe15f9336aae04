#!/usr/bin/env python3
"""calib from Python beside other packages of Python, in the same run, on one thread each.

    python3 scripts/peers/python.py [--rounds N] [--rows N]

Runs with whatever Python has calib_rl, gymnasium, numpy, and of faiss, pynndescent, scikit-learn, numba and stable_baselines3 those that are installed: the others
are skipped. Every round runs every contender once; what is shown is the median of processor seconds, because machines are shared.
"""

import os

for name in ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "RAYON_NUM_THREADS"):
    os.environ[name] = "1"

import argparse
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

import numpy as np

import calib_rl
import calib_rl.gym

K = 3


def measured(work):
    """Returns the processor seconds of a call, and its result."""
    begun = time.process_time()
    result = work()
    return time.process_time() - begun, result


def rounds(count, contenders, show):
    """Returns medians of interleaved rounds; a contender that cannot be imported is skipped."""
    times, results = {}, {}
    for _ in range(count):
        for name, work in list(contenders.items()):
            try:
                seconds, result = measured(work)
            except ImportError as missing:
                print(f"  {name}: skipped, {missing}")
                del contenders[name]
                continue
            times.setdefault(name, []).append(seconds)
            results[name] = result
    for name, seconds in times.items():
        print(f"  {name}: {show(statistics.median(seconds), results[name])}", flush=True)


def joins(points, count):
    """Compares neighbour tables of the same array."""

    def of_calib():
        return calib_rl.knn_join(points, K, exclude_self=True)[0]

    def of_faiss():
        import faiss

        index = faiss.IndexFlatL2(points.shape[1])
        index.add(points)
        return index.search(points, K + 1)[1]

    def of_sklearn():
        from sklearn.neighbors import NearestNeighbors

        return NearestNeighbors(n_neighbors=K, algorithm="kd_tree").fit(points).kneighbors(return_distance=False)

    def of_pynndescent():
        import pynndescent

        return pynndescent.NNDescent(points, n_neighbors=15, random_state=0).neighbor_graph[0][:, : K + 1]

    exact = [set(row) for row in of_calib()[:2000].tolist()]

    def show(seconds, found):
        shares = [len(truth & set(row)) / K for truth, row in zip(exact, found[:2000].tolist())]
        return f"{seconds:.2f} s, recall@{K} {np.mean(shares):.3f}"

    try:
        of_pynndescent()  # compiled once, outside the measurement
    except ImportError:
        pass
    contenders = {"calib_rl.knn_join": of_calib, "faiss IndexFlatL2": of_faiss}
    rounds(count, contenders | {"scikit-learn kd_tree": of_sklearn, "pynndescent": of_pynndescent}, show)


def walks(model, count):
    """Compares the steps of one rollout."""
    steps = 1_000_000
    neighbors, distances = model.neighbors(0), model.distances(0)
    start = int(model.transitions(0)[0])

    def of_calib():
        return model.rollout(1, steps)

    def with_numpy():
        rng, at = np.random.default_rng(0), start
        for _ in range(steps // 100):
            far = distances[at]
            total = far.sum()
            weights = (1 - far / total) / (len(far) - 1) if total > 0 else np.full(len(far), 1 / len(far))
            at = neighbors[at][min(int(np.searchsorted(np.cumsum(weights), rng.random())), len(far) - 1)]
        return at

    compiled = []

    def with_numba():
        if not compiled:
            import numba

            @numba.njit
            def walk(neighbors, distances, at, steps):
                rows, k = np.empty(steps, np.uint32), neighbors.shape[1]
                for step in range(steps):
                    total = 0.0
                    for place in range(k):
                        total += distances[at, place]
                    left, drawn = np.random.random(), k - 1
                    for place in range(k):
                        weight = (1 - distances[at, place] / total) / (k - 1) if total > 0 else 1 / k
                        if left < weight:
                            drawn = place
                            break
                        left -= weight
                    at = neighbors[at, drawn]
                    rows[step] = at
                return rows

            compiled.append(walk)
        return compiled[0](neighbors, distances, start, steps)

    try:
        with_numba()
    except ImportError:
        pass
    rounds(count, {"Model.rollout": of_calib, "numba": with_numba}, lambda seconds, _: f"{steps / seconds / 1e6:.1f} M steps/s")
    rounds(count, {"NumPy": with_numpy}, lambda seconds, _: f"{steps / 100 / seconds / 1e6:.3f} M steps/s")


def environments(model, count):
    """Compares the steps of environments, in batches of 256 and alone."""
    batches, batch = 2000, 256
    actions = np.zeros(batch, np.int64)
    many = calib_rl.gym.make_vec(model, batch, members=range(model.members))
    many.reset(seed=0)
    one = calib_rl.gym.make(model)
    one.reset(seed=0)
    baselines = []

    def of_calib():
        for _ in range(batches):
            many.step(actions)
        return batches * batch

    def alone():
        for _ in range(50_000):
            one.step(0)
        return 50_000

    def of_baselines():
        if not baselines:
            from stable_baselines3.common.vec_env import DummyVecEnv

            baselines.append(DummyVecEnv([lambda: calib_rl.gym.make(model)] * batch))
            baselines[0].reset()
        for _ in range(40):
            baselines[0].step(actions)
        return 40 * batch

    contenders = {"calib_rl.gym.make_vec, 256": of_calib, "calib_rl.gym.make": alone, "the same in DummyVecEnv of Stable-Baselines3, 256": of_baselines}
    rounds(count, contenders, lambda seconds, steps: f"{steps / seconds / 1e6:.2f} M steps/s")


COPY = """
import sys, numpy as np, calib_rl

def memory(of):
    return next(int(line.split()[1]) for line in open("/proc/self/status") if line.startswith(of)) / 1024

rows, columns = 1 << 21, 128
states = np.full((rows, columns), 0.5, np.{kind}){layout}
calib_rl.knn_join(np.zeros((9, 1)), 1)
with open("/proc/self/clear_refs", "w") as forget:
    forget.write("5")  # the peak so far
before = memory("VmRSS")
try:
    calib_rl.build_model(states, neighbors=0)
except calib_rl.CalibError:
    print(f"{{states.nbytes / 2**20:.0f}} MiB of {kind}, peak + {{memory('VmHWM') - before:.0f}} MiB")
"""


def copies():
    """Measures the peak memory of passing an array: the build is refused for its number of neighbours once it has the states."""
    for kind, layout in [("float32", ""), ("float32", ".T.copy().T"), ("float64", "[:, ::2].astype(np.float64)")]:
        done = subprocess.run([sys.executable, "-c", COPY.format(kind=kind, layout=layout)], capture_output=True, text=True)
        print(f"  {layout or 'contiguous'}: {done.stdout.strip() or done.stderr.strip()[-200:]}")


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--rows", type=int, default=30_000)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        plant = pathlib.Path(folder) / "plant"
        calib_rl.simulate(plant, days=options.rows * 10 / 86_400, channels=64, period_secs=10)
        model = calib_rl.build_model(plant, pathlib.Path(folder) / "model")
        points = np.ascontiguousarray(model.states)
        print(f"neighbours: {len(points):,} states of {points.shape[1]} columns of the simulated plant, k = {K}")
        joins(points, options.rounds)
        uniform = np.random.default_rng(0).random((5_000, 30)).astype(np.float32)
        print("neighbours: 5,000 uniform points of 30 columns")
        joins(uniform, options.rounds)
        print("rollouts of that plant")
        walks(model, options.rounds)
        print(f"environments of that plant, observations of {points.shape[1]} columns")
        environments(model, options.rounds)
        print("an array handed over")
        copies()


if __name__ == "__main__":
    main()
