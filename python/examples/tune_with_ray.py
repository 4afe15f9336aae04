"""Ray Tune tunes an agent in a calibration model; the held-out log then says what that was worth.

python tune_with_ray.py STUDY [TRIALS]
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
from own_agents import LinearTd

import calib_rl
from calib_rl.agents import Streams, Sweep

DEFAULT = {"learning_rate": 1e-2, "trace": 0.0}


def error(values: dict[str, float], study: str) -> dict[str, float]:
    """One trial, in a process of Ray: the geometric mean of the errors over all members."""
    calib_rl.set_threads(1)
    streams = Streams(calib_rl.Study(study))
    sensor = next(iter(streams.sensors))
    members = [stream for stream in streams.all if stream.environment.startswith("member")]
    errors = [streams.run(LinearTd, stream, sensor, values)[0].nrmse for stream in members]
    return {"error": float(np.exp(np.mean(np.log(errors))))}


def main() -> None:
    try:
        import ray
        from ray import tune
    except ImportError as missing:
        print(f"skipped, {missing}")
        return
    study = calib_rl.Study(sys.argv[1])
    trials = int(sys.argv[2]) if len(sys.argv) > 2 else 8
    # Ray's processes import what they run from here.
    paths = os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
    ray.init(num_cpus=2, include_dashboard=False, logging_level="ERROR", runtime_env={"env_vars": {"PYTHONPATH": paths}})
    space: dict[str, Any] = {"learning_rate": tune.loguniform(1e-4, 1.0), "trace": tune.uniform(0.0, 0.95)}
    path = str(study.path.resolve())
    tuner = tune.Tuner(
        lambda values: error(values, path),
        param_space=space,
        tune_config=tune.TuneConfig(metric="error", mode="min", num_samples=trials),
        run_config=tune.RunConfig(verbose=0),
    )
    best = tuner.fit().get_best_result()
    ray.shutdown()
    chosen = {name: best.config[name] for name in DEFAULT} if best.config else DEFAULT
    print(f"in the model: {chosen}, error {best.metrics['error']:.3f}" if best.metrics else "in the model: no result")
    runs = Sweep(study, study.results / "agents" / "ray", progress=False).run(LinearTd, [chosen, DEFAULT], default=DEFAULT)
    for line in runs.evaluate().advice[0]:
        print(line)


if __name__ == "__main__":
    main()
