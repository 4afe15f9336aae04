#!/usr/bin/env python3
"""Print the tables of src/statistics.rs from a pilot plant's mode schedule.

Usage: mode_statistics.py november_modes.json

Input: november_modes.json of https://github.com/haseebs/gvf-real-world (MIT), per log file the
[start, end, length] in seconds of every segment of every mode. The first and the last segment of
a file are cut by the file's ends, so their durations are left out; their transitions count.
"""

import collections
import json
import sys

POINTS = [0.0, 0.025, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.975, 1.0]


def quantile(values, q):
    """Linear interpolation between order statistics (Hyndman and Fan, type 7)."""
    values = sorted(values)
    at = q * (len(values) - 1)
    low = int(at)
    high = min(low + 1, len(values) - 1)
    return values[low] + (values[high] - values[low]) * (at - low)


counts = collections.Counter()
durations = collections.defaultdict(list)
per_mode = collections.defaultdict(list)
time = collections.Counter()
files = json.load(open(sys.argv[1]))
for modes in files.values():
    segments = sorted((s, n, int(mode)) for mode, all_ in modes.items() for s, _, n in all_)
    for i, (_, length, mode) in enumerate(segments):
        time[mode] += length
        if i + 1 == len(segments):
            continue
        after = segments[i + 1][2]
        counts[mode, after] += 1
        if i > 0:
            durations[mode, after].append(length)
            per_mode[mode].append(length)

print("levels", POINTS)
for (mode, after), count in sorted(counts.items()):
    table = [round(quantile(durations[mode, after], q)) for q in POINTS]
    print(f"{mode} -> {after}: count {count}, seconds {table}")
total = sum(time.values())
for mode in sorted(time):
    median = quantile(per_mode[mode], 0.5)
    number = sum(n for (a, _), n in counts.items() if a == mode)
    print(f"mode {mode}: share {time[mode] / total:.4f}, median {median:.0f} s, {number * 86400 / total:.2f} a day")
