"""Calibration models as arrays."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _calib
from ._checks import LARGEST_SEED, opened, position, whole
from ._progress import Observer, observer

if TYPE_CHECKING:
    from ._study import Study

Units = Literal["normalised", "physical"]


def check_units(units: Units) -> None:
    """Refuses unknown units."""
    if units not in ("normalised", "physical"):
        raise ValueError(f"units are {units!r}, expected 'normalised' or 'physical'")


def physical_values(columns: Sequence[tuple[str, float, float]], states: ArrayLike) -> NDArray[np.float64]:
    """Converts normalised states, ``[..., d]``, to the units of columns with these names, offsets and scales."""
    _, offset, scale = zip(*columns)
    values: NDArray[np.float64] = np.asarray(states, np.float64) * np.array(scale) + np.array(offset)
    return values


class Model:
    """A calibration model of neighbours: an ensemble that recombines recorded transitions.

    It is made by `calib_rl.build_model`, `Study.build_model` or `Model.open`. Transition ``i`` leads from row ``sources[i]`` to the
    next row. If the model was opened from a folder, all its arrays are read-only views of its files. The system can take their
    memory back.

    Models can be pickled: a model in a folder as its path, a model of arrays as its arrays, of which it is built again. They may be used from
    several threads at once.

    If a file of an open model is truncated by another program, or its disk fails, the next call raises `CalibError`. Data that
    was read in the meantime is zeros.

    Examples:
        >>> import numpy as np
        >>> import calib_rl
        >>> states = np.tile(np.arange(7.0), 10)[:, None]    # a sawtooth: every state recurs
        >>> model = calib_rl.build_model(states, members=5)
        >>> model
        <calib_rl.Model: 5 members of 69 transitions, 3 neighbours, 1 columns>
        >>> model.neighbors(0).shape, model.neighbors(0).dtype
        ((69, 3), dtype('uint32'))
        >>> rows = model.rollout(2, 100)
        >>> rows.shape
        (2, 101)
        >>> bool((np.diff(model.states[rows[0], 0]) % 7 == 1).all())    # it goes on as the sawtooth does
        True
    """

    def __init__(
        self, native: _calib.Model, built: tuple[list[int] | None, dict[str, Any]] | None = None
    ) -> None:
        self._native = native
        self._built = built

    @staticmethod
    def open(folder: str | os.PathLike[str]) -> Model:
        """Open the model in a folder.

        Args:
            folder: ``model/`` of a study's results.

        Returns:
            The memory-mapped model.

        Raises:
            CalibError: The folder has no model, or the model is damaged or a network.

        Examples:
            >>> import calib_rl
            >>> from calib_rl._study import _example_study
            >>> folder = _example_study().build_model(progress=False).path
            >>> calib_rl.Model.open(folder).members
            5
        """
        return Model(_calib.Model.open(os.fspath(folder)))

    @staticmethod
    def of(study: Study | str | os.PathLike[str]) -> Model:
        """Open the model of a study.

        Args:
            study: The study, or its file.

        Returns:
            The memory-mapped model.

        Raises:
            CalibError: The model was not built, or it is of another study.

        Examples:
            >>> import calib_rl
            >>> from calib_rl._study import _example_study
            >>> study = _example_study()
            >>> _ = study.build_model(progress=False)
            >>> calib_rl.Model.of(study).members
            5
        """
        return Model(_calib.Model.of_job(opened(study)._job))

    @property
    def path(self) -> Path | None:
        """The folder of the model. ``None`` if it was built of arrays.

        Examples:
            >>> import numpy as np
            >>> import calib_rl
            >>> model = calib_rl.build_model(np.arange(60.0).reshape(30, 2) % 7, members=5)
            >>> model.path is None
            True
        """
        directory = self._native.directory
        return None if directory is None else Path(directory).absolute()

    @property
    def members(self) -> int:
        """Number of ensemble members. Each lacks one block of the data.

        Examples:
            >>> import numpy as np
            >>> import calib_rl
            >>> model = calib_rl.build_model(np.arange(60.0).reshape(30, 2) % 7, members=5)
            >>> model.members
            5
        """
        return self._native.members

    @property
    def k(self) -> int:
        """Number of neighbours of each transition.

        Examples:
            >>> import numpy as np
            >>> import calib_rl
            >>> model = calib_rl.build_model(np.arange(60.0).reshape(30, 2) % 7, members=5)
            >>> model.k
            3
        """
        return self._native.k

    @property
    def period(self) -> float | None:
        """Seconds from one row to the next. ``None`` if the model was built of arrays.

        Examples:
            >>> from calib_rl._study import _example_study
            >>> _example_study().build_model(progress=False).period
            60.0
        """
        return self._native.period

    @property
    def columns(self) -> list[str]:
        """Names of the ``d`` columns of the states.

        Examples:
            >>> from calib_rl._study import _example_study
            >>> "PIT300" in _example_study().build_model(progress=False).columns
            True
        """
        return [name for name, _, _ in self._native.columns]

    @property
    def states(self) -> NDArray[np.float32]:
        """Normalised states, ``float32 [n, d]``: usually in [0, 1] over the training range.

        Examples:
            >>> import numpy as np
            >>> import calib_rl
            >>> model = calib_rl.build_model(np.arange(60.0).reshape(30, 2) % 7, members=5)
            >>> model.states.shape, model.states.dtype
            ((30, 2), dtype('float32'))
        """
        return self._native.states()

    @property
    def times(self) -> NDArray[np.datetime64] | None:
        """Time of every row, ``datetime64[us] [n]``, in UTC if the log has a time zone. ``None`` if there are no times.

        Examples:
            >>> from calib_rl._study import _example_study
            >>> _example_study().build_model(progress=False).times.dtype
            dtype('<M8[us]')
        """
        times = self._native.times()
        return None if times is None else times.view("datetime64[us]")

    @property
    def segments(self) -> list[int]:
        """Number of rows of each unbroken segment. No transition crosses from one segment into the next.

        Examples:
            >>> import numpy as np
            >>> import calib_rl
            >>> model = calib_rl.build_model(np.arange(60.0).reshape(30, 2) % 7, members=5)
            >>> model.segments
            [30]
        """
        return self._native.segments()

    @property
    def sources(self) -> NDArray[np.uint32]:
        """Source row of each of the ``t`` transitions, ``uint32 [t]``. A transition goes to the next row.

        Examples:
            >>> import numpy as np
            >>> import calib_rl
            >>> model = calib_rl.build_model(np.arange(60.0).reshape(30, 2) % 7, members=5)
            >>> model.sources[:3]
            array([0, 1, 2], dtype=uint32)
        """
        return self._native.sources()

    def transitions(self, member: int = 0) -> NDArray[np.uint32]:
        """The transitions of an ensemble member, in time order.

        Args:
            member: Position of the member.

        Returns:
            Their numbers, ``uint32``.

        Raises:
            IndexError: The member does not exist.

        Examples:
            >>> import numpy as np
            >>> import calib_rl
            >>> model = calib_rl.build_model(np.arange(60.0).reshape(30, 2) % 7, members=5)
            >>> len(model.transitions(0)) < len(model.sources)
            True
        """
        return self._native.transitions(position(member, "member"))

    def neighbors(self, member: int = 0) -> NDArray[np.uint32]:
        """The transitions whose source states are nearest to the next state of each transition, nearest first.

        Args:
            member: Position of the member.

        Returns:
            ``uint32 [t, k]``, a read-only view. Rows of transitions that the member lacks hold 4294967295.

        Raises:
            IndexError: The member does not exist.

        Examples:
            >>> import numpy as np
            >>> import calib_rl
            >>> model = calib_rl.build_model(np.arange(60.0).reshape(30, 2) % 7, members=5)
            >>> model.neighbors(0).shape
            (29, 3)
        """
        return self._native.neighbors(position(member, "member"))

    def distances(self, member: int = 0) -> NDArray[np.float32]:
        """Distances to the source states of `neighbors`.

        Args:
            member: Position of the member.

        Returns:
            ``float32 [t, k]``, a read-only view: Euclidean, in units of the states, or of their representation. +∞ for
            transitions that the member lacks.

        Raises:
            IndexError: The member does not exist.

        Examples:
            >>> import numpy as np
            >>> import calib_rl
            >>> model = calib_rl.build_model(np.arange(60.0).reshape(30, 2) % 7, members=5)
            >>> model.distances(0).shape
            (29, 3)
        """
        return self._native.distances(position(member, "member"))

    def physical(self, states: ArrayLike) -> NDArray[np.float64]:
        """Convert normalised states to the units of the sensors.

        Args:
            states: ``[…, d]``, or rows of `states`.

        Returns:
            ``float64 [..., d]``.

        Examples:
            >>> from calib_rl._study import _example_study
            >>> model = _example_study().build_model(progress=False)
            >>> model.physical(model.states[:2]).shape == model.states[:2].shape
            True
        """
        return physical_values(self._native.columns, states)

    def normalised(self, values: ArrayLike) -> NDArray[np.float32]:
        """Convert values in the units of the sensors to normalised states. This is the inverse of `physical`.

        Args:
            values: ``[..., d]``.

        Returns:
            ``float32 [..., d]``.

        Examples:
            >>> import numpy as np
            >>> from calib_rl._study import _example_study
            >>> model = _example_study().build_model(progress=False)
            >>> values = model.physical(model.states[:2])
            >>> bool(np.allclose(model.normalised(values), model.states[:2], atol=1e-5))
            True
        """
        _, offset, scale = zip(*self._native.columns)
        states: NDArray[np.float32] = ((np.asarray(values, np.float64) - np.array(offset)) / np.array(scale)).astype(np.float32)
        return states

    def rollout(
        self,
        n: int,
        steps: int,
        *,
        member: int = 0,
        start: Sequence[int] | NDArray[np.integer[Any]] | None = None,
        seed: int | None = None,
        progress: bool | Observer = False,
    ) -> NDArray[np.uint32]:
        """Make rollouts of an ensemble member: every step draws one of the nearest recorded transitions.

        Args:
            n: Number of rollouts. Rollout ``r`` does not depend on this number.
            steps: Number of steps of each rollout.
            member: Position of the member.
            start: Start rows, one for each rollout, cyclically. Default: random rows. A row that the
                member lacks is replaced by its nearest.
            seed: Seed of the random numbers. Default: the study's seed, which gives the rollouts of the command line if those also start at
                random states.
            progress: Whether to print the progress, or an observer.

        Returns:
            The visited rows, ``uint32 [n, steps + 1]``. ``model.states[rows]`` are their states.

        Raises:
            IndexError: The member or row does not exist.
            ValueError: ``n`` or ``steps`` is negative.
            TypeError: A number is not a whole number.
            MemoryError: There is not enough memory for the steps.
            KeyboardInterrupt: Ctrl-C.

        Examples:
            >>> import numpy as np
            >>> import calib_rl
            >>> model = calib_rl.build_model(np.random.default_rng(0).random((300, 2)))
            >>> rows = model.rollout(4, 50, member=1, seed=3)
            >>> rows.shape, model.states[rows].shape
            ((4, 51), (4, 51, 2))
        """
        rows = None if start is None else [position(row, "start") for row in np.asarray(start).ravel()]
        root = None if seed is None else whole(seed, "seed", most=LARGEST_SEED)
        member, n, steps = position(member, "member"), whole(n, "n"), whole(steps, "steps")
        return self._native.rollout(member, n, steps, rows, root, observer(progress))

    def nearest(
        self, states: ArrayLike, k: int | None = None, *, member: int = 0, units: Units = "normalised"
    ) -> tuple[NDArray[np.uint32], NDArray[np.float32]]:
        """Find the states from which a member would continue after given states, by exact search. The given states need not be in the model.

        Args:
            states: ``[q, d]``, real numbers of any type and layout.
            k: Number of neighbours to find. Default: as in the tables.
            member: Position of the member.
            units: Units of the values.

        Returns:
            Rows of the nearest states, nearest first, ``uint32 [q, k]``, and their distances, ``float32 [q, k]``.

        Raises:
            CalibError: A value is NaN or infinite, or the number of columns is wrong.
            ValueError: ``k`` is less than 1, or more than the number of the member's transitions. The units are unknown.
            TypeError: The values are not real numbers.
            IndexError: The member does not exist.
            MemoryError: There is not enough memory.
            KeyboardInterrupt: Ctrl-C.

        Examples:
            >>> import numpy as np
            >>> import calib_rl
            >>> model = calib_rl.build_model(np.random.default_rng(0).random((300, 2)))
            >>> rows, distances = model.nearest([[0.5, 0.5]], k=4)
            >>> rows.shape, bool((np.diff(distances) >= 0).all())
            ((1, 4), True)
        """
        check_units(units)
        if units == "physical":
            states = self.normalised(states)
        neighbors = self.k if k is None else whole(k, "k", 1)
        return self._native.nearest(states, neighbors, position(member, "member"))

    def __reduce__(self) -> tuple[Any, ...]:
        path = self.path
        if path is not None:
            return Model.open, (str(path),)
        segments, options = self._built or (None, {})
        return of_arrays, (np.array(self.states), segments, options)

    def __repr__(self) -> str:
        count = len(self.sources)
        return (
            f"<calib_rl.Model: {self.members} members of {count:,} transitions, {self.k} neighbours, "
            f"{len(self.columns)} columns>"
        )


def of_arrays(
    states: ArrayLike, segments: Sequence[int] | None, options: dict[str, Any], progress: bool | Observer = False
) -> Model:
    """Builds a model of normalised states in memory."""
    lengths = None if segments is None else [whole(length, "segments") for length in segments]
    return Model(_calib.Model.build(states, lengths, options, observer(progress)), (lengths, options))
