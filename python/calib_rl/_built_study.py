"""The study files that `build_model` writes: it may replace its own as long as nothing was made of them."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from . import _calib
from ._errors import StudyError
from ._files import write_whole
from ._study import write_study

# The first line of such a file, followed by a digest of the other lines. A user who edits them owns the file.
_FIRST = "# Written by calib_rl.build_model, which may replace it until a model is built, unless it is edited: "
# Number of digits of the digest.
_DIGITS = 16
# Folders of results that are made before the model.
_BEFORE_THE_MODEL = ("dataset",)
# The most differences that a message lists one by one.
_TOLD = 4


def write_built_study(path: Path, text: str, output: str | None) -> None:
    """Write the study of a model before it is built. It replaces the study of a build that failed.

    Args:
        path: The file.
        text: Its content, without the first line.
        output: The folder of results, if it is not the study's own.

    Raises:
        FileExistsError: The file is not calib's, was edited, or has results that follow from other arguments, or that another version of calib made.
    """
    whole = _marked(text)
    if not os.path.lexists(path):
        write_study(path, whole)
        return
    there = path.read_bytes() if path.is_file() else b""
    # Earlier versions wrote no first line.
    if there in (whole.encode(), text.encode()):
        return
    if path.is_symlink() or not _is_own(there):
        raise FileExistsError(f"{path} holds another study, which build_model did not write, or which was edited; choose another folder, or remove it")
    wanted = _calib.Job(os.fspath(path), text, output=output)
    # An earlier call may have had another output. Such files say nothing of it, so that their own folder does not depend on the text.
    roots = [Path(job.path("root")) for job in (wanted, _calib.Job(os.fspath(path), text))]
    if any(map(_has_results, roots)):
        job = _job(path)
        if job is None:
            raise FileExistsError(f"{path.parent} holds results of a study that this version cannot read. Choose another folder, or delete this one")
        raise FileExistsError(_refusal(path, job, wanted))
    write_whole(path, whole.encode())


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:_DIGITS]


def _marked(text: str) -> str:
    """Returns the text with the first line of such files."""
    return f"{_FIRST}{_digest(text)}\n{text}"


def _is_own(content: bytes) -> bool:
    """Whether `build_model` wrote this, and it has not been edited."""
    try:
        text = content.decode()
    except UnicodeDecodeError:
        return False
    return text == _marked(text.partition("\n")[2])


def _job(path: Path) -> _calib.Job | None:
    """The study in a file, or nothing if this version of calib cannot read it."""
    try:
        return _calib.Job(os.fspath(path))
    except StudyError:
        return None


def _has_results(root: Path) -> bool:
    """Whether a folder has results other than those that are made before the model."""
    manifests = root.glob("*/manifest.json")
    others = root.glob("*/*/manifest.json")
    return any(found.relative_to(root).parts[0] not in _BEFORE_THE_MODEL for both in (manifests, others) for found in both)


def _refusal(path: Path, there: _calib.Job, wanted: _calib.Job) -> str:
    """Returns the message for a folder that holds a model of other arguments."""
    before, now = dict(_keys(json.loads(there.json()))), dict(_keys(json.loads(wanted.json())))
    differ = [
        f"{key} is {_shown(before.get(key))} there and {_shown(now.get(key))} here" for key in dict.fromkeys([*before, *now]) if before.get(key) != now.get(key)
    ]
    told = "; ".join([*differ[:_TOLD], *([f"and {len(differ) - _TOLD} more keys differ"] if len(differ) > _TOLD else [])])
    return f"{path.parent} has a model of other arguments: {told or 'the study is another one'}. Choose another folder, or delete this one"


def _keys(section: dict[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Yields the keys of a section and of its nested sections, such as ``control.model.members``, with their values."""
    for key, value in section.items():
        if isinstance(value, dict) and value:
            yield from _keys(value, f"{before}{key}.")
        else:
            yield f"{before}{key}", value


def _shown(value: Any) -> str:
    return "not given" if value is None else json.dumps(value, ensure_ascii=False)
