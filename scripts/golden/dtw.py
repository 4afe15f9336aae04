"""Writes the reference values of crates/calib-dtw/tests/golden/.

    python3 -m venv .venv-golden && .venv-golden/bin/pip install dtw-python==1.9.0 numpy
    .venv-golden/bin/python scripts/golden/dtw.py

distances.json: the series and the questions are kept, the answers are computed again.
paths.json:     made here from a fixed seed, with the warping paths.

dtw-python is run as a program; nothing of it is copied.
"""

import itertools
import json
import pathlib
import re
import sys

import layout

sys.path.pop(0)  # this file has the name of the package
import dtw  # noqa: E402
import numpy as np  # noqa: E402

FOLDER = pathlib.Path(__file__).parents[2] / "crates/calib-dtw/tests/golden"
ENDS = {"closed": (False, False), "openEnd": (False, True), "openBegin": (True, False), "openBoth": (True, True)}
WINDOWS = {"sakoeChiba": "sakoechiba", "slanted": "slantedband", "itakura": "itakura"}
# Step patterns of different kinds, and whether their query may be open at its ends.
FEW = {"symmetricP1": False, "asymmetricP05": True, "symmetric2": False, "rabinerJuang:6c": True, "rabinerJuang:7c": True}
VERSION = "dtw-python 1.9.0, local distance |x-y|"


def step_pattern(name):
    match = re.fullmatch(r"rabinerJuang:(\d)([abcd])(:smoothed)?", name)
    if match:
        return dtw.rabinerJuangStepPattern(int(match[1]), match[2], match[3] is not None)
    return getattr(dtw, name)


def align(query, reference, pattern, window, ends):
    open_begin, open_end = ENDS[ends]
    kind, _, radius = window.partition(":")
    arguments = {} if kind == "none" else {"window_type": WINDOWS[kind]}
    if radius:
        arguments["window_args"] = {"window_size": int(radius)}
    try:
        return dtw.dtw(
            np.asarray(query), np.asarray(reference), step_pattern=step_pattern(pattern),
            open_begin=open_begin, open_end=open_end, **arguments,
        )
    except ValueError as error:
        assert "No warping path" in str(error), error
        return None


def number(value):
    return None if value is None or np.isnan(value) else float(value)


def distances():
    golden = json.loads((FOLDER / "distances.json").read_text())
    for case in golden["cases"]:
        for result in case["results"]:
            answer = align(case["query"], case["reference"], *result[:3])
            new = [None, None] if answer is None else [number(answer.distance), number(answer.normalizedDistance)]
            for old, value in zip(result[3:], new):
                assert old == value or abs(old - value) <= 1e-12 * abs(old), (result, new)
            result[3:] = new
    golden["generated_with"] = VERSION
    layout.write(FOLDER / "distances.json", golden)


def patterns():
    for family in ("symmetric", "asymmetric"):
        for slope in ("P0", "P05", "P1", "P2"):
            yield family + slope
    yield from ("symmetric1", "symmetric2", "asymmetric")
    for kind, weighting, smoothing in itertools.product(range(1, 8), "abcd", ("", ":smoothed")):
        yield f"rabinerJuang:{kind}{weighting}{smoothing}"


def every_pattern():
    """Asks about every step pattern, and with those of FEW about every window and open end."""
    for pattern in patterns():
        yield pattern, "none", "closed"
        if pattern in FEW:
            if FEW[pattern]:
                yield from ((pattern, "none", ends) for ends in ("openEnd", "openBegin", "openBoth"))
            yield from ((pattern, window, "closed") for window in ("sakoeChiba:9", "slanted:5", "itakura"))


def borders():
    """Asks about a long pair, which crosses the borders between blocks of rows. The first window leaves no path."""
    for pattern in FEW:
        yield pattern, "none", "closed"
        yield pattern, "sakoeChiba:9", "closed"
    yield "symmetric2", "slanted:5", "closed"
    yield "rabinerJuang:6c", "none", "openBoth"


def paths():
    rng = np.random.default_rng(20261121)
    cases = []
    # The second pair is drawn only so that the third stays what it was.
    for lengths, questions in (((19, 23), every_pattern()), ((70, 61), ()), ((140, 150), borders())):
        query, reference = (np.round(rng.normal(size=n).cumsum(), 4).tolist() for n in lengths)
        results = []
        for question in questions:
            answer = align(query, reference, *question)
            if answer is None:
                results.append([*question, None, None, [], []])
                continue
            path = [answer.index1.tolist(), answer.index2.tolist()]
            results.append([*question, number(answer.distance), number(answer.normalizedDistance), *path])
        if results:
            cases.append({"query": query, "reference": reference, "results": results})
    layout.write(FOLDER / "paths.json", {"generated_with": VERSION, "cases": cases})


if __name__ == "__main__":
    distances()
    paths()
