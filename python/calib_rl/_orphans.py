"""Processes that end after the one that started them."""

from __future__ import annotations

import contextlib
import os
import threading
import time

# Seconds between two looks at the parent.
_EVERY = 1.0


def end_with_parent(parent: int, storing: contextlib.AbstractContextManager[object] | None = None) -> None:
    """Ends this process soon after its parent is gone, which may have been killed.

    An agent may learn for hours, or never stop. Until it does, its process reads no message, and so does not see that no more will come.

    Args:
        parent: The process that started this one.
        storing: A lock that is held while a result is stored. The process ends outside of it.
    """

    def watch() -> None:
        # The system gives another parent to a process that has lost its own.
        while os.getppid() == parent:
            time.sleep(_EVERY)
        with storing or contextlib.nullcontext():
            os._exit(1)

    threading.Thread(target=watch, name="calib-parent", daemon=True).start()
