"""Small logs whose pages carry checksums, which polars does not write: page CRCs, and gzip's own.

    python3 scripts/golden/parquet_checksums.py crates/calib-data/tests/it/checked
"""

import sys
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

rows = 120
log = pa.table(
    {
        "timestamp": pa.array([1_667_260_800_000_000 + 60_000_000 * row for row in range(rows)], pa.timestamp("us")),
        "P": pa.array([(row * 37 % 101) / 7 for row in range(rows)]),
        "Q": pa.array([None if row % 11 == 3 else float(row % 5) for row in range(rows)], pa.float32()),
    }
)
folder = Path(sys.argv[1])
shared = {"row_group_size": 70, "write_statistics": False, "store_schema": False}
pq.write_table(log, folder / "crc.parquet", compression="none", write_page_checksum=True, **shared)
pq.write_table(log, folder / "crc-v2.parquet", compression="zstd", write_page_checksum=True, data_page_version="2.0", **shared)
pq.write_table(log, folder / "gzip.parquet", compression="gzip", **shared)
pq.write_table(log, folder / "gzip-v2.parquet", compression="gzip", data_page_version="2.0", **shared)
