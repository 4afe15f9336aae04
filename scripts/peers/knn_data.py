"""The data sets of knn.py, made once and kept."""

import os
import pathlib
import shutil
import subprocess
import sys

import common


HERE = pathlib.Path(__file__).resolve().parent


def step(python, *arguments):
    done = subprocess.run(
        [python, HERE / "knn_truth.py", *map(str, arguments)], check=True, capture_output=True, text=True
    )
    return done.stdout.split()


class Data:
    """Arrays in the cache."""

    def __init__(self, python, cache, calib):
        self.python, self.cache, self.calib = python, pathlib.Path(cache), calib
        self.cache.mkdir(parents=True, exist_ok=True)

    def once(self, name, make):
        path = self.cache / f"{name}.npy"
        if not path.exists():
            print(f"making {path.name}", file=sys.stderr)
            part = self.cache / f"part-{name}.npy"
            make(part)
            part.rename(path)
        return path

    def plant(self, rows):
        """Returns the first rows of one simulation, so that a longer log continues a shorter one."""
        larger = [path for path in self.cache.glob("plant-*.npy") if int(path.stem.split("-")[1]) >= rows]
        if larger:
            return min(larger, key=lambda path: int(path.stem.split("-")[1]))
        program = common.build("calib-knn", "plant_tables")
        return self.once(
            f"plant-{rows}", lambda out: subprocess.run([program, "simulate", str(rows), "10", out], check=True, stdout=2)
        )

    def wells(self, name, overrides):
        if "CALIB_DATA" not in os.environ:
            raise LookupError("CALIB_DATA does not name the folder with the wells' logs")

        def make(out):
            model = self.cache / f"{name}-model"
            command = [self.calib, "build-model", common.ROOT / "configs/wells.toml", "--set", f"output={str(model)!r}"]
            for override in overrides:
                command += ["--set", override]
            done = subprocess.run(command, capture_output=True, text=True)
            if done.returncode != 0:
                raise SystemExit(f"{name}: {done.stderr.strip()}")
            step(self.python, "wells", next(model.rglob("states.npy")), out)
            shutil.rmtree(model)

        return self.once(name, make)

    def get(self, name, rows):
        """Returns a file and the number of its rows to use."""
        kind = name.split("-")[0]
        if kind == "plant":
            rows = min(rows or sys.maxsize, int(name.split("-")[1]))
            return self.plant(rows), rows
        if kind == "gaussian":
            rows = rows or 100_000
            path = self.once(f"gaussian-{rows}", lambda out: step(self.python, "gaussian", out, rows, 142))
            return path, rows
        if kind == "switching":
            rows = rows or 200_000
            return self.once(f"switching-{rows}", lambda out: step(self.python, "switching", out, rows)), rows
        if kind in ("quantised", "embedding"):
            rows = rows or {"quantised": 200_000, "embedding": 400_000}[kind]
            path = self.once(f"{kind}-{rows}", lambda out: step(self.python, kind, self.plant(rows), out, rows))
            return path, rows
        if name == "wells":
            path = self.wells(name, ["preprocess.subsample=1"])
        elif name == "wells-traces":
            decays = [round(1 - 2.0**-power, 6) for power in range(1, 12)]
            path = self.wells(name, ["preprocess.subsample=1", f"preprocess.traces={decays}"])
        else:
            raise LookupError(f"no such data: {name}")
        whole = int(step(self.python, "shape", path)[0])
        return path, min(rows or whole, whole)

    def truth(self, path, rows, sample):
        stem = f"truth-{path.stem}-{rows}-{sample}"
        queries, truth = self.cache / f"{stem}-queries.npy", self.cache / f"{stem}.npy"
        if not truth.exists():
            step(self.python, "truth", path, rows, queries, truth, sample)
        return queries, truth
