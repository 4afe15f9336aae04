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

import json
from datetime import datetime, timedelta
from pathlib import Path

import protocols
from protocols import CAP, day, head, mean_of, quotient, regrets, row, smallest, typical_regret

SENSORS = ["PIT300", "TIT101", "TUIT101"]
RATES = [0, 1e-6, 1e-5, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2]
LEADS = [3, 14, 33, 93]
MONTHS = range(1, 11)
ENDS = [datetime(2023, 3, 31), datetime(2023, 7, 31), datetime(2023, 11, 30)]
# Longest time before T at which the training of an agent begins, in days.
LENGTHS = {"12 months": 365, "6 months": 182, "3 months": 91}
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


def span(start: datetime, end: datetime) -> str:
    return f"{{ start = {day(start)}, end = {day(end)} }}"


def days(count: int) -> timedelta:
    return timedelta(days=count)


class Plant:
    def __init__(self, number: int, folder: Path, calib: str):
        self.seed = 700 + number
        self.end = ENDS[number % 3]
        self.calib = calib
        self.folder = folder

    def runs(self, name: str, train: str, pretrain: str, model: str, leads: list[int], origin: datetime, online: int, replay: int):
        """Returns the runs of one study by deployment. Its agents are deployed `leads` days after `origin`."""
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
        # The plant is the same in all studies, and checking it takes seconds, so only the first study does it.
        protocols.run(self.calib, path, *["simulate"] * (name == "newest"), "pretrain", "sweep")
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
    """Returns the mean logarithm of the error, `[sensor][rate]`, of windows that begin in row `since` or later."""
    import polars

    own = table.filter(polars.col("environment") == environment)
    if since is not None:
        own = own.filter(polars.col("start_row") >= since)
        if own.is_empty():
            return None
    return protocols.errors(own, SENSORS, len(RATES))


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
        """Returns, per plant, the mean over sensors of ln(error of the choice / error of the best rate)."""
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

    print(f"{len(plants)} plants. Typical regret in % (95 % over plants), by days from training to deployment:\n")
    columns = [f"{lead} days" for lead in LEADS]
    head("chooser", *columns)
    rows = [(name, "12 months") for name in ["not going on", "split", "year", "lead", "others", "hindsight", "random"]]
    rows += [(name, length) for length in list(LENGTHS)[1:] for name in ["year", "lead"]]
    for name, length in rows:
        cells = []
        for lead in LEADS:
            values = over_sensors(lead, name, length)
            cells.append("" if values is None else typical_regret(values))
        row(name if length == "12 months" else f"{name}, {length}", *cells)
    cells = []
    for lead in LEADS:
        own = [
            [regrets(plant["half_truth"][str(lead)][sensor])[smallest(plant["half"][sensor])] for sensor in range(len(SENSORS))]
            for plant in plants
        ]
        cells.append(typical_regret([sum(values) / len(values) for values in own]))
    row("agent of the first half, log replay of the second (its own regret)", *cells)

    print("\nQuotients of errors (95 % over plants):\n")
    head("", *columns)
    for one, other in [("lead", "split"), ("year", "split"), ("year", "lead"), ("lead", "others"), ("lead", "not going on")]:
        cells = []
        for lead in LEADS:
            pairs = zip(over_sensors(lead, one), over_sensors(lead, other))
            cells.append(quotient([a - b for a, b in pairs]))
        row(f"{one} / {other}", *cells)
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
        cells.append(quotient(values))
    row("newest agent by lead / agent of the first half by log replay", *cells)

    print("\nMost frequent choice of each sensor:\n")
    head("chooser", "sensor", *columns)
    for name in ["split", "year", "lead", "hindsight"]:
        for number, sensor in enumerate(SENSORS):
            cells = []
            for lead in LEADS:
                all_chosen = [chosen(plant, lead, number, name, "12 months") for plant in plants]
                mode = max(set(all_chosen), key=all_chosen.count)
                cells.append(f"{RATES[mode]:g} ({all_chosen.count(mode)})")
            row(name, sensor, *cells)


if __name__ == "__main__":
    protocols.make_and_report(
        __doc__, "lead.jsonl", 24, lambda number, folder, calib: Plant(number, folder, calib).outcome(), report
    )
