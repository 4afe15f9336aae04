from __future__ import annotations

import doctest
import importlib
import io
import os
import signal
import subprocess
import sys
import threading
import time
import types
from pathlib import Path

import numpy as np
import pytest

import calib_rl


@pytest.mark.parametrize(
    "name",
    ["", "_acting", "_functions", "_model", "_progress", "_study", "_tune", "_tune_settings", "_tuned", "_verdict", "gym"]
    + [f"agents.{name}" for name in ("_optuna", "_protocol", "_runs", "_simple", "_streams", "_sweep")],
)
def test_examples_of_the_documentation(name: str) -> None:
    module = importlib.import_module(f"calib_rl.{name}".rstrip("."))
    failed, tried = doctest.testmod(module, optionflags=doctest.NORMALIZE_WHITESPACE)
    assert not failed and tried


@pytest.mark.parametrize("index", ["auto", "join", "scan", "kd_tree"])
@pytest.mark.parametrize("exclude_self", [False, True])
def test_neighbour_tables_are_exact(index: calib_rl._functions.Index, exclude_self: bool) -> None:
    points = np.random.default_rng(0).random((700, 3)).astype(np.float32)
    neighbors, distances = calib_rl.knn_join(points, 4, exclude_self=exclude_self, index=index)
    far = np.square(points.astype(float)[:, None] - points.astype(float)).sum(2)
    if exclude_self:
        np.fill_diagonal(far, np.inf)
    expected = np.argsort(far, axis=1, kind="stable")[:, :4]
    assert (neighbors == expected).all()
    assert np.allclose(distances, np.sqrt(np.take_along_axis(far, expected, 1)), atol=1e-6)


def test_neighbours_of_other_points() -> None:
    rng = np.random.default_rng(0)
    points, queries = rng.random((500, 5)), rng.random((30, 5))
    neighbors, _ = calib_rl.knn_join(points, 3, queries=queries)
    far = np.square(points.astype(np.float32).astype(float) - queries.astype(np.float32).astype(float)[:, None]).sum(2)
    assert (neighbors == np.argsort(far, axis=1, kind="stable")[:, :3]).all()
    with pytest.raises(ValueError, match="columns"):
        calib_rl.knn_join(points, 3, queries=queries[:, :4])
    with pytest.raises(ValueError, match="only 499 others"):
        calib_rl.knn_join(points, 500, exclude_self=True)
    with pytest.raises(ValueError, match="not finite"):
        calib_rl.knn_join([[np.nan]], 1)
    with pytest.raises(ValueError, match='index is "tree"'):
        calib_rl.knn_join(points, 3, index="tree")  # type: ignore[arg-type]
    with pytest.raises(ValueError):
        calib_rl.knn_join(np.zeros((0, 3)), 1)


def test_dtw_is_that_of_the_definition() -> None:
    rng = np.random.default_rng(3)
    x, y = rng.random(40), rng.random(55)
    cost = np.full((41, 56), np.inf)
    cost[0, 0] = 0
    for i in range(40):
        for j in range(55):
            local = abs(x[i] - y[j])
            first = i == j == 0
            cost[i + 1, j + 1] = local if first else min(cost[i, j] + 2 * local, cost[i, j + 1] + local, cost[i + 1, j] + local)
    found = calib_rl.dtw(x, y, path=True)
    assert found.distance == pytest.approx(cost[40, 55], rel=1e-12)
    assert found.normalized == pytest.approx(found.distance / 95)
    assert found.path is not None and found.path[0][0] == 0 and found.path[1][-1] == 54
    assert calib_rl.dtw(x[::-1], y[::-1]) == calib_rl.dtw(x[::-1].copy(), y[::-1].tolist())
    assert calib_rl.dtw(np.stack([x, x], 1), np.stack([y, y], 1)).distance == pytest.approx(2 * found.distance)
    for options in [{"step_pattern": "nothing"}, {"local_distance": "far"}, {"window": "wide"}, {"ends": "loose"}]:
        with pytest.raises(ValueError):
            calib_rl.dtw(x, y, **options)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="query"):
        calib_rl.dtw([], y)
    with pytest.raises(ValueError, match="NaN|finite"):
        calib_rl.dtw(x, [np.nan])


def test_plants_are_simulated(tmp_path: Path) -> None:
    told = calib_rl.simulate(tmp_path / "plant", days=0.1, channels=5, period_secs=60, seed=3)
    assert "5 channels" in told and list((tmp_path / "plant").glob("*.parquet"))
    with pytest.raises(TypeError, match="^unknown argument `dais`; did you mean `days`"):
        calib_rl.simulate(tmp_path / "other", dais=3)
    with pytest.raises(ValueError):
        calib_rl.simulate(tmp_path / "other", channels=1)


def test_threads_are_chosen_first() -> None:
    program = "import calib_rl, numpy as np; calib_rl.set_threads(1); print(calib_rl.knn_join(np.arange(9.0)[:, None], 2)[0].sum())"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert int(done.stdout) == int(calib_rl.knn_join(np.arange(9.0)[:, None], 2)[0].sum())
    with pytest.raises(ValueError, match="threads is -2, expected a whole number of at least 1"):
        calib_rl.set_threads(-2)
    with pytest.raises(ValueError, match="from 1 to 1024"):
        calib_rl.set_threads(2000)
    with pytest.raises(ValueError, match="at least 1"):
        calib_rl.set_threads(0)


def test_ctrl_c_ends_a_search() -> None:
    points = np.random.default_rng(0).random((60_000, 60)).astype(np.float32)
    # A shell that started the tests in the background may have made Python ignore the signal.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    timer = threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    begun = time.monotonic()
    try:
        with pytest.raises(KeyboardInterrupt):
            calib_rl.knn_join(points, 10)
            while time.monotonic() - begun < 5:
                time.sleep(0.05)
    finally:
        timer.cancel()
        signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize("path", [False, True])
def test_ctrl_c_ends_a_warping(path: bool) -> None:
    # This would take minutes if it were not interrupted.
    series = np.random.default_rng(0).random(2_000_000)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    timer = threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    begun = time.monotonic()
    try:
        with pytest.raises(KeyboardInterrupt):
            calib_rl.dtw(series, series[::-1], path=path)
    finally:
        timer.cancel()
        signal.signal(signal.SIGINT, before)
    assert time.monotonic() - begun < 30


def test_searches_take_any_layout_and_refuse_what_is_none() -> None:
    points = np.random.default_rng(0).random((300, 4)).astype(np.float32)
    expected = calib_rl.knn_join(points, 3)[0]
    for same in (np.asfortranarray(points), np.repeat(points, 2, axis=1)[:, ::2], points.astype(">f4"), points[::-1][::-1]):
        assert (calib_rl.knn_join(same, 3)[0] == expected).all()
    for bad in (points.astype(str), points.astype(complex), points.astype(object)):
        with pytest.raises(TypeError, match="dtype"):
            calib_rl.knn_join(bad, 3)
    with pytest.raises(MemoryError):
        calib_rl.knn_join(np.broadcast_to(np.float32(0), (1 << 40, 16)), 3)
    with pytest.raises(MemoryError):
        calib_rl.dtw(np.broadcast_to(0.0, (1 << 45,)), [1.0])


def test_other_threads_run_meanwhile() -> None:
    points = np.random.default_rng(0).random((20_000, 30)).astype(np.float32)
    done = threading.Event()

    def search() -> None:
        calib_rl.knn_join(points, 5)
        done.set()

    thread = threading.Thread(target=search)
    thread.start()
    ticks = 0
    while not done.is_set():
        ticks += 1
        time.sleep(0.001)
    thread.join()
    assert ticks > 3


def test_a_notebook_shows_progress_as_one_output(monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[list[str]] = []

    class Handle:
        def update(self, text: dict[str, str], raw: bool) -> None:
            shown[-1].append(text["text/plain"])

    def display(text: dict[str, str], raw: bool, display_id: bool) -> Handle:
        shown.append([text["text/plain"]])
        return Handle()

    notebook = types.ModuleType("IPython.display")
    monkeypatch.setattr(notebook, "display", display, raising=False)
    monkeypatch.setitem(sys.modules, "ipykernel", types.ModuleType("ipykernel"))
    monkeypatch.setitem(sys.modules, "IPython", types.ModuleType("IPython"))
    monkeypatch.setitem(sys.modules, "IPython.display", notebook)
    monkeypatch.setattr("calib_rl._progress._EVERY", 0.0)
    said = io.StringIO()
    monkeypatch.setattr(sys, "stderr", said)
    printed = calib_rl.Printed()
    for task in ("rolling out", "training"):
        for done in (0, 5, 10):
            printed.progress(task, done, 10)
    printed.told("warning", "few horizons")
    assert said.getvalue() == "warning: few horizons\n", "nothing of the line is in the stream"
    lines = ["rolling out: 0 % of 10", "rolling out: 50 % of 10", "", "training: 0 % of 10", "training: 50 % of 10", ""]
    assert shown == [lines], "one output"
