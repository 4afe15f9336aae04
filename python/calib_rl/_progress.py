"""Progress of long work, on a terminal and in notebooks."""

import sys
import time
from typing import Any, Protocol, TextIO

_EVERY = 0.2


class Observer(Protocol):
    """Receives the messages and the progress of a step. An exception in one of its methods ends the step at its next safe point.

    Any object with these two methods is an observer. Give it as ``progress=`` to any step.

    Examples:
        >>> class Warnings:
        ...     def __init__(self):
        ...         self.texts = []
        ...     def told(self, kind, text):
        ...         if kind == "warning":
        ...             self.texts.append(text)
        ...     def progress(self, task, done, total):
        ...         pass
        >>> from calib_rl._study import _example_study
        >>> observer = Warnings()
        >>> model = _example_study().build_model(progress=observer)
        >>> all("walks" in text or "rollouts" in text for text in observer.texts)
        True
    """

    def told(self, kind: str, text: str) -> None:
        """Receive a message.

        Args:
            kind: ``"talk"``, ``"table"``, ``"heading"``, ``"warning"``, ``"error"``, ``"result"`` or ``"json"``.
            text: The message.
        """

    def progress(self, task: str, done: int, total: int) -> None:
        """Receive the progress of a task, at most about twenty times per second.

        Args:
            task: Name of the task, such as ``"training"``. An empty name means that it has ended.
            done: Units that are done.
            total: Number of all units.
        """


class Printed:
    """Prints messages to stderr, and progress in one line that is overwritten. In a notebook the line is one
    output that is updated.

    Args:
        stream: The output stream. ``None`` is ``sys.stderr`` at that time, which notebooks show below the cell.

    Examples:
        >>> import io
        >>> import calib_rl
        >>> told = io.StringIO()
        >>> calib_rl.Printed(told).told("warning", "few horizons")
        >>> told.getvalue()
        'warning: few horizons\\n'
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream = stream
        self._width = 0
        self._last = 0.0
        self._shown: Any = None

    def _out(self) -> TextIO:
        return self._stream if self._stream is not None else sys.stderr

    def _clear(self) -> None:
        if self._width:
            self._out().write("\r" + " " * self._width + "\r")
            self._width = 0

    def told(self, kind: str, text: str) -> None:
        """Print a message. Details are left out.

        Args:
            kind: See `Observer.told`.
            text: The message.
        """
        if kind == "detail":
            return
        self._clear()
        before = f"{kind}: " if kind in ("warning", "error") else ""
        self._out().write(f"{before}{text}\n")
        self._out().flush()

    def progress(self, task: str, done: int, total: int) -> None:
        """Print the progress of a task, at most five times per second.

        Args:
            task: See `Observer.progress`.
            done: Units that are done.
            total: Number of all units.
        """
        now = time.monotonic()
        ended = not task or done >= total
        if now - self._last < _EVERY and not ended:
            return
        self._last = now
        line = f"{task}: {100 * done // total} % of {total:,}" if total and not ended else ""
        if self._stream is None and "ipykernel" in sys.modules:
            self._show(line)
            return
        out = self._out()
        self._clear()
        if line and out.isatty():
            out.write(line)
            self._width = len(line)
        out.flush()

    def _show(self, line: str) -> None:
        """Shows a line in a notebook in the place of the previous one, so that the notebook's file has a single output too."""
        if self._shown is None and not line:
            return
        from IPython.display import display

        text = {"text/plain": line}
        if self._shown is None:
            self._shown = display(text, raw=True, display_id=True)
        else:
            self._shown.update(text, raw=True)


class Heard:
    """Keeps warnings for ``warnings.warn``, and passes on everything else. An observer of the user receives warnings too;
    one that prints would show them twice.

    Args:
        progress: Whether to print what is done, or an observer.
    """

    def __init__(self, progress: "bool | Observer") -> None:
        self.warnings: list[str] = []
        self._observer = observer(progress)

    def told(self, kind: str, text: str) -> None:
        """Keep a warning, and pass on other messages.

        Args:
            kind: See `Observer.told`.
            text: The message.
        """
        if kind == "warning":
            self.warnings.append(text)
        if kind != "warning" or not isinstance(self._observer, Printed):
            self._observer.told(kind, text)

    def progress(self, task: str, done: int, total: int) -> None:
        """Pass on the progress of a task.

        Args:
            task: See `Observer.progress`.
            done: Units that are done.
            total: Number of all units.
        """
        self._observer.progress(task, done, total)


class _Silent:
    def told(self, kind: str, text: str) -> None:
        pass

    def progress(self, task: str, done: int, total: int) -> None:
        pass


def observer(progress: "bool | Observer") -> Observer:
    """Returns the observer for ``progress``: ``True`` prints, ``False`` is silent, anything else is an observer itself."""
    if progress is True:
        return Printed()
    if progress is False:
        return _Silent()
    return progress
