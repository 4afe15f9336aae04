"""One small log in the forms in which programs and historians write logs.

    pip install polars==2.1.0 pandas==3.1.1 pyarrow==26.0.1 duckdb==2.0.0
    python3 scripts/golden/log_formats.py crates/calib-data/tests/it/formats

Every form holds the same three channels at the same instants, so that all must become the same states.
"""

import gzip
import shutil
import sys
from pathlib import Path

import duckdb
import pandas as pd
import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq

START = pd.Timestamp("2024-03-12 23:30:00")
ROWS = 60
CHANNELS = {"FIT100": ("m3/h", "permeate flow"), "PIT300": ("kPa", "membrane pressure"), "TIT101": ("°C", "temperature of the influent")}
BAD = -9999.0


def log() -> pd.DataFrame:
    """Returns a log whose first channel always has a value, so that every instant has one."""
    times = [START + pd.Timedelta(minutes=row) for row in range(ROWS)]
    return pd.DataFrame(
        {
            "timestamp": times,
            "FIT100": [row % 7 * 0.25 + 10 for row in range(ROWS)],
            "PIT300": [None if row % 17 == 5 else 1500 + (row * 37 % 101) / 8 for row in range(ROWS)],
            "TIT101": [None if row % 23 == 9 else -2.5 + row / 10 for row in range(ROWS)],
        }
    )


def long(wide: pd.DataFrame) -> pd.DataFrame:
    return wide.melt("timestamp", var_name="tag", value_name="value").dropna().sort_values(["timestamp", "tag"], kind="stable")


def long_with_bad(wide: pd.DataFrame, good, bad) -> pd.DataFrame:
    """Returns a long table in which a missing value is present, with a quality that must not count."""
    table = wide.melt("timestamp", var_name="tag", value_name="value")
    table["quality"] = table["value"].isna().map({True: bad, False: good})
    table["value"] = table["value"].fillna(BAD)
    return table


def compressed(data: bytes, path: Path, codec: str) -> None:
    with pa.CompressedOutputStream(str(path), codec) as stream:
        stream.write(data)


def wide_text(wide: pd.DataFrame, out: Path) -> None:
    text = pl.from_pandas(wide).write_csv()
    (out / "polars.csv").write_text(text)
    (out / "polars.csv.gz").write_bytes(gzip.compress(text.encode(), mtime=0))
    compressed(text.encode(), out / "pyarrow.csv.zst", "zstd")
    wide.to_csv(out / "pandas.tsv", sep="\t", index=False)
    wide.to_csv(out / "pandas-german.csv", sep=";", decimal=",", index=False, date_format="%d.%m.%Y %H:%M:%S", encoding="latin-1")
    wide.to_csv(out / "pandas-us.csv", index=False, date_format="%m/%d/%Y %I:%M:%S %p", quoting=1)
    wide.to_csv(out / "pandas-pi.csv", index=False, date_format="%d-%b-%y %H:%M:%S", na_rep="Bad Input")
    units = wide.copy()
    units.columns = pd.MultiIndex.from_tuples([("timestamp", "")] + [(name, unit) for name, (unit, _) in CHANNELS.items()])
    units.to_csv(out / "pandas-units.csv", index=False)
    paris = wide.copy()
    paris["timestamp"] = paris["timestamp"].dt.tz_localize("UTC").dt.tz_convert("Europe/Paris").dt.tz_localize(None)
    paris.to_csv(out / "pandas-paris.csv", index=False)
    epoch = wide.copy()
    epoch["timestamp"] = (epoch["timestamp"] - pd.Timestamp(0)) // pd.Timedelta(milliseconds=1)
    epoch.to_csv(out / "pandas-epoch.csv", index=False)
    duckdb.sql("SET TimeZone = 'Asia/Kolkata'")
    duckdb.sql("SELECT * REPLACE (timestamp AT TIME ZONE 'UTC' AS timestamp) FROM wide").write_csv(str(out / "duckdb-zone.csv"), quotechar='"', quoting="ALL")


def historian_table(samples: pd.DataFrame, out: Path) -> None:
    """Writes the columns of Ignition's tables `sqlt_data_*`, with a tag whose values are dates."""
    started = samples[samples["tagpath"] == "FIT100"].iloc[::20].assign(tagpath="P100/started", floatvalue=None)
    table = pd.concat([samples, started]).sort_values("t_stamp", kind="stable")
    table = table.drop(columns="datestring").assign(intvalue=pd.array([None] * len(table), dtype="Int64"), stringvalue=None)
    is_date = table["tagpath"] == "P100/started"
    dates = pd.to_datetime(table["t_stamp"], unit="ms").dt.floor("D").where(is_date)
    table.insert(4, "datevalue", dates)
    table.to_csv(out / "ignition-table.csv", index=False)
    table.to_parquet(out / "ignition-table.parquet", index=False)
    empty = table[~is_date].assign(datevalue=pd.NaT)
    empty.to_csv(out / "ignition-no-dates.csv", index=False)
    empty.to_parquet(out / "ignition-no-dates.parquet", index=False)


def samples(wide: pd.DataFrame, out: Path) -> None:
    long(wide).to_csv(out / "pandas-long.csv", index=False)
    long_with_bad(wide, "Good", "Bad").to_csv(out / "pandas-long-quality.csv", index=False)
    tags = long(wide)
    duckdb.sql("SELECT * FROM tags ORDER BY tag, timestamp").write_parquet(str(out / "duckdb-long.parquet"))
    pl.from_pandas(wide).unpivot(index="timestamp").with_columns(pl.col("timestamp").dt.epoch("ms")).write_csv(out / "polars-long.csv")
    opc = long_with_bad(wide, 192, 0)
    ignition = pd.DataFrame(
        {
            "tagpath": opc["tag"],
            "intvalue": "",
            "floatvalue": opc["value"],
            "stringvalue": "",
            "datestring": "",
            "dataintegrity": opc["quality"],
            "t_stamp": (opc["timestamp"] - pd.Timestamp(0)) // pd.Timedelta(milliseconds=1),
        }
    )
    ignition.to_csv(out / "ignition.csv", index=False)
    historian_table(ignition, out)
    aveva = pd.DataFrame(
        {
            "DateTime": opc["timestamp"].dt.strftime("%Y-%m-%d %H:%M:%S.%f"),
            "TagName": opc["tag"],
            "Value": opc["value"],
            "Quality": (opc["quality"] == 0).astype(int),
            "QualityDetail": opc["quality"],
            "OPCQuality": opc["quality"],
        }
    )
    aveva.to_csv(out / "aveva.csv", index=False)
    for name in CHANNELS:
        one = wide[["timestamp", name]].dropna()
        folder = out / "polars-per-tag"
        folder.mkdir(exist_ok=True)
        pl.from_pandas(one.rename(columns={name: "value"})).write_parquet(folder / f"{name}.parquet")
        folder = out / "pandas-per-tag"
        folder.mkdir(exist_ok=True)
        one.to_csv(folder / f"export-{name}.csv", index=False)
    duckdb.sql(f"COPY tags TO '{out / 'duckdb-hive'}' (FORMAT csv, PARTITION_BY (tag))")


def influx(wide: pd.DataFrame, out: Path) -> None:
    """Writes the format of https://docs.influxdata.com/influxdb/v2/reference/syntax/annotated-csv/."""
    lines = []
    for number, name in enumerate(CHANNELS):
        lines += [
            "#group,false,false,true,true,false,false,true,true,true",
            "#datatype,string,long,dateTime:RFC3339,dateTime:RFC3339,dateTime:RFC3339,double,string,string,string",
            "#default,_result,,,,,,,,",
            ",result,table,_start,_stop,_time,_value,_field,_measurement,sensor",
        ]
        for time, value in wide[["timestamp", name]].dropna().itertuples(index=False):
            lines.append(f",,{number},2024-03-12T00:00:00Z,2024-03-14T00:00:00Z,{time.isoformat()}Z,{value},value,plant,{name}")
        lines.append("")
    (out / "influxdb.csv").write_bytes("\r\n".join(lines).encode() + b"\r\n")


def main() -> None:
    out = Path(sys.argv[1])
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    wide = log()
    pq.write_table(pa.Table.from_pandas(wide, preserve_index=False), out / "pyarrow.parquet")
    wide_text(wide, out)
    samples(wide, out)
    influx(wide, out)


if __name__ == "__main__":
    main()
