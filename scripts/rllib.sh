#!/usr/bin/env bash
# An agent of RLlib is tuned in a model, as python/examples/tune_rllib.py has it:
#
#   bash scripts/rllib.sh      needs the wheel of scripts/python_wheel.sh in CALIB_TOOLS (target/tools otherwise). Fetches ray there.
set -euo pipefail
. "$(dirname "$0")/python_env.sh" ray
# The last two are what PyTorch needs and RLlib does not bring.
"$python" -m pip install --quiet 'ray[rllib]==2.40.0' sympy jinja2
"$python" -m pip install --quiet --force-reinstall --no-deps "$wheel"

. "$root/scripts/pytorch.sh"
export PYTHONPATH=$PYTHONPATH:$root/.libtorch:$root/python/examples RAY_USAGE_STATS_ENABLED=0

cd "$work"
"$tools/ray/bin/calib" -q simulate pole --task cart-pole --policy random --transitions 500 >/dev/null
"$python" -W ignore - <<'TUNE'
import logging

import calib_rl
from tune_rllib import Agent

logging.disable(logging.WARNING)
model = calib_rl.build_model("pole", "tuned", actions=["action"], reward="reward", terminal="terminal")
few = {"members": [0, 1], "kinds": ["neighbors"], "processes": 1, "default": None}
tuned = calib_rl.tune(Agent, {"lr": [1e-5, 1e-2], "num_epochs": [2]}, model, total_timesteps=1000, **few)
assert not tuned.failures, tuned.failures[0].trace
slow, fast = (run["returns"] for run in tuned.runs if run["member"] == 0)
assert slow[0] == fast[0] and slow != fast, "the first episode is before the first update, and settings matter after it"
TUNE
echo "rllib: PPO is tuned (at $SECONDS s)"
