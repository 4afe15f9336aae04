#!/usr/bin/env python3
"""The rate of reading a CSV log beside polars and DuckDB, and the memory that each takes.

    pip install polars==2.1.0 duckdb==2.0.0
    python3 scripts/peers/csv_rate.py FOLDER [GIGABYTES] [CALIB]

The log has 120 channels of three decimals, a row a second. Each program reads all of it, in a process of its own: calib as `inspect`
(parsing, and every channel looked at) and as `import` (parsing, and Parquet written), polars as `read_csv` and as a streamed
`sink_parquet`, DuckDB as a count over all columns and as `COPY … TO` Parquet. One run each, in turn.
"""

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import polars as pl

CHANNELS = 120
ROOT = Path(__file__).resolve().parents[2]


def generate(path: Path, size: float) -> None:
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


def timed(name: str, command: list[str], size: int) -> None:
    begun = time.monotonic()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    seconds = time.monotonic() - begun
    processor = usage.ru_utime + usage.ru_stime
    print(f"{name:24} {size / seconds / 1e6:7.0f} MB/s {seconds:7.1f} s, processor {processor:6.1f} s, {usage.ru_maxrss / 1024:7.0f} MiB, status {status}", flush=True)


def main() -> None:
    folder = Path(sys.argv[1])
    size = float(sys.argv[2] if len(sys.argv) > 2 else 1) * 1e9
    calib = sys.argv[3] if len(sys.argv) > 3 else str(ROOT / "target" / "release" / "calib")
    folder.mkdir(parents=True, exist_ok=True)
    log = folder / "log.csv"
    if not log.exists():
        generate(log, size)
    packed = folder / "log.csv.gz"
    if not packed.exists():
        subprocess.run(["gzip", "-1", "-k", str(log)], check=True)
    size, out = log.stat().st_size, folder / "out.parquet"
    python = [sys.executable, "-c"]
    print(f"{size / 1e9:.2f} GB, {packed.stat().st_size / 1e9:.2f} GB packed; rates are of the unpacked text")
    for path in (log, packed):
        kind = path.suffix
        timed(f"calib inspect {kind}", [calib, "-q", "inspect", str(path)], size)
        timed(f"calib import {kind}", [calib, "-q", "import", "--force", str(path), str(out)], size)
        timed(f"polars read_csv {kind}", [*python, f"import polars as pl; pl.read_csv({str(path)!r}, try_parse_dates=True)"], size)
        timed(f"polars sink_parquet {kind}", [*python, f"import polars as pl; pl.scan_csv({str(path)!r}, try_parse_dates=True).sink_parquet({str(out)!r})"], size)
        columns = ", ".join(f"sum(TAG{n:03})" for n in range(CHANNELS))
        timed(f"duckdb sums {kind}", [*python, f"import duckdb; duckdb.sql(\"SELECT {columns} FROM read_csv('{path}')\").fetchall()"], size)
        timed(f"duckdb copy {kind}", [*python, f"import duckdb; duckdb.sql(\"COPY (FROM read_csv('{path}')) TO '{out}' (FORMAT parquet)\")"], size)


if __name__ == "__main__":
    main()
