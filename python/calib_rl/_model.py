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


def physical_values(columns: Sequence[tuple[str, float, float]], states: ArrayLike) -> NDArray[np.float64]:
    """Normalised states, ``[..., d]``, in the units of columns of these names, offsets and scales."""
    _, offset, scale = zip(*columns)
    values: NDArray[np.float64] = np.asarray(states, np.float64) * np.array(scale) + np.array(offset)
    return values


class Model:
    """A calibration model of neighbours: an ensemble that recombines recorded transitions.

    Made by `calib_rl.build_model`, `Study.build_model` or `Model.open`. Transition ``i`` leads from row ``sources[i]`` to the
    row after it. All arrays of a model are read-only views of its files where it was opened from a folder: they take memory only
    while there is some.

    Models can be pickled: one that lies in a folder as its path, one of arrays as these, of which it is built again. They may be used from
    several threads at once.

    A file of an open model that is cut short by somebody else, or whose disk fails, is noticed: the next call raises `CalibError`, and what
    was read of it meanwhile is zeros.

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
            The model, mapped.

        Raises:
            CalibError: There is none, it was damaged, or it is a network.

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
            The model, mapped.

        Raises:
            CalibError: It was not built, or of another study.

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
        """The folder that the model lies in. ``None`` where it was built of arrays.

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
        """Members of the ensemble. Each lacks one block of the data.

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
        """Neighbours of each transition.

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
        """Seconds from one row to the next. ``None`` where the model was built of arrays.

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
        """Time of every row, ``datetime64[us] [n]``, UTC where the log knows it. ``None`` where there are none.

        Examples:
            >>> from calib_rl._study import _example_study
            >>> _example_study().build_model(progress=False).times.dtype
            dtype('<M8[us]')
        """
        times = self._native.times()
        return None if times is None else times.view("datetime64[us]")

    @property
    def segments(self) -> list[int]:
        """Rows of each unbroken segment. No transition crosses from one into the next.

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
        """Row that each of the ``t`` transitions starts from, ``uint32 [t]``. It leads to the row after it.

        Examples:
            >>> import numpy as np
            >>> import calib_rl
            >>> model = calib_rl.build_model(np.arange(60.0).reshape(30, 2) % 7, members=5)
            >>> model.sources[:3]
            array([0, 1, 2], dtype=uint32)
        """
        return self._native.sources()

    def transitions(self, member: int = 0) -> NDArray[np.uint32]:
        """The transitions that a member has, in time order.

        Args:
            member: Position of the member.

        Returns:
            Their numbers, ``uint32``.

        Raises:
            IndexError: There is no such member.

        Examples:
            >>> import numpy as np
            >>> import calib_rl
            >>> model = calib_rl.build_model(np.arange(60.0).reshape(30, 2) % 7, members=5)
            >>> len(model.transitions(0)) < len(model.sources)
            True
        """
        return self._native.transitions(position(member, "member"))

    def neighbors(self, member: int = 0) -> NDArray[np.uint32]:
        """The transitions whose sources are nearest to where each one leads, nearest first.

        Args:
            member: Position of the member.

        Returns:
            ``uint32 [t, k]``, a read-only view. Rows of transitions that the member lacks hold 4294967295.

        Raises:
            IndexError: There is no such member.

        Examples:
            >>> import numpy as np
            >>> import calib_rl
            >>> model = calib_rl.build_model(np.arange(60.0).reshape(30, 2) % 7, members=5)
            >>> model.neighbors(0).shape
            (29, 3)
        """
        return self._native.neighbors(position(member, "member"))

    def distances(self, member: int = 0) -> NDArray[np.float32]:
        """How far the sources of `neighbors` are.

        Args:
            member: Position of the member.

        Returns:
            ``float32 [t, k]``, a read-only view: Euclidean, in units of the states, or of their representation. +∞ for
            transitions that the member lacks.

        Raises:
            IndexError: There is no such member.

        Examples:
            >>> import numpy as np
            >>> import calib_rl
            >>> model = calib_rl.build_model(np.arange(60.0).reshape(30, 2) % 7, members=5)
            >>> model.distances(0).shape
            (29, 3)
        """
        return self._native.distances(position(member, "member"))

    def physical(self, states: ArrayLike) -> NDArray[np.float64]:
        """Normalised states in the units of the sensors.

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
        """Values in the units of the sensors on the scale of the states. This is the inverse of `physical`.

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
        """Roll a member out: every step draws one of the nearest recorded transitions.

        Args:
            n: Rollouts. Rollout ``r`` is the same however many there are.
            steps: Steps of each.
            member: Position of the member.
            start: Rows to start from, one for each rollout, again from the first after the last. Random ones unless given. A row that the
                member lacks is replaced by its nearest.
            seed: Root of the draws. Unless given, it is the study's, which gives the rollouts of the command line where they start at random
                states too.
            progress: Whether to print how far it is, or an observer.

        Returns:
            The rows that are visited, ``uint32 [n, steps + 1]``. ``model.states[rows]`` are their states.

        Raises:
            IndexError: There is no such member or row.
            ValueError: ``n`` or ``steps`` is negative.
            TypeError: A number that is to be whole is not.
            MemoryError: There is no memory for so many steps.
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
        """Where a member would go on from states that it need not have seen, by exact search.

        Args:
            states: ``[q, d]``, real numbers of any type and layout.
            k: Neighbours to find. As many as the tables have, unless given.
            member: Position of the member.
            units: What the values are in.

        Returns:
            Rows of the nearest states, nearest first, ``uint32 [q, k]``, and their distances, ``float32 [q, k]``.

        Raises:
            CalibError: A value is NaN or infinite, or there is another number of columns.
            ValueError: ``k`` is less than 1, or more than the member has transitions.
            TypeError: These are no real numbers.
            IndexError: There is no such member.
            MemoryError: There is no memory for so many.
            KeyboardInterrupt: Ctrl-C.

        Examples:
            >>> import numpy as np
            >>> import calib_rl
            >>> model = calib_rl.build_model(np.random.default_rng(0).random((300, 2)))
            >>> rows, distances = model.nearest([[0.5, 0.5]], k=4)
            >>> rows.shape, bool((np.diff(distances) >= 0).all())
            ((1, 4), True)
        """
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
    """A model of normalised states in memory."""
    lengths = None if segments is None else [whole(length, "segments") for length in segments]
    return Model(_calib.Model.build(states, lengths, options, observer(progress)), (lengths, options))
