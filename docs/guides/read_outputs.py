"""Read what a study leaves behind, with polars and NumPy.

    python3 read_outputs.py calib-quickstart/results
"""

import json
import sys
from pathlib import Path

import numpy as np
import polars as pl

results = Path(sys.argv[1])

# The model: recorded states, and for every transition the transitions that may follow it.
manifest = json.loads((results / "model/manifest.json").read_text())
states = np.load(results / "model/states.npy", mmap_mode="r")
rows = pl.read_parquet(results / "model/rows.parquet")
neighbors = np.load(results / "model/members/0/neighbors.npy", mmap_mode="r")
present = neighbors[:, 0] != np.iinfo(np.uint32).max
print(f"{states.shape[0]} states of {states.shape[1]} columns, {rows['segment'].n_unique()} segments")
print(f"member 0 has {present.sum()} of {len(present)} transitions, k = {neighbors.shape[1]}")

# A column in physical units.
column = manifest["normaliser"][0]
physical = states[:, 0] * column["bounds"]["scale"] + column["bounds"]["offset"]
print(f"{column['name']} from {physical.min():.4g} to {physical.max():.4g}")

# Walks through the model, beside what the plant did.
trajectories = pl.read_parquet(results / "rollout/trajectories.parquet")
print(trajectories.group_by("member").agg(pl.col("row").n_unique().alias("distinct rows")).sort("member"))
print(pl.read_parquet(results / "rollout/dtw.parquet").group_by("sensor", "step_pattern").agg(pl.col("normalized_distance").mean()))

# Every run of the sweep: all hyperparameters are columns.
runs = pl.read_parquet(results / "sweep/runs.parquet")
online = runs.filter(pl.col("environment") == "online")
print(online.group_by("sensor", "learning_rate").agg(pl.col("nrmse").mean(), pl.len().alias("runs")).sort("sensor", "nrmse"))
curves = pl.read_parquet(results / "sweep/curves.parquet")
print(f"{curves.height} points of learning curves")

# What was recorded while it was learned from, and held out: the extremes of short stretches of time.
recorded = pl.read_parquet(results / "sweep/recorded.parquet")
print(recorded.group_by("sensor", "period").agg(pl.col("value").min().alias("from"), pl.col("value").max().alias("to")).sort("sensor", "period"))

# The verdict.
summary = json.loads((results / "evaluate/summary.json").read_text())
for verdict, advice in zip(summary["verdicts"], summary["advice"], strict=True):
    print(f"{verdict['sensor']}: {advice[0]}")
