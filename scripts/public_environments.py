"""How well `calib_rl.tune` chooses on environments that nobody of calib wrote: the tables of docs/control.md, "Public environments".

    pip install './python[gym,frames,tune]' pcgym gymchem box2d bsm2-python
    python3 scripts/public_environments.py DIR [--environments cstr,lunar] [--logs FIRST END]
    python3 scripts/public_environments.py DIR --report
    python3 scripts/public_environments.py DIR --agent own [--report]
    python3 scripts/public_environments.py DIR --fitted-q [d3rlpy]
    python3 scripts/public_environments.py DIR --random-actions wastewater-7,four_tank-1
    python3 scripts/public_environments.py DIR --columns 24 [--report]
    python3 scripts/public_environments.py DIR --pessimism [--report]

For each environment and each number of a log: a rule of the plant acts, a quarter of its actions are at random, and what
happened is a log of 1,000 to 20,000 steps. A linear Q-learning agent has 16 settings. `calib_rl.tune` lets each learn in the
models of the log and chooses one. The truth is what each setting gets while it learns in the environment itself, as a mean over
five runs. Everything is kept in DIR as it is made, and the same call goes on from there.

--report prints Markdown: regret of the choice in % of that of a random choice, beside what calib advises (the default, unless
it says to deploy the choice), the choice where calib says that it is ahead of the default and else the default, the agent's
default, and the setting that is best in the other environments, with 95 % intervals by a bootstrap over logs, environments
weighted equally. Runs of a truth have common seeds, so how well it tells settings apart
is known: the share of the variance between settings that is not noise. Averages are given twice, over all environments and
over those where that share is at least RELIABLE.

--fitted-q makes the logs again, and chooses by fitted Q evaluation instead, which needs no model: each setting learns from as many
recorded transitions, in their order, as its agent has steps. What its policy would get then is estimated by 200 passes of ridge
regression on the features of the agent itself (Le, Voloshin and Yue 2019). It needs only the logs, and keeps the values of all
settings in DIR/fitted-q.json; --report has a row of it. It was added after the choices of calib were known. `--fitted-q d3rlpy` asks
the estimator of d3rlpy 2.8.1 about the same policies in the same logs: `DiscreteFQE` with its usual network and constants, 5,000
gradient steps, and its own predictions in the first states. Its values are kept in DIR/fitted-q-d3rlpy.json.

--agent dqn is the same question for Stable-Baselines3's DQN with its usual network, in the first five logs of pc-gym's reactor and
four tanks, whose settings the linear agent told apart. It has eight settings. Before its runs it was decided: the choice is better
than DQN's default if its regret is less, with a 95 % interval over logs above 0. The truth of a setting is again a mean over five runs.

--agent own asks it for an agent of calib, Q-learning with a network, which `calib control` sweeps itself. It has 16 settings, and ten
logs of pc-gym's reactor and four tanks and of LunarLander, whose settings the linear agent told apart. Its other settings are
calib's defaults, and the discount that of the linear agent. calib's agents scale the state by the range of the log they are tuned on.
In truth they do so by the range of the longest log, number 4. Before its runs it was decided: the choice is better than the default
(Adam's usual step size, 0.001, and calib's epsilon, 0.1) if it has less regret, with an interval above 0.

--columns N asks whether models of many columns choose as well. N columns replace those of the log: its own ones, and others that the
agent does not see. Half of the others are random mixtures of its own, standardised, with as much white noise; half are noise that drifts
(an autoregression of 0.95). The truth and the agent stay the same, so that only the models change. It was decided before its runs that
increments stay in calib's pool for logs of many columns if, with 24 and with 480 columns, the regret of the pool with them is no more
than 5 points above that of the pool without them, over the first five logs of the reactor and the four tanks. With --report it prints
the regret of each pool of kinds of models, with the columns of the environments and with each N that has logs in DIR.

--pessimism asks whether rollouts of neighbours should end, with the worst return, where the log has no such action near
(`pessimism="minimum_return"`). Only neighbours know this, so their runs are made again on all ten logs of the reactor, the four tanks
and LunarLander, and the stored runs of the other kinds of models stay. It was decided before its runs that this becomes the default if
the regret of the pool is less with it, with an interval above 0. With --report it prints both regrets, of neighbours alone and of the pool.
Both options need the truth and the choices of the linear agent in DIR.

`lane` was added after all of this, because the plant of `wastewater` is overloaded: BSM1 gets the untreated influent of BSM2, which is
twice as large, and its ammonia rises through every episode. Before its runs it was decided: its ten logs count in place of those of
`wastewater`, whatever they show, and the table keeps both. Its reward is made of what is measured, its episodes begin where the rule of
the plant had brought it, and all else is as for `wastewater`: actions, rule, rewards, agent, settings, runs and lengths of logs.

--random-actions names logs that are in DIR, and prints a row for each: what random actions get in the models of the log beside the choice
that is stored.
"""

import argparse
import dataclasses
import functools
import itertools
import json
import os
import random
import statistics
import sys
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np

STEPS = 5_000
RUNS = 5
LENGTHS = [1_000, 2_000, 5_000, 10_000, 20_000]
RANDOM_SHARE = 0.25
GAMMA = 0.97
PASSES = 200
D3RLPY_STEPS = 5_000
GRID = {"learning_rate": [0.003, 0.03, 0.1, 0.5], "epsilon": [0.02, 0.1, 0.3, 0.8]}
DEFAULT = {"learning_rate": 0.1, "epsilon": 0.1}
SETTINGS = [dict(zip(GRID, values)) for values in itertools.product(*GRID.values())]
RELIABLE = 0.8
WIDE = [24, 480]
WIDE_LOGS = 5
# The environments of pc-gym, whose settings the truth of the linear agent tells apart.
TOLD_APART = ["cstr", "four_tank"]
# The same and LunarLander: those that are told apart and whose truth takes little time.
WITH_FAST_TRUTH = [*TOLD_APART, "lunar"]
KINDS = {"neighbors", "increments", "network"}
# Environments that count in place of others.
REPLACED = {"wastewater": "lane"}
RUNS_OF_RANDOM = 4
# Warnings of calib that say that the choice is not ahead of the default in the models.
NOT_AHEAD = {"not_better_than_default", "not_told_apart", "diverged"}
DRAWS = 10_000


class Levels:
    """An environment with a few levels per action instead of numbers, observations scaled to about -1 to 1, and a limit of steps."""

    def __init__(self, env, levels, low, high, limit):
        import gymnasium

        self.env, self.levels, self.limit = env, levels, limit
        self.low, self.high = np.asarray(low, float), np.asarray(high, float)
        self.observation_space = gymnasium.spaces.Box(-10.0, 10.0, (len(low),))
        self.action_space = gymnasium.spaces.Discrete(len(levels))

    def scaled(self, seen):
        return (2.0 * (np.asarray(seen, float).ravel() - self.low) / (self.high - self.low) - 1.0).clip(-10, 10)

    def reset(self, seed=None):
        self.taken = 0
        return self.scaled(self.env.reset(seed=seed)[0]), {}

    def step(self, action):
        seen, reward, over, cut, _ = self.env.step(self.levels[int(action)])
        self.taken += 1
        return self.scaled(seen), float(np.asarray(reward).ravel()[0]), bool(over), bool(cut) or self.taken >= self.limit, {}


class Reactor:
    """pc-gym's stirred-tank reactor or its four tanks, whose episodes end after a fixed number of steps with a separate flag."""

    def __init__(self, parameters):
        from pcgym import make_env

        self.env, self.length = make_env(parameters), parameters["N"]

    def reset(self, seed=None):
        if seed is not None:
            np.random.seed(seed)
        self.taken = 0
        return self.env.reset()

    def step(self, action):
        seen, reward, _, _, info = self.env.step(action)
        self.taken += 1
        # The end of the time is not a terminal state.
        return seen, reward, False, self.taken >= self.length, info


def cstr():
    points = {"Ca": [0.85] * 30 + [0.9] * 31}
    parameters = {
        "N": 60, "tsim": 15.6, "SP": points, "x0": np.array([0.8, 330, 0.8]), "r_scale": {"Ca": 1e3}, "model": "cstr",
        "o_space": {"low": np.array([0.7, 300, 0.8]), "high": np.array([1, 350, 0.9])},
        "a_space": {"low": np.array([295]), "high": np.array([302])},
        "normalise_a": True, "normalise_o": True, "noise": True, "noise_percentage": 0.001, "integration_method": "casadi",
    }  # fmt: skip
    levels = [np.array([level]) for level in np.linspace(-1, 1, 7)]
    return Levels(Reactor(parameters), levels, [-1] * 3, [1] * 3, 60)


def cstr_rule(seen, _):
    # Concentration in [0.7, 1], set-point in [0.8, 0.9]: the coolant is colder if the concentration is too low.
    error = (0.8 + 0.05 * (seen[2] + 1)) - (0.7 + 0.15 * (seen[0] + 1))
    return int(np.clip(round(3 - 40 * error), 0, 6))


def four_tank():
    points = {"h3": [0.5] * 30 + [0.1] * 31, "h4": [0.2] * 30 + [0.3] * 31}
    parameters = {
        "N": 60, "tsim": 1000, "SP": points, "x0": np.array([0.141, 0.112, 0.072, 0.42, 0.5, 0.2]), "model": "four_tank",
        "o_space": {"low": np.zeros(6), "high": np.full(6, 0.6)},
        "a_space": {"low": np.array([0.1, 0.1]), "high": np.array([10, 10])}, "r_scale": {"h3": 1e3, "h4": 1e3},
        "normalise_a": True, "normalise_o": True, "noise": True, "noise_percentage": 0.001, "integration_method": "casadi",
    }  # fmt: skip
    pumps = [-0.8, 0.0, 0.8]
    return Levels(Reactor(parameters), [np.array([first, second]) for first in pumps for second in pumps], [-1] * 6, [1] * 6, 60)


def four_tank_rule(seen, _):
    # The second pump fills the third tank, and the first pump fills the fourth.
    def wanted(error):
        return 0 if error < -0.1 else 2 if error > 0.1 else 1

    return 3 * wanted(seen[5] - seen[3]) + wanted(seen[4] - seen[2])


def gymchem():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import gymchem as package
    levels = [np.array([level], np.float32) for level in (-10, -5, 0, 5, 10)]
    return Levels(package.CSTREnv(), levels, [250, 0, 280], [500, 1500, 350], 100)


def gymchem_rule(seen, _):
    # The coolant is warmer if the reactor is below the middle of its range.
    return int(np.clip(round(2 - 4 * (seen[0] + 0.2)), 0, 4))


def tanks_of(plant):
    return [plant.reactor1, plant.reactor2, plant.reactor3, plant.reactor4, plant.reactor5]


def state_of(plant):
    """Returns the state from which a plant of bsm2-python continues."""
    return [tank.y0.copy() for tank in tanks_of(plant)], plant.settler.ys0.copy(), plant.ys_out.copy(), plant.y_out5_r.copy()


def restore(plant, state):
    tanks, settler, out, back = state
    for tank, own in zip(tanks_of(plant), tanks):
        tank.y0 = own.copy()
    plant.settler.ys0, plant.ys_out, plant.y_out5_r = settler.copy(), out.copy(), back.copy()


class Wastewater:
    """The wastewater benchmark BSM1 with the weather and loads of BSM2. An episode is one of its 600 days, from a stable plant.

    An action sets the aeration of three tanks, every 15 minutes. The reward is minus the benchmark's costs in thousands: the pollution
    of the effluent (its EQI, kg per day) and the energy for aeration (kWh per day).
    """

    def __init__(self):
        from bsm2_python import BSM1OL

        self.plant = BSM1OL(timestep=15 / 1440, endtime=602)
        self.plant.stabilize()
        self.stable = state_of(self.plant)
        self.rng = np.random.default_rng(0)

    def reset(self, seed=None):
        if seed is not None:
            self.rng = np.random.default_rng(seed)
        restore(self.plant, self.stable)
        self.at = 96 * int(self.rng.integers(600))
        self.plant.step(self.at)
        return self.seen(), {}

    def seen(self):
        # Oxygen, nitrate and ammonia of the last tank, nitrate of the second, flow and ammonia of the influent.
        last, second, came = self.plant.y_out5, self.plant.y_out2, self.plant.y_in_all[self.at]
        return np.array([last[7], last[8], last[9], second[8], came[14], came[9]])

    def step(self, action):
        self.at += 1
        self.plant.step(self.at, action)
        aeration = self.plant.perf_factors_all[self.at, 1]
        return self.seen(), -(self.plant.eqi_all[self.at] + aeration) / 1e3, False, False, {}


AERATION = [np.array([both, both, last]) for both in (60.0, 150.0, 240.0) for last in (10.0, 84.0, 160.0)]


@functools.cache  # the plant takes half a minute to become stable
def wastewater():
    levels = [np.array([0.0, 0.0, *level]) for level in AERATION]
    return Levels(Wastewater(), levels, [0, 0, 0, 0, 5_000, 0], [3, 5, 25, 0.5, 50_000, 60], 96)


def wastewater_rule(seen, _):
    return by_ammonia_and_oxygen(12.5 * (seen[2] + 1), 1.5 * (seen[0] + 1))


def by_ammonia_and_oxygen(ammonia, oxygen):
    """Returns the position in AERATION: more air if ammonia is left over, and more in the last tank if its oxygen is too low."""
    return 3 * (0 if ammonia < 1 else 1 if ammonia < 4 else 2) + (2 if oxygen < 1 else 1 if oxygen < 3 else 0)


class Lane:
    """The wastewater benchmark at its design load: one of two lanes of BSM2, as in wastewater_logs.py.

    Actions and rewards are those of `Wastewater`. An episode is one day of the plant, which its rule ran until then. The costs of the
    effluent are measured too.
    """

    WARM_UP = 21
    LAST_DAY = 600
    STEPS_A_DECISION = 3

    def __init__(self):
        import wastewater_logs as logs

        logs.solve_to_five_digits()
        self.waste_flow, self.rows_a_day = logs.WASTE_FLOW, logs.ROWS_A_DAY
        self.lane = logs.Plant(logs.influent(0, self.LAST_DAY + 2), charged=True)
        self.rng = np.random.default_rng(0)
        self.row = 0
        self.begun = []
        seen, _ = self.act(AERATION[4])
        while self.row < self.rows_a_day * self.LAST_DAY:
            if self.row >= self.rows_a_day * self.WARM_UP and self.row % self.rows_a_day == 0:
                self.begun.append((self.row, seen, state_of(self.lane.plant)))
            seen, _ = self.act(AERATION[by_ammonia_and_oxygen(seen[2], seen[0])])

    def act(self, air):
        """Returns the observation after 15 minutes of this aeration, and the reward."""
        cost, plant = 0.0, self.lane.plant
        for _ in range(self.STEPS_A_DECISION):
            self.lane.step(self.row, air, self.waste_flow)
            cost += (plant.eqi_all[self.row] + plant.perf_factors_all[self.row, 1]) / self.STEPS_A_DECISION
            self.row += 1
        # Oxygen, nitrate and ammonia of the last tank, nitrate of the second, flow and ammonia of the influent, and ammonia,
        # nitrate and solids of the effluent.
        last, second, came, left = plant.y_out5, plant.y_out2, plant.y_in_all[self.row - 1], plant.ys_eff
        seen = np.array([last[7], last[8], last[9], second[8], came[14], came[9], left[9], left[8], left[13]])
        return seen, -cost / 1e3

    def reset(self, seed=None):
        if seed is not None:
            self.rng = np.random.default_rng(seed)
        self.row, seen, state = self.begun[int(self.rng.integers(len(self.begun)))]
        restore(self.lane.plant, state)
        return seen, {}

    def step(self, action):
        seen, reward = self.act(action)
        return seen, reward, False, False, {}


@functools.cache  # the rule first runs the plant for 600 days
def lane():
    return Levels(Lane(), AERATION, [0, 0, 0, 0, 0, 0, 0, 0, 0], [3, 20, 10, 10, 20_000, 60, 10, 20, 40], 96)


def lane_rule(_, env):
    return by_ammonia_and_oxygen(env.env_seen[2], env.env_seen[0])


def lunar():
    import gymnasium

    env = gymnasium.make("LunarLander-v3").unwrapped
    return Levels(env, [0, 1, 2, 3], [-1.5, -1.5, -2, -2, -1, -2, -1, -1], [1.5, 1.5, 2, 2, 1, 2, 1, 1], 400)


def lunar_rule(_, env):
    from gymnasium.envs.box2d.lunar_lander import heuristic

    return heuristic(env.env, (env.env_seen if hasattr(env, "env_seen") else np.zeros(8)))


ENVIRONMENTS = {
    "cstr": (cstr, cstr_rule), "four_tank": (four_tank, four_tank_rule), "gymchem": (gymchem, gymchem_rule),
    "lunar": (lunar, lunar_rule), "wastewater": (wastewater, wastewater_rule), "lane": (lane, lane_rule),
}  # fmt: skip


class Agent:
    """Linear Q-learning on random features of the state."""

    def __init__(self, env, learning_rate=DEFAULT["learning_rate"], epsilon=DEFAULT["epsilon"], seed=0):
        self.env, self.learning_rate, self.epsilon = env, learning_rate, epsilon
        self.rng = np.random.default_rng(seed)
        width = env.observation_space.shape[0]
        self.directions, self.offsets = self.rng.normal(0.0, 1.5, (100, width)), self.rng.uniform(0.0, 2 * np.pi, 100)
        self.weights = np.zeros((int(env.action_space.n), 100))

    def features(self, seen):
        return np.cos(self.directions @ seen + self.offsets) * 0.14

    def learn(self, total_timesteps):
        here, over = self.features(self.env.reset()[0]), False
        for _ in range(total_timesteps):
            if over:
                here = self.features(self.env.reset()[0])
            values = self.weights @ here
            explores = self.rng.random() < self.epsilon
            action = int(self.rng.integers(len(values)) if explores else values.argmax())
            seen, reward, terminated, truncated, _ = self.env.step(action)
            after, over = self.features(seen), terminated or truncated
            self.update(here, action, values[action], reward, after, terminated)
            here = after

    def update(self, here, action, value, reward, after, terminated):
        target = reward + (0.0 if terminated else GAMMA * (self.weights @ after).max())
        self.weights[action] += self.learning_rate * (target - value) * here


class Counted:
    """An environment that records the return of each episode."""

    def __init__(self, env, seed):
        self.env, self.seed, self.returns, self.sum = env, seed, [], 0.0
        self.observation_space, self.action_space = env.observation_space, env.action_space

    def reset(self):
        seen = self.env.reset(seed=self.seed)
        self.seed, self.sum = None, 0.0
        return seen

    def step(self, action):
        came = self.env.step(action)
        self.sum += came[1]
        if came[2] or came[3]:
            self.returns.append(self.sum)
        return came


def deep(env, seed=0, **setting):
    """Stable-Baselines3's DQN, with its default exploration and network copies unless the setting changes them."""
    import stable_baselines3
    import torch

    torch.set_num_threads(1)
    return stable_baselines3.DQN("MlpPolicy", env, seed=seed, device="cpu", **setting)


def as_gymnasium(env):
    """Returns the same environment with the interface that Stable-Baselines3 needs."""
    import gymnasium

    class Environment(gymnasium.Env):
        observation_space, action_space = env.observation_space, env.action_space

        def reset(self, *, seed=None, options=None):
            seen, info = env.reset()
            return seen.astype(np.float32), info

        def step(self, action):
            seen, *rest = env.step(action)
            return (seen.astype(np.float32), *rest)

    return Environment()


@dataclasses.dataclass
class Compared:
    """An agent whose settings are compared."""

    make: Callable
    settings: list[dict]
    default: dict
    environments: list[str]
    logs: int
    # Suffix of its file names.
    suffix: str = ""
    # Number of columns of the states, if it is not that of the environment.
    columns: int | None = None
    # More arguments of `calib_rl.tune`, and of the environments in it.
    tune: dict = dataclasses.field(default_factory=dict)
    environment: dict = dataclasses.field(default_factory=dict)
    # Whether the truth is that of the linear agent, which is made without this option.
    has_truth_of_linear: bool = False

    def in_truth(self, env, seed, setting, name, folder):
        """Returns the agent that learns in an environment itself."""
        if self.make is OwnAgent:
            return OwnAgent(env, model_of_longest_log(name, folder), seed=seed, **setting)
        return self.make(as_gymnasium(env) if self.make is deep else env, seed=seed, **setting)


class OwnAgent:
    """calib's Q-learning with a network, which learns in an environment itself."""

    # Settings that are not swept.
    FIXED = {"algorithm": "deep_q_learning", "gamma": GAMMA}

    def __init__(self, env, model, seed=0, **setting):
        import calib_rl

        self.env = env
        self.agent = calib_rl.ControlAgent(model, seed=seed, **self.FIXED, **setting)
        self.levels = [int(action.values[0]) for action in self.agent.actions]

    def learn(self, total_timesteps):
        over, action = True, 0
        for _ in range(total_timesteps):
            if over:
                action = self.agent.begin(self.env.reset()[0])
            seen, reward, terminated, truncated, _ = self.env.step(self.levels[action])
            action, over = self.agent.step(reward, seen, terminal=terminated), terminated or truncated


OWN_GRID = {"step_size": [1e-4, 3e-4, 1e-3, 3e-3], "epsilon": [0.02, 0.1, 0.3, 0.8]}
OWN_SETTINGS = [dict(zip(OWN_GRID, values)) for values in itertools.product(*OWN_GRID.values())]
OWN_DEFAULT = {"step_size": 1e-3, "epsilon": 0.1}
LONGEST_LOG = LENGTHS.index(max(LENGTHS))

DEEP_SETTINGS = [
    {"learning_rate": rate, "target_update_interval": interval, "exploration_fraction": share}
    for rate in [1e-4, 1e-3] for interval in [250, 10_000] for share in [0.1, 0.5]
]  # fmt: skip
DEEP_DEFAULT = {"learning_rate": 1e-4, "target_update_interval": 10_000, "exploration_fraction": 0.1}
AGENTS = {
    "linear": Compared(Agent, SETTINGS, DEFAULT, list(ENVIRONMENTS), 10),
    "dqn": Compared(deep, DEEP_SETTINGS, DEEP_DEFAULT, TOLD_APART, 5, "-dqn"),
    "own": Compared(OwnAgent, OWN_SETTINGS, OWN_DEFAULT, WITH_FAST_TRUTH, 10, "-own"),
}


def truth_of(name, agent, folder):
    """Returns the mean return per episode of each setting, including the learning phase, in each run."""
    env = ENVIRONMENTS[name][0]()
    returns = []
    for setting in agent.settings:
        of_runs = []
        for run in range(RUNS):
            counted = Counted(env, 1_000 + run)
            agent.in_truth(counted, run, setting, name, folder).learn(STEPS)
            of_runs.append(statistics.fmean(counted.returns))
        returns.append(of_runs)
        print(f"{name}: {setting} gets {statistics.fmean(of_runs):.4g}", file=sys.stderr, flush=True)
    return returns


def log_of(name, number):
    """Returns a frame of the actions of the plant's rule; a quarter of the actions is random."""
    import datetime

    import polars as pl

    make, rule = ENVIRONMENTS[name]
    env, rng = make(), np.random.default_rng([7, number])
    length = LENGTHS[number % len(LENGTHS)]
    rows, time = [], datetime.datetime(2024, 1, 1)
    second = datetime.timedelta(seconds=1)
    seen, reward, terminal, over = None, None, 0.0, True
    taken = 0
    while taken < length:
        if over:
            if seen is not None:
                rows.append((time, *seen, None, reward, terminal))
                time += 100 * second
            (seen, _), reward, terminal = env.reset(seed=int(rng.integers(2**31))), None, 0.0
            env.env_seen = recorded(env, seen)
        action = int(rng.integers(len(env.levels))) if rng.random() < RANDOM_SHARE else rule(seen, env)
        rows.append((time, *seen, float(action), reward, terminal))
        seen, reward, end, cut, _ = env.step(action)
        env.env_seen = recorded(env, seen)
        terminal, over, time, taken = float(end), end or cut, time + second, taken + 1
    rows.append((time, *seen, None, reward, terminal))
    columns = [f"o{column}" for column in range(len(seen))]
    return pl.DataFrame(rows, schema=["time", *columns, "action", "reward", "terminal"], orient="row"), columns


def recorded(env, seen):
    """Returns an observation as the environment gave it."""
    return (seen + 1.0) / 2.0 * (env.high - env.low) + env.low


def widened(frame, columns, count, number):
    """Returns the frame with `count` columns of the state: `columns`, mixtures of them with noise, and noise that drifts."""
    import polars as pl

    rng = np.random.default_rng([8, number, count])
    own = frame.select(columns).to_numpy()
    own = (own - own.mean(0)) / own.std(0).clip(1e-9)
    others = []
    for place in range(count - len(columns)):
        noise = rng.normal(size=len(own))
        if place % 2:
            for row in range(1, len(noise)):
                noise[row] = 0.95 * noise[row - 1] + noise[row]
        else:
            weights = rng.normal(size=len(columns))
            noise += own @ (weights / np.linalg.norm(weights))
        others.append(pl.Series(f"x{place}", noise))
    return frame.with_columns(others)


def model_of(name, number, folder, width=None):
    """Returns the model of a log, and the columns of its states that agents observe."""
    import calib_rl

    frame, columns = log_of(name, number)
    if width:
        frame = widened(frame, columns, width, number)
    has_terminals = frame["terminal"].sum() > 0
    if not has_terminals:
        frame = frame.drop("terminal")
    model = calib_rl.build_model(
        frame, folder / f"{name}{f'-wide-{width}' if width else ''}-{number}", actions=["action"], reward="reward", terminal="terminal" if has_terminals else None,
        timeout=ENVIRONMENTS[name][0]().limit,
    )  # fmt: skip
    return model, columns


@functools.cache  # every run of a truth scales states by it
def model_of_longest_log(name, folder):
    return model_of(name, LONGEST_LOG, folder)[0]


def choice_of(name, number, folder, agent):
    """Returns the result of `calib_rl.tune` for a log."""
    import calib_rl

    model, columns = model_of(name, number, folder, agent.columns)
    tuned = calib_rl.tune(
        agent.make, agent.settings, model, total_timesteps=STEPS, default=agent.default, seed=number,
        folder=folder / f"{name}{agent.suffix}-{number}" / "units", **agent.tune,
        environment={"observe": columns, "units": "physical", **agent.environment},
    )  # fmt: skip
    places = [agent.settings.index(setting) for setting in tuned.settings]
    selection = tuned.verdict["selection"]
    returns = [[unit["kind"], unit["member"], agent.settings.index(unit["setting"]), unit["mean_return"]] for unit in tuned.runs]
    return {
        "steps": LENGTHS[number % len(LENGTHS)],
        "chosen": agent.settings.index(tuned.chosen),
        "advice": tuned.advice[0],
        "reasons": [doubt["reason"] for doubt in tuned.verdict["doubts"]],
        "mean_ranks": {place: rank for place, rank in zip(places, selection["mean_ranks"])},
        "returns": returns,
    }


def choice_of_control(name, number, folder, agent):
    """Returns the result of `calib control` for a log."""
    import calib_rl

    # The model's folder has the study.
    model_of(name, number, folder)
    # A default that is swept has the agent's own values.
    swept = {"control.agent": {**OwnAgent.FIXED, **agent.default}, "control.grid": OWN_GRID, "control.steps": STEPS, "seed": number}
    study = calib_rl.Study(folder / f"{name}-{number}" / "study.toml", set=swept, output=folder / f"{name}{agent.suffix}-{number}")
    verdict = study.control(progress=False)
    said = verdict.summary["verdict"]
    places = [agent.settings.index({key: candidate[key] for key in OWN_GRID}) for candidate in verdict.summary["candidates"]]
    runs = verdict.runs()
    returns = [
        [run["model"], run["member"], places[run["candidate"]], run["mean_return"]]
        for run in runs.iter_rows(named=True)
    ]  # fmt: skip
    return {
        "steps": LENGTHS[number % len(LENGTHS)],
        "chosen": places[said["selection"]["chosen"]],
        "advice": verdict.advice[0],
        "reasons": [doubt["reason"] for doubt in said["doubts"]],
        "mean_ranks": {place: rank for place, rank in zip(places, said["selection"]["mean_ranks"])},
        "returns": returns,
    }


def beside_random_actions(log, folder):
    """Returns a row: the returns of four runs of random actions in each member of each kind of model, and those of the stored choice."""
    from calib_rl.gym import make_vec

    name, number = log.rsplit("-", 1)
    stored = json.loads((folder / f"{log}.json").read_text())
    model, columns = model_of(name, int(number), folder / "work")
    limit = ENVIRONMENTS[name][0]().limit
    count = 5 * RUNS_OF_RANDOM
    of_random, of_choice = np.zeros(5), np.zeros(5)
    kinds = sorted({kind for kind, *_ in stored["returns"]})
    for kind in kinds:
        walks = make_vec(model, count, members=range(5), kind=kind, observe=columns, units="physical")
        walks.reset(seed=int(number))
        rng = np.random.default_rng(int(number))
        rewards, episodes, lengths, over = np.zeros(count), np.zeros(count), np.zeros(count), np.zeros(count, bool)
        for _ in range(STEPS):
            _, reward, terminated, truncated, _ = walks.step(rng.integers(len(model.actions), size=count))
            # The step after the end of an episode starts the next one, and does not belong to it.
            rewards += np.where(over, 0.0, reward)
            lengths = np.where(over, 0, lengths + 1)
            over = terminated | truncated
            episodes += over
        returns = rewards / np.maximum(episodes + np.where(over, 0, lengths) / limit, 1)
        # Rollouts alternate between members.
        of_random += returns.reshape(RUNS_OF_RANDOM, 5).mean(0) / len(kinds)
        for _, member, setting, value in (one for one in stored["returns"] if one[0] == kind):
            of_choice[member] += value / len(kinds) if setting == stored["chosen"] else 0.0
    less = of_choice - of_random
    # The jackknife over blocks, one of which each member lacks; Student's t with four degrees of freedom.
    half = 2.776 * np.sqrt(4 / 5 * ((less - less.mean()) ** 2).sum())
    said = "nothing" if stored["advice"].startswith("Deploy nothing") else stored["advice"].split()[0].rstrip(":").lower()
    now = "refused" if less.mean() <= half else "as before"
    return (
        f"| {log} | {stored['steps']:,} | {said} | {model.recorded().mean:,.0f} | {of_random.mean():,.0f} | {of_choice.mean():,.0f} "
        f"| {less.mean():,.0f} ({less.mean() - half:,.0f} to {less.mean() + half:,.0f}) | {now} |"
    )


@dataclasses.dataclass
class LoggedTransitions:
    """The transitions of a log: row i is from states[rows[i]] to states[rows[i] + 1]."""

    states: np.ndarray
    rows: np.ndarray
    actions: np.ndarray
    rewards: np.ndarray
    goes_on: np.ndarray
    begins: np.ndarray
    levels: int
    limit: int


def logged_transitions(name, number):
    frame, columns = log_of(name, number)
    env = ENVIRONMENTS[name][0]()
    taken = frame["action"].to_numpy()
    rows = np.flatnonzero(np.isfinite(taken))
    rewards = frame["reward"].to_numpy().astype(float)
    return LoggedTransitions(
        states=frame.select(columns).to_numpy(),
        rows=rows,
        actions=taken[rows].astype(int),
        rewards=rewards[rows + 1],
        goes_on=frame["terminal"].to_numpy()[rows + 1] == 0,
        begins=np.flatnonzero(~np.isfinite(rewards)),
        levels=len(env.levels),
        limit=env.limit,
    )


def fitted_q(name, number, value_of_policy):
    """Estimates the value of each setting's policy in the first states of episodes, from the log alone."""
    log = logged_transitions(name, number)
    values = []
    for setting in SETTINGS:
        agent = Agent(Spaces(log.states.shape[1], log.levels), **setting)
        features = agent_features(agent, log.states)
        before, after = features[log.rows], features[log.rows + 1]
        for update in range(STEPS):
            at = update % len(log.rows)
            value = agent.weights[log.actions[at]] @ before[at]
            agent.update(before[at], log.actions[at], value, log.rewards[at], after[at], not log.goes_on[at])
        values.append(value_of_policy(agent, log) if np.isfinite(agent.weights).all() else -np.inf)
    return values


def agent_features(agent, states):
    return np.cos(states @ agent.directions.T + agent.offsets) * 0.14


def probabilities_of_actions(agent, features):
    count = len(agent.weights)
    probabilities = np.full((len(features), count), agent.epsilon / count)
    probabilities[np.arange(len(features)), (features @ agent.weights.T).argmax(1)] += 1.0 - agent.epsilon
    return probabilities


class Spaces:
    """The spaces of an environment that is not installed."""

    def __init__(self, columns, actions):
        self.observation_space = type("Box", (), {"shape": (columns,)})
        self.action_space = type("Discrete", (), {"n": actions})


def value_by_ridge(agent, log):
    """Estimates the mean return of the agent's policy: repeated least squares, with targets limited to possible returns."""
    features = agent_features(agent, log.states)
    before, after, begins = features[log.rows], features[log.rows + 1], features[log.begins]
    count, width = agent.weights.shape
    low = min(log.rewards.min(), log.limit * log.rewards.min())
    high = max(log.rewards.max(), log.limit * log.rewards.max())
    probabilities, discount = probabilities_of_actions(agent, after), GAMMA * log.goes_on
    rows = [np.flatnonzero(log.actions == action) for action in range(count)]
    solvers = [np.linalg.solve(before[own].T @ before[own] + np.eye(width), before[own].T) for own in rows]
    weights = np.zeros((count, width))
    for _ in range(PASSES):
        targets = (log.rewards + discount * (probabilities * (after @ weights.T)).sum(1)).clip(low, high)
        weights = np.array([solver @ targets[own] for solver, own in zip(solvers, rows)])
    return float((probabilities_of_actions(agent, begins) * (begins @ weights.T)).sum(1).mean())


def value_by_d3rlpy(agent, log):
    """Estimates the mean return of the agent's policy by d3rlpy's network, which sees states and rewards divided by their spreads."""
    import d3rlpy
    import structlog
    import torch

    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(40))
    torch.set_num_threads(1)
    d3rlpy.seed(0)

    class Policy:
        """What d3rlpy asks of an algorithm: the actions that the agent takes next."""

        impl = property(lambda self: self)

        def predict_best_action(self, states):
            features = agent_features(agent, states.numpy() * spreads + means)
            probabilities = torch.from_numpy(probabilities_of_actions(agent, features))
            return torch.multinomial(probabilities, 1).squeeze(1)

    means, spreads = log.states.mean(0), log.states.std(0).clip(1e-9)
    states = ((log.states - means) / spreads).astype(np.float32)
    rewards = (log.rewards / max(log.rewards.std(), 1e-9)).astype(np.float32)
    # An episode is a run of rows with actions. Where it was cut off, d3rlpy needs the row after it too, with any action.
    ends = np.flatnonzero(np.append(np.diff(log.rows) > 1, True))
    episodes = []
    for first, last in zip(np.append(0, ends[:-1] + 1), ends):
        own = slice(first, last + 1)
        seen, actions, got = states[log.rows[own]], log.actions[own], rewards[own]
        if log.goes_on[last]:
            seen = np.append(seen, states[[log.rows[last] + 1]], axis=0)
            actions, got = np.append(actions, 0), np.append(got, np.float32(0))
        episodes.append(d3rlpy.dataset.Episode(seen, actions[:, None], got[:, None], not log.goes_on[last]))
    buffer = d3rlpy.dataset.ReplayBuffer(
        d3rlpy.dataset.InfiniteBuffer(), episodes=episodes, action_space=d3rlpy.ActionSpace.DISCRETE, action_size=log.levels
    )  # fmt: skip
    estimator = d3rlpy.ope.DiscreteFQE(Policy(), d3rlpy.ope.FQEConfig(gamma=GAMMA))
    estimator.build_with_dataset(buffer)
    for _ in range(D3RLPY_STEPS):
        estimator.update(buffer.sample_transition_batch(estimator.batch_size))
    begins = states[log.begins]
    values = [estimator.predict_value(begins, np.full(len(begins), action)) for action in range(log.levels)]
    probabilities = probabilities_of_actions(agent, agent_features(agent, log.states[log.begins]))
    return float((probabilities * np.stack(values, axis=1)).sum(1).mean())


# The file of each estimator of the values of policies, and its name in the report.
ESTIMATORS = {
    "calib": (value_by_ridge, "fitted-q.json", "by fitted Q"),
    "d3rlpy": (value_by_d3rlpy, "fitted-q-d3rlpy.json", "by d3rlpy's fitted Q"),
}


def make_fitted_q(args, folder):
    value_of_policy, file, label = ESTIMATORS[args.fitted_q]
    path = folder / file
    found = json.loads(path.read_text()) if path.exists() else {}
    names = args.environments.split(",") if args.environments else list(ENVIRONMENTS)
    for number in range(*(args.logs or [0, 10])):
        for name in names:
            log = f"{name}-{number}"
            if log not in found:
                found[log] = [round(value, 4) for value in fitted_q(name, number, value_of_policy)]
                write(path, found)
                print(f"{log}: {label} is done", file=sys.stderr, flush=True)


def make(args, folder, agent):
    folder.mkdir(parents=True, exist_ok=True)
    names = args.environments.split(",") if args.environments else agent.environments
    for name in names:
        path = folder / f"truth-{name}{agent.suffix}.json"
        if not agent.has_truth_of_linear and not path.exists():
            write(path, truth_of(name, agent, folder / "work"))
    for number in range(*(args.logs or [0, agent.logs])):
        for name in names:
            path = folder / f"{name}{agent.suffix}-{number}.json"
            if not path.exists():
                choose = choice_of_control if agent.make is OwnAgent else choice_of
                write(path, choose(name, number, folder / "work", agent))
                print(f"{name} {number}: done", file=sys.stderr, flush=True)


def write(path, what):
    unfinished = path.with_suffix(".tmp")
    unfinished.write_text(json.dumps(what))
    os.replace(unfinished, path)


def spearman(left, right):
    def ranked(values):
        order = sorted(range(len(values)), key=values.__getitem__)
        found = [0.0] * len(values)
        for rank, place in enumerate(order):
            found[place] = rank
        return found

    return float(np.corrcoef(ranked(left), ranked(right))[0, 1])


def interval(of_logs, digits=1):
    """Returns the mean over environments of means over logs, and a bootstrap interval over logs."""
    rng = random.Random(1)
    names = sorted(of_logs)
    mean = statistics.fmean(statistics.fmean(of_logs[name]) for name in names)
    draws = sorted(statistics.fmean(statistics.fmean(rng.choices(of_logs[name], k=len(of_logs[name]))) for name in names) for _ in range(DRAWS))
    return f"{mean:.{digits}f} ({draws[DRAWS // 40]:.{digits}f} to {draws[-DRAWS // 40]:.{digits}f})"


def reliability(truth):
    """Returns the share of the variance between settings that is not noise; runs with the same seed are compared."""
    runs = np.asarray(truth, float)
    settings = runs.mean(1)
    rest = runs - runs.mean(0) - (settings - settings.mean())[:, None]
    noise = (rest**2).sum() / ((runs.shape[0] - 1) * (runs.shape[1] - 1)) / runs.shape[1]
    return max(0.0, 1.0 - noise / settings.var(ddof=1))


def regret_in(truth, place):
    """Returns the regret of a setting in % of that of a random choice, from the true mean return of each."""
    return 100.0 * (max(truth) - truth[place]) / (max(truth) - statistics.fmean(truth))


def truth_of_linear(name, folder):
    """Reads the true mean return of each setting of the linear agent."""
    path = folder / f"truth-{name}.json"
    if not path.exists():
        sys.exit(f"{path} is missing; make it first: python3 scripts/public_environments.py {folder} --environments {name}")
    return [statistics.fmean(runs) for runs in json.loads(path.read_text())]


def mean_ranks(returns, kinds):
    """Returns the mean rank of each setting over the ensemble members of these kinds of models, by the setting's place."""
    members = {}
    for kind, member, place, value in returns:
        if kind in kinds:
            members.setdefault((kind, member), {})[place] = value
    places = sorted(next(iter(members.values())))
    return {place: statistics.fmean(1 + sum(other > own[place] for other in own.values()) for own in members.values()) for place in places}


def choice_by_mean_rank(returns, kinds):
    """Returns the setting with the smallest mean rank over the ensemble members of these kinds of models."""
    ranks = mean_ranks(returns, kinds)
    return min(ranks, key=ranks.__getitem__)


def report_columns(folder):
    """Prints the regret by the kinds of models that choose, with the environments' own columns and with more."""
    names = TOLD_APART
    truths = {name: truth_of_linear(name, folder) for name in names}
    pools = {
        "the pool": KINDS, "without increments": KINDS - {"increments"}, **{f"{kind} alone": {kind} for kind in sorted(KINDS)},
    }  # fmt: skip
    print("| columns | " + " | ".join(pools) + " | the pool less that without increments |")
    print("|---" * (len(pools) + 2) + "|")
    for label, middle in (("their own", ""), *((f"{width}", f"-wide-{width}") for width in WIDE)):
        regrets = {pool: {name: [] for name in names} for pool in pools}
        for name, truth in truths.items():
            for number in range(WIDE_LOGS):
                path = folder / f"{name}{middle}-{number}.json"
                if path.exists():
                    returns = json.loads(path.read_text())["returns"]
                    for pool, kinds in pools.items():
                        regrets[pool][name].append(regret_in(truth, choice_by_mean_rank(returns, kinds)))
        if all(all(logs.values()) for logs in regrets.values()):
            less = {name: [one - other for one, other in zip(regrets["the pool"][name], regrets["without increments"][name])] for name in names}
            print(f"| {label} | " + " | ".join(interval(logs) for logs in regrets.values()) + f" | {interval(less)} |")


def report_pessimism(folder):
    """Prints the regret by neighbours alone and by the pool, with both ways to go on where the log has no such action near."""
    rows = {f"{label}, {way}": {} for label in ("neighbours", "pool") for way in ("nearest", "minimum_return")}
    less = {}
    for name in WITH_FAST_TRUTH:
        truth = truth_of_linear(name, folder)
        logs = [[folder / f"{name}{middle}-{number}.json" for middle in ("", "-pessimism")] for number in range(AGENTS["linear"].logs)]
        made = [paths for paths in logs if all(path.exists() for path in paths)]
        for paths in made:
            stored, own = (json.loads(path.read_text())["returns"] for path in paths)
            others = [one for one in stored if one[0] != "neighbors"]
            for row, (returns, kinds) in zip(rows, ((stored, {"neighbors"}), (own, {"neighbors"}), (stored, KINDS), (own + others, KINDS))):
                rows[row].setdefault(name, []).append(regret_in(truth, choice_by_mean_rank(returns, kinds)))
        if made:
            less[name] = [one - other for one, other in zip(rows["pool, nearest"][name], rows["pool, minimum_return"][name])]
    if not less:
        sys.exit(f"{folder} has no logs with --pessimism; leave --report out to make them")
    print("| choice of | " + " | ".join(less) + " | environments equal (95 % over logs) |")
    print("|---" * (len(less) + 2) + "|")
    for row, of_logs in [*rows.items(), ("pool, nearest less minimum_return", less)]:
        print(f"| {row} | " + " | ".join(f"{statistics.fmean(logs):.1f}" for logs in of_logs.values()) + f" | {interval(of_logs)} |")


def kinds_agreement(log):
    """Returns Spearman's correlation between the mean ranks of the settings by kind of model, as a mean over pairs of kinds."""
    kinds = dict.fromkeys(kind for kind, *_ in log["returns"])
    orders = [list(mean_ranks(log["returns"], {kind}).values()) for kind in kinds]
    return statistics.fmean(spearman(one, other) for number, one in enumerate(orders) for other in orders[number + 1 :])


def report(folder, agent):
    runs = {name: json.loads(path.read_text()) for name in ENVIRONMENTS if (path := folder / f"truth-{name}{agent.suffix}.json").exists()}
    truths = {name: [statistics.fmean(of_runs) for of_runs in found] for name, found in runs.items()}

    def regret(name, place):
        return regret_in(truths[name], place)

    default = agent.settings.index(agent.default)
    labels = ["choice", "what calib advises", "choice if ahead of the default", "default", "best of the other environments"]
    rows = {row: {} for row in [*labels, *(f"default less {label}" for label in labels[:3])]}
    estimates = {}
    for _, file, label in ESTIMATORS.values() if not agent.suffix else ():
        if (folder / file).exists():
            estimates[label] = json.loads((folder / file).read_text())
            rows |= {label: {}, f"{label}, less the choice": {}}
    correlations, groups = {}, {"calib says to deploy the choice": {}, "it is only ahead of the default": {}, "neither": {}}
    agreements = {}
    print("| environment | logs | random | best | told apart | choice: regret | advice: regret | default: regret | best of the others: regret | Spearman | kinds agree | deploy, keep, nothing |")
    print("|---|---|---|---|---|---|---|---|---|---|---|---|")
    for name, truth in truths.items():
        found = [json.loads(path.read_text()) for path in sorted(folder.glob(f"{name}{agent.suffix}-[0-9]*.json"))]
        if not found:
            continue
        others = [other for other in truths if other not in (name, *REPLACED) and other != REPLACED.get(name)]
        fixed = min(range(len(agent.settings)), key=lambda place: statistics.fmean(regret(other, place) for other in others)) if others else default
        says = [one["advice"].split()[0] if not one["advice"].startswith("Deploy nothing") else "nothing" for one in found]
        chosen = [regret(name, one["chosen"]) for one in found]
        advised = [regret(name, one["chosen"] if said == "Deploy" else default) for one, said in zip(found, says)]
        rows["choice"][name], rows["what calib advises"][name] = chosen, advised
        rows["default"][name] = [regret(name, default)] * len(found)
        rows["best of the other environments"][name] = [regret(name, fixed)] * len(found)
        is_ahead = [not NOT_AHEAD & set(one["reasons"]) for one in found]
        logs = [path.stem for path in sorted(folder.glob(f"{name}-[0-9]*.json"))]
        for label, values in estimates.items():
            # They are made after the choices, one log at a time.
            done = [place for place, log in enumerate(logs) if log in values]
            if done:
                own = [regret(name, values[logs[place]].index(max(values[logs[place]]))) for place in done]
                rows[label][name] = own
                rows[f"{label}, less the choice"][name] = [one - chosen[place] for one, place in zip(own, done)]
                print(f"{name} {label}: {statistics.fmean(own):.1f} %, worst {max(own):.0f}, {len(done)} logs", file=sys.stderr)
        rows["choice if ahead of the default"][name] = [one if ahead else regret(name, default) for one, ahead in zip(chosen, is_ahead)]
        for label in labels[:3]:
            rows[f"default less {label}"][name] = [regret(name, default) - one for one in rows[label][name]]
        correlations[name] = []
        for one in found:
            raced = [place for place in range(len(agent.settings)) if str(place) in one["mean_ranks"]]
            correlations[name].append(spearman([-one["mean_ranks"][str(place)] for place in raced], [truth[place] for place in raced]))
        agreements[name] = [kinds_agreement(one) for one in found]
        for one, said, ahead in zip(chosen, says, is_ahead):
            group = "calib says to deploy the choice" if said == "Deploy" else "it is only ahead of the default" if ahead else "neither"
            groups[group].setdefault(name, []).append(one)
        print(
            f"| {name} | {len(found)} | {statistics.fmean(truth):.4g} | {max(truth):.4g} | {100 * reliability(runs[name]):.0f} % | {statistics.fmean(chosen):.1f} % (worst {max(chosen):.0f}) "
            f"| {statistics.fmean(advised):.1f} % | {regret(name, default):.1f} % | {regret(name, fixed):.1f} % | {statistics.fmean(correlations[name]):.2f} | {statistics.fmean(agreements[name]):.2f} "
            f"| {says.count('Deploy')}, {says.count('Keep')}, {says.count('nothing')} |"
        )
    told_apart = {name for name in truths if reliability(runs[name]) >= RELIABLE}
    for scope, names in (
        ("all environments", set(truths)),
        ("environments whose settings are told apart, without what was added", told_apart - set(REPLACED.values())),
        ("environments whose settings are told apart, with what replaces others", told_apart - set(REPLACED)),
    ):
        print(f"\nOver {scope}:\n")
        for row, of_logs in rows.items():
            own = {name: logs for name, logs in of_logs.items() if name in names}
            if own:
                print(f"- {row}: {interval(own)} % of a random choice's regret")
        print(f"- Spearman's correlation of ranks with the truth: {interval({name: logs for name, logs in correlations.items() if name in names}, 2)}")
        for low, high in ((-1.0, 0.5), (0.5, 0.8), (0.8, 1.01)):
            places = [(name, place) for name in names if name in agreements for place, value in enumerate(agreements[name]) if low <= value < high]
            if places:
                own = [rows["choice"][name][place] for name, place in places]
                other = [rows["default"][name][place] for name, place in places]
                print(f"- kinds agree with {low} to {high}: {len(places)} logs, the choice has {statistics.fmean(own):.1f} % on average, the default {statistics.fmean(other):.1f} %")
        for label, of_logs in groups.items():
            regrets = [one for name, logs in of_logs.items() if name in names for one in logs]
            if regrets:
                print(f"- {label}: {len(regrets)} logs, the choice has {statistics.fmean(regrets):.1f} % on average, at most {max(regrets):.0f} %")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--environments")
    parser.add_argument("--logs", type=int, nargs=2)
    parser.add_argument("--agent", choices=list(AGENTS), default="linear")
    parser.add_argument("--columns", type=int, choices=WIDE)
    parser.add_argument("--pessimism", action="store_true")
    parser.add_argument("--report", action="store_true")
    parser.add_argument("--random-actions", metavar="LOG,LOG")
    parser.add_argument("--fitted-q", nargs="?", const="calib", choices=list(ESTIMATORS))
    args = parser.parse_args()
    if args.random_actions:
        for log in args.random_actions.split(","):
            print(beside_random_actions(log, args.folder), flush=True)
    elif args.fitted_q:
        make_fitted_q(args, args.folder)
    elif args.columns and args.report:
        report_columns(args.folder)
    elif args.columns:
        agent = dataclasses.replace(
            AGENTS["linear"], environments=TOLD_APART, logs=WIDE_LOGS, suffix=f"-wide-{args.columns}", columns=args.columns,
            has_truth_of_linear=True,
        )  # fmt: skip
        make(args, args.folder, agent)
    elif args.pessimism and args.report:
        report_pessimism(args.folder)
    elif args.pessimism:
        agent = dataclasses.replace(
            AGENTS["linear"], environments=WITH_FAST_TRUTH, suffix="-pessimism", tune={"kinds": ["neighbors"]},
            environment={"pessimism": "minimum_return"}, has_truth_of_linear=True,
        )  # fmt: skip
        make(args, args.folder, agent)
    elif args.report:
        report(args.folder, AGENTS[args.agent])
    else:
        make(args, args.folder, AGENTS[args.agent])


if __name__ == "__main__":
    main()
