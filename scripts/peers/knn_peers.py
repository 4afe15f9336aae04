"""The Python contenders of knn.py, each in a process of its own.

    python3 knn_peers.py NAME STATES.npy ROWS QUERIES.npy OUT.npy BUDGET_SECS THREADS TRUTH.npy
"""

import json
import sys
import time

import numpy as np

import common
from knn_truth import K, RECALL, member_sources, recall


class Flat:
    settings = (None,)
    batch = 2048  # a product of few queries is slow

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
    batch = 256
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
    batch = 256
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
    batch = 256
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
    batch = 256
    settings = (None,)

    def build(self, sources, threads):
        from sklearn.neighbors import KDTree

        self.tree = KDTree(sources)

    def tune(self, setting):
        pass

    def search(self, queries):
        return self.tree.query(queries, k=K + 1, return_distance=False)


class Descent:
    """Its graph of all rows is the answer, so no search is left."""

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
    found, seconds, done, batch = [], 0.0, 0, peer.batch
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
        batch = max(peer.batch // 4, min(max(2 * batch, 1 << 16 if done > 4096 else 0), fits))
    return np.concatenate(found), seconds


def tune(peer, states, base, sample, truth, budget):
    """Returns the cheapest setting with the required recall, or the one beyond which recall hardly grows."""
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
    states = np.load(file, mmap_mode="r")[:rows]
    queries, truth = np.load(queries)[:, 0].astype(np.int64), np.load(truth)
    sample = queries[: len(truth)]
    lo, hi = member_sources(rows)
    if name == "pynndescent":
        peer = Descent()
        table = np.ascontiguousarray(states[lo : hi + 1])
        peer.graph(table[:20_000], 15, threads)  # compiles; small tables use another algorithm
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

if __name__ == "__main__":
    name, file, rows, queries, out, budget, threads, truth = sys.argv[1:]
    worker(name, file, int(rows), queries, out, float(budget), int(threads), truth)
