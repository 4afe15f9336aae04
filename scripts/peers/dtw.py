"""Dynamic time warping: calib-dtw beside other packages, interleaved, one thread each.

    python3 scripts/peers/dtw.py [--rounds N] [--quick]

Builds the example `dtw_bench`, installs the peers below into target/peers/dtw (a virtual
environment of its own), and prints one table: median wall and processor time, cells a second,
peak memory, and how many times faster calib-dtw is in the same run. Every round measures every
contender once, so that a noisy machine is noisy for all of them; the ratio is the median of the
rounds' ratios. Results are compared as well: a contender that computes something else is an error.
"""

import argparse
import json
import platform
import resource
import statistics
import subprocess
import sys
import time

import common

PINNED = {
    "numpy": "2.3.5",
    "dtw-python": "1.9.0",
    "dtaidistance": "2.5.1",
    "tslearn": "0.10.0",
    "aeon": "1.6.0",
}
PATTERNS = ("symmetric2", "asymmetric", "symmetricP1", "rabinerJuang:6c")
# All packages have the classic recursion (symmetric1 on squared differences).
CLASSIC = {
    "dtaidistance": "2 rows",
    "aeon": "N x M",
    "tslearn": "N x M",
}


# ---- a peer, in its own process ----------------------------------------------------------------


def peer_function(peer, pattern):
    """Returns a function of two arrays that computes the raw distance."""
    if peer == "dtw-python":
        import dtw

        steps = dtw.rabinerJuangStepPattern(6, "c", False) if pattern == "rabinerJuang:6c" else pattern
        return lambda x, y: dtw.dtw(x, y, step_pattern=steps, distance_only=True).distance
    if peer == "dtaidistance":
        from dtaidistance import dtw

        return lambda x, y: dtw.distance_fast(x, y) ** 2
    if peer == "aeon":
        from aeon.distances import dtw_distance

        return lambda x, y: dtw_distance(x, y)
    if peer == "tslearn":
        from tslearn.metrics import dtw

        return lambda x, y: dtw(x, y) ** 2
    raise ValueError(peer)


def worker(peer, patterns, query, reference, length):
    """Runs once for every line read, after one short warm-up for just-in-time compilation."""
    sys.path.pop(0)  # this file has the name of a package
    import numpy as np

    query, reference = (np.fromfile(name).reshape(-1, length) for name in (query, reference))
    functions = [peer_function(peer, pattern) for pattern in patterns]
    for function in functions:
        function(query[0][:50], reference[0][:50])
    print("ready", flush=True)
    for _ in sys.stdin:
        wall, busy = time.perf_counter(), time.process_time()
        raw = [float(function(x, y)) for x, y in zip(query, reference) for function in functions]
        seconds, processor = time.perf_counter() - wall, time.process_time() - busy
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        print(json.dumps({"seconds": seconds, "processor": processor, "raw": raw, "peak_kib": peak}), flush=True)


class Peer:
    def __init__(self, python, name, patterns, files, length):
        command = [python, __file__, "--worker", name, ",".join(patterns), *files, str(length)]
        self.name = name
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=common.threads(1)
        )
        self.wait_for("ready")

    def wait_for(self, word=None):
        """Returns the next line of our protocol: packages print greetings on standard output."""
        for line in self.process.stdout:
            if word is None and line.startswith("{"):
                return json.loads(line)
            if word is not None and line.strip() == word:
                return None
        raise RuntimeError(f"{self.name}: {self.process.stderr.read().strip().splitlines()[-1:]}")

    def run(self):
        self.process.stdin.write("go\n")
        self.process.stdin.flush()
        return self.wait_for()

    def close(self):
        self.process.stdin.close()
        self.process.wait()


class Ours:
    """calib-dtw, with several repeats per round: one is too short for an accurate time."""

    def __init__(self, binary, mode, patterns, files, length, repeats):
        self.name = "calib-dtw"
        self.command = [binary, mode, str(repeats), ",".join(patterns), *files, str(length)]

    def run(self):
        out = json.loads(subprocess.check_output(self.command, env=common.threads(1)))
        out["seconds"] = statistics.median(out["seconds"])
        return out

    def close(self):
        pass


# ---- set-up ------------------------------------------------------------------------------------


def write_series(python, folder, pairs, length):
    """Writes slow waves with correlated noise, from a fixed seed, as little-endian f64."""
    names = [str(folder / f"{role}-{pairs}x{length}.f64") for role in ("query", "reference")]
    program = (
        "import sys, numpy as np\n"
        "pairs, length = int(sys.argv[1]), int(sys.argv[2])\n"
        "rng = np.random.default_rng(length)\n"
        "for name in sys.argv[3:]:\n"
        "    x = np.sin(np.arange(length) / 200 + rng.uniform(0, 1, (pairs, 1)))\n"
        "    x += 0.02 * np.cumsum(rng.normal(size=(pairs, length)), axis=1)\n"
        "    x.astype('<f8').tofile(name)\n"
    )
    subprocess.run([python, "-c", program, str(pairs), str(length), *names], check=True)
    return names


# ---- measuring ---------------------------------------------------------------------------------


def compare(title, contenders, cells, rounds):
    """Runs rounds of one measurement each, and prints one line per contender."""
    results = {contender.name: [] for contender in contenders}
    for _ in range(rounds):
        for contender in contenders:
            results[contender.name].append(contender.run())
    for contender in contenders:
        contender.close()
    ours = results["calib-dtw"]
    print(f"\n{title}")
    print(f"  {'':14}{'wall s':>10}{'cpu s':>10}{'Mcell/s':>10}{'peak MB':>9}{'wall ratio':>12}{'cpu ratio':>11}")
    for name, runs in results.items():
        for ours_value, value in zip(ours[0]["raw"], runs[0]["raw"]):
            assert abs(ours_value - value) <= 1e-9 * abs(value), (name, ours_value, value)
        wall, busy = (statistics.median(run[key] for run in runs) for key in ("seconds", "processor"))
        ratios = [
            statistics.median(run[key] / mine[key] for run, mine in zip(runs, ours)) for key in ("seconds", "processor")
        ]
        peak = max(run["peak_kib"] for run in runs) / 1024
        print(f"  {name:14}{wall:10.4f}{busy:10.4f}{cells / busy / 1e6:10.0f}{peak:9.1f}{ratios[0]:12.1f}{ratios[1]:11.1f}")
    sys.stdout.flush()


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--quick", action="store_true", help="only the pairs of 3,000 samples")
    parser.add_argument("--worker", nargs=5, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        peer, patterns, query, reference, length = options.worker
        return worker(peer, patterns.split(","), query, reference, int(length))

    binary = common.build("calib-dtw", "dtw_bench")
    python, installed = common.environment("dtw", PINNED)
    folder = common.target() / "peers"
    print(f"{common.machine()}, one thread each, {options.rounds} rounds")
    print(", ".join(f"{name} {PINNED[name]}" for name in installed) + f", Python {platform.python_version()}")
    print("Mcell/s is by processor time; ratio = peer's time / calib-dtw's, median over the rounds")

    def contest(title, pairs, length, mode, patterns, peers, rounds, repeats):
        files = write_series(python, folder, pairs, length)
        contenders = [Ours(binary, mode, patterns, files, length, repeats)]
        for name in peers:
            if name not in installed:
                continue
            try:
                contenders.append(Peer(python, name, patterns, files, length))
            except RuntimeError as error:
                print(f"skipped: {error}", file=sys.stderr)
        compare(title, contenders, pairs * length * length * len(patterns), rounds)

    contest("classic recursion, squared differences, 3,000 x 3,000", 1, 3000, "distance:squared", ["symmetric1"],
            list(CLASSIC), options.rounds, 99)
    for pattern in PATTERNS:
        contest(f"{pattern}, 3,000 x 3,000", 1, 3000, "distance", [pattern], ["dtw-python"], options.rounds, 99)
    contest(f"30 pairs x 4 patterns ({', '.join(PATTERNS)}), 3,000 x 3,000", 30, 3000, "table", PATTERNS,
            [] if options.quick else ["dtw-python"], max(1, options.rounds // 3), 1)
    if options.quick:
        return None
    whole = [peer for peer, memory in CLASSIC.items() if memory == "N x M"]
    print(f"\nleft out below: {', '.join(whole)}, dtw-python (they keep an N x M matrix: 7.2 GB)")
    rounds = max(1, options.rounds // 2)
    contest("classic recursion, squared differences, 30,000 x 30,000", 1, 30000, "distance:squared", ["symmetric1"],
            ["dtaidistance"], rounds, 1)
    for pattern in PATTERNS:
        contest(f"{pattern}, 30,000 x 30,000", 1, 30000, "distance", [pattern], [], rounds, 1)
    contest("symmetric2 with the path, 30,000 x 30,000", 1, 30000, "align", ["symmetric2"], [], rounds, 1)
    return None


if __name__ == "__main__":
    sys.exit(main())
