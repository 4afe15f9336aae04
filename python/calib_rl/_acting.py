"""Models with actions, in which agents that act are tuned."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _calib
from ._checks import opened, position, whole
from ._errors import CalibError
from ._files import digest
from ._model import physical_values

if TYPE_CHECKING:
    from ._study import Study


class Action(NamedTuple):
    """One of the actions of a model. `ActionModel.actions` lists them.

    Examples:
        >>> model = _example_model()
        >>> model.actions[2].name, model.actions[2].values
        ('valve=1', (1.0,))
    """

    name: str
    """What it is called."""
    values: tuple[float, ...]
    """What it sets, one a column of the actions."""
    transitions: int
    """Recorded transitions with it, or with the nearest setting where actions are numbers."""


class Decisions(NamedTuple):
    """The recorded actions, rewards and terminals. `ActionModel.decisions` returns them.

    Examples:
        >>> decisions = _example_model().decisions
        >>> len(decisions.actions) == len(decisions.rewards) == len(decisions.terminals)
        True
    """

    actions: NDArray[np.int64]
    """The action of every transition, ``int64 [t]``."""
    rewards: NDArray[np.float32]
    """Its reward, ``float32 [t]``."""
    terminals: NDArray[np.bool_]
    """Whether it ends an episode, ``bool [t]``."""


class Recorded(NamedTuple):
    """Returns of the recorded behaviour. `ActionModel.recorded` returns them.

    Examples:
        >>> recorded = _example_model().recorded(timeout=50)
        >>> recorded.worst <= recorded.best
        True
    """

    mean: float
    """Mean return an episode: all rewards divided by all episodes, of which a part counts as its share of the timeout. So it can lie beyond ``best`` and ``worst``."""
    best: float | None
    """The best whole episode. ``None`` where none is whole."""
    worst: float | None
    """The worst one."""


class ActionModel:
    """A model with actions: an ensemble that recombines the recorded transitions with the action that an agent takes.

    It is built by `calib_rl.build_model` with ``actions=`` or by ``calib control``, or opened from a folder. A step with action ``a`` draws one of the ``k`` recorded
    transitions with ``a`` whose source states are nearest to the current state. It goes to the next state of this transition, with its reward
    and its terminal. Each ensemble member lacks one block of the log.

    Models can be pickled, as the path of their folder.

    Examples:
        >>> import calib_rl, tempfile, numpy as np
        >>> log = _example_log()
        >>> model = calib_rl.build_model(log, tempfile.mkdtemp(), actions=["valve"], reward="reward")
        >>> model
        <calib_rl.ActionModel: 5 members of 599 transitions, 3 actions, 3 neighbours, 1 columns>
        >>> [action.name for action in model.actions]
        ['valve=0', 'valve=0.5', 'valve=1']
        >>> model.neighbors(0).shape
        (599, 3, 3)
    """

    def __init__(self, native: _calib.ActionModel) -> None:
        self._native = native
        # Agents may change the working folder later.
        self._path = Path(native.directory).absolute()
        # What tells this model from one that is later built in the same folder.
        self._digest = _digest_of(self.path)

    @staticmethod
    def open(folder: str | os.PathLike[str]) -> ActionModel:
        """Open the model in a folder.

        Args:
            folder: ``control-model/`` of a study's results.

        Returns:
            The model, mapped.

        Raises:
            CalibError: The folder has no model, or the model is damaged.

        Examples:
            >>> model = _example_model()
            >>> ActionModel.open(model.path).members
            5
        """
        return ActionModel(_calib.ActionModel.open(os.fspath(folder)))

    @staticmethod
    def of(study: Study | str | os.PathLike[str]) -> ActionModel:
        """Open the model with actions of a study.

        Args:
            study: The study, or its file.

        Returns:
            The model, mapped.

        Raises:
            CalibError: The model was not built.

        Examples:
            >>> import calib_rl
            >>> study = calib_rl.Study(_example_model().path.parents[1] / "study.toml")
            >>> ActionModel.of(study).members
            5
        """
        return ActionModel(_calib.ActionModel.of_job(opened(study)._job))

    @property
    def path(self) -> Path:
        """The folder that the model lies in."""
        return self._path

    @property
    def members(self) -> int:
        """Number of ensemble members. Each lacks one block of the log."""
        return self._native.members

    @property
    def k(self) -> int:
        """Number of neighbours of each state, for each action."""
        return self._native.k

    @property
    def radius(self) -> float:
        """Distance up to which a recorded transition covers a state."""
        return self._native.radius

    @property
    def period(self) -> float:
        """Seconds from one row to the next. With ``control.every``, rows are decisions, and this is the time between two decisions."""
        return self._native.period

    @property
    def timeout(self) -> int:
        """Steps after which the study cuts an episode; a step is a decision."""
        return self._native.timeout

    @property
    def worst_return(self) -> float:
        """The return that an episode ends with where the log does not cover a step. Default: the return of the worst recorded episode."""
        return self._native.worst_return

    @property
    def is_continuous(self) -> bool:
        """Whether actions are continuous. `actions` are then levels of them."""
        return self._native.is_continuous

    @property
    def columns(self) -> list[str]:
        """Names of the ``d`` columns of the states."""
        return [name for name, _, _ in self._native.columns]

    @property
    def actions(self) -> list[Action]:
        """The actions that agents choose among."""
        return [Action(name, tuple(values), count) for name, values, count in self._native.actions]

    @property
    def action_columns(self) -> dict[str, tuple[float, float]]:
        """Columns of the actions, each with its smallest and largest recorded value."""
        return {name: (low, high) for name, low, high in self._native.action_columns}

    @property
    def states(self) -> NDArray[np.float32]:
        """Normalised states, ``float32 [n, d]``, a read-only view.

        Examples:
            >>> model = _example_model()
            >>> model.states.shape[1] == len(model.columns)
            True
        """
        return self._native.states()

    @property
    def times(self) -> NDArray[np.datetime64]:
        """Time of every row, ``datetime64[us] [n]``."""
        return self._native.times().view("datetime64[us]")

    @property
    def sources(self) -> NDArray[np.uint32]:
        """Source row of each of the ``t`` transitions, ``uint32 [t]``. A transition goes to the next row."""
        return self._native.sources()

    @property
    def decisions(self) -> Decisions:
        """The action, reward and terminal of each transition."""
        return Decisions(*self._native.decisions())

    def neighbors(self, member: int = 0) -> NDArray[np.uint32]:
        """The transitions whose source states are nearest to the next state of each transition, for every action, nearest first.

        Args:
            member: Position of the member.

        Returns:
            ``uint32 [t, actions, k]``, a read-only view. It is 4294967295 where there are fewer than ``k`` neighbours, and for transitions that the member lacks.

        Raises:
            IndexError: The member does not exist.

        Examples:
            >>> model = _example_model()
            >>> model.neighbors(0).shape
            (599, 3, 3)
        """
        return self._native.neighbors(position(member, "member"))

    def distances(self, member: int = 0) -> NDArray[np.float32]:
        """Distances to the source states of `neighbors`.

        Args:
            member: Position of the member.

        Returns:
            ``float32 [t, actions, k]``, a read-only view; +∞ where there is no neighbour.

        Raises:
            IndexError: The member does not exist.

        Examples:
            >>> model = _example_model()
            >>> model.distances(0).shape
            (599, 3, 3)
        """
        return self._native.distances(position(member, "member"))

    def recorded(self, timeout: int | None = None) -> Recorded:
        """Returns per episode of the recorded behaviour.

        Recorded episodes are cut after every ``timeout`` steps. A piece is whole if it has that many steps, or if it is a shorter episode that ends in a
        terminal. The other pieces count in the mean alone, with their rewards and as their share of ``timeout``. These are the rest of an episode after a cut, and
        what a gap, a row without an action or the end of the log cut short. So the mean can lie beyond the best and the worst return, above all if
        most pieces are not whole.

        Args:
            timeout: Steps after which an episode is cut. Default: as in the study.

        Returns:
            Mean return of all pieces, and the best and the worst return of whole ones.

        Examples:
            >>> model = _example_model()
            >>> recorded = model.recorded(timeout=50)
            >>> recorded.worst <= recorded.best
            True
        """
        return Recorded(*self._native.recorded(self.timeout if timeout is None else whole(timeout, "timeout", 1)))

    def physical(self, states: ArrayLike) -> NDArray[np.float64]:
        """Convert normalised states to the units of the sensors.

        Args:
            states: ``[..., d]``.

        Returns:
            ``float64 [..., d]``.

        Examples:
            >>> model = _example_model()
            >>> model.physical(model.states[:2]).shape
            (2, 1)
        """
        return physical_values(self._native.columns, states)

    def __reduce__(self) -> tuple[Any, ...]:
        return _reopened, (str(self.path), self._digest)

    def __repr__(self) -> str:
        return (
            f"<calib_rl.ActionModel: {self.members} members of {self._native.transitions:,} transitions, {len(self.actions)} actions, "
            f"{self.k} neighbours, {len(self.columns)} columns>"
        )


def _reopened(folder: str, digest: str | None) -> ActionModel:
    """Opens a pickled model again, in this process or another.

    Raises:
        CalibError: The folder has no model, or another one than that which was pickled.
    """
    model = ActionModel.open(folder)
    if digest is not None and model._digest != digest:
        raise CalibError(_told_of_another(folder))
    return model


def _told_of_another(folder: str) -> str:
    return (
        f"{folder} holds another model than the one that was opened, because one was built there again; take ActionModel.open({folder!r}), "
        "and give build_model a folder of its own for each log"
    )


def _digest_of(folder: Path) -> str | None:
    """Returns the digest of the manifest in a model's folder, or ``None`` if there is none."""
    try:
        return digest((folder / "manifest.json").read_bytes())
    except OSError:
        return None


def require_own_folder(model: ActionModel, is_read_again: bool) -> None:
    """Refuses a model whose folder holds another one by now.

    Args:
        model: The model. It stays readable whatever becomes of its folder.
        is_read_again: Whether other processes open the folder.

    Raises:
        CalibError: It holds another model, or none, and is read again.
    """
    there = _digest_of(model.path)
    if there == model._digest or (there is None and not is_read_again):
        return
    if there is None:
        raise CalibError(f"{model.path} has no model any more, which other processes would open; build it again, or take processes=1")
    raise CalibError(_told_of_another(os.fspath(model.path)))


def acting_model(value: Any) -> ActionModel:
    """Returns the argument if it is a model with actions.

    Raises:
        TypeError: It is not, for example the path of one.
    """
    if isinstance(value, ActionModel):
        return value
    shown = repr(value) if isinstance(value, (str, os.PathLike)) else type(value).__name__
    raise TypeError(
        f"model is {shown}, expected a calib_rl.ActionModel: build_model(..., actions=[...]) makes one, ActionModel.open(folder) opens the one in "
        "a folder such as study-results/control-model, and ActionModel.of(study) that of a study"
    )


def _example_model() -> ActionModel:
    """Returns a model with actions of `_example_log`, for examples."""
    from ._functions import build_model

    return build_model(_example_log(), tempfile.mkdtemp(), actions=["valve"], reward="reward")


def _example_log() -> Any:
    """Returns the log of a tank with a valve, for examples: six hundred rows, from which `calib_rl.ActionModel` is built."""
    rng = np.random.default_rng(0)
    level, rows = 0.5, 600
    levels, valves, rewards = [], [], []
    for _ in range(rows):
        valve = float(rng.integers(3)) / 2
        levels.append(level)
        valves.append(valve)
        rewards.append(-abs(level - 0.6))
        level = float(np.clip(level + 0.1 * (valve - 0.5) + rng.normal(0.0, 0.01), 0.0, 1.0))
    times = np.datetime64("2024-03-01", "us") + np.arange(rows) * np.timedelta64(60_000_000, "us")
    columns = {"time": times, "level": levels, "valve": valves, "reward": rewards}
    try:
        import polars
    except ImportError:
        import pandas

        return pandas.DataFrame(columns)
    return polars.DataFrame(columns)
