"""The paper's three studies on 1 to 1,000 cores, on paper: from rates that were measured on one core, with the division that calib makes.

    python3 scripts/cluster/on_paper.py

Rates are those of docs/performance.md; a pass is divided by sensor where cores outnumber passes. What one process does before the shards
(log, representation, model) and after them (merge, verdict) is not divided.
"""

from math import ceil

# Core seconds per thousand steps of one setting: 142 columns, two layers of 256 units, batches of 256 (docs/performance.md, the paper's sweep).
PER_THOUSAND = 0.97
# Factor for two layers of 512 units, by the number of parameters.
WIDE = (142 * 512 + 512 * 512 + 512) / (142 * 256 + 256 * 256 + 256)
# Updates of a representation per second on one core (docs/performance.md).
LAPLACIAN = 352
# A thousand epochs over nine tenths of half a year at 10 s, with one update per mini-batch of 256.
PRETRAINING = 1000 * 0.9 * 1_600_000 / 256 * PER_THOUSAND / 1000 * WIDE
# Seconds in which a shard opens its inputs and a batch system starts it (docs/guides/cluster.md).
START = 2 + 1
# Core seconds to read the log and to compute the neighbour tables, of a week at 1 Hz and of a year at 10 s; these run side by side.
WEEK, YEAR = 15, 60
# Rollouts and their comparison, merge, verdict and report.
AFTER = 60


def study(name, before, streams, sensors, values, steps, units, limit):
    """Returns the core seconds of a pass with all sensors, and of the work that cannot be divided."""
    secs = PER_THOUSAND * (WIDE if units == 512 else 1) * steps / 1000 * values
    return name, before, streams, sensors, secs, limit


STUDIES = [
    # Shared: 30 runs on held-out data and 10 on the log. Two models of neighbours have 5
    # x 10 runs, two networks 10 each (training not counted).
    study("one week, four models", WEEK + 100_000 / LAPLACIAN, 40 + 2 * 50 + 2 * 10, 3, 9, 30_000, 256, "training the representation"),
    # Three deployments of 5 held-out runs; 5 of the log; two models with 5 members x 2 runs in each of three deployments.
    study("twelve months", YEAR + 200_000 / LAPLACIAN + 100_000 / LAPLACIAN, 3 * 5 + 5 + 2 * 3 * 10, 3, 7, 3_000, 512, "training two representations"),
    # Three deployments of 30 held-out runs; one model from random rows, 5 x 10, and one from the month, 5 x 10 per deployment.
    study("fine-tuning", YEAR + 200_000 / LAPLACIAN + PRETRAINING, 3 * 30 + 50 + 3 * 50, 1, 8, 30_000, 512, "pre-training"),
]


def on(cores, before, streams, sensors, secs):
    """Returns the wall seconds of the sweep: passes of equal length, distributed over the cores."""
    groups = min(sensors, max(1, ceil(cores / streams)))
    passes = streams * groups
    a_pass = secs * sensors / groups
    return before + ceil(passes / min(cores, passes)) * a_pass + START + AFTER, passes


def main():
    for name, before, streams, sensors, secs, limit in STUDIES:
        sweep = streams * sensors * secs
        print(f"{name}: {sweep / 3600:.1f} core hours of sweep in {streams} streams of {sensors} sensors, {secs:.0f} s each; {before / 60:.0f} min before")
        alone = on(1, before, streams, sensors, secs)[0]
        for cores in (1, 10, 100, 1000):
            wall, passes = on(cores, before, streams, sensors, secs)
            what = limit if before > wall / 2 else "passes" if cores < passes else "one pass"
            print(f"  {cores:5d} cores: {wall / 3600:6.2f} h, {alone / wall:5.0f} x; limited by {what}")


if __name__ == "__main__":
    main()
