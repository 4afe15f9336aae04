"""Reference trajectories for crates/calib-control: Gymnasium's Acrobot, Cart-pole and Pendulum, one step at a time.

    python3 -m venv .venv-golden && .venv-golden/bin/pip install gymnasium==1.4.0 numpy
    .venv-golden/bin/python scripts/golden/control.py

Of each step that is kept: the state before (double precision), the action, what is observed after (single precision, as Gymnasium
gives it), the reward, whether it is terminal, and the state after. Gymnasium has no Puddle World; its numbers are written here from
Sutton (1996) without noise: distances to the two segments by projection, not as the crate does them.
"""

import math
import random
from pathlib import Path

import gymnasium
import numpy as np

import layout

OUT = Path(__file__).parents[2] / "crates/calib-control/tests/golden/tasks.json"
# Of the joints of Acrobot, and of Pendulum.
SPEED_LIMITS = (4 * math.pi, 9 * math.pi, 8.0)


def rolled(name, actions, steps, spread):
    env = gymnasium.make(name).unwrapped
    rng = random.Random(7)
    rows = []
    env.reset(seed=1)

    def restart():
        env.reset(seed=rng.randrange(1 << 30))
        env.state = np.array([rng.uniform(-s, s) for s in spread], dtype=np.float64)

    restart()
    for _ in range(steps):
        before = [float(x) for x in env.state]
        action = rng.choice(actions)
        observed, reward, terminal, _, _ = env.step(action if isinstance(action, int) else np.array(action))
        rows.append({
            "state": before,
            "action": action if isinstance(action, int) else action[0],
            "observed": [float(x) for x in observed],
            "reward": float(reward),
            "terminal": bool(terminal),
            "next": [float(x) for x in env.state],
        })
        if terminal or len(rows) % 50 == 0:
            restart()
    return rows


def distance(p, a, b):
    """Returns the distance from point p to the segment a-b."""
    p, a, b = map(np.array, (p, a, b))
    along = b - a
    share = min(1.0, max(0.0, float(np.dot(p - a, along) / np.dot(along, along))))
    return float(np.linalg.norm(p - a - share * along))


def puddle(steps):
    rng = random.Random(9)
    moves = [(0.0, 0.05), (0.0, -0.05), (0.05, 0.0), (-0.05, 0.0)]
    segments = [((0.1, 0.75), (0.45, 0.75)), ((0.45, 0.4), (0.45, 0.8))]
    rows = []
    for _ in range(steps):
        before = [rng.random(), rng.random()]
        action = rng.randrange(4)
        after = [min(1.0, max(0.0, s + m)) for s, m in zip(before, moves[action])]
        depth = sum(max(0.0, 0.1 - distance(after, *segment)) for segment in segments)
        rows.append({
            "state": before,
            "action": action,
            "observed": after,
            "reward": -1.0 - 400.0 * depth,
            "terminal": sum(after) >= 1.9,
            "next": after,
        })
    return rows


def kept(steps):
    """Returns every tenth step, the first four that end an episode, and those after which a speed is at its limit."""
    terminal = [number for number, step in enumerate(steps) if step["terminal"]][:4]
    fast = [number for number, step in enumerate(steps) if any(abs(x) in SPEED_LIMITS for x in step["next"])]
    return [step for number, step in enumerate(steps) if number % 10 == 0 or number in terminal + fast]


tasks = {
    "acrobot": rolled("Acrobot-v1", [0, 1, 2], 200, [math.pi, math.pi, 8.0, 16.0]),
    "cart_pole": rolled("CartPole-v1", [0, 1], 200, [2.0, 2.0, 0.2, 2.0]),
    "pendulum": rolled("Pendulum-v1", [[-2.0], [-0.7], [0.0], [1.3], [2.0]], 200, [6.0, 7.0]),
    "puddle_world": puddle(200),
}
layout.write(OUT, {name: kept(steps) for name, steps in tasks.items()})
