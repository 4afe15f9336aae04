"""What the protocols with simulated plants share: how their plants are made and kept, and how regrets are told."""

import argparse
import json
import math
import random
import subprocess
from collections.abc import Callable, Iterable
from datetime import datetime
from pathlib import Path

# Cap: a larger ratio to the best error counts as this one. Otherwise a single diverged run would decide every mean.
CAP = math.log(10)


def make_and_report(description: str, name: str, plants: int, make: Callable, report: Callable) -> None:
    """Runs the command line of a protocol: makes its plants one by one, keeps them in FOLDER/NAME, and prints the report.

    `make(number, folder, calib)` returns a plant's outcome as JSON, and `report(outcomes)` prints the tables.
    """
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--plants", type=int, nargs=2, default=[0, plants], metavar=("FIRST", "END"))
    parser.add_argument("--report", action="store_true", help=f"only print the tables of FOLDER/{name}")
    parser.add_argument("--calib", default="target/release/calib")
    arguments = parser.parse_args()
    path = arguments.folder / name
    lines = path.read_text().splitlines() if path.exists() else []
    kept = {plant["plant"]: plant for plant in map(json.loads, lines)}
    if not arguments.report:
        for number in range(*arguments.plants):
            if number in kept:
                continue
            folder = arguments.folder / f"plant-{number}"
            folder.mkdir(parents=True, exist_ok=True)
            kept[number] = json.loads(json.dumps({"plant": number} | make(number, folder, arguments.calib)))
            with path.open("a") as file:
                file.write(json.dumps(kept[number]) + "\n")
            print(f"plant {number} is done", flush=True)
    if not kept:
        parser.error(f"{path} has no plants; leave --report out to make them")
    report([kept[number] for number in sorted(kept)])


def day(time: datetime) -> str:
    return time.strftime("%Y-%m-%d")


def even_in_logarithm(generator: random.Random, low: float, high: float) -> float:
    return math.exp(generator.uniform(math.log(low), math.log(high)))


def mean(values: Iterable[float]) -> float:
    own = list(values)
    return sum(own) / len(own)


def run(calib: str, study: Path, *steps: str) -> None:
    for step in steps:
        subprocess.run([calib, step, "-q", str(study)], check=True, stdout=subprocess.DEVNULL)


def errors(runs, sensors: list[str], candidates: int) -> list[list[float]]:
    """Returns the mean logarithm of the error over some rows of runs.parquet, `[sensor][candidate]`; infinite if a run diverged."""
    import polars

    found = []
    for sensor in sensors:
        row = []
        for candidate in range(candidates):
            own = runs.filter((polars.col("sensor") == sensor) & (polars.col("candidate") == candidate))
            values = own["nrmse"].to_list()
            if own["diverged"].any() or not all(math.isfinite(value) for value in values):
                row.append(math.inf)
            else:
                row.append(round(sum(map(math.log, values)) / len(values), 5))
        found.append(row)
    return found


def mean_of(tables: list[list[list[float]]]) -> list[list[float]] | None:
    """Returns the mean of tables `[sensor][candidate]`."""
    if not tables:
        return None
    return [[round(sum(values) / len(values), 5) for values in zip(*rows)] for rows in zip(*tables)]


def smallest(row: list[float]) -> int:
    return min(range(len(row)), key=lambda place: row[place])


def regret_of_choice(truth, errors) -> float:
    """Returns ln(error / best error) of the candidate with the smallest of `errors`, or of a random one if there are none.

    Both are arrays of logarithms, by candidate.
    """
    chosen = truth.mean() if errors is None else truth[smallest(list(errors))]
    return float(chosen - truth.min())


def regrets(truth: list[float]) -> list[float]:
    """Returns ln(error / best error) of each candidate, at most ln(10)."""
    best = min(truth)
    return [min(value - best, CAP) for value in truth]


def quantile(freedom: int) -> float:
    """Returns the two-sided 97.5 % point of Student's t; from 30 degrees of freedom on that for 30."""
    points = [12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179, 2.160, 2.145, 2.131,
              2.120, 2.110, 2.101, 2.093, 2.086, 2.080, 2.074, 2.069, 2.064, 2.060, 2.056, 2.052, 2.048, 2.045, 2.042]
    return points[min(freedom, len(points)) - 1]


def interval(values: list[float]) -> tuple[float, float, float]:
    """Returns the mean and its 95 % interval by Student's t."""
    count, middle = len(values), mean(values)
    if count < 2:
        return middle, math.nan, math.nan
    deviation = math.sqrt(sum((value - middle) ** 2 for value in values) / (count - 1))
    half = quantile(count - 1) * deviation / math.sqrt(count)
    return middle, middle - half, middle + half


def typical_regret(values: list[float]) -> str:
    """Formats the typical regret in per cent with its interval, from one logarithm per plant."""
    middle, low, high = (f"{(math.exp(value) - 1) * 100:.1f}" for value in interval(values))
    return f"{middle} ({low} to {high})"


def quotient(values: list[float]) -> str:
    """Formats a ratio with its interval, from differences of the plants' logarithms."""
    middle, low, high = (f"{math.exp(value):.3f}" for value in interval(values))
    return f"{middle} ({low} to {high})"


def head(*names: str) -> None:
    print("| " + " | ".join(names) + " |")
    print("|---" * len(names) + "|")


def row(*cells: object) -> None:
    print("| " + " | ".join(map(str, cells)) + " |")
