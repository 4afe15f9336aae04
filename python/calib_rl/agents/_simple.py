"""Simple predictors, as agents that are ready to be deployed."""

from __future__ import annotations

import json
import os
from collections import deque
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from .._study import Study
from .._verdict import Verdict

NAMES = ("mean", "persistence", "line", "autoregression", "ridge", "least_squares_td")


class SimplePredictor:
    """A predictor that calib fitted on the training range, and that learns nothing afterwards.

    Args:
        source: A study that was swept, a verdict, or the folder with ``simple.json``.
        sensor: The predicted sensor.
        predictor: ``"mean"``, ``"persistence"``, ``"line"``, ``"autoregression"``, ``"ridge"`` or
            ``"least_squares_td"``.

    It is an `Agent`: it predicts normalised returns from normalised states. Of an autoregression, `predict` is called
    once for every state, in order, and `begin` where an unbroken piece begins.

    Examples:
        >>> from calib_rl._study import _example_study
        >>> verdict = _example_study().run(progress=False)
        >>> ridge = SimplePredictor(verdict, "PIT300", "ridge")
        >>> ridge
        <SimplePredictor: ridge of PIT300>
        >>> state = _example_study().model().states[-1]
        >>> isinstance(ridge.predict(state), float)
        True
    """

    predictor: ClassVar[str] = ""

    def __init__(self, source: Study | Verdict | str | os.PathLike[str], sensor: str, predictor: str = "") -> None:
        name = predictor or self.predictor
        if name not in NAMES:
            raise ValueError(f"predictor is {name!r}, expected one of {', '.join(NAMES)}")
        rows: list[dict[str, Any]] = json.loads(_file(source).read_text(encoding="utf-8"))["fitted"]
        sensors = {row["sensor"] for row in rows}
        if sensor not in sensors:
            raise ValueError(f"the study predicts no sensor {sensor!r}; it predicts {', '.join(sorted(sensors))}")
        self.sensor: str = sensor
        self.name: str = name
        fitted = next(row["fitted"] for row in rows if row["sensor"] == sensor and row["predictor"] == name)
        self.bias: float = float(fitted["bias"])
        self.weights: NDArray[np.float64] | None = None
        """One for each column of a state. An autoregression has none."""
        self.lags: NDArray[np.float64] | None = None
        """For the sensor's latest values, the present one first. Only an autoregression has them."""
        if fitted["form"] == "affine":
            self.weights = np.array(fitted["weights"], dtype=np.float64)
        else:
            self.column: int = int(fitted["column"])
            self.lags = np.array(fitted["lags"], dtype=np.float64)
            self._latest: deque[float] = deque(maxlen=len(self.lags))

    def begin(self) -> None:
        """Forget the values before a gap.

        Examples:
            >>> from calib_rl._study import _example_study
            >>> latest = SimplePredictor(_example_study().run(progress=False), "PIT300", "autoregression")
            >>> latest.begin()    # after a gap
        """
        if self.lags is not None:
            self._latest.clear()

    def predict(self, observation: NDArray[np.float32]) -> float:
        """Predict the return from a state.

        Args:
            observation: The state, normalised.

        Returns:
            The return, in normalised units.

        Examples:
            >>> from calib_rl._study import _example_study
            >>> ridge = SimplePredictor(_example_study().run(progress=False), "PIT300", "ridge")
            >>> isinstance(ridge.predict(_example_study().model().states[-1]), float)
            True
        """
        if self.weights is not None:
            return float(self.bias + self.weights @ np.asarray(observation, dtype=np.float64)[: len(self.weights)])
        assert self.lags is not None
        value = float(observation[self.column])
        # Before the first state, the sensor counts as having had its first value.
        self._latest.extendleft([value] * (1 if self._latest else len(self.lags)))
        return float(self.bias + self.lags @ np.array(self._latest))

    def update(self, observation: NDArray[np.float32], reward: float, next_observation: NDArray[np.float32]) -> None:
        """Learn nothing.

        Args:
            observation: Not used.
            reward: Not used.
            next_observation: Not used.
        """

    def state_dict(self) -> Mapping[str, Any]:
        """The coefficients.

        Returns:
            ``bias``, ``weights`` and ``lags``. One of the last two is ``None``.

        Examples:
            >>> from calib_rl._study import _example_study
            >>> ridge = SimplePredictor(_example_study().run(progress=False), "PIT300", "ridge")
            >>> sorted(ridge.state_dict())
            ['bias', 'lags', 'weights']
        """
        return {"bias": self.bias, "weights": self.weights, "lags": self.lags}

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.name} of {self.sensor}>"


class Mean(SimplePredictor):
    """The mean return of the training range. See `SimplePredictor`.

    Examples:
        >>> from calib_rl._study import _example_study
        >>> Mean(_example_study().run(progress=False), "PIT300").name
        'mean'
    """

    predictor = "mean"


class Persistence(SimplePredictor):
    """The sensor stays as it is. See `SimplePredictor`.

    Examples:
        >>> from calib_rl._study import _example_study
        >>> Persistence(_example_study().run(progress=False), "PIT300").name
        'persistence'
    """

    predictor = "persistence"


class Ridge(SimplePredictor):
    """Ridge regression on all columns of the state. See `SimplePredictor`.

    Examples:
        >>> from calib_rl._study import _example_study
        >>> Ridge(_example_study().run(progress=False), "PIT300").name
        'ridge'
    """

    predictor = "ridge"


class LeastSquaresTD(SimplePredictor):
    """Least-squares TD on all columns of the state. See `SimplePredictor`.

    Examples:
        >>> from calib_rl._study import _example_study
        >>> LeastSquaresTD(_example_study().run(progress=False), "PIT300").name
        'least_squares_td'
    """

    predictor = "least_squares_td"


def _file(source: Study | Verdict | str | os.PathLike[str]) -> Path:
    if isinstance(source, Study):
        folder = source.results / "sweep"
    elif isinstance(source, Verdict):
        folder = source._sweep
    else:
        folder = Path(source)
    file = folder / "simple.json"
    if not file.exists():
        raise FileNotFoundError(f"{file} is not there; sweep the study first")
    return file
