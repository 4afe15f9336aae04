"""Tables that users give to `build_model`, and what it says of them."""

from __future__ import annotations

import shutil
import sys
import warnings
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import polars
import pytest

import calib_rl
from calib_rl._built_study import _marked
from calib_rl._frames import arrow_stream, table_of

ROWS = 400


def tank(rows: int = ROWS) -> pandas.DataFrame:
    """Returns the log of a tank whose valve raises or lowers its level. The reward asks for a level of 0.6."""
    rng = np.random.default_rng(1)
    level, levels, valves = 0.5, [], []
    for _ in range(rows):
        valve = float(rng.integers(3)) / 2
        levels.append(level)
        valves.append(valve)
        level = float(np.clip(level + 0.1 * (valve - 0.5) + rng.normal(0.0, 0.01), 0.0, 1.0))
    times = pandas.date_range("2024-03-01", periods=rows, freq="1min")
    return pandas.DataFrame({"time": times, "level": levels, "valve": valves, "reward": -np.abs(np.array(levels) - 0.6)})


def built(log: Any, folder: Path, **arguments: Any) -> calib_rl.ActionModel:
    given: dict[str, Any] = {"actions": ["valve"], "reward": "reward", "timeout": 40, **arguments}
    model: calib_rl.ActionModel = calib_rl.build_model(log, folder, **given)
    return model


def heard(log: Any, folder: Path, **arguments: Any) -> tuple[calib_rl.ActionModel, list[str]]:
    """Returns the model, and the warnings of calib."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        model = built(log, folder, **arguments)
    return model, [str(warning.message) for warning in caught if warning.category is calib_rl.CalibWarning]


def test_the_section_of_the_data_can_be_given(tmp_path: Path) -> None:
    log = tank().assign(step=np.arange(ROWS) % 50, flow=np.random.default_rng(0).random(ROWS))
    model = built(log, tmp_path / "some", data={"exclude": ["step"]})
    assert model.columns == ["level", "flow"]
    model = built(log, tmp_path / "one", data={"include": ["level"], "period_secs": 60})
    assert model.columns == ["level"]
    predicting = calib_rl.build_model(log, tmp_path / "none", data={"exclude": ["step", "valve", "reward"]}, model={"members": 3})
    assert predicting.columns == ["level", "flow"]


def test_a_corrected_call_goes_into_the_same_folder(tmp_path: Path) -> None:
    with pytest.raises(calib_rl.CalibError, match="the log has no column Valve"):
        built(tank(), tmp_path, actions=["Valve"])
    model = built(tank(), tmp_path)
    assert len(model.actions) == 3
    assert (built(tank(), tmp_path).neighbors(1) == model.neighbors(1)).all(), "the same call finds its model"
    study = (tmp_path / "study.toml").read_bytes()
    with pytest.raises(FileExistsError, match="has a model of other arguments: .*control.timeout is 40 there and 50 here.*delete this one"):
        built(tank(), tmp_path, timeout=50)
    assert (tmp_path / "study.toml").read_bytes() == study and calib_rl.ActionModel.open(model.path).timeout == 40


def test_a_model_is_found_whatever_the_output_is(tmp_path: Path) -> None:
    model = built(tank(), tmp_path)
    study = (tmp_path / "study.toml").read_bytes()
    with pytest.raises(FileExistsError, match="has a model of other arguments: .*control.timeout is 40 there and 50 here"):
        built(tank(), tmp_path, timeout=50, output=tmp_path / "other")
    assert (tmp_path / "study.toml").read_bytes() == study and calib_rl.ActionModel.open(model.path).timeout == 40


def test_results_of_a_study_of_another_version_are_not_lost(tmp_path: Path) -> None:
    built(tank(), tmp_path)
    later = _marked("[control]\nkey_of_tomorrow = 1\n")
    (tmp_path / "study.toml").write_text(later)
    with pytest.raises(FileExistsError, match="holds results of a study that this version cannot read. Choose another folder, or delete this one"):
        built(tank(), tmp_path)
    assert (tmp_path / "study.toml").read_text() == later
    shutil.rmtree(tmp_path / "study-results")
    assert built(tank(), tmp_path).timeout == 40, "nothing came of it"


def test_a_study_of_somebody_is_not_replaced(tmp_path: Path) -> None:
    study = tmp_path / "study.toml"
    study.write_text("[data]\npath = 'years'\n")
    with pytest.raises(FileExistsError, match="another study, which build_model did not write"):
        built(tank(), tmp_path)
    assert study.read_text() == "[data]\npath = 'years'\n" and list(tmp_path.iterdir()) == [study]
    study.unlink()
    with pytest.raises(calib_rl.CalibError):
        built(tank(), tmp_path, actions=["Valve"])
    # An edited file belongs to the user.
    edited = study.read_text() + "# to be tried on Monday\n"
    study.write_text(edited)
    with pytest.raises(FileExistsError, match="or which was edited"):
        built(tank(), tmp_path)
    assert study.read_text() == edited


@pytest.mark.parametrize("name", [None, "time", "when"])
def test_an_index_of_times_is_the_time(name: str | None) -> None:
    indexed = tank().set_index("time").rename_axis(name)
    for index in (indexed, indexed.set_axis(pandas.PeriodIndex(indexed.index, freq="min"))):
        table = table_of(index)
        assert table is not None and list(table.columns.columns) == [name or "time", "level", "valve", "reward"]
        assert table.columns.iloc[1, 0] == pandas.Timestamp("2024-03-01 00:01") and not table.left_out
    assert list(indexed.columns) == ["level", "valve", "reward"], "the frame of the user stays as it is"


def test_an_index_and_a_column_of_one_name_agree() -> None:
    indexed = tank().set_index("time").rename_axis(None)
    seconds = indexed.assign(time=np.arange(float(ROWS)))
    with pytest.raises(calib_rl.CalibError, match="a column 'time' whose values are not those of its index of times"):
        table_of(seconds)
    for frame, times in ((indexed.assign(time=indexed.index), None), (seconds, "time")):
        table = table_of(frame, times)
        assert table is not None and (table.columns["time"].to_numpy() == frame["time"].to_numpy()).all()
    label = indexed.index.astype(str)
    written = {
        "texts": indexed.assign(time=label).rename_axis("time"),
        "seconds": indexed.assign(time=(indexed.index - pandas.Timestamp(0)) // pandas.Timedelta("1s")),
        "another zone": indexed.tz_localize("UTC").assign(time=pandas.DatetimeIndex(indexed.index).tz_localize("UTC").tz_convert("Asia/Tokyo")),
    }
    for what, frame in written.items():
        table = table_of(frame)
        assert table is not None and table.columns["time"].tolist() == frame["time"].tolist(), what
    for other in (label[::-1], ["none"] * ROWS, [True] * ROWS):
        with pytest.raises(calib_rl.CalibError, match="a column 'time' whose values are not those of its index of times"):
            table_of(indexed.assign(time=other))
    levels = pandas.MultiIndex.from_arrays([indexed.index, range(ROWS)], names=["time", "run"])
    with pytest.raises(calib_rl.CalibError, match="a column 'time' whose values are not those of its index of times"):
        table_of(seconds.set_index(levels))
    labelled = tank().set_index(np.array([f"row {number}" for number in range(ROWS)]))
    table = table_of(labelled)
    assert table is not None and table.columns["time"].tolist() == tank()["time"].tolist(), "labels are no times"


@pytest.mark.parametrize("other", ["level", "0"])
def test_a_column_that_comes_twice_is_named(other: str) -> None:
    twice = tank().assign(level2=0.0).set_axis(["time", "level" if other == "level" else 0, "valve", "reward", other], axis=1)
    with pytest.raises(calib_rl.CalibError, match=f"more than one column '{other}'; give each a name of its own"):
        table_of(twice)


def test_row_numbers_are_no_sensors(tmp_path: Path) -> None:
    log = tank()
    some = log.drop(index=[3, 4, 90])
    numbered = log.assign(**{"Unnamed: 0": np.arange(ROWS)})
    frames: list[tuple[Any, list[str]]] = [
        (some, []),
        (pandas.concat([some, some]), []),
        (numbered, ["Unnamed: 0"]),
        (numbered.drop(index=[3, 4, 90]), ["Unnamed: 0"]),
        (polars.DataFrame({"": np.arange(ROWS), **log.to_dict("list")}), [""]),
        (polars.DataFrame({"__index_level_0__": np.arange(ROWS)[::-1], **log.to_dict("list")}), ["__index_level_0__"]),
    ]
    for frame, left_out in frames:
        table = table_of(frame)
        assert table is not None and list(table.columns.columns) == list(log.columns)
        assert [told.split("'")[1] for told in table.left_out] == left_out
    late = log.assign(**{"Unnamed: 0": 1_700_000_000 + 60 * np.arange(ROWS)})
    for times in (late, late.astype({"Unnamed: 0": "uint32"})):
        taken = table_of(times)
        assert taken is not None and "Unnamed: 0" in taken.columns.columns, "seconds of an instant"
    falling = table_of(log.assign(**{"Unnamed: 0": np.arange(ROWS, dtype=np.uint64)[::-1]}))
    assert falling is not None and "Unnamed: 0" in falling.columns.columns and not falling.left_out
    for frame in (numbered, polars.DataFrame(numbered.to_dict("list"))):
        named = table_of(frame, "Unnamed: 0")
        assert named is not None and "Unnamed: 0" in named.columns.columns and not named.left_out
    wave = table_of(log.assign(**{"Unnamed: 0": np.sin(np.arange(ROWS))}))
    assert wave is not None and "Unnamed: 0" in wave.columns.columns and not wave.left_out
    model, told = heard(numbered, tmp_path)
    assert model.columns == ["level"] and any("'Unnamed: 0' numbers the rows" in text for text in told)


def test_a_column_of_times_needs_no_name(tmp_path: Path) -> None:
    seconds = tank().drop(columns="time").assign(**{"Unnamed: 0": np.arange(ROWS) + 1_700_000_000})
    data = {"timestamp": "Unnamed: 0", "timestamp_unit": "s"}
    model, told = heard(seconds, tmp_path, data=data)
    assert model.columns == ["level"] and model.period == 1.0 and not any("numbers the rows" in text for text in told)


def test_row_numbers_of_a_file_are_no_sensors(tmp_path: Path) -> None:
    tank().to_csv(tmp_path / "tank.csv")
    model, told = heard(tmp_path / "tank.csv", tmp_path / "model")
    assert model.columns == ["level"]
    assert any(text.startswith("column 1 has no name of its own and numbers the rows") for text in told), told


def test_columns_that_count_on_are_told(tmp_path: Path) -> None:
    log = tank().assign(step=np.arange(ROWS) % 50, total=np.arange(ROWS))
    model, told = heard(log, tmp_path)
    assert model.columns == ["level", "step", "total"]
    for name in ("step", "total"):
        assert any(text.startswith(f'{name} counts on evenly') and f'add "{name}" to data.exclude' in text for text in told), told
    assert not any(text.startswith("level counts") for text in told)


def test_columns_count_on_as_the_guide_says(tmp_path: Path) -> None:
    rows = np.arange(ROWS)
    columns = {
        "twenty": rows * 20 // ROWS,
        "more": rows * 21 // ROWS,
        "uneven": rows // 21 * 30 + rows % 21 + rows % 21 // 11,
        "filled": rows + (rows >= ROWS // 2) * (ROWS - 10),
        "sparse": rows + (rows >= ROWS // 2) * (ROWS + 10),
    }
    _, told = heard(tank().assign(**columns), tmp_path)
    assert [text.split()[0] for text in told if "counts on evenly" in text] == ["more", "filled"]


def kinds() -> pandas.DataFrame:
    """Returns columns of many types."""
    log = tank(50)
    return log.assign(
        time=log.time.dt.tz_localize("Europe/Paris"),
        whole=pandas.array(range(50), dtype="Int64"),
        missing=pandas.array([None if row == 3 else row / 2 for row in range(50)], dtype="Float64"),
        running=pandas.array([row % 3 == 0 for row in range(50)], dtype="boolean"),
        objects=pandas.Series([row / 4 for row in range(50)], dtype=object),
        exact=[Decimal(row) / 4 for row in range(50)],
        mode=pandas.Categorical(["on", "off"] * 25),
        note=["text", None] * 25,
        single=log.level.astype("float32"),
    )


def test_a_frame_of_pandas_needs_no_pyarrow(monkeypatch: pytest.MonkeyPatch) -> None:
    log = kinds()
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(ImportError):
        log.__arrow_c_stream__()
    taken = polars.DataFrame(_Capsule(arrow_stream(log)))
    assert taken["time"].dtype == polars.Datetime(taken["time"].dtype.time_unit, "UTC")  # type: ignore[attr-defined]
    assert str(taken["time"][0]) == "2024-02-29 23:00:00+00:00"
    assert taken["whole"].to_list() == list(range(50)) and taken["running"].cast(float)[3] == 1.0
    assert np.isnan(taken["missing"].to_numpy()[3]) and taken["missing"][4] == 2.0
    for name in ("objects", "exact"):
        assert taken[name].to_list() == [row / 4 for row in range(50)]
    assert taken["mode"].to_list()[:2] == ["on", "off"] and taken["note"].to_list()[:2] == ["text", None]
    assert taken["single"].dtype == polars.Float32


class _Capsule:
    """An object that hands over a stream."""

    def __init__(self, stream: Any) -> None:
        self._stream = stream

    def __arrow_c_stream__(self, requested_schema: Any = None) -> Any:
        del requested_schema
        return self._stream


def test_models_without_pyarrow_are_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    frame = tank().assign(time=tank().time.astype("datetime64[ns]"))
    with_it = built(frame, tmp_path / "with")
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    without = built(frame, tmp_path / "without")
    assert (with_it.states == without.states).all() and (with_it.times == without.times).all()
    monkeypatch.setitem(sys.modules, "polars", None)
    with pytest.raises(ImportError, match="pip install pyarrow, or pip install polars"):
        built(frame, tmp_path / "neither")
    assert not (tmp_path / "neither").exists()


def test_what_a_log_costs_is_told_without_progress(tmp_path: Path) -> None:
    log = tank()
    assert heard(log, tmp_path / "good")[1] == []
    lacking = log.copy()
    lacking.loc[5:9, "reward"] = np.nan
    told = heard(lacking, tmp_path / "lacking")[1]
    assert any(text.startswith("5 rows have no reward though an action leads there") for text in told), told
    told = heard(pandas.concat([log, log]).sort_values("time"), tmp_path / "twice")[1]
    assert any(text.startswith(f"{ROWS} rows have the time of another row and are left out, the first at 2024-03-01 00:00:00") for text in told), told
    late = np.cumsum(np.random.default_rng(0).exponential(60.0, ROWS))
    uneven = log.assign(time=pandas.Timestamp("2024-03-01") + pandas.to_timedelta(late, unit="s"))
    model, told = heard(uneven, tmp_path / "uneven")
    lost = ROWS - 1 - len(model.decisions.actions)
    assert any(text.startswith(f"{lost} of {ROWS - 1} steps from row to row are no transitions") for text in told), (lost, told)


def test_an_error_is_told_where_warnings_are_errors(tmp_path: Path) -> None:
    numbered = tank().assign(**{"Unnamed: 0": np.arange(ROWS)})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(calib_rl.CalibError, match="the log has no column Valve"):
            built(numbered, tmp_path, actions=["Valve"])
        with pytest.raises(calib_rl.CalibWarning, match="numbers the rows"):
            built(numbered, tmp_path)


def test_an_observer_hears_warnings_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = tank()
    log.loc[5:9, "reward"] = np.nan
    kinds_heard: list[str] = []

    class Listening:
        def told(self, kind: str, text: str) -> None:
            kinds_heard.append(kind)

        def progress(self, task: str, done: int, total: int) -> None:
            pass

    assert len(heard(log, tmp_path / "one", progress=Listening())[1]) == 1 and "warning" in kinds_heard
    # A printed warning is not printed twice.
    assert len(heard(log, tmp_path / "two", progress=True)[1]) == 1
    assert "no reward though" not in capsys.readouterr().err


def test_rewards_may_be_in_the_row_of_the_action(tmp_path: Path) -> None:
    log = tank()
    ends = np.arange(ROWS) % 40 == 39
    # The reward of a step is its action, with a penalty at the end of an episode.
    steps = log.assign(reward=log.valve - 9.0 * ends, done=ends.astype(float))
    model = built(steps, tmp_path / "same", terminal="done", reward_row="same")
    done = model.decisions
    names = {action.name: action.values[0] for action in model.actions}
    assert sorted(names.values()) == [0.0, 0.5, 1.0]
    set_to = np.array([action.values[0] for action in model.actions])[done.actions]
    assert done.terminals.sum() == ends.sum()
    np.testing.assert_allclose(done.rewards, set_to - 9.0 * done.terminals)
    # Every step has its transition, including the last ones of episodes.
    assert len(done.actions) == ROWS
    shifted = built(steps, tmp_path / "next", terminal="done").decisions
    assert len(shifted.actions) < ROWS
    with pytest.raises(calib_rl.StudyError, match="lag"):
        built(steps, tmp_path / "both", reward_row="same", control={"lag": 1})
    with pytest.raises(TypeError, match="reward_row is for models with actions"):
        calib_rl.build_model(steps, tmp_path / "none", reward_row="same")
