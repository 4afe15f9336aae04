from __future__ import annotations

import multiprocessing
import pickle
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import polars as pl
import pytest

import calib_rl

ABSENT = np.uint32(0xFFFFFFFF)


def random_model(rows: int = 400, columns: int = 3, **options: Any) -> calib_rl.Model:
    states = np.random.default_rng(1).random((rows, columns))
    model: calib_rl.Model = calib_rl.build_model(states, **options)
    return model


def test_arrays_are_what_the_files_hold(model: calib_rl.Model) -> None:
    assert model.path is not None
    for member in range(model.members):
        folder = model.path / "members" / str(member)
        assert (model.neighbors(member) == np.load(folder / "neighbors.npy")).all()
        assert (model.distances(member) == np.load(folder / "distances.npy")).all()
    assert (model.states == np.load(model.path / "states.npy")).all()
    assert model.states.shape[1] == len(model.columns)
    assert model.times is not None and model.times.dtype == np.dtype("datetime64[us]")
    assert (np.diff(model.times).astype(float) > 0).all()
    assert sum(model.segments) == len(model.states) == len(model.times)
    assert model.period == 60.0


def test_views_are_read_only_and_keep_the_model(model: calib_rl.Model) -> None:
    for view in (model.states, model.neighbors(0), model.distances(0), model.sources):
        assert not view.flags.writeable
        with pytest.raises(ValueError, match="read-only|readonly"):
            view[0] = 0
    assert model.path is not None
    states = calib_rl.Model.open(model.path).states
    assert np.isfinite(states).all()


def test_neighbours_are_the_nearest() -> None:
    model = random_model(120, members=3, neighbors=2, remove_traps=False)
    for member in range(3):
        own = model.transitions(member)
        sources = model.sources.astype(int)
        for transition in own[::7]:
            query = model.states[sources[transition] + 1]
            far = np.square(model.states[sources[own]].astype(float) - query).sum(1)
            expected = own[np.argsort(far, kind="stable")[:2]]
            assert (model.neighbors(member)[transition] == expected).all()
        lacking = np.setdiff1d(np.arange(len(sources)), own)
        assert (model.neighbors(member)[lacking] == ABSENT).all()


def test_rollouts_follow_the_tables(model: calib_rl.Model) -> None:
    rows = model.rollout(3, 500, member=2, seed=5)
    assert rows.shape == (3, 501) and rows.dtype == np.uint32
    sources, neighbors = model.sources, model.neighbors(2)
    leads_to = {int(source) + 1: transition for transition, source in enumerate(sources)}
    for walk in rows:
        for before, after in zip(walk[:-1].tolist(), walk[1:].tolist()):
            assert after - 1 in sources[neighbors[leads_to[before]]]
    assert (model.rollout(2, 500, member=2, seed=5) == rows[:2]).all()
    assert (model.rollout(3, 500, member=2, seed=6) != rows).any()
    started = model.rollout(3, 5, start=np.array([2000, 2500]))
    assert started[:, 0].tolist() == [2000, 2500, 2000]
    assert model.rollout(1, 5, start=[100])[0, 0] != 100, "a row of the block that member 0 lacks"
    with pytest.raises(IndexError, match="row 99999"):
        model.rollout(1, 5, start=[99999])


def test_physical_values_come_back(model: calib_rl.Model, folder: Path) -> None:
    values = model.physical(model.states[:50])
    assert np.allclose(model.normalised(values), model.states[:50], atol=1e-6)
    log = pl.read_parquet(sorted((folder / "plant").glob("*.parquet"))[0])
    assert model.times is not None
    column = model.columns.index("PIT300")
    recorded = dict(zip(log["timestamp"].cast(pl.Int64), log["PIT300"]))
    for time, value in zip(model.times[:50].astype(np.int64).tolist(), values[:, column]):
        if recorded[time] is not None:
            assert value == pytest.approx(recorded[time], rel=1e-4, abs=1e-4)


def test_nearest_states_of_elsewhere(model: calib_rl.Model) -> None:
    queries = model.states[[50, 1000]]
    rows, distances = model.nearest(queries, 4, member=1)
    assert rows.shape == distances.shape == (2, 4)
    far = np.linalg.norm(model.states[rows].astype(float) - queries[:, None], axis=2)
    assert np.allclose(far, distances, atol=1e-6) and (np.diff(distances) >= 0).all()
    in_units, _ = model.nearest(model.physical(queries), 4, member=1, units="physical")
    assert (in_units == rows).mean() > 0.7
    with pytest.raises(calib_rl.CalibError, match="columns"):
        model.nearest(queries[:, :2])
    with pytest.raises(IndexError, match="member 5: the model has 5"):
        model.nearest(queries, member=5)


def test_frames_of_other_libraries(folder: Path, tmp_path: Path) -> None:
    logs = pl.read_parquet(sorted((folder / "plant").glob("*.parquet")))
    sections: dict[str, Any] = {"preprocess": {"subsample": 3}, "model": {"members": 3}}
    pandas = logs.to_pandas()
    models = [
        calib_rl.build_model(data, tmp_path / name, **sections)
        for name, data in [
            ("polars", logs),
            ("arrow", logs.to_arrow()),
            ("pandas", pandas),
            ("path", folder / "plant"),
        ]
    ]
    for other in models[1:]:
        assert other.columns == models[0].columns
        assert (other.times == models[0].times).all()
        assert (other.states == models[0].states).all()
        assert (other.neighbors(2) == models[0].neighbors(2)).all()
    from conftest import command_line

    again = command_line("build-model", tmp_path / "polars" / "study.toml")
    assert again.returncode == 0 and "up to date" in again.stdout + again.stderr, again.stderr
    with pytest.raises(TypeError, match="folder says"):
        calib_rl.build_model(logs)
    with pytest.raises(calib_rl.CalibError, match="no rows"):
        calib_rl.build_model(logs.head(0), tmp_path / "empty")
    with pytest.raises(TypeError, match="segments are for arrays"):
        calib_rl.build_model(logs, tmp_path / "polars", segments=[3])


@pytest.mark.parametrize(
    "of",
    [
        lambda x: x.astype(np.float64),
        lambda x: np.asfortranarray(x),
        lambda x: np.repeat(x, 2, axis=0)[::2],
        lambda x: x[::-1][::-1],
        lambda x: x.astype(">f4"),
        lambda x: x.tolist(),
    ],
)
def test_layouts_and_types_make_no_difference(of: object) -> None:
    states = np.random.default_rng(2).random((200, 3)).astype(np.float32)
    expected = calib_rl.build_model(states)
    got = calib_rl.build_model(of(states))  # type: ignore[operator]
    assert (got.states == expected.states).all() and (got.neighbors(0) == expected.neighbors(0)).all()


def test_the_callers_array_stays_the_callers() -> None:
    states = np.random.default_rng(2).random((200, 3)).astype(np.float32)
    model = calib_rl.build_model(states)
    before = model.states.copy()
    states[:] = -1
    assert (model.states == before).all() and states.flags.writeable


def test_bad_arrays_are_refused() -> None:
    good = np.random.default_rng(2).random((50, 2))
    for bad, kind, told in [
        (good.astype(str), TypeError, "dtype <U"),
        (good.astype(complex), TypeError, "dtype complex128"),
        (good.astype(object), TypeError, "dtype object"),
        (np.array(["2020-01-01"], "M8[s]"), TypeError, "datetime64"),
        (good[0], ValueError, "1 dimensions, expected 2"),
        (good[None], ValueError, "3 dimensions"),
        (np.where(good > 0.9, np.nan, good), calib_rl.CalibError, "is not finite"),
        (good * 1e300, calib_rl.CalibError, "is not finite"),
        (good[:3], calib_rl.CalibError, "transitions"),
        (good[:0], calib_rl.CalibError, "segment 0 has no rows"),
    ]:
        with pytest.raises(kind, match=told):
            calib_rl.build_model(bad)
    with pytest.raises(calib_rl.CalibError, match="segment 1 has no rows"):
        calib_rl.build_model(good, segments=[50, 0])
    with pytest.raises(calib_rl.CalibError, match="rows"):
        calib_rl.build_model(good, segments=[20])
    with pytest.raises(TypeError, match=r"^unknown argument `neighbours`; did you mean `neighbors`\? \(known arguments: members, "):
        calib_rl.build_model(good, neighbours=3)
    with pytest.raises(ValueError, match="^members: expected a whole number from 0 up, got the text \"x\"$"):
        calib_rl.build_model(good, members="x")


def test_out_of_memory_is_an_exception() -> None:
    huge = np.broadcast_to(np.float32(0), (1 << 40, 16))
    with pytest.raises(MemoryError):
        calib_rl.build_model(huge)
    with pytest.raises(MemoryError):
        random_model().rollout(1 << 30, 1 << 20)


def test_models_are_pickled_by_their_path(model: calib_rl.Model) -> None:
    again = pickle.loads(pickle.dumps(model))
    assert again.path == model.path and len(pickle.dumps(model)) < 500
    assert (again.neighbors(1) == model.neighbors(1)).all()
    built = random_model()
    again = pickle.loads(pickle.dumps(built))
    assert (again.states == built.states).all() and again.segments == built.segments
    assert all((again.neighbors(of) == built.neighbors(of)).all() for of in range(built.members))


def test_numbers_are_refused_in_plain_words(model: calib_rl.Model) -> None:
    states = model.states[:2]
    half: Any = 0.5
    unknown: Any = "bar"
    cases: list[tuple[Callable[[], object], type[Exception], str]] = [
        (lambda: model.nearest(states, units=unknown), ValueError, "units are 'bar', expected 'normalised' or 'physical'"),
        (lambda: model.nearest(states, -1), ValueError, "k is -1, expected a whole number of at least 1"),
        (lambda: model.nearest(states, 0), ValueError, "k is 0, expected"),
        (lambda: model.nearest(states, half), TypeError, "k is 0.5, expected a whole number, such as 1"),
        (lambda: model.nearest(states, 10**9), ValueError, "k is 1000000000: member 0 has .* lower k"),
        (lambda: model.nearest(states, 2**62), ValueError, "transitions to find; lower k"),
        (lambda: model.nearest(states, 2**80), ValueError, "at most 9223372036854775807"),
        (lambda: model.neighbors(-1), IndexError, "member is -1; positions count from 0 on"),
        (lambda: model.transitions(half), TypeError, "member is 0.5"),
        (lambda: model.rollout(-1, 5), ValueError, "n is -1"),
        (lambda: model.rollout(1, half), TypeError, "steps is 0.5"),
        (lambda: model.rollout(1, 5, start=[-3]), IndexError, "start is -3"),
        (lambda: model.rollout(1, 5, start=[half]), TypeError, "start is .*0.5"),
        (lambda: model.rollout(1, 5, seed=-1), ValueError, "seed is -1"),
        (lambda: calib_rl.knn_join(states, -2), ValueError, "k is -2"),
        (lambda: calib_rl.knn_join(states, half), TypeError, "k is 0.5"),
        (lambda: calib_rl.build_model(states, segments=[half]), TypeError, "segments is 0.5"),
        (lambda: calib_rl.build_model(states, segments=[-1, 3]), ValueError, "segments is -1"),
    ]
    for call, kind, told in cases:
        with pytest.raises(kind, match=told):
            call()


def test_a_search_without_room_is_an_exception() -> None:
    points = np.random.default_rng(3).random((300_000, 2), np.float32)
    with pytest.raises(MemoryError, match="nearest neighbours may take .* lower k"):
        calib_rl.knn_join(points, 299_999)
    with pytest.raises(MemoryError, match="building the model"):
        calib_rl.build_model(points, neighbors=100_000)


def test_ctrl_c_ends_a_search_for_states() -> None:
    program = """
import numpy as np, calib_rl
states = np.random.default_rng(0).random((60_000, 40), np.float32)
model = calib_rl.build_model(states, members=2)
print("ready", flush=True)
model.nearest(np.random.default_rng(1).random((400_000, 40), np.float32), 50)
"""
    process = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None and process.stdout.readline() == "ready\n"
    time.sleep(1)
    process.send_signal(signal.SIGINT)
    _, told = process.communicate(timeout=30)
    assert told.strip().endswith("KeyboardInterrupt"), told


def test_a_model_that_is_cut_short_while_it_is_open_is_an_exception(model: calib_rl.Model, tmp_path: Path) -> None:
    import shutil

    assert model.path is not None
    shutil.copytree(model.path, tmp_path / "model")
    program = """
import sys, os, numpy as np, calib_rl, calib_rl.gym
model, other = calib_rl.Model.open(sys.argv[1]), calib_rl.Model.open(sys.argv[2])
states, walks = model.states, calib_rl.gym.make_vec(model, 2)
walks.reset(seed=1)
path = os.path.join(sys.argv[1], "states.npy")
os.truncate(path, os.path.getsize(path) // 2)
print(float(states.sum()) > 0)
for call in (lambda: model.states, lambda: model.rollout(1, 5), lambda: walks.step(np.zeros(2)), lambda: model.nearest(states[:1])):
    try:
        call()
    except calib_rl.CalibError as error:
        print("cut short" in str(error))
print(calib_rl.Model.open(sys.argv[2]).rollout(1, 5).shape)
"""
    command = [sys.executable, "-c", program, str(tmp_path / "model"), str(model.path)]
    ran = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout.split("\n") == ["True", "True", "True", "True", "True", "(1, 6)", ""]


def frame() -> pandas.DataFrame:
    times = pandas.date_range("2024-03-01", periods=400, freq="1min")
    return pandas.DataFrame({"time": times, "P": np.sin(np.arange(400) / 9), "T": np.cos(np.arange(400) / 7)})


def test_a_frame_goes_into_a_folder_of_whatever_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    model = calib_rl.build_model(frame(), "results", model={"members": 3}, progress=False)
    assert (tmp_path / "results" / "log.parquet").exists() and model.members == 3
    # calib may replace a file that it wrote.
    again = calib_rl.build_model(frame().iloc[:300], Path("results"), model={"members": 3})
    assert len(again.states) < len(model.states)
    # The folder can be moved with its contents.
    (tmp_path / "results").rename(tmp_path / "moved")
    assert calib_rl.Study(tmp_path / "moved" / "study.toml").build_model(progress=False).members == 3


def test_a_log_of_somebody_is_not_replaced(tmp_path: Path) -> None:
    log = tmp_path / "log.parquet"
    log.write_bytes(b"years of work")
    with pytest.raises(calib_rl.CalibError, match="log.parquet is in the way: calib did not write it"):
        calib_rl.build_model(frame(), tmp_path)
    assert log.read_bytes() == b"years of work"
    log.unlink()
    (tmp_path / "theirs").write_bytes(b"years of work")
    log.symlink_to("theirs")
    with pytest.raises(calib_rl.CalibError, match="in the way"):
        calib_rl.build_model(frame(), tmp_path)
    assert (tmp_path / "theirs").read_bytes() == b"years of work" and log.is_symlink()


def test_other_results_are_no_model(study: calib_rl.Study, tmp_path: Path) -> None:
    with pytest.raises(calib_rl.CalibError, match="has other results than those of `calib build-model STUDY`"):
        calib_rl.Model.open(study.results / "sweep")
    (tmp_path / "verdict.json").write_text("{}")
    with pytest.raises(calib_rl.CalibError, match="has the verdict of `calib control`, which keeps no model"):
        calib_rl.Model.open(tmp_path)


def test_what_is_not_valid_writes_nothing(tmp_path: Path) -> None:
    with pytest.raises(calib_rl.StudyError, match="members"):
        calib_rl.build_model(frame(), tmp_path / "new", model={"memebers": 3})
    assert not (tmp_path / "new").exists()
    recursive: dict[str, object] = {}
    recursive["model"] = recursive
    deep: object = 1
    for _ in range(100_000):
        deep = [deep]
    for wrong in (recursive, {"data": deep}, {"data": {"path": deep}}):
        with pytest.raises(ValueError, match="nested more than 32 deep, or holds itself"):
            calib_rl.Study(wrong, path=tmp_path / "new" / "study.toml")
    assert not (tmp_path / "new").exists()


def _rows(model: calib_rl.Model) -> list[int]:
    return [int(row) for row in model.rollout(1, 50, seed=3)[0]]


@pytest.mark.parametrize("method", ["spawn", "forkserver"])
def test_models_go_to_other_processes(model: calib_rl.Model, method: str) -> None:
    with multiprocessing.get_context(method).Pool(2) as pool:
        assert pool.map(_rows, [model, model]) == [_rows(model)] * 2


def _in_a_fork(model: calib_rl.Model, queue: "multiprocessing.Queue[object]") -> None:
    queue.put(_rows(model))
    queue.put(calib_rl.knn_join(np.arange(3000.0)[:, None], 2)[0].sum())
    try:
        calib_rl.Model.open(model.path)  # type: ignore[arg-type]
    except RuntimeError as error:
        queue.put(str(error))


@pytest.mark.filterwarnings("ignore:.*multi-threaded.*:DeprecationWarning")
def test_a_fork_has_threads_of_its_own(model: calib_rl.Model) -> None:
    expected = _rows(model)
    joined = calib_rl.knn_join(np.arange(3000.0)[:, None], 2)[0].sum()
    context = multiprocessing.get_context("fork")
    queue = context.Queue()
    process = context.Process(target=_in_a_fork, args=(model, queue))
    process.start()
    got = [queue.get(timeout=60) for _ in range(3)]
    process.join(60)
    assert got[:2] == [expected, joined]
    assert "forked" in str(got[2]) and "spawn" in str(got[2])


def test_threads_share_a_model(model: calib_rl.Model) -> None:
    expected = _rows(model)
    results: list[list[int]] = []
    threads = [threading.Thread(target=lambda: results.append(_rows(model))) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert results == [expected] * 8


def test_a_damaged_model_is_refused(model: calib_rl.Model, tmp_path: Path) -> None:
    import shutil

    assert model.path is not None
    copy = tmp_path / "model"
    shutil.copytree(model.path, copy)
    assert calib_rl.Model.open(copy).members == model.members
    with open(copy / "members" / "0" / "distances.npy", "r+b") as file:
        file.seek(500)
        file.write(b"\x01\x02")
    with pytest.raises(calib_rl.CalibError, match="not what was written"):
        calib_rl.Model.open(copy)
    with pytest.raises(calib_rl.CalibError, match="does not exist"):
        calib_rl.Model.open(tmp_path)
