"""What long work shows while it runs: on a terminal, and in notebooks."""

import sys
import time
from typing import Protocol, TextIO

_EVERY = 0.2


class Observer(Protocol):
    """Whoever watches a step. An exception that one of these raises ends the step at its next safe point."""

    def told(self, kind: str, text: str) -> None:
        """Hear something.

        Args:
            kind: ``"talk"``, ``"table"``, ``"heading"``, ``"warning"``, ``"error"``, ``"result"`` or ``"json"``.
            text: What was said.
        """

    def progress(self, task: str, done: int, total: int) -> None:
        """See how far a task is, some twenty times a second at most; an empty name says that it has ended."""


class Printed:
    """Prints what it hears to stderr, and how far a task is in one line that is written over.

    Args:
        stream: Where to; ``None`` is ``sys.stderr`` at that time, which notebooks show below the cell.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream = stream
        self._width = 0
        self._last = 0.0

    def _out(self) -> TextIO:
        return self._stream if self._stream is not None else sys.stderr

    def _clear(self) -> None:
        if self._width:
            self._out().write("\r" + " " * self._width + "\r")
            self._width = 0

    def told(self, kind: str, text: str) -> None:
        """See `Observer.told`. Details are left out."""
        if kind == "detail":
            return
        self._clear()
        before = f"{kind}: " if kind in ("warning", "error") else ""
        self._out().write(f"{before}{text}\n")
        self._out().flush()

    def progress(self, task: str, done: int, total: int) -> None:
        """See `Observer.progress`."""
        now = time.monotonic()
        ended = not task or done >= total
        if now - self._last < _EVERY and not ended:
            return
        self._last = now
        out = self._out()
        self._clear()
        if not ended and total and (out.isatty() or "ipykernel" in sys.modules):
            line = f"{task}: {100 * done // total} % of {total:,}"
            out.write(line)
            self._width = len(line)
        out.flush()


class _Silent:
    def told(self, kind: str, text: str) -> None:
        pass

    def progress(self, task: str, done: int, total: int) -> None:
        pass


def observer(progress: "bool | Observer") -> Observer:
    """The observer that ``progress`` stands for: ``True`` prints, ``False`` is silent, anything else is one."""
    if progress is True:
        return Printed()
    if progress is False:
        return _Silent()
    return progress
