"""One small study for all tests: three days of a simulated plant, linear agents; seconds."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import calib_rl

STUDY = """
[simulate]
days = 3
channels = 8
period_secs = 60

[data]
path = "plant"
train_fraction = 0.7

[agent]
value_function = "linear"
gamma = 0.9
batch_size = 16

[rollout]
start = "random"
steps = 200

[sweep]
sensors = ["PIT300"]
steps = 600
online_runs = 2
member_runs = 1
log_replay_runs = 2

[sweep.grid]
learning_rate = [1e-4, 1e-3, 1e-2]
"""


@contextlib.contextmanager
def within(folder: Path) -> Iterator[None]:
    """Changes the working folder. Studies do not depend on it: paths follow their file."""
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


def command_line(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Runs the command of the wheel."""
    command = [sys.executable, "-m", "calib_rl._command", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("study")
    (folder / "study.toml").write_text(STUDY)
    return folder


@pytest.fixture(scope="session")
def verdict(folder: Path) -> calib_rl.Verdict:
    verdict = calib_rl.Study(folder / "study.toml").run(progress=False)
    assert isinstance(verdict, calib_rl.Verdict)
    return verdict


@pytest.fixture(scope="session")
def study(folder: Path, verdict: calib_rl.Verdict) -> calib_rl.Study:
    del verdict
    return calib_rl.Study(folder / "study.toml")


@pytest.fixture(scope="session")
def model(study: calib_rl.Study) -> calib_rl.Model:
    return study.model()
