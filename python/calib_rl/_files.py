"""Files that are written as a whole."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path


def write_whole(path: Path, content: bytes) -> None:
    """Writes the whole file, or leaves the previous one unchanged.

    Raises:
        OSError: The file cannot be written.
    """
    unfinished = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        unfinished.write_bytes(content)
        os.replace(unfinished, path)
    except BaseException:  # Ctrl-C may leave nothing either
        with contextlib.suppress(OSError):
            unfinished.unlink()
        raise
