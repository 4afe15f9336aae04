#!/usr/bin/env python3
"""The rate of reading a CSV log beside polars and DuckDB, and the memory that each takes.

    pip install polars==2.1.0 duckdb==2.0.0
    python3 scripts/peers/csv_rate.py FOLDER [GIGABYTES [CALIB [ROUNDS]]]

The log has 120 channels of three decimals, a row a second. Each program reads all of it, in a process of its own: calib as `inspect`
(parsing, and every channel looked at) and as `import` (parsing, and Parquet written), polars as `read_csv` and as a streamed
`sink_parquet`, DuckDB as sums of all columns and as `COPY … TO` Parquet. ROUNDS runs each, in turn; of each the median is told,
of processor time too, which other work on the machine changes less.
"""

import multiprocessing
import os
import statistics
import subprocess
import sys
import time
from pathlib import Path

CHANNELS = 120
ROOT = Path(__file__).resolve().parents[2]


def generate(path: Path, size: float) -> None:
    import numpy as np
    import polars as pl

    rng = np.random.default_rng(0)
    rows = 100_000
    start = np.datetime64("2024-03-01T00:00:00", "us")
    with path.open("wb") as out:
        done = 0
        while out.tell() < size:
            times = start + np.arange(done, done + rows) * np.timedelta64(1, "s")
            walk = 1500 + rng.normal(0, 1, (rows, CHANNELS)).cumsum(axis=0)
            frame = pl.DataFrame({"timestamp": times, **{f"TAG{n:03}": walk[:, n].round(3) for n in range(CHANNELS)}})
            out.write(frame.write_csv(include_header=done == 0).encode())
            done += rows


def timed(command: list[str]) -> tuple[float, float, float]:
    """Returns wall seconds, processor seconds and peak MiB of a successful command."""
    begun = time.monotonic()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(f"csv_rate.py: {command} ends with {status}")
    return time.monotonic() - begun, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


def main() -> None:
    folder = Path(sys.argv[1])
    size = float(sys.argv[2] if len(sys.argv) > 2 else 1) * 1e9
    calib = sys.argv[3] if len(sys.argv) > 3 else str(ROOT / "target" / "release" / "calib")
    rounds = int(sys.argv[4]) if len(sys.argv) > 4 else 1
    folder.mkdir(parents=True, exist_ok=True)
    log = folder / "log.csv"
    if not log.exists():
        # A separate process is needed, because the peak memory of a process begins with the memory
        # of its parent.
        maker = multiprocessing.get_context("spawn").Process(target=generate, args=(log, size))
        maker.start()
        maker.join()
    packed = folder / "log.csv.gz"
    if not packed.exists():
        subprocess.run(["gzip", "-1", "-k", str(log)], check=True)
    size, out = log.stat().st_size, folder / "out.parquet"
    python = [sys.executable, "-c"]
    columns = ", ".join(f"sum(TAG{n:03})" for n in range(CHANNELS))
    print(f"{size / 1e9:.2f} GB, {packed.stat().st_size / 1e9:.2f} GB packed; rates are of the unpacked text; {rounds} rounds")
    commands = {}
    for path in (log, packed):
        text, kind = repr(str(path)), path.suffix
        commands[f"calib inspect {kind}"] = [calib, "-q", "inspect", str(path)]
        commands[f"calib import {kind}"] = [calib, "-q", "import", "--force", str(path), str(out)]
        read = "import polars as pl; pl.{}(" + text + ", try_parse_dates=True)"
        commands[f"polars read_csv {kind}"] = [*python, read.format("read_csv")]
        commands[f"polars sink_parquet {kind}"] = [*python, read.format("scan_csv") + f".sink_parquet({str(out)!r})"]
        commands[f"duckdb sums {kind}"] = [*python, f"import duckdb; duckdb.sql(\"SELECT {columns} FROM read_csv('{path}')\").fetchall()"]
        commands[f"duckdb copy {kind}"] = [*python, f"import duckdb; duckdb.sql(\"COPY (FROM read_csv('{path}')) TO '{out}' (FORMAT parquet)\")"]
    runs = {name: [] for name in commands}
    for _ in range(rounds):
        for name, command in commands.items():
            runs[name].append(timed(command))
    for name, all_runs in runs.items():
        seconds, processor, memory = (statistics.median(of) for of in zip(*all_runs))
        print(f"{name:24} {size / seconds / 1e6:6.0f} MB/s {size / processor / 1e6:6.0f} MB a processor second {seconds:6.1f} s {memory:6.0f} MiB")


if __name__ == "__main__":
    main()
