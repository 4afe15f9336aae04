#!/usr/bin/env python3
"""Logs of twenty wastewater plants that nobody of calib wrote, for configs/validity/wastewater.toml.

    pip install bsm2-python==0.0.16 numpy polars
    python3 scripts/wastewater_logs.py DIR [--plants FIRST END]     # it can be stopped and run again

DIR gets plant-00.parquet to plant-19.parquet. A log that is there is kept. All random numbers follow from the plant's number.

*The plant* is the wastewater benchmark BSM1 of the International Water Association, as bsm2-python (BSD-3) simulates it: five tanks of
activated sludge and a settler. Its influent is that of BSM2: 609 days of weather, seasons and loads. The tanks of BSM1 are half as
large as those of BSM2, and untreated influent would wash its nitrifying bacteria out. So it runs as one of two equal lanes of BSM2:
the influent goes through BSM2's primary clarifier, and half of it comes here. The settler, the return sludge and the recirculation
are half of BSM2's too. Between its values, 15 minutes apart, the influent follows straight lines.

*A log* has 74 days with a row every five minutes, which is also the step of the simulation: 60 days to learn from, 14 held out. It
begins after 21 days that are not recorded. The twenty logs begin 27 days apart. So each shares 47 days of its influent with the next
one, and held-out periods share none. Intervals over these plants are therefore not those of fully independent plants. Day 0 of the
influent is called 1 November 2022 here, which puts its coldest day into January.

*Operators* differ. The number of the plant decides which of four rules sets the aeration of tanks 3 to 5: oxygen is kept at a
set-point, the aeration follows ammonia, it follows the clock, or somebody chooses a level three times a day. Each operator draws his own
levels and set-points, takes the aeration in hand from time to time, and wastes sludge by its concentration once per day.

*Sensors* have white noise and a drift over days, both in per cent of the value, and a noise of their own (NOISE, our choice). Each
plant has 0.5 to 2 times that noise. Operators see what the log has. One value in a thousand is missing, and once per week and
sensor 15 to 50 minutes are, as while it is cleaned. Set values (aeration, waste flow) are exact.

Units are in the names of columns. `per_d` is the oxygen transfer coefficient KLa in 1/day.
"""

import argparse
import dataclasses
import functools
import math
import os
from collections.abc import Callable
from datetime import datetime, timedelta, timezone
from pathlib import Path

import numpy as np

PLANTS = 20
# Days from one log's first day to that of the next one.
SPACING_DAYS = 27
WARM_UP_DAYS = 21
LOG_DAYS = 74
ROWS_A_DAY = 288
FIRST_DAY = datetime(2022, 11, 1, tzinfo=timezone.utc)
# Share of BSM2 that this lane has.
LANE = 0.5
# Waste sludge in m3 per day: half of BSM2's in winter.
WASTE_FLOW = 150.0
MOST_AIR = 240.0
# Positions of the measured quantities among the 21 numbers of a stream.
OXYGEN, NITRATE, AMMONIA, SOLIDS, FLOW, TEMPERATURE = 7, 8, 9, 13, 14, 15
COD = slice(0, 7)


@dataclasses.dataclass(frozen=True)
class Noise:
    """Errors of a sensor: standard deviations of noise and drift as shares of the value, of noise in its unit, and digits of the log."""

    share: float
    own: float
    digits: int


NOISE = {
    "influent_flow_m3_d": Noise(0.015, 0.0, 0),
    "influent_ammonia_mg_l": Noise(0.03, 0.2, 2),
    "influent_cod_mg_l": Noise(0.04, 3.0, 1),
    "tank_5_temperature_c": Noise(0.0, 0.05, 2),
    "tank_2_nitrate_mg_l": Noise(0.03, 0.1, 2),
    "tank_3_oxygen_mg_l": Noise(0.02, 0.02, 2),
    "tank_4_oxygen_mg_l": Noise(0.02, 0.02, 2),
    "tank_5_oxygen_mg_l": Noise(0.02, 0.02, 2),
    "tank_5_nitrate_mg_l": Noise(0.03, 0.1, 2),
    "tank_5_ammonia_mg_l": Noise(0.03, 0.1, 2),
    "tank_5_solids_mg_l": Noise(0.02, 10.0, 0),
    "effluent_flow_m3_d": Noise(0.015, 0.0, 0),
    "effluent_ammonia_mg_l": Noise(0.03, 0.1, 2),
    "effluent_nitrate_mg_l": Noise(0.03, 0.1, 2),
    "effluent_solids_mg_l": Noise(0.03, 0.2, 1),
}
DRIFT_DAYS = 2.0


def influent(first_day: int, days: int) -> np.ndarray:
    """Returns BSM2's influent after its primary clarifier: one row per 5 min with the time in days and the stream's 21 numbers."""
    import bsm2_python
    from bsm2_python.bsm2.init import asm1init_bsm2, primclarinit_bsm2
    from bsm2_python.bsm2.primclar_bsm2 import PrimaryClarifier

    path = Path(bsm2_python.__file__).parent / "data/dyninfluent_bsm2.csv"
    rows = range(96 * first_day, 96 * (first_day + days) + 1)
    with path.open(encoding="utf-8-sig") as file:
        raw = np.array([line.split(",") for number, line in enumerate(file) if number in rows], float)
    clarifier = PrimaryClarifier(
        primclarinit_bsm2.VOL_P, primclarinit_bsm2.YINIT1.copy(), primclarinit_bsm2.PAR_P, asm1init_bsm2.PAR1,
        primclarinit_bsm2.XVECTOR_P, tempmodel=True, activate=False,
    )  # fmt: skip
    settled = np.array([clarifier.output(1 / 96, 0.0, row)[1][:21] for row in raw[:, 1:]])
    settled[:, FLOW] *= LANE
    # The benchmark stops two rows before the end of its influent.
    coarse, fine = np.arange(len(raw)) / 96, np.arange(ROWS_A_DAY * days + 2) / ROWS_A_DAY
    # It takes the last row whose time is not after its own. The offset
    # keeps rounding from selecting the row before.
    return np.column_stack([fine - 1e-9, *(np.interp(fine, coarse, column) for column in settled.T)])


class Plant:
    """The benchmark as one lane of BSM2. With `charged` it also computes the costs of its effluent, which takes an eighth of the time."""

    def __init__(self, stream: np.ndarray, charged: bool = False):
        from bsm2_python import BSM1OL
        from bsm2_python.bsm2.init import asm1init_bsm2

        self.plant = BSM1OL(data_in=stream, timestep=1 / ROWS_A_DAY, tempmodel=True)
        plant = self.plant
        tanks = [plant.reactor1, plant.reactor2, plant.reactor3, plant.reactor4, plant.reactor5]
        for number, tank in enumerate(tanks, 1):
            tank.y0 = getattr(asm1init_bsm2, f"YINIT{number}").copy()
        plant.performance.iqi = lambda *_: [0.0]
        if not charged:
            plant.performance.eqi = plant.performance.iqi
        # The package shares this array among all plants.
        plant.settler.ys0 = plant.settler.ys0.copy()
        plant.settler.dim = plant.settler.dim * [LANE, 1.0]
        plant.settler.q_r = LANE * asm1init_bsm2.QR
        plant.qintr = LANE * asm1init_bsm2.QINTR
        # Until the first step, the returned streams equal the content of the last tank.
        plant.ys_out, plant.y_out5_r = tanks[4].y0.copy(), tanks[4].y0.copy()
        plant.ys_out[FLOW], plant.y_out5_r[FLOW] = plant.settler.q_r, plant.qintr

    def step(self, row: int, air: np.ndarray, waste_flow: float) -> np.ndarray:
        """Advances five minutes, and returns the true values of the quantities in NOISE."""
        plant = self.plant
        plant.settler.q_w = waste_flow
        plant.step(row, np.array([0.0, 0.0, *air]))
        came, last, left = plant.y_in_all[row], plant.y_out5, plant.ys_eff
        return np.array([
            came[FLOW], came[AMMONIA], came[COD].sum(), last[TEMPERATURE], plant.y_out2[NITRATE],
            plant.y_out3[OXYGEN], plant.y_out4[OXYGEN], last[OXYGEN], last[NITRATE], last[AMMONIA], last[SOLIDS],
            left[FLOW], left[AMMONIA], left[NITRATE], left[SOLIDS],
        ])  # fmt: skip


class Sensors:
    """Recorded values of the sensors, made from the true values."""

    def __init__(self, rng: np.random.Generator):
        self.rng = rng
        scale = math.exp(rng.uniform(math.log(0.5), math.log(2.0)))
        self.share = scale * np.array([noise.share for noise in NOISE.values()])
        self.own = scale * np.array([noise.own for noise in NOISE.values()])
        self.digits = [noise.digits for noise in NOISE.values()]
        self.drift = rng.standard_normal(len(NOISE))
        self.kept = math.exp(-1.0 / (DRIFT_DAYS * ROWS_A_DAY))

    def measure(self, true: np.ndarray) -> np.ndarray:
        new, relative, own = self.rng.standard_normal((3, len(true)))
        self.drift = self.kept * self.drift + math.sqrt(1.0 - self.kept**2) * new
        seen = true * (1.0 + self.share * (relative + self.drift)) + self.own * own
        return np.array([round(max(value, 0.0), digits) for value, digits in zip(seen, self.digits)])

    def missing(self, rows: int) -> np.ndarray:
        """Returns which values the log lacks, `[row, sensor]`."""
        lacks = self.rng.random((rows, len(NOISE))) < 0.001
        for sensor in range(len(NOISE)):
            for start in np.flatnonzero(self.rng.random(rows) < 1.0 / (7 * ROWS_A_DAY)):
                lacks[start : start + self.rng.integers(3, 11), sensor] = True
        return lacks


class Operator:
    """Rule that sets the aeration of tanks 3 to 5 and the flow of waste sludge."""

    def __init__(self, number: int, rng: np.random.Generator):
        self.rng, self.rule = rng, RULES[number % len(RULES)]
        self.oxygen, self.ammonia, self.solids = rng.uniform(0.8, 2.0), rng.uniform(1.0, 3.0), rng.uniform(2800, 4000)
        self.level = rng.uniform(100.0, 160.0)
        self.hands_a_day = math.exp(rng.uniform(math.log(0.5), math.log(4.0)))
        self.split = np.array([1.0, rng.uniform(0.7, 1.1), rng.uniform(0.35, 0.65)])
        self.air, self.waste_flow = self.level * self.split, WASTE_FLOW
        self.rows_by_hand, self.factor = 0, 1.0

    def decide(self, row: int, seen: dict[str, float]) -> np.ndarray:
        """Returns the aeration until the next row, from the sensor values."""
        hour = 24.0 * (row % ROWS_A_DAY) / ROWS_A_DAY
        if hour == 8.0:
            wasted = WASTE_FLOW * (seen["tank_5_solids_mg_l"] / self.solids) ** 2
            self.waste_flow = float(np.clip(5.0 * round(wasted / 5.0), 40.0, 400.0))
        self.air = self.rule(self, hour, seen).clip(0.0, MOST_AIR)
        self.rows_by_hand -= 1
        if self.rng.random() < self.hands_a_day / ROWS_A_DAY:
            self.rows_by_hand, self.factor = self.rng.integers(6, 37), self.rng.uniform(0.3, 1.7)
        return (self.air * (self.factor if self.rows_by_hand > 0 else 1.0)).clip(0.0, MOST_AIR).round()


def keep_oxygen(operator: Operator, hour: float, seen: dict[str, float]) -> np.ndarray:
    """Increases the air in the last two tanks while their oxygen is below the set-point."""
    lacks = [0.0, operator.oxygen - seen["tank_4_oxygen_mg_l"], operator.oxygen - seen["tank_5_oxygen_mg_l"]]
    return operator.air + 4.0 * np.array(lacks)


def follow_ammonia(operator: Operator, hour: float, seen: dict[str, float]) -> np.ndarray:
    """Increases the air with the ammonia that is left, partially in each row."""
    wanted = operator.level * min(0.4 + 0.5 * seen["tank_5_ammonia_mg_l"] / operator.ammonia, 1.6)
    return operator.air + 0.15 * (wanted * operator.split - operator.air)


def follow_clock(operator: Operator, hour: float, seen: dict[str, float]) -> np.ndarray:
    """Sets little air at night, and most around noon."""
    share = 0.6 if hour < 6 else 1.0 if hour < 10 else 1.3 if hour < 16 else 1.0
    return operator.level * share * operator.split


def choose_level(operator: Operator, hour: float, seen: dict[str, float]) -> np.ndarray:
    """Sets a level for the shift, by ammonia and oxygen at its beginning."""
    if hour not in (6.0, 14.0, 22.0):
        return operator.air
    place = 2 if seen["tank_5_ammonia_mg_l"] > operator.ammonia else 1 if seen["tank_5_oxygen_mg_l"] < operator.oxygen else 0
    # Operators on a shift choose differently.
    share = [0.7, 1.0, 1.3][place] * operator.rng.uniform(0.8, 1.2)
    return operator.level * share * operator.split


RULES: list[Callable] = [keep_oxygen, follow_ammonia, follow_clock, choose_level]


def log_of(number: int):
    """Returns the log of a plant as a data frame."""
    import polars

    operator = Operator(number, np.random.default_rng([number, 0]))
    sensors = Sensors(np.random.default_rng([number, 1]))
    first_day = SPACING_DAYS * number
    plant = Plant(influent(first_day, WARM_UP_DAYS + LOG_DAYS))
    seen, table = None, []
    for row in range(ROWS_A_DAY * (WARM_UP_DAYS + LOG_DAYS)):
        air = operator.decide(row, seen) if seen else operator.air
        waste_flow = operator.waste_flow
        measured = sensors.measure(plant.step(row, air, waste_flow))
        seen = dict(zip(NOISE, measured))
        table.append([*measured, *air, waste_flow])
    recorded = np.array(table[ROWS_A_DAY * WARM_UP_DAYS :])
    if not np.isfinite(recorded).all():
        raise ArithmeticError(f"plant {number} does not stay finite")
    recorded[:, : len(NOISE)][sensors.missing(len(recorded))] = np.nan
    start = FIRST_DAY + timedelta(days=first_day + WARM_UP_DAYS)
    # The settings of the five minutes that end in a row stand in that row, beside the measurements at their end.
    times = [start + timedelta(minutes=1440 / ROWS_A_DAY * (row + 1)) for row in range(len(recorded))]
    names = [*NOISE, *(f"tank_{tank}_aeration_per_d" for tank in (3, 4, 5)), "waste_flow_m3_d"]
    columns = {name: polars.Series(column, nan_to_null=True) for name, column in zip(names, recorded.T)}
    return polars.DataFrame({"timestamp": polars.Series(times, dtype=polars.Datetime("ms", "UTC"))} | columns)


def solve_to_five_digits() -> None:
    """Makes the solver compute five digits per step instead of eight, which is much faster. Sensors show three."""
    import scipy.integrate
    from bsm2_python.bsm2 import asm1_bsm2, primclar_bsm2, settler1d_bsm2

    for module in (asm1_bsm2, primclar_bsm2, settler1d_bsm2):
        module.odeint = functools.partial(scipy.integrate.odeint, rtol=1e-5, atol=1e-5)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--plants", type=int, nargs=2, default=[0, PLANTS], metavar=("FIRST", "END"))
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    solve_to_five_digits()
    for number in range(*arguments.plants):
        path = arguments.folder / f"plant-{number:02}.parquet"
        if path.exists():
            continue
        unfinished = path.with_suffix(".tmp")
        log_of(number).write_parquet(unfinished)
        os.replace(unfinished, path)
        print(f"{path} is made", flush=True)


if __name__ == "__main__":
    main()
