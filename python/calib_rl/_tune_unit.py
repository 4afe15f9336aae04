"""One setting in one ensemble member: the work of a process of `calib_rl.tune`."""

from __future__ import annotations

import copy
import inspect
import json
import os
import pickle
import random
import sys
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np

from ._acting import ActionModel
from ._kinds import ModelKind
from ._orphans import end_with_parent
from ._tune_conduct import LastSteps
from .gym import make

# An agent may round its steps up to whole batches. An agent that continues far beyond never stops.
_BEYOND = 100_000


@dataclass
class Unit:
    """One setting in one run of one ensemble member. ``is_recorded`` is whether the agent's last steps are kept."""

    setting: dict[str, Any]
    candidate: int
    kind: ModelKind
    member: int
    run: int
    seed: int
    steps: int
    is_recorded: bool


class Recorder(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Records the rewards of an agent in its first ``steps`` steps, including the learning phase."""

    def __init__(self, env: gymnasium.Env[Any, Any], steps: int, timeout: int) -> None:
        super().__init__(env)
        self.left, self.timeout = steps, timeout
        self.returns: list[float] = []
        # Number of episodes that were reset before their end, their shares of the timeout, and their rewards.
        self.cut_off, self.cut_share, self.cut_reward = 0, 0.0, 0.0
        self.resets = 0
        self.terminals = 0
        self.reward, self.length = 0.0, 0
        self.beyond = 0
        self.seed: int | None = None
        self.coverage: str | None = None
        self.last: LastSteps | None = None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Reset the environment. The first episode uses our seed instead of the agent's, so that all settings have the same random numbers."""
        seed, self.seed = (seed if self.seed is None else self.seed), None
        self.resets += 1
        if self.left > 0:
            if self.length > 0:
                self.cut_off += 1
                self.cut_share += self.length / self.timeout
                self.cut_reward += self.reward
            self.reward, self.length = 0.0, 0
        seen, info = self.env.reset(seed=seed, options=options)
        if self.last is not None:
            self.last.begin(seen)
        return seen, info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Take a step. It counts until ``steps`` steps are counted."""
        seen, reward, terminated, truncated, info = self.env.step(action)
        if self.left == 0:
            self.beyond += 1
            if self.beyond > _BEYOND:
                raise RuntimeError("the agent took 100,000 steps more than it was given: learn(total_timesteps) does not stop")
            return seen, reward, terminated, truncated, info
        self.left -= 1
        self.length += 1
        self.reward += float(reward)
        if self.last is not None:
            self.last.add(action, float(reward), seen)
        if terminated or truncated:
            self.returns.append(self.reward)
            self.terminals += int(terminated)
            self.reward, self.length = 0.0, 0
        if self.left == 0:
            self.coverage = self.env.unwrapped.lived()  # type: ignore[attr-defined]
        return seen, reward, terminated, truncated, info

    def mean_return(self) -> float:
        """The sum of all rewards divided by the number of episodes, at least one.

        An incomplete episode counts as its share of the timeout. These are the last episode, and those that the agent reset before their end, for example by a
        ``TimeLimit``. So each step has the same weight, and a setting gains nothing by resets. As whole episodes they would make costs small,
        and without their rewards they would cost nothing.
        """
        episodes = max(1.0, len(self.returns) + self.cut_share + self.length / self.timeout)
        return (sum(self.returns) + self.cut_reward + self.reward) / episodes

    def lost(self) -> int:
        """Number of steps that were not taken, without those that vector environments use for resets.

        With ``AutoresetMode.NEXT_STEP``, the default of Gymnasium's vector environments, the step after the end of an episode resets the environment and does
        nothing else. An agent that counts those steps takes fewer here, at most one for each reset but the first.
        """
        return max(0, self.left - max(0, self.resets - 1))


def run_unit(make_agent: Callable[..., Any], model: ActionModel, unit: Unit, environment: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the result of a unit: a run as in `calib control`, with the return of every episode, or the reason of its failure.

    A recorded unit also has the agent's last steps as ``conduct``.
    """
    place, env = "make_agent", None
    try:
        made = make(model, member=unit.member, kind=unit.kind, **environment)
        env = Recorder(made, unit.steps, made.timeout)
        env.seed = unit.seed
        if unit.is_recorded:
            env.last = LastSteps(made, unit.steps)
        env.action_space.seed(unit.seed % 2**32)
        _seed_all(unit.seed)
        agent = make_agent(env, **_arguments(make_agent, unit))
        learn = getattr(agent, "learn", None)
        if learn is None:
            raise TypeError(f"make_agent returned {type(agent).__name__}, which has no learn(total_timesteps)")
        place = "learn"
        learn(unit.steps)
        if env.lost():
            taken = unit.steps - env.left
            raise RuntimeError(
                f"learn({unit.steps}) returned after {taken} steps in env; it must take all of them, in env itself. Let learn go on until they are taken, and "
                "give the agent env rather than a copy, as copy.deepcopy, pickle and SubprocVecEnv make one"
            )
        mean = env.mean_return()
        if not np.isfinite(mean):
            raise FloatingPointError(f"the mean return is {mean}")
        conduct = {} if env.last is None else {"conduct": env.last.conduct()}
    except (Exception, SystemExit) as error:  # whatever an agent raises is told, and the others go on
        failure = {"error": _told(error), "place": place, "trace": traceback.format_exc(limit=-8)}
        if place == "make_agent" and env is not None and isinstance(error, Exception):
            failure["remedy"] = _other_space(make_agent, model, unit, environment)
        return failure
    returns = env.returns
    run = {
        "kind": unit.kind,
        "member": unit.member,
        "run": unit.run,
        "candidate": unit.candidate,
        "mean_return": mean,
        "episodes": len(returns),
        "terminals": env.terminals,
        "curve": _tenths(returns),
        **json.loads(env.coverage or made.lived()),
    }
    return {"run": run, "returns": returns, "cut_off": env.cut_off, **conduct}


def _other_space(make_agent: Callable[..., Any], model: ActionModel, unit: Unit, environment: Mapping[str, Any]) -> str:
    """Returns the remedy for an agent that needs another action space, or an empty text.

    Libraries say in many ways that they refuse a space, and agents of one's own fail anywhere. So the agent is made with the others.
    """

    def is_made(given: Mapping[str, Any]) -> bool:
        try:
            made = make(model, member=unit.member, kind=unit.kind, **given)
            env = Recorder(made, unit.steps, made.timeout)
            _seed_all(unit.seed)
            make_agent(env, **_arguments(make_agent, unit))
        except (Exception, SystemExit):
            return False
        return True

    # An error that does not come again has another cause.
    if is_made(environment):
        return ""
    for space in ("box", "discrete"):
        if is_made({**environment, "action_space": space}):
            return f'take environment={{"action_space": "{space}"}}, with which it can be made'
    return ""


def _arguments(make_agent: Callable[..., Any], unit: Unit) -> dict[str, Any]:
    """Returns a copy of the setting, with a seed if ``make_agent`` has such an argument."""
    try:
        wants = "seed" in inspect.signature(make_agent).parameters and "seed" not in unit.setting
    except (TypeError, ValueError):
        wants = False
    setting = {name: _copied(value) for name, value in unit.setting.items()}
    return {**setting, "seed": unit.seed % 2**31} if wants else setting


def _copied(value: Any) -> Any:
    """Returns a copy, because agents change their arguments, and the next agent must get the same ones."""
    try:
        return copy.deepcopy(value)
    except Exception:  # what cannot be copied, such as a lock, is shared
        return value


def _seed_all(seed: int) -> None:
    random.seed(seed)
    np.random.seed(seed % 2**32)
    torch = sys.modules.get("torch")
    if torch is not None:
        torch.manual_seed(seed % 2**63)


def _told(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}".strip()


def _tenths(returns: list[float]) -> list[float]:
    if len(returns) < 10:
        return []
    bounds = [tenth * len(returns) // 10 for tenth in range(11)]
    return [float(np.mean(returns[low:high])) for low, high in zip(bounds, bounds[1:])]


def main(parent: int) -> None:
    """Runs the units that it reads from standard input, and writes the results to the original standard output.

    Args:
        parent: The process that started this one, and stores the results.
    """
    end_with_parent(parent)
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    # The output of agents must not be taken for an answer.
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    sys.path[:] = json.loads(sys.stdin.readline())
    length = int(sys.stdin.readline())
    # The modules that make_agent needs are imported here.
    try:
        make_agent, folder, environment = pickle.loads(bytes.fromhex(sys.stdin.readline()[:length]))
        model = ActionModel.open(folder)
        torch = sys.modules.get("torch")
        if torch is not None:
            torch.set_num_threads(1)
    except (Exception, SystemExit) as error:
        failure = {"error": _told(error), "place": "make_agent", "trace": traceback.format_exc(limit=-4)}
        for _ in sys.stdin:
            print(json.dumps(failure), file=answers, flush=True)
        return
    for line in sys.stdin:
        unit = Unit(**pickle.loads(bytes.fromhex(line.strip())))
        print(json.dumps(run_unit(make_agent, model, unit, environment)), file=answers, flush=True)
