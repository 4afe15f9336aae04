"""A profile of the whole: what each step takes of a week at 1 Hz (345,600 training states of 142 columns), and how near it is to its bound.

    python3 scripts/profile_run.py [CALIB] [--days 7] [--channels 480] [--keep DIR]

Processor time, wall time, peak memory, and bytes that each step leaves on the disk. The log is read by `build-model`, the first
step that needs it. Bounds: the products of the networks (multiplications of the paper's agents, against the rate of one
large product in NumPy on one thread, in the same run), and what neighbours would take by comparing every pair of states at that rate. Wants NumPy.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"
import numpy as np  # noqa: E402

STUDY = """
seed = 1
[simulate]
days = {days}
channels = {channels}
period_secs = 1
[data]
path = "log"
train_fraction = 0.5714285714
[preprocess]
max_missing = 0.1
missing = "forward_fill"
fill_limit = 30
[rollout]
steps = 30000
rollouts = 3
[agent]
value_function = "mlp"
hidden_layers = 2
hidden_units = 256
batch_size = 256
gamma = 0.99
[sweep]
sensors = ["PIT300"]
steps = {steps}
online_windows = 1
online_runs = 2
member_runs = 1
log_replay_runs = 1
[sweep.grid]
learning_rate = [1e-6, 3e-6, 1e-5, 3e-5, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2]
"""


def size(folder):
    return sum(path.stat().st_blocks * 512 for path in folder.rglob("*") if path.is_file()) if folder.exists() else 0


def run(program, folder, *words):
    """Returns processor seconds, wall seconds, peak bytes, and bytes left on disk."""
    before, begun = size(folder), time.monotonic()
    process = subprocess.Popen([program, "-q", *words], cwd=folder, stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    if os.waitstatus_to_exitcode(status) not in (0, 1):
        sys.exit(f"calib {' '.join(words)} ended with {os.waitstatus_to_exitcode(status)}")
    return used.ru_utime + used.ru_stime, time.monotonic() - begun, used.ru_maxrss * 1024, size(folder) - before


def peak():
    """Returns multiplications and additions per second of one large product in f32, on one thread."""
    a, b = (np.random.default_rng(0).standard_normal((2048, 2048), dtype=np.float32) for _ in range(2))
    best = 0.0
    for _ in range(5):
        begun = time.process_time()
        a @ b
        best = max(best, 2 * 2048**3 / (time.process_time() - begun))
    return best


def update_flops(width, units=256, batch=256):
    """Returns the operations of one TD(0) update: forward of states and of next states, backward for weights and for the hidden layer."""
    layers = [(width, units), (units, units), (units, 1)]
    forward = 2 * batch * sum(a * b for a, b in layers)
    return 2 * forward + forward + 2 * batch * sum(a * b for a, b in layers[1:])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    root = Path(__file__).resolve().parents[1]
    parser.add_argument("calib", nargs="?", default=root / "target/release/calib", type=Path)
    parser.add_argument("--days", type=float, default=7)
    parser.add_argument("--channels", type=int, default=480)
    parser.add_argument("--steps", type=int, default=2000)
    parser.add_argument("--keep", type=Path)
    options = parser.parse_args()
    program = options.calib.resolve()
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.keep or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "study.toml").write_text(STUDY.format(days=options.days, channels=options.channels, steps=options.steps))
        rate = peak()
        steps = ["simulate", "build-model", "rollout", "sweep", "evaluate", "run"]
        rows = []
        for step in steps:
            taken = run(program, folder, step, "study.toml")
            rows.append((f"calib {step}", taken))
            print(f"  {rows[-1][0]}: {taken[0]:.1f} s of processors, {taken[1]:.1f} s", file=sys.stderr, flush=True)
        manifest = json.loads((folder / "study-results/model/manifest.json").read_text())
        states, width = manifest["rows"], len(manifest["normaliser"])
        units = len(list((folder / "study-results/sweep/units").rglob("*.json")))
        print(f"{states:,} states x {width} columns; one thread multiplies and adds {rate / 1e9:.0f} GFLOP/s in one large product\n")
        print("| step | processor s | wall s | peak memory | left on disk | bound |\n|---|---|---|---|---|---|")
        bounds = {
            "calib build-model": f"every pair of states: {2 * states**2 * width / rate:,.0f} s for the tables alone, at the rate of products",
            "calib sweep": f"products: {units * 9 * options.steps * update_flops(width) / rate:.1f} s ({units} streams x 9 values x {options.steps:,} updates)",
            "calib run": "everything is there",
        }
        for name, (used, wall, memory, disk) in rows:
            print(f"| {name} | {used:.1f} | {wall:.1f} | {memory / 1e9:.2f} GB | {disk / 1e6:,.0f} MB | {bounds.get(name, '')} |")


if __name__ == "__main__":
    main()
