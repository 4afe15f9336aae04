"""Settings of `calib_rl.tune`, and their names."""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import FunctionType
from typing import Any

import numpy as np

from ._identity import Unstable, identity

Setting = dict[str, Any]
Grid = Mapping[str, Sequence[Any]] | Sequence[Mapping[str, Any]]


@dataclass(frozen=True)
class Failure:
    """A setting that failed, and is not in the verdict. `Tuned.failures` lists them.

    Examples:
        >>> failure = Failure({"gamma": 2.0}, 0, 0, "make_agent", "ValueError: gamma", "")
        >>> print(failure)
        gamma=2 failed in ensemble member 0, run 0, in make_agent: ValueError: gamma; see that make_agent(env, **setting) can be called with it
    """

    setting: Setting
    """The setting."""
    member: int
    """The member in which it failed first."""
    run: int
    """The run there."""
    place: str
    """``"make_agent"``, ``"learn"``, or ``"process"``."""
    error: str
    """What was raised."""
    trace: str
    """Where, as Python tells it."""
    name: str = ""
    """What the setting is called among the others."""
    remedy: str = ""
    """What to do about it, if calib knows more than what usually helps in this place."""

    def __str__(self) -> str:
        remedy = self.remedy or {
            "make_agent": "see that make_agent(env, **setting) can be called with it",
            "learn": "see to the agent, or leave the setting out",
            "process": "give it less memory or fewer processes=, or leave the setting out",
        }[self.place]
        return f"{self.name or label(self.setting)} failed in ensemble member {self.member}, run {self.run}, in {self.place}: {self.error}; {remedy}"


def settings_of(grid: Any, default: Any) -> tuple[list[Setting], int | None]:
    """Returns the settings of a grid, including the default, and the place of the default.

    Raises:
        TypeError: The grid or the default is of another form.
        ValueError: There is no setting, or one occurs twice.
    """
    if default is not None and not isinstance(default, Mapping):
        raise TypeError(f"default is {default!r}, expected a setting, such as {{'gamma': 0.9}}; {{}} is the agent's own default, and None is nothing")
    settings = [_plain(setting) for setting in _combinations(grid)]
    if not settings or settings == [{}]:
        raise ValueError("the grid has no setting; give values of an argument of make_agent, such as {'gamma': [0.9, 0.99]}")
    known = _Known(_are_same_settings)
    for setting in settings:
        if known.place_of(setting) is not None:
            raise ValueError(f"the grid has {label(setting)} twice; remove one")
        known.add(setting)
    if default is None:
        return settings, None
    found = known.place_of(default)
    if found is not None:
        return settings, found
    # Of settings with equal results the first one is chosen.
    return [_plain(default), *settings], 0


def _combinations(grid: Any) -> list[Mapping[str, Any]]:
    expected = "expected values of each argument, such as {'gamma': [0.9, 0.99]}, or a list of settings, such as [{'gamma': 0.9}]"
    if isinstance(grid, Mapping):
        for name, values in grid.items():
            if isinstance(values, (str, bytes, Mapping)) or not isinstance(values, Iterable) or getattr(values, "ndim", 1) == 0:
                raise TypeError(f"grid[{name!r}] is {values!r}, expected a list of values")
        settings: list[Mapping[str, Any]] = [dict(zip(grid, values)) for values in itertools.product(*grid.values())]
    elif isinstance(grid, (str, bytes)) or not isinstance(grid, Iterable) or callable(grid):
        raise TypeError(f"grid is {_shown(grid)}, {expected}; the order is tune(make_agent, grid, model)")
    else:
        settings = list(grid)
    for place, setting in enumerate(settings):
        if not isinstance(setting, Mapping):
            raise TypeError(f"grid[{place}] is {_shown(setting)}, {expected}")
        for name in setting:
            if not isinstance(name, str):
                raise TypeError(f"grid has {name!r}, expected the name of an argument of make_agent, such as 'gamma'")
    return settings


def _shown(value: Any) -> str:
    return repr(value) if isinstance(value, (str, bytes, int, float)) or value is None else getattr(value, "__name__", type(value).__name__)


def _plain(setting: Mapping[str, Any]) -> Setting:
    """Returns a setting in which numbers of NumPy are Python's own, because JSON and configurations refuse the former."""
    return {name: value.item() if isinstance(value, (np.number, np.bool_, np.str_)) else value for name, value in setting.items()}


class _Known:
    """Values seen before. An equal value is found in constant time, except for objects of other kinds.

    Args:
        is_same: Whether two values are equal.
    """

    def __init__(self, is_same: Callable[[Any, Any], bool]) -> None:
        self.values: list[Any] = []
        """The values, in the order in which they came."""
        self._is_same = is_same
        self._by_key: dict[Hashable, int] = {}
        self._others: list[int] = []

    def place_of(self, value: Any) -> int | None:
        """Returns the place of the first equal value."""
        try:
            key = _key(value)
        except (TypeError, RecursionError):
            places: Iterable[int] = range(len(self.values))
        else:
            if key in self._by_key:
                return self._by_key[key]
            places = self._others
        return next((place for place in places if self._is_same(value, self.values[place])), None)

    def add(self, value: Any) -> None:
        """Add a value that equals no earlier one."""
        try:
            self._by_key[_key(value)] = len(self.values)
        except (TypeError, RecursionError):
            self._others.append(len(self.values))
        self.values.append(value)


def _key(value: Any) -> Hashable:
    """What equal values of these kinds have alike, and no others.

    Raises:
        TypeError: The value is of another kind, or contains such a one. Its own equality may be anything.
        RecursionError: It contains itself.
    """
    kind = type(value)
    if kind in (type(None), bool, int, float, str, bytes, FunctionType, type):
        plain: Hashable = value
        return plain
    if kind in (list, tuple):
        return (kind, *map(_key, value))
    if kind is dict:
        return (kind, frozenset((_key(name), _key(item)) for name, item in value.items()))
    raise TypeError(kind)


def _are_same_settings(one: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    return one.keys() == other.keys() and all(_is_same(value, other[name]) for name, value in one.items())


def _is_same(one: Any, other: Any) -> bool:
    if one is other:
        return True
    try:
        return bool(one == other)
    except Exception:  # arrays and tensors, and what contains them, have no single truth
        try:
            return identity(one, "value") == identity(other, "value")
        except Unstable:
            return False


def counted(number: int, noun: str) -> str:
    """Returns a number with its noun, such as ``1 run`` and ``2,000 runs``."""
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


def label(setting: Mapping[str, Any]) -> str:
    """Returns a setting as one line."""
    return _line({name: short(value) for name, value in setting.items()})


def _line(texts: Mapping[str, str]) -> str:
    return " ".join(f"{name}={text}" for name, text in texts.items()) or "the agent's own default"


def short(value: Any) -> str:
    """Returns a value as it is printed: numbers with four digits, functions by name."""
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, type) or type(value).__name__ == "function":
        return str(value.__name__)
    # An address is of no use to a reader.
    return re.sub(r" at 0x[0-9a-fA-F]+", "", str(value))


class Names:
    """Names of settings and their values. No two have the same name."""

    def __init__(self, settings: Sequence[Setting]) -> None:
        self.texts: list[dict[str, str]] = [{} for _ in settings]
        """The text of each value, for each setting."""
        for name in dict.fromkeys(name for setting in settings for name in setting):
            places = [place for place, setting in enumerate(settings) if name in setting]
            for place, text in zip(places, _distinct([settings[place][name] for place in places])):
                self.texts[place][name] = text
        # Texts have the order of each setting's own arguments.
        self.texts = [{name: texts[name] for name in setting} for setting, texts in zip(settings, self.texts)]
        lines = [_line(texts) for texts in self.texts]
        times = Counter(lines)
        self.labels = [line if times[line] == 1 else f"{line} (setting {place})" for place, line in enumerate(lines)]
        """Each setting in a line."""


def _distinct(values: Sequence[Any]) -> list[str]:
    """Returns values as they are printed: with all digits, with quotes, or with a number if two would otherwise be equal."""
    different = _Known(_is_same)
    numbers = []
    for value in values:
        number = different.place_of(value)
        if number is None:
            number = len(different.values)
            different.add(value)
        numbers.append(number)
    texts = [short(value) for value in different.values]
    times = Counter(texts)
    texts = [text if times[text] == 1 else _exact(value) for value, text in zip(different.values, texts)]
    times = Counter(texts)
    texts = [text if times[text] == 1 else f"{text} #{number}" for number, text in enumerate(texts, 1)]
    return [texts[number] for number in numbers]


def _exact(value: Any) -> str:
    return repr(value) if isinstance(value, (float, str, int)) else short(value)
