"""Optuna tunes an agent in a calibration model; the held-out log then says what that was worth.

python tune_with_optuna.py STUDY
"""

import sys

import optuna
from own_agents import LinearTd

import calib_rl
from calib_rl.agents import Sweep, optuna_objective

study = calib_rl.Study(sys.argv[1])
sweep = Sweep(study, study.results / "agents" / "optuna", progress=False)


def suggest(trial: optuna.Trial) -> dict[str, float]:
    return {
        "learning_rate": trial.suggest_float("learning_rate", 1e-4, 1.0, log=True),
        "trace": trial.suggest_float("trace", 0.0, 0.95),
    }


optuna.logging.set_verbosity(optuna.logging.WARNING)
search = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=0), pruner=optuna.pruners.MedianPruner(n_warmup_steps=3))
search.optimize(optuna_objective(sweep, LinearTd, suggest), n_trials=20)
print(f"in the model: {search.best_params}, error {search.best_value:.3f}")

runs = sweep.run(LinearTd, [search.best_params, {"learning_rate": 1e-2, "trace": 0.0}], default={"learning_rate": 1e-2, "trace": 0.0})
for line in runs.evaluate().advice[0]:
    print(line)
