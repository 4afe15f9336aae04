from __future__ import annotations

import datetime
import filecmp
import json
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from conftest import STUDY, command_line

import calib_rl


def test_a_study_ends_with_a_verdict(verdict: calib_rl.Verdict) -> None:
    assert verdict.report.is_file()
    assert list(verdict.chosen) == ["PIT300"]
    assert verdict.chosen["PIT300"].startswith("learning_rate = ")
    rate = verdict.settings["PIT300"]["learning_rate"]
    assert rate in (1e-4, 1e-3, 1e-2) and list(verdict.settings["PIT300"]) == ["learning_rate"]
    assert float(verdict.chosen["PIT300"].removeprefix("learning_rate = ")) == rate
    assert list(verdict.recommendations) == ["PIT300"]
    assert "PIT300" in str(verdict) and "PIT300" in verdict._repr_html_()
    runs = verdict.runs()
    assert len(runs) == 3 * (5 + 2 + 2)
    scores = verdict.scores()
    assert set(scores["environment"]) == {*(f"member:{m}" for m in range(5)), "online", "log-replay"}
    assert all(skill is None or skill < 1 for skill in scores["skill"])
    parts = verdict.parts()
    assert list(parts["part"]) == ["whole_run", "after_first_quarter", "final_quarter"]
    assert parts["recommendation"][0] == verdict.recommendations["PIT300"], "errors over whole runs decide"
    assert all(ratio is None or ratio > 0 for ratio in parts["ratio"])
    for advice, predictor in zip(parts["recommendation"], parts["predictor"], strict=True):
        assert (predictor is not None) == (advice == "use_simple_predictor")


def test_parts_name_the_predictor_to_use_beside_the_compared_one(tmp_path: Path) -> None:
    compared = {"predictor": "persistence", "ratio": {"value": 0.8, "interval": {"low": 0.7, "high": 0.9}}}
    whole = {"part": "whole_run", "chosen": 1, "recommendation": "use_simple_predictor", "predictor": "line", "simple": compared}
    last = {"part": "final_quarter", "chosen": 1, "recommendation": "deploy", "simple": compared}
    unknown = {"part": "after_first_quarter", "chosen": 0, "recommendation": "not_checked"}
    summary = {"candidates": ["learning_rate = 0", "learning_rate = 0.1"], "verdicts": [{"sensor": "A", "parts": [whole, last, unknown]}]}
    parts = calib_rl.Verdict(tmp_path, tmp_path, tmp_path / "report.html", summary, negative=False).parts()
    assert list(parts["predictor"]) == ["line", None, None], "what the agent that does not learn starts from"
    assert list(parts["compared"]) == ["persistence", "persistence", None]
    assert list(parts["ratio"]) == [0.8, 0.8, None]
    assert list(parts["low"]) == [0.7, 0.7, None]


def test_a_verdict_holds_what_the_step_returned(study: calib_rl.Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    results = tmp_path / "results"
    shutil.copytree(study.results, results)
    done = command_line("evaluate", study.path, "--output", results, "--json")
    again = calib_rl.Study(study.path, output=results)

    def refuse(path: Path, *_: object, **__: object) -> str:
        raise AssertionError(f"{path} is read again")

    for step in (again.evaluate, again.run):
        with monkeypatch.context() as patched:
            patched.setattr(Path, "read_text", refuse)
            verdict = step(progress=False)
        assert isinstance(verdict, calib_rl.Verdict)
        summary = verdict.path / "summary.json"
        assert verdict.summary == json.loads(done.stdout) == json.loads(summary.read_text())
        assert done.returncode == int(verdict.negative), done.stderr
        summary.unlink()
        assert str(verdict).startswith(verdict.advice[0][0]) and "PIT300" in verdict._repr_html_()
        assert verdict.settings["PIT300"]["learning_rate"] in (1e-4, 1e-3, 1e-2)
        assert len(verdict.scores()) == 3 * (5 + 1 + 1)


def test_the_command_line_gives_the_same_bytes(study: calib_rl.Study, tmp_path: Path) -> None:
    (tmp_path / "study.toml").write_text(STUDY)
    done = command_line("run", "-q", tmp_path / "study.toml")
    assert done.returncode in (0, 1), done.stderr
    ours, theirs = study.results, tmp_path / "study-results"

    def of(folder: Path) -> list[Path]:
        # Other tests run their own agents there.
        there = (path.relative_to(folder) for path in folder.rglob("*") if path.is_file())
        return sorted(path for path in there if path.parts[0] != "agents")

    files = of(ours)
    assert files == of(theirs)
    # Times, locks, and files that name the folder of the log.
    own = {"timings.json", ".lock", "manifest.json", "dataset.json", "report.html"}
    compared = [path for path in files if path.name not in own and path.parts[0] != "dataset"]
    assert {"runs.parquet", "neighbors.npy", "distances.npy", "states.npy", "summary.json"} <= {path.name for path in compared}
    different = [str(path) for path in compared if not filecmp.cmp(ours / path, theirs / path, shallow=False)]
    assert not different


def test_agents_that_act_get_the_verdict_of_the_command_line(tmp_path: Path) -> None:
    ours, theirs = tmp_path / "ours", tmp_path / "theirs"
    for folder in (ours, theirs):
        done = command_line("simulate", folder, "--task", "cart-pole", "--policy", "random", "--transitions", 400)
        assert done.returncode == 0, done.stderr
    quick = ["control.steps=200", "control.model.members=2", "control.grid={ step_size = [0.03, 0.3] }"]
    study = calib_rl.Study(ours / "study.toml", set=quick)
    verdict = study.run(progress=False)
    assert isinstance(verdict, calib_rl.ControlVerdict)
    done = command_line("control", theirs / "study.toml", *(part for text in quick for part in ("--set", text)), "--json")
    assert done.returncode == int(verdict.negative), done.stderr
    assert json.loads(done.stdout) == verdict.summary
    for name in ("verdict.json", "runs.parquet"):
        assert (verdict.path / name).read_bytes() == (theirs / "study-results" / "control" / name).read_bytes(), name
    assert verdict.path == study.results / "control" and verdict.report.is_file()
    assert verdict.log_warnings == verdict.summary.get("log_warnings", [])
    assert verdict.choice["step_size"] in (0.03, 0.3) and len(verdict.runs()) == 2 * 2 * 3
    assert verdict.advice[0] == verdict.summary["decision"]["headline"] and verdict.advice[0] in verdict._repr_html_()
    assert str(verdict).startswith(verdict.advice[0]) and study.control(progress=False).summary == verdict.summary


def test_a_study_without_actions_says_what_acting_agents_need(tmp_path: Path) -> None:
    (tmp_path / "study.toml").write_text(STUDY)
    with pytest.raises(calib_rl.CalibError, match=r"has no \[control\] section; say there which columns are actions"):
        calib_rl.Study(tmp_path / "study.toml").control(progress=False)


def test_the_command_line_goes_on_where_python_stopped(study: calib_rl.Study) -> None:
    done = command_line("sweep", study.path)
    assert done.returncode == 0 and "up to date" in done.stdout, done.stderr


def test_rollouts_are_those_of_the_study(study: calib_rl.Study, model: calib_rl.Model) -> None:
    tables = study.rollout(progress=False)
    assert "trajectories" in tables.tables()
    written = tables.frame("trajectories").sort("member", "rollout", "step")
    count, steps = study.config["rollout"]["rollouts"], study.config["rollout"]["steps"]
    for member in (0, 4):
        rows = model.rollout(count, steps, member=member)
        of_member = written.filter(pl.col("member") == member)
        assert rows.ravel().tolist() == of_member["row"].to_list()


def test_a_dictionary_is_a_study(folder: Path, tmp_path: Path) -> None:
    sections = {
        "data": {"path": folder / "plant", "train": {"start": datetime.datetime(2022, 11, 1), "end": datetime.datetime(2022, 11, 3)}},
        "sweep": {"sensors": ("PIT300",), "steps": np.int64(600), "grid": {"learning_rate": np.array([1e-3, 1e-2])}},
        "agent": {"gamma": np.float64(0.9), "traces": None},
    }
    study = calib_rl.Study(sections, path=tmp_path / "a" / "study.toml")
    assert study.config["sweep"]["steps"] == 600
    assert study.config["agent"]["gamma"] == 0.9
    assert calib_rl.Study(study.path).config == study.config
    assert calib_rl.Study(sections, path=study.path).config == study.config
    with pytest.raises(FileExistsError, match="another study"):
        calib_rl.Study(sections, path=study.path, seed=3)
    overridden = calib_rl.Study(study.path, set={"agent.gamma": 0.5, "sweep.sensors": ["A", 'b"'], "rollout.start": "recent"})
    assert overridden.config["agent"]["gamma"] == 0.5
    assert overridden.config["sweep"]["sensors"] == ["A", 'b"']
    assert calib_rl.Study(study.path, set=["agent.gamma=0.25"]).config["agent"]["gamma"] == 0.25
    # A table replaces that of the study, as on the command line.
    replaced = calib_rl.Study(study.path, set={"sweep.grid": {"batch_size": np.array([8, 16])}})
    typed = calib_rl.Study(study.path, set=["sweep.grid={ batch_size = [8, 16] }"])
    assert replaced.config["sweep"]["grid"] == typed.config["sweep"]["grid"]
    assert list(replaced.config["sweep"]["grid"]) == ["batch_size"]
    with pytest.raises(TypeError, match=r"sweep\.grid\.batch_size is a object"):
        calib_rl.Study(study.path, set={"sweep.grid": {"batch_size": object()}})


def test_mistakes_are_told_as_on_the_command_line(tmp_path: Path) -> None:
    path = tmp_path / "study.toml"
    path.write_text("[agent]\ngama = 0.5\n")
    with pytest.raises(calib_rl.StudyError) as refused:
        calib_rl.Study(path)
    assert isinstance(refused.value, ValueError)
    told = command_line("run", path)
    assert told.returncode == 2
    assert str(refused.value) in told.stderr
    assert f"{path}:2:1" in str(refused.value)
    path.write_text('[data]\npath = "nothing"\n[sweep]\nsensors = ["A"]\n')
    with pytest.raises(calib_rl.CalibError) as absent:
        calib_rl.Study(path).build_model(progress=False)
    assert str(absent.value) in command_line("build-model", path).stderr
    with pytest.raises(TypeError, match="sweep.steps is a object"):
        calib_rl.Study(sweep={"steps": object()}, path=tmp_path / "b.toml")
    with pytest.raises(TypeError, match="path says where"):
        calib_rl.Study(sweep={"steps": 1})
    with pytest.raises(TypeError, match="a study file is complete"):
        calib_rl.Study(path, seed=1)
    with pytest.raises(TypeError):
        calib_rl.Study()


def test_what_is_said_is_heard(study: calib_rl.Study) -> None:
    class Ears:
        def __init__(self) -> None:
            self.heard: list[tuple[str, str]] = []

        def told(self, kind: str, text: str) -> None:
            self.heard.append((kind, text))

        def progress(self, task: str, done: int, total: int) -> None:
            assert done <= total

    ears = Ears()
    study.evaluate(progress=ears)
    assert any(kind == "result" and "PIT300" in text for kind, text in ears.heard)

    class Angry(Ears):
        def told(self, kind: str, text: str) -> None:
            raise LookupError("enough")

    with pytest.raises(LookupError, match="enough"):
        study.evaluate(progress=Angry())


def test_progress_is_printed(study: calib_rl.Study, capsys: pytest.CaptureFixture[str]) -> None:
    study.evaluate()
    assert "PIT300" in capsys.readouterr().err


def test_ctrl_c_ends_a_step_and_the_next_call_goes_on(tmp_path: Path) -> None:
    (tmp_path / "study.toml").write_text(STUDY.replace("steps = 600", "steps = 2500").replace("member_runs = 1", "member_runs = 600"))
    program = """
        import os, signal, sys, threading, time
        import calib_rl
        study = calib_rl.Study(sys.argv[1])
        study.simulate(progress=False)
        study.build_model(progress=False)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGINT)).start()
        begun = time.monotonic()
        try:
            study.sweep(progress=False)
        except KeyboardInterrupt:
            print("interrupted", time.monotonic() - begun < 20)
        study.sweep(progress=False)
        print("went on")
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program), str(tmp_path / "study.toml")], capture_output=True, text=True, check=False
    )
    assert done.stdout.splitlines() == ["interrupted True", "went on"], (done.stdout, done.stderr)
