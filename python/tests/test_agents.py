from __future__ import annotations

import inspect
import json
import os
import re
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from conftest import STUDY, command_line
from numpy.typing import NDArray

import calib_rl
from calib_rl import agents


class Td:
    """A complete linear TD(0) agent."""

    def __init__(self, task: agents.Task, learning_rate: float, fail_at: int = -1) -> None:
        self.gamma, self.learning_rate, self.fail_at = task.gamma, learning_rate, fail_at
        # An agent with too large a step size should diverge without a warning.
        np.seterr(over="ignore", invalid="ignore")
        self.weights = np.zeros(task.columns + 1)
        self.pieces = 0
        self.updates = 0

    def begin(self) -> None:
        self.pieces += 1

    def _value(self, observation: NDArray[np.float32]) -> float:
        return float(self.weights[:-1] @ observation + self.weights[-1])

    def predict(self, observation: NDArray[np.float32]) -> float:
        return self._value(observation)

    def update(self, observation: NDArray[np.float32], reward: float, next_observation: NDArray[np.float32]) -> None:
        error = reward + self.gamma * self._value(next_observation) - self._value(observation)
        self.weights[:-1] += self.learning_rate * error * observation
        self.weights[-1] += self.learning_rate * error
        self.updates += 1
        if self.updates == self.fail_at:
            raise ArithmeticError("an agent's own mistake")

    def state_dict(self) -> dict[str, Any]:
        return {"weights": self.weights}


@pytest.fixture(scope="session")
def sweep(study: calib_rl.Study, tmp_path_factory: pytest.TempPathFactory) -> agents.Sweep:
    return agents.Sweep(study, tmp_path_factory.mktemp("agents"), progress=False)


@pytest.fixture(scope="session")
def runs(sweep: agents.Sweep) -> agents.AgentRuns:
    return sweep.run(Td, {"learning_rate": [1e-3, 1e-2, 1e-1, 1e3]}, default={"learning_rate": 1e-2}, keep_states=True)


def test_agents_are_run_and_judged(runs: agents.AgentRuns, study: calib_rl.Study) -> None:
    table = runs.frame()
    assert len(table) == 4 * (5 + 2 + 2)
    diverged = table.filter(pl.col("diverged"))
    assert set(diverged["learning_rate"]) == {1e3} and diverged["rmse"].is_infinite().all()
    assert set(table.filter(pl.col("is_default"))["label"]) == {"learning_rate = 0.01"}
    verdict = runs.evaluate()
    assert verdict.chosen["PIT300"] in {"learning_rate = 0.01", "learning_rate = 0.1"}
    assert "PIT300" in str(verdict) and (verdict.path / "figures" / "sensitivity-PIT300.svg").is_file()
    told = command_line("evaluate", study.path, "--runs", runs.path / "runs.parquet")
    assert told.returncode == 0, told.stderr
    assert verdict.advice[0][0] in told.stdout
    without = command_line("evaluate", "--runs", runs.path / "runs.parquet", "--set", "evaluate.rule=worst_rank", "--json")
    assert without.returncode == 0 and '"rule": "worst_rank"' in without.stdout, without.stderr


def test_streams_are_those_of_calibs_agents(runs: agents.AgentRuns, verdict: calib_rl.Verdict) -> None:
    keys = ["environment", "run", "start_row", "seed", "steps", "scored_steps", "mean_return", "return_std", "error_scale"]
    ours = runs.frame().filter(~pl.col("diverged")).select(keys).unique().sort("environment", "run")
    theirs = verdict.runs().select(keys).unique().sort("environment", "run")
    assert ours.equals(theirs)


def test_scores_are_those_of_the_definition(sweep: agents.Sweep, runs: agents.AgentRuns) -> None:
    streams = sweep.streams
    stream = next(of for of in streams.all if of.environment == "member:1")
    states, pieces = stream.states()
    assert pieces == [(0, len(states))]
    column = streams.sensors["PIT300"]
    agent = Td(agents.Task("PIT300", column, states.shape[1], 0.9, 0), 1e-2)
    returns = np.zeros(len(states))
    for t in reversed(range(len(states) - 1)):
        returns[t] = states[t + 1, column] + 0.9 * returns[t + 1]
    errors = []
    for t in range(stream.steps):
        errors.append(agent.predict(states[t]) - returns[t])
        agent.update(states[t], float(states[t + 1, column]), states[t + 1])
    part = {"whole_run": 0.0, "after_first_quarter": 0.25, "final_quarter": 0.75}[streams.part]
    rmse = np.sqrt(np.mean(np.square(errors[round(part * stream.steps) :])))
    score, _ = streams.run(Td, stream, "PIT300", {"learning_rate": 1e-2})
    assert score.rmse == pytest.approx(rmse, rel=1e-4)
    assert score.parts[streams.part]["rmse"] == score.rmse
    assert set(score.parts) == {"whole_run", "after_first_quarter", "final_quarter"}
    counted = returns[round(part * stream.steps) : stream.steps]
    assert score.skill == pytest.approx(1 - rmse / np.std(counted), rel=1e-2)
    row = runs.frame().filter((pl.col("environment") == "member:1") & (pl.col("learning_rate") == 1e-2))
    assert row["rmse"][0] == pytest.approx(rmse, rel=1e-4)


def test_runs_are_kept(sweep: agents.Sweep, runs: agents.AgentRuns, monkeypatch: pytest.MonkeyPatch) -> None:
    before = (runs.path / "runs.parquet").read_bytes()
    monkeypatch.setattr(Td, "predict", lambda self, observation: pytest.fail("run again"))
    again = sweep.run(Td, {"learning_rate": [1e-3, 1e-2, 1e-1, 1e3]}, default={"learning_rate": 1e-2})
    assert (again.path / "runs.parquet").read_bytes() == before
    assert len(again.states()) == 4 * 9
    with pytest.raises(pytest.fail.Exception, match="run again"):
        sweep.run(Td, {"learning_rate": [1e-3]}, version="2")


def test_a_damaged_run_is_made_again(study: calib_rl.Study, tmp_path: Path) -> None:
    sweep = agents.Sweep(study, tmp_path, progress=False)

    def swept() -> bytes:
        return (sweep.run(Td, {"learning_rate": [1e-2]}, keep_states=True).path / "runs.parquet").read_bytes()

    def unchanged() -> bytes:
        with warnings.catch_warnings():
            warnings.simplefilter("error", calib_rl.CalibWarning)
            return swept()

    first = unchanged()
    records, pickles = (sorted((tmp_path / "units").glob(pattern)) for pattern in ("*.json", "*.pickle"))
    assert len(records) == len(pickles) == 9
    record, pickle, text = records[0], pickles[0], records[0].read_text(encoding="utf-8")
    learned = pickle.read_bytes()
    told = json.loads(text)
    assert told["setting"] == {"learning_rate": "0.01"} and told["sensor"] == "PIT300" and told["state"] is not None
    unsealed = text.partition(', "sha256"')[0] + "}"
    updates = text.replace('"updates": ', '"updates": 1')
    another = records[1].read_text(encoding="utf-8")
    for edited in (updates, text.replace('"sha256": "', '"sha256": "0'), unsealed, text[:-40], "", text + "\n", another):
        assert edited != text
        record.write_text(edited, encoding="utf-8")
        with pytest.warns(calib_rl.CalibWarning, match=rf"^folder: {re.escape(str(record))} is damaged or was edited; calib makes its training run again$") as came:
            assert swept() == first
        assert [warning.filename for warning in came] == [__file__]
        assert record.read_text(encoding="utf-8") == text
    # What the agent learned has its checksum in the record.
    for damage in (learned[:-1], b"", learned + b"\0"):
        pickle.write_bytes(damage)
        with pytest.warns(calib_rl.CalibWarning, match=rf"^folder: {re.escape(str(pickle))} is damaged or was edited"):
            assert swept() == first
        assert pickle.read_bytes() == learned
    # A removed file is no damage.
    pickle.unlink()
    records[1].unlink()
    assert unchanged() == first and pickle.read_bytes() == learned
    records[0].write_text("", encoding="utf-8")
    records[1].write_text("", encoding="utf-8")
    with pytest.warns(calib_rl.CalibWarning, match=r"^folder: 2 files are damaged or were edited, such as .*; calib makes their training runs again$"):
        assert swept() == first
    assert unchanged() == first


def test_runs_of_earlier_versions_count_as_not_made(study: calib_rl.Study, tmp_path: Path) -> None:
    earlier = agents.Sweep(study, tmp_path, progress=False)
    first = earlier.run(Td, {"learning_rate": [1e-2]}, keep_states=True)
    units = tmp_path / "units"
    names = {path.name for path in units.iterdir()}
    # Earlier versions stored a run as three files without a checksum.
    for record in units.glob("*.json"):
        key = record.stem
        np.save(units / f"{key}.npy", np.zeros(600, np.float32))
        (units / f"{key}.npy.updates").write_text("600")
        (units / f"{key}.state.pickle").rename(units / f"{key}.npy.state.pickle")
        record.unlink()
    table = (first.path / "runs.parquet").read_bytes()
    again = earlier.run(Td, {"learning_rate": [1e-2]}, keep_states=True)
    assert (again.path / "runs.parquet").read_bytes() == table
    assert {path.name for path in units.iterdir()} == names and len(again.states()) == 9


def test_processes_make_no_difference(study: calib_rl.Study, runs: agents.AgentRuns, tmp_path: Path) -> None:
    other = agents.Sweep(study, tmp_path, progress=False)
    there = other.run(Td, {"learning_rate": [1e-3, 1e-2, 1e-1, 1e3]}, default={"learning_rate": 1e-2}, processes=2)
    assert (there.path / "runs.parquet").read_bytes() == (runs.path / "runs.parquet").read_bytes()
    assert there.states() == []
    assert len(other.run(Td, {"learning_rate": [1e-3]}, keep_states=True).states()) == 9, "made again, with states"


HANGS = """
import sys, time
import calib_rl
from calib_rl import agents
class Hangs:
    def __init__(self, task, rate): pass
    def predict(self, observation): return 0.0
    def state_dict(self): return {}
    def update(self, observation, reward, next_observation):
        sys.stderr.write("learning\\n")
        while True: time.sleep(0.1)
if __name__ == "__main__":
    sweep = agents.Sweep(calib_rl.Study(sys.argv[1]), sys.argv[2], progress=False)
    sweep.run(Hangs, [{"rate": 0.1}], processes=2)
"""


def test_processes_end_after_a_parent_that_was_killed(study: calib_rl.Study, tmp_path: Path) -> None:
    program = tmp_path / "hangs.py"
    program.write_text(HANGS, encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    parent = subprocess.Popen(
        [sys.executable, str(program), str(study.path), str(tmp_path / "agents")], stderr=subprocess.PIPE, text=True, env=environment
    )
    assert parent.stderr is not None
    assert [parent.stderr.readline(), parent.stderr.readline()] == ["learning\n"] * 2
    parent.kill()
    # The processes have the same standard error, which ends with the last of them.
    parent.communicate(timeout=60)


def test_an_agents_mistake_is_told(sweep: agents.Sweep) -> None:
    with pytest.raises(ArithmeticError, match="own mistake"):
        sweep.run(Td, {"learning_rate": [1e-2], "fail_at": [50]})
    with pytest.raises(TypeError, match="is no agent"):
        sweep.run(lambda task: object(), [{}])  # type: ignore[arg-type, return-value]
    with pytest.raises(ValueError, match="no values"):
        sweep.run(Td, [])
    with pytest.raises(calib_rl.CalibError, match="cannot be called `seed`"):
        sweep.run(lambda task, seed: Td(task, 0.1), {"seed": [1, 2]})


def test_a_sensor_is_predicted_as_in_a_study_of_its_own_gamma(study: calib_rl.Study, tmp_path: Path) -> None:
    def swept(name: str, gamma: str) -> tuple[agents.Sweep, agents.AgentRuns]:
        sensors = 'sweep.sensors=["PIT300", "TIT101"]'
        given = calib_rl.Study(study.path, set=[sensors, gamma], output=tmp_path / "results")
        sweep = agents.Sweep(given, tmp_path / name, progress=False)
        return sweep, sweep.run(Td, {"learning_rate": [1e-3, 1e-2]})

    sweep, both = swept("both", "agent.gammas={ TIT101 = 0.5 }")
    keys = ["environment", "run", "candidate"]
    columns = [*keys, "gamma", "seed", "start_row", "scored_steps", "rmse", "nrmse"]
    for sensor, name, gamma in [("PIT300", "near", 0.9), ("TIT101", "far", 0.5)]:
        _, alone = swept(name, f"agent.gamma={gamma}")
        of_both, of_one = (
            table.frame().filter(pl.col("sensor") == sensor).sort(keys).select(columns) for table in (both, alone)
        )
        assert set(of_both["gamma"]) == {gamma} and of_both.equals(of_one)
    verdict, simple = both.evaluate(), json.loads((both.path / "simple.json").read_text())
    assert set(verdict.chosen) == {"PIT300", "TIT101"}
    assert {score["sensor"] for score in simple["scores"]} == {"PIT300", "TIT101"}
    stream = sweep.streams.all[0]
    assert (stream.sensors, stream.gamma) == (["PIT300"], 0.9)
    with pytest.raises(ValueError, match="is a stream of PIT300"):
        sweep.streams.run(Td, stream, "TIT101", {"learning_rate": 1e-2})


EXTERNAL = """
[agent]
kind = "external"
command = [{python!r}, "agent.py"]
gamma = 0.9
states_per_message = {states}

[agent.parameters]
learning_rate = 1e-2

[sweep.grid]
learning_rate = [1e-3, 1e-2, 1e-1, 1e3]
"""

AGENT = """
from calib_rl.agents import serve
{td}

class Talking(Td):
    def begin(self) -> None:
        print("what an agent prints disturbs nobody")
        super().begin()

serve(Talking)
"""


def external(folder: Path, study: calib_rl.Study, states: int) -> Path:
    """Returns the tests' study with the tests' agent as a program."""
    header = "from typing import Any\nimport numpy as np\nfrom numpy.typing import NDArray\nfrom calib_rl import agents\n"
    folder.mkdir(exist_ok=True)
    (folder / "agent.py").write_text(AGENT.format(td=header + inspect.getsource(Td)))
    text = STUDY[: STUDY.index("[agent]")] + STUDY[STUDY.index("[rollout]") : STUDY.index("[sweep.grid]")]
    text = text.replace('"plant"', json.dumps(str(study.path.parent / "plant")))
    text = text[text.index("[data]") :] + EXTERNAL.format(python=sys.executable, states=states)
    (folder / "study.toml").write_text(text)
    return folder / "study.toml"


@pytest.mark.parametrize("states", [1, 100])
def test_a_program_is_swept_as_calibs_own_agents(
    study: calib_rl.Study, runs: agents.AgentRuns, tmp_path: Path, states: int
) -> None:
    path = external(tmp_path, study, states)
    done = command_line("run", path)
    assert done.returncode in (0, 1), done.stderr
    keys = ["environment", "run", "learning_rate"]
    same = ["seed", "start_row", "steps", "updates", "diverged", "rmse", "nrmse", "rmse_whole_run"]
    results = tmp_path / "study-results"
    theirs = pl.read_parquet(results / "sweep" / "runs.parquet").sort(keys)
    assert theirs.select(keys + same).equals(runs.frame().sort(keys).select(keys + same))
    assert (results / "report.html").is_file()
    curves = pl.read_parquet(results / "sweep" / "curves.parquet")
    assert curves.sort("environment", "run", "label", "step").equals(runs.curves().sort("environment", "run", "label", "step"))
    assert "up to date" in command_line("sweep", path).stdout
    with open(tmp_path / "agent.py", "a") as program:
        program.write("\n# another version\n")
    again = command_line("sweep", path, "--dry-run")
    assert re.search(r"; all \d+ training runs are left", again.stdout + again.stderr)


def test_a_program_that_fails_is_told(study: calib_rl.Study, tmp_path: Path) -> None:
    path = external(tmp_path, study, 1024)
    program = tmp_path / "agent.py"
    good = program.read_text()
    command_line("build-model", path)
    for edit, told in [
        (good.replace("serve(Talking)", "raise SystemExit(7)"), "exit status: 7"),
        (good.replace("self.updates += 1\n", "raise ArithmeticError('own mistake')\n"), "ArithmeticError: own mistake"),
        (good.replace("learning_rate: float,", "rate: float,"), "unexpected keyword argument"),
        (good.replace("serve(Talking)", "import os; os.write(1, b'hello\\n'); serve(Talking)"), '"hello": expected one line'),
    ]:
        program.write_text(edit)
        done = command_line("sweep", path)
        assert done.returncode == 2, done.stderr
        assert told in done.stderr and "agent.py" in done.stderr, done.stderr
    program.write_text(good.replace("serve(Talking)", "import time; time.sleep(30)"))
    done = command_line("sweep", path, "--set", "agent.timeout_secs=0.5")
    assert "has not answered" in done.stderr and "agent.py" in done.stderr, done.stderr


def test_curves_and_a_report_of_ones_own_agents(runs: agents.AgentRuns) -> None:
    curves = runs.curves()
    assert {"environment", "sensor", "run", "candidate", "label", "step", "rmse"} == set(curves.columns)
    assert curves["rmse"].is_finite().all() and curves["step"].max() == 600
    page = runs.evaluate().report.read_text(encoding="utf-8")
    assert "learning_rate" in page and "PIT300" in page and "<svg" in page


def test_a_study_without_a_model_is_swept_and_judged(study: calib_rl.Study, tmp_path: Path) -> None:
    alone = calib_rl.Study(study.path, set={"model.kind": "none"}, output=tmp_path / "results")
    assert study.has_model and not alone.has_model
    sweep = agents.Sweep(alone, progress=False)
    assert {stream.environment for stream in sweep.streams.all} == {"online", "log-replay"}
    runs = sweep.run(Td, {"learning_rate": [1e-3, 1e-2]})
    verdict = runs.evaluate()
    assert list(verdict.chosen) == ["PIT300"]
    assert set(verdict.scores()["environment"]) == {"online", "log-replay"}
    # The same holds for calib's own agents, without a model.
    own = alone.run(progress=False)
    assert isinstance(own, calib_rl.Verdict)
    assert set(own.scores()["environment"]) == {"online", "log-replay"} and "report.html" in str(own.report)
    assert not (alone.results / "model").exists() and not (alone.results / "rollout").exists()
    for step in (alone.build_model, alone.rollout, alone.model):
        with pytest.raises(calib_rl.CalibError, match="the study has no model"):
            step()
    with pytest.raises(calib_rl.CalibError, match="evaluate.rule"):
        agents.evaluate(runs.path / "runs.parquet")


def test_tables_of_others_are_judged(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    rows = [
        {"environment": f"member:{member}", "sensor": "A", "run": 0, "candidate": candidate, "rmse": 1 + candidate + rng.random() / 9}
        for member in range(4)
        for candidate in range(3)
    ]
    path = tmp_path / "runs.parquet"
    pl.DataFrame(rows).write_parquet(path)
    verdict = agents.evaluate(path)
    assert verdict.chosen == {"A": "candidate = 0"} and not verdict.negative
    assert verdict.summary == json.loads((tmp_path / "evaluate" / "summary.json").read_text())
    for change, told in [
        (pl.col("rmse") * np.nan, "rmse is NaN"),
        (pl.lit("plant").alias("environment"), 'environment is "plant"'),
        (pl.lit("online").alias("environment"), "another row|no run in a member"),
        (pl.col("candidate") * 2, "has no row"),
    ]:
        pl.DataFrame(rows).with_columns(change).write_parquet(path)
        with pytest.raises(calib_rl.CalibError, match=told):
            agents.evaluate(path)
    pl.DataFrame(rows).drop("sensor").write_parquet(path)
    with pytest.raises(calib_rl.CalibError, match="sensor"):
        agents.evaluate(path)
    assert command_line("evaluate").returncode == 2


def test_optuna_tunes_in_the_model(sweep: agents.Sweep) -> None:
    optuna = pytest.importorskip("optuna")
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    objective = agents.optuna_objective(
        sweep, Td, lambda trial: {"learning_rate": trial.suggest_float("learning_rate", 1e-5, 10, log=True)}
    )
    study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=0), pruner=optuna.pruners.MedianPruner(n_warmup_steps=2))
    study.optimize(objective, n_trials=15)
    assert 1e-3 < study.best_params["learning_rate"] < 1
    states = {trial.state.name for trial in study.trials}
    assert "COMPLETE" in states


def test_simple_predictors_stand_beside_agents(runs: agents.AgentRuns, sweep: agents.Sweep) -> None:
    verdict = runs.evaluate()
    sensor = next(iter(sweep.streams.sensors))
    told = next(of for of in verdict.summary["verdicts"] if of["sensor"] == sensor)
    rows = {row["predictor"]: row["online_rmse"] for row in told["simple"]}
    assert set(rows) == {"mean", "persistence", "line", "autoregression", "ridge", "least_squares_td"}
    # The deployed agent makes the predictions that were scored, over the streams that agents see.
    errors = {}
    for name in rows:
        predictor = agents.SimplePredictor(verdict, sensor, name)
        windows = {}
        for stream in sweep.streams.all:
            if stream.environment != "online":
                continue
            states, pieces = stream.states()
            starts = {start for start, _ in pieces}
            predictions = np.zeros(stream.steps, dtype=np.float32)
            for step in range(stream.steps):
                if step in starts:
                    predictor.begin()
                predictions[step] = predictor.predict(states[step])
            windows[stream.start_row] = sweep.streams._native.score(stream.position, sensor, 0, predictions, 0).nrmse
        errors[name] = np.mean(list(windows.values()))
    for name, error in errors.items():
        assert error / errors["mean"] == pytest.approx(rows[name] / rows["mean"], rel=1e-4), name
    assert agents.Ridge(verdict, sensor).state_dict()["weights"] is not None
    with pytest.raises(ValueError, match="expected one of mean"):
        agents.SimplePredictor(verdict, sensor, "nothing")
    with pytest.raises(ValueError, match="the study predicts no sensor"):
        agents.Ridge(verdict, "nobody")
