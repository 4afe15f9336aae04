"""Files that are written as a whole, and the folders for them."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import tempfile
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ._errors import CalibError, CalibWarning

# What the digest of a sealed file follows, and what follows the digest.
_OPENS, _CLOSES = b', "sha256": "', b'"}'
# Length of all of this, with a digest of 64 hexadecimal digits.
_SEAL = len(_OPENS) + 64 + len(_CLOSES)


def made_folder(folder: Path, content: str) -> Path:
    """Returns the folder of an argument ``folder``, which is made if it is missing.

    Args:
        folder: The folder.
        content: What lies in it, in the plural.

    Raises:
        CalibError: It is a file, or cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise CalibError(f"folder: {folder} is a file, and {content} are kept in a folder; name another one") from None
    except OSError as error:
        raise CalibError(f"folder: {folder} cannot be made ({error.strerror}); name one that can be written to") from error
    return folder


def why_unwritable(folder: Path) -> str | None:
    """Returns why no file can be made in a folder, or ``None`` if one can be made. A folder that is missing would be made."""
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    try:
        with tempfile.TemporaryFile(dir=folder):
            return None
    except OSError as error:
        return error.strerror or str(error)


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


def write_sealed_json(path: Path, entries: Mapping[str, Any]) -> None:
    """Writes a JSON object whose last entry ``sha256`` is the digest of the bytes before it.

    Raises:
        OSError: The file cannot be written.
    """
    body = json.dumps(entries).encode()[:-1]
    write_whole(path, body + _seal(body))


def read_sealed_json(path: Path) -> dict[str, Any]:
    """Returns the entries that `write_sealed_json` wrote.

    Raises:
        OSError: The file cannot be read.
        ValueError: A byte of it has changed, or it was not sealed.
    """
    content = path.read_bytes()
    body, seal = content[:-_SEAL], content[-_SEAL:]
    if seal != _seal(body):
        raise ValueError(f"{path} is damaged or was edited: it does not end with the checksum of its content")
    entries: dict[str, Any] = json.loads(body + b"}")
    return entries


def digest(content: bytes) -> str:
    """Returns the checksum of a file's content."""
    return hashlib.sha256(content).hexdigest()


def warn_of_damage(files: Sequence[Path], stacklevel: int) -> None:
    """Warns of stored training runs that are made again because their files are not as calib wrote them.

    Args:
        files: The files. Without one there is no warning.
        stacklevel: That of ``warnings.warn``, as seen by the caller of this function.
    """
    if len(files) == 1:
        told = f"{files[0]} is damaged or was edited; calib makes its training run again"
    elif files:
        told = f"{len(files):,} files are damaged or were edited, such as {files[0]}; calib makes their training runs again"
    else:
        return
    warnings.warn(f"folder: {told}", CalibWarning, stacklevel=stacklevel + 1)


def _seal(body: bytes) -> bytes:
    return _OPENS + digest(body).encode() + _CLOSES
