from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import calib_rl

EXAMPLES = Path(__file__).parents[1] / "examples"


def run(name: str, *arguments: object) -> str:
    done = subprocess.run(
        [sys.executable, EXAMPLES / name, *map(str, arguments)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_ten_lines_end_with_a_verdict(tmp_path: Path) -> None:
    assert "PIT300" in run("first_verdict.py", tmp_path)
    assert (tmp_path / "study-results" / "report.html").is_file()


def test_agents_of_three_libraries_are_judged(study: calib_rl.Study) -> None:
    pytest.importorskip("sklearn")
    told = run("own_agents.py", study.path)
    for name in ("LinearTd", "SklearnTd"):
        assert f"{name}: " in told and "PIT300" in told


def test_optuna_tunes_an_example(study: calib_rl.Study) -> None:
    pytest.importorskip("optuna")
    told = run("tune_with_optuna.py", study.path)
    assert "in the model" in told and "PIT300" in told
