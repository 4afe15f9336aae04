from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import calib_rl
from conftest import command_line

EXAMPLES = Path(__file__).parents[1] / "examples"


def run(name: str, *arguments: object) -> str:
    done = subprocess.run(
        [sys.executable, EXAMPLES / name, *map(str, arguments)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_an_example_without_arguments_tells_its_usage() -> None:
    done = subprocess.run([sys.executable, EXAMPLES / "tune_numpy.py"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (1, "usage: python tune_numpy.py LOG FOLDER [STEPS]\n")


def test_ten_lines_end_with_a_verdict(tmp_path: Path) -> None:
    assert "PIT300" in run("first_verdict.py", tmp_path)
    assert (tmp_path / "study-results" / "report.html").is_file()


def test_agents_of_three_libraries_are_judged(study: calib_rl.Study) -> None:
    pytest.importorskip("sklearn")
    told = run("own_agents.py", study.path)
    for name in ("LinearTd", "SklearnTd"):
        assert f"{name}: " in told and "PIT300" in told


def test_examples_of_libraries_that_may_be_missing(study: calib_rl.Study) -> None:
    told = run("more_agents.py", study.path).splitlines()
    assert [line.split(":")[0] for line in told] == ["river_td", "jax_td"]
    for line in told:
        assert "PIT300" in line or ("skipped" in line and "No module" in line), line


def test_ray_tunes_an_example_or_says_that_it_is_missing(study: calib_rl.Study) -> None:
    told = run("tune_with_ray.py", study.path, 2)
    assert "PIT300" in told or "skipped, No module named 'ray'" in told


def shown(cells: list[Any]) -> list[list[tuple[str, str]]]:
    """Returns the outputs of each cell: their kinds, and the words of texts. Numbers may differ between processors."""

    def words(text: str) -> str:
        return " ".join(re.findall(r"[A-Za-z_]{2,}", text))

    def told(output: Any) -> tuple[str, str]:
        if output["output_type"] == "stream":
            return "stream", words(output["text"])
        data = output["data"]
        return " ".join(sorted(data)), words(data.get("text/plain", ""))

    return [[told(output) for output in cell.get("outputs", [])] for cell in cells]


def texts(cells: list[Any]) -> list[str]:
    """Returns the outputs that are HTML."""
    return [output["data"].get("text/html", "") for cell in cells for output in cell.get("outputs", []) if "data" in output]


@pytest.mark.parametrize(
    ("name", "kind", "figures", "words"),
    [("frame_to_verdict.ipynb", "image/svg+xml", 2, ("PIT300", "Report")), ("tune_agent.ipynb", "image/png", 2, ("learning_rate", "mean_rank"))],
)
def test_notebooks_show_what_is_saved_in_them(name: str, kind: str, figures: int, words: tuple[str, ...]) -> None:
    nbclient = pytest.importorskip("nbclient")
    nbformat = pytest.importorskip("nbformat")
    saved = nbformat.read(EXAMPLES / name, as_version=4)
    notebook = nbformat.read(EXAMPLES / name, as_version=4)
    nbclient.NotebookClient(notebook, timeout=300, kernel_name="python3").execute()
    assert shown(notebook.cells) == shown(saved.cells), "save it anew with scripts/notebook.py"
    assert sum(kind in kinds for cell in shown(saved.cells) for kinds, _ in cell) == figures
    assert any(all(word in text for word in words) for text in texts(saved.cells))


def test_the_notebook_has_the_agent_of_the_example() -> None:
    cells = json.loads((EXAMPLES / "tune_agent.ipynb").read_text(encoding="utf-8"))["cells"]
    example = (EXAMPLES / "tune_numpy.py").read_text(encoding="utf-8")
    assert any(text.startswith("class Agent:") and f"\n\n\n{text}\n\n\n" in example for text in map("".join, (cell["source"] for cell in cells)))


def test_optuna_tunes_an_example(study: calib_rl.Study) -> None:
    pytest.importorskip("optuna")
    told = run("tune_with_optuna.py", study.path)
    assert "in the model" in told and "PIT300" in told


def run_page(name: str, folder: Path, take: slice = slice(None)) -> str:
    """Runs the Python blocks of a page of docs, one after the other, in an empty folder."""
    page = (Path(__file__).parents[2] / "docs" / name).read_text(encoding="utf-8")
    blocks = re.findall(r"^```python\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    # A block that serves on standard output waits for questions.
    program = "\n".join(block for block in blocks[take] if "serve(" not in block)
    done = subprocess.run([sys.executable, "-c", program], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_page_about_optuna_runs_as_it_stands(tmp_path: Path) -> None:
    pytest.importorskip("optuna")
    told = run_page("optuna-and-ray.md", tmp_path, slice(1))
    assert "learning_rate" in told and "TIT101" in told


def test_the_page_about_python_runs_as_it_stands(tmp_path: Path) -> None:
    pytest.importorskip("gymnasium")
    told = run_page("guides/python.md", tmp_path)
    assert "did you mean `gamma`?" in told and "calib_rl.Model: 5 members" in told and "(10, 501, 4)" in told


def test_agents_that_act_are_tuned(tmp_path: Path) -> None:
    assert command_line("simulate", tmp_path / "pole", "--task", "cart-pole", "--policy", "random", "--transitions", 600).returncode == 0
    told = run("tune_numpy.py", tmp_path / "pole", tmp_path / "numpy", 300)
    assert "all reasons" in told and "worst_rank" in told and (tmp_path / "numpy" / "units").is_dir()
