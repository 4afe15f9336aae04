"""calib chooses the hyperparameters of an online learner from the logs of a plant.

- `Study`: what to compute. Its steps `Study.build_model`, `Study.rollout`, `Study.sweep`, `Study.evaluate`, or all in `Study.run`.
  `Study.control` is the step of agents that act.
- `build_model`: builds a calibration model of a frame, an array, or logs. `Model`: the model as arrays.
- `ActionModel`: a model with actions, for agents that act. `tune`: chooses their settings. `ControlAgent`: an agent of calib.
- `Verdict`, `ControlVerdict`: what to deploy, as text and frames.
- `knn_join`, `dtw`, `simulate`: functions that need no study.
- `calib_rl.gym`: a model as an environment of Gymnasium.
- `calib_rl.agents`: agents of your own in the environments of a study.
"""

import importlib
from typing import TYPE_CHECKING, Any

from ._acting import Action, ActionModel, Decisions, Recorded
from ._calib import __version__
from ._control_agent import AgentAction, ControlAgent, Training
from ._errors import CalibError, CalibWarning, StudyError
from ._functions import Warping, build_model, dtw, knn_join, set_threads, simulate
from ._model import Model
from ._progress import Observer, Printed
from ._study import Study
from ._tune import tune
from ._tune_settings import Failure
from ._tuned import Tuned
from ._verdict import ControlVerdict, Rollouts, Runs, Verdict

if TYPE_CHECKING:
    from . import agents as agents
    from . import gym as gym
else:

    def __getattr__(name: str) -> Any:
        """Imports the modules ``agents`` and ``gym`` at their first use, because Gymnasium is slow to import and optional."""
        if name not in ("agents", "gym"):
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        try:
            return importlib.import_module(f"{__name__}.{name}")
        except ModuleNotFoundError as missing:
            if missing.name != "gymnasium":
                raise
            told = "calib_rl.gym needs the package gymnasium: pip install gymnasium"
            raise ImportError(told) from missing

__all__ = [
    "Action",
    "ActionModel",
    "AgentAction",
    "CalibError",
    "CalibWarning",
    "ControlAgent",
    "ControlVerdict",
    "Decisions",
    "Failure",
    "Model",
    "Observer",
    "Printed",
    "Recorded",
    "Rollouts",
    "Runs",
    "Study",
    "StudyError",
    "Training",
    "Tuned",
    "Verdict",
    "Warping",
    "__version__",
    "build_model",
    "dtw",
    "knn_join",
    "set_threads",
    "simulate",
    "tune",
]
