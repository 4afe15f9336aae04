#!/usr/bin/env python3
"""Which part of the log should choose the rate at which a pre-trained agent goes on learning?

    pip install numpy polars
    python3 scripts/lead_protocol.py DIR [--plants FIRST END]     # it can be stopped and run again
    python3 scripts/lead_protocol.py DIR --report                 # only the tables

The protocol, as it was fixed before its runs:

- *Plants.* 24 simulated plants that change while they run (`simulate.change = 1`), numbers 0 to 23: seed 700 + number, 16
  channels, a row every ten minutes. A year of log ends at T: 365 days after 31 March, 31 July or 30 November 2022, in turn.
- *Agents.* The network of the profile `tiny` of configs/paper/fine-tuning.toml (2 x 32 units, gamma 0.9), pre-trained for 30
  epochs on one month, for PIT300, TIT101 and TUIT101. Nine rates to go on with. Runs of 900 steps (6 days), scored over their
  final quarter.
- *Truth.* The agent of the last month before T goes on learning in two windows of the two weeks that begin 3, 14, 33 and 93 days
  after T, three runs in each. The error of a rate is the geometric mean. What diverges counts as ten times the best.
- *Choosers*, each by the smallest mean logarithm of the error:
  - `not going on`: rate 0;
  - `split`: the agent of the last month but one, replayed over the last month (the paper's split, with months);
  - `year`: the deployed agent, replayed over the eleven months before it was trained;
  - `lead`: agents of ten months (those that end 30, 60, ... 300 days before T), each replayed in the two weeks that begin as
    many days after its training as the deployment does; where these end after T the agent is left out;
  - `others`: the rate with the least error over the other plants, for that sensor and lead;
  - `hindsight`: the best rate over all plants, for that sensor and lead; `random`: the mean over all rates.
- *Beside it* stands what a user of calib's default gets (`pretrain.fraction = 0.5`): the agent of the first half of the year,
  with the rate that log replay over the second half chooses.
- *The unit of every interval is the plant*: mean over sensors of the logarithm, Student's t over plants.
- *What is decided.* `lead` becomes a feature (`pretrain.lead`) if at 33 and at 93 days its error is below 0.97 of the split's,
  with an interval below 1, and if `year`, which needs no new feature, is not as good: if the upper end of year / lead is at most
  1.02 at both leads, `year` is what the documents and `calib init` propose.
- *Second*: `lead` and `year` from the last six and three months of the log only, where agents remain.
"""

import argparse
import json
import math
import subprocess
from datetime import datetime, timedelta
from pathlib import Path

SENSORS = ["PIT300", "TIT101", "TUIT101"]
RATES = [0, 1e-6, 1e-5, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2]
LEADS = [3, 14, 33, 93]
MONTHS = range(1, 11)
ENDS = [datetime(2023, 3, 31), datetime(2023, 7, 31), datetime(2023, 11, 30)]
# How long before T the training of an agent began, at the most.
LENGTHS = {"12 months": 365, "6 months": 182, "3 months": 91}
CAP = math.log(10)
ROWS_A_DAY = 144

STUDY = """seed = {seed}
output = "{name}"

[simulate]
start = {start}
days = 472
channels = 16
period_secs = 600
change = 1
seed = {seed}

[data]
path = "plant"
train = {train}

[preprocess]
missing = "forward_fill"
fill_limit = 2

[pretrain]
{pretrain}
epochs = 30
learning_rate = 3e-4

[agent]
optimiser = "adam"
gamma = 0.9
batch_size = 64
hidden_layers = 2
hidden_units = 32
replay_capacity = 3000000
learning_rate = 1e-5

[model]
kind = "none"
{model}

[sweep]
sensors = {sensors}
steps = 900
online_runs = {online}
log_replay_runs = {replay}
scored = "final_quarter"
curve_points = 0

[sweep.grid]
learning_rate = {rates}

[evaluate]
rule = "log_replay"
"""


def day(time: datetime) -> str:
    return time.strftime("%Y-%m-%d")


def span(start: datetime, end: datetime) -> str:
    return f"{{ start = {day(start)}, end = {day(end)} }}"


def days(count: int) -> timedelta:
    return timedelta(days=count)


class Plant:
    def __init__(self, number: int, calib: str, folder: Path):
        self.number = number
        self.seed = 700 + number
        self.end = ENDS[number % 3]
        self.calib = calib
        self.folder = folder / f"plant-{number}"
        self.folder.mkdir(parents=True, exist_ok=True)

    def runs(self, name: str, train: str, pretrain: str, model: str, leads: list[int], origin: datetime, online: int, replay: int):
        """The runs of one study: its agents are deployed so many days after `origin`. By deployment."""
        import polars

        path = self.folder / f"{name}.toml"
        text = STUDY.format(
            name=name, seed=self.seed, start=day(self.end - days(365)), train=train, pretrain=pretrain, model=model,
            sensors=json.dumps(SENSORS), online=online, replay=replay, rates=json.dumps(RATES),
        )
        for lead in leads:
            start = origin + days(lead)
            text += f"\n[deployments.d{lead}]\nstart = {day(start)}\nend = {day(start + days(14))}\n"
        path.write_text(text)
        # The plant is the same in all studies, and looking whether it is there takes seconds: the first study does.
        for step in ["simulate", "pretrain", "sweep"] if name == "newest" else ["pretrain", "sweep"]:
            subprocess.run([self.calib, step, "-q", str(path)], check=True, stdout=subprocess.DEVNULL)
        tables = {}
        for lead in leads:
            several = self.folder / name / "deployments" / f"d{lead}" / "sweep" / "runs.parquet"
            one = self.folder / name / "sweep" / "runs.parquet"
            tables[lead] = polars.read_parquet(several if several.exists() else one)
        return tables

    def outcome(self) -> dict:
        begin, end = self.end - days(365), self.end
        month = f"period = {span(end - days(30), end)}"
        before = f"period = {span(begin, end - days(30))}"
        newest = self.runs("newest", span(begin, end), month, before, LEADS, end, 6, 24)
        split = self.runs("split", span(begin, end), f"period = {span(end - days(60), end - days(30))}",
                          f"period = {span(end - days(30), end)}", [3], end, 1, 8)
        half = self.runs("half", span(begin, end), "fraction = 0.5", "", LEADS, end, 6, 12)
        origins = {}
        for number in MONTHS:
            origin = end - days(30 * number)
            leads = [lead for lead in LEADS if origin + days(lead + 14) <= end]
            if leads:
                pretrain = f"period = {span(origin - days(30), origin)}"
                model = f"period = {span(begin, origin - days(30))}"
                origins[number] = self.runs(f"month-{number}", span(begin, origin), pretrain, model, leads, origin, 2, 1)
        first = {name: 365 - length for name, length in LENGTHS.items()}
        return {
            "plant": self.number,
            "truth": {lead: errors(table, "online") for lead, table in newest.items()},
            "half_truth": {lead: errors(table, "online") for lead, table in half.items()},
            "split": errors(split[3], "log-replay"),
            "half": errors(half[3], "log-replay"),
            "year": {
                name: errors(newest[3], "log-replay", skipped * ROWS_A_DAY) for name, skipped in first.items()
            },
            "lead": {
                lead: {
                    name: mean_of([
                        errors(tables[lead], "online")
                        for number, tables in origins.items()
                        if lead in tables and 30 * number + 30 <= length
                    ])
                    for name, length in LENGTHS.items()
                }
                for lead in LEADS
            },
        }


def errors(table, environment: str, since: int | None = None) -> list[list[float]] | None:
    """Mean logarithm of the error, `[sensor][rate]`; of windows that begin in row `since` or later."""
    import polars

    own = table.filter(polars.col("environment") == environment)
    if since is not None:
        own = own.filter(polars.col("start_row") >= since)
        if own.is_empty():
            return None
    found = []
    for sensor in SENSORS:
        row = []
        for candidate in range(len(RATES)):
            runs = own.filter((polars.col("sensor") == sensor) & (polars.col("candidate") == candidate))
            values = runs["nrmse"].to_numpy()
            if runs["diverged"].any() or not all(math.isfinite(value) for value in values):
                row.append(math.inf)
            else:
                row.append(round(sum(math.log(value) for value in values) / len(values), 5))
        found.append(row)
    return found


def mean_of(tables: list) -> list[list[float]] | None:
    if not tables:
        return None
    return [
        [round(sum(table[sensor][rate] for table in tables) / len(tables), 5) for rate in range(len(RATES))]
        for sensor in range(len(SENSORS))
    ]


def smallest(row: list[float]) -> int:
    return min(range(len(row)), key=lambda rate: row[rate])


def interval(values: list[float]) -> tuple[float, float, float]:
    """Mean and 95 % interval by Student's t."""
    # Two-sided 97.5 % points of Student's t for 1 to 30 degrees of freedom.
    points = [12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179, 2.160, 2.145, 2.131,
              2.120, 2.110, 2.101, 2.093, 2.086, 2.080, 2.074, 2.069, 2.064, 2.060, 2.056, 2.052, 2.048, 2.045, 2.042]
    count = len(values)
    mean = sum(values) / count
    if count < 2:
        return mean, math.nan, math.nan
    deviation = math.sqrt(sum((value - mean) ** 2 for value in values) / (count - 1))
    half = points[min(count - 1, 30) - 1] * deviation / math.sqrt(count)
    return mean, mean - half, mean + half


def regrets(truth: list[float]) -> list[float]:
    """Logarithm of each rate's error by the best one's, at most that of ten."""
    best = min(truth)
    return [min(value - best, CAP) for value in truth]


def report(plants: list[dict]) -> None:
    def cost(plant: dict, lead: int, sensor: int, rate: int) -> float:
        return regrets(plant["truth"][str(lead)][sensor])[rate]

    def cheapest(plants: list[dict], lead: int, sensor: int) -> int:
        return min(range(len(RATES)), key=lambda rate: sum(cost(plant, lead, sensor, rate) for plant in plants))

    def chosen(plant: dict, lead: int, sensor: int, chooser: str, length: str) -> int | None:
        if chooser == "not going on":
            return 0
        if chooser == "split":
            return smallest(plant["split"][sensor])
        if chooser == "others":
            return cheapest([other for other in plants if other is not plant], lead, sensor)
        if chooser == "hindsight":
            return cheapest(plants, lead, sensor)
        table = plant["year"][length] if chooser == "year" else plant["lead"][str(lead)][length]
        return smallest(table[sensor]) if table else None

    def over_sensors(lead: int, chooser: str, length: str = "12 months") -> list[float] | None:
        """Of each plant, the mean over sensors of the logarithm of the choice's error by the best rate's."""
        values = []
        for plant in plants:
            own = []
            for sensor in range(len(SENSORS)):
                if chooser == "random":
                    own.append(sum(regrets(plant["truth"][str(lead)][sensor])) / len(RATES))
                    continue
                rate = chosen(plant, lead, sensor, chooser, length)
                if rate is None:
                    return None
                own.append(cost(plant, lead, sensor, rate))
            values.append(sum(own) / len(own))
        return values

    def percent(value: float) -> str:
        return f"{(math.exp(value) - 1) * 100:.1f}"

    print(f"{len(plants)} plants. Typical regret in % (95 % over plants), by days from training to deployment:\n")
    print("| chooser | " + " | ".join(f"{lead} days" for lead in LEADS) + " |")
    print("|---" * (len(LEADS) + 1) + "|")
    rows = [(name, "12 months") for name in ["not going on", "split", "year", "lead", "others", "hindsight", "random"]]
    rows += [(name, length) for length in list(LENGTHS)[1:] for name in ["year", "lead"]]
    for name, length in rows:
        cells = []
        for lead in LEADS:
            values = over_sensors(lead, name, length)
            if values is None:
                cells.append("")
                continue
            mean, low, high = interval(values)
            cells.append(f"{percent(mean)} ({percent(low)} to {percent(high)})")
        label = name if length == "12 months" else f"{name}, {length}"
        print(f"| {label} | " + " | ".join(cells) + " |")
    cells = []
    for lead in LEADS:
        own = [
            [regrets(plant["half_truth"][str(lead)][sensor])[smallest(plant["half"][sensor])] for sensor in range(len(SENSORS))]
            for plant in plants
        ]
        mean, low, high = interval([sum(values) / len(values) for values in own])
        cells.append(f"{percent(mean)} ({percent(low)} to {percent(high)})")
    print("| agent of the first half, log replay of the second (its own regret) | " + " | ".join(cells) + " |")

    print("\nQuotients of errors (95 % over plants):\n")
    print("| | " + " | ".join(f"{lead} days" for lead in LEADS) + " |")
    print("|---" * (len(LEADS) + 1) + "|")
    for one, other in [("lead", "split"), ("year", "split"), ("year", "lead"), ("lead", "others"), ("lead", "not going on")]:
        cells = []
        for lead in LEADS:
            pairs = zip(over_sensors(lead, one), over_sensors(lead, other))
            mean, low, high = interval([a - b for a, b in pairs])
            cells.append(f"{math.exp(mean):.3f} ({math.exp(low):.3f} to {math.exp(high):.3f})")
        print(f"| {one} / {other} | " + " | ".join(cells) + " |")
    cells = []
    for lead in LEADS:
        values = []
        for plant in plants:
            own = []
            for sensor in range(len(SENSORS)):
                half = plant["half_truth"][str(lead)][sensor][smallest(plant["half"][sensor])]
                newest = plant["truth"][str(lead)][sensor][chosen(plant, lead, sensor, "lead", "12 months")]
                own.append(max(min(newest - half, CAP), -CAP))
            values.append(sum(own) / len(own))
        mean, low, high = interval(values)
        cells.append(f"{math.exp(mean):.3f} ({math.exp(low):.3f} to {math.exp(high):.3f})")
    print("| newest agent by lead / agent of the first half by log replay | " + " | ".join(cells) + " |")

    print("\nMost frequent choice of each sensor:\n")
    print("| chooser | sensor | " + " | ".join(f"{lead} days" for lead in LEADS) + " |")
    print("|---" * (len(LEADS) + 2) + "|")
    for name in ["split", "year", "lead", "hindsight"]:
        for number, sensor in enumerate(SENSORS):
            cells = []
            for lead in LEADS:
                all_chosen = [chosen(plant, lead, number, name, "12 months") for plant in plants]
                mode = max(set(all_chosen), key=all_chosen.count)
                cells.append(f"{RATES[mode]:g} ({all_chosen.count(mode)})")
            print(f"| {name} | {sensor} | " + " | ".join(cells) + " |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--plants", type=int, nargs=2, default=[0, 24], metavar=("FIRST", "END"))
    parser.add_argument("--report", action="store_true", help="only print the tables of FOLDER/lead.jsonl")
    parser.add_argument("--calib", default="target/release/calib")
    arguments = parser.parse_args()
    path = arguments.folder / "lead.jsonl"
    lines = path.read_text().splitlines() if path.exists() else []
    plants = {plant["plant"]: plant for plant in map(json.loads, lines)}
    if not arguments.report:
        for number in range(*arguments.plants):
            if number in plants:
                continue
            plants[number] = json.loads(json.dumps(Plant(number, arguments.calib, arguments.folder).outcome()))
            with path.open("a") as file:
                file.write(json.dumps(plants[number]) + "\n")
            print(f"plant {number} is done", flush=True)
    if not plants:
        parser.error(f"{path} has no plants; leave --report out to make them")
    report([plants[number] for number in sorted(plants)])


if __name__ == "__main__":
    main()
