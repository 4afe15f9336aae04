"""From nothing to a verdict: three days of a simulated plant, linear agents.

python first_verdict.py FOLDER
"""

import sys
from pathlib import Path

import calib_rl

folder = Path(sys.argv[1])
study = calib_rl.Study(
    path=folder / "study.toml",
    simulate={"days": 3, "channels": 8, "period_secs": 60},
    data={"path": "plant", "train_fraction": 0.7},
    agent={"value_function": "linear", "gamma": 0.9, "batch_size": 16},
    sweep={"sensors": ["PIT300"], "steps": 600, "online_runs": 2, "grid": {"learning_rate": [1e-4, 1e-3, 1e-2]}},
)
print(study.run())
