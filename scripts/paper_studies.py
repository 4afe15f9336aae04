#!/usr/bin/env python3
"""Run the paper's studies in their profiles `tiny`, `small` and `change`, and print the tables of docs/paper-studies.md.

    python3 scripts/paper_studies.py --calib BINARY --output FOLDER [--only PART] [--tables]

Everything is written below FOLDER: copies of the studies, the simulated plants, results, logs, and the processor time
of each run in times.json. What was stopped goes on, what is done is not run again, and what was done by another
binary or from another study is. The bioreactor is run where CALIB_DATA names the folder of mbr-mines/.
--only PART runs those whose name has PART in it; --tables runs nothing. Tables show what is there.
"""

import argparse
import hashlib
import json
import os
import resource
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import paper_tables

STUDIES = Path(__file__).resolve().parents[1] / "configs" / "paper"
SEEDS = (0, 1, 2)
BIOREACTOR = [
    "data.path=${CALIB_DATA}/mbr-mines",
    "data.train={ start = 2010-04-10, end = 2010-05-01 }",
    "data.held_out={ start = 2010-05-01, end = 2010-05-11 }",
    "data.gap_tolerance=2.5",
    'sweep.sensors=["mbr_1_tmp", "bio_1_temp", "perm_turb"]',
]


class Run(NamedTuple):
    """A study in one profile, with its changes."""

    study: str
    profile: str
    plant: str  # distinguishes it within the profile: a seed, or the name of a plant
    overrides: list[str]

    @property
    def name(self) -> str:
        return f"{self.study}/{self.profile}-{self.plant}"


def seeded(study: str, profile: str, seed: int) -> Run:
    """Returns the study on the plant with another seed."""
    return Run(study, profile, str(seed), [f"seed={seed}", f"simulate.seed={seed}"])


def runs() -> list[Run]:
    """Returns all runs, the cheap ones first."""
    years = ("twelve-months", "fine-tuning")
    listed = [seeded("one-week", "tiny", seed) for seed in SEEDS]
    listed.append(Run("one-week", "tiny", "bioreactor", BIOREACTOR))
    listed += [seeded(study, profile, seed) for profile in ("tiny", "tiny-change") for study in years for seed in SEEDS]
    listed.append(seeded("one-week", "small", 0))
    return listed + [seeded(study, profile, 0) for profile in ("small", "small-change") for study in years]


def processor_secs() -> float:
    """Returns the processor time of all commands so far."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def fingerprint(binary: Path, run: Run) -> str:
    """Returns the fingerprint of all inputs of the results, except for data that are not simulated."""
    digest = hashlib.sha256(binary.read_bytes())
    digest.update((STUDIES / f"{run.study}.toml").read_bytes())
    digest.update(json.dumps(run).encode())
    return digest.hexdigest()


def recorded(output: Path) -> dict:
    """Returns the record of each run: `key` (fingerprint of its inputs), `done`, `processor_secs`."""
    kept = output / "times.json"
    return json.loads(kept.read_text()) if kept.exists() else {}


def execute(binary: Path, output: Path, run: Run) -> float:
    """Runs one study to its end; returns the processor time of all attempts so far."""
    log = output / "logs" / f"{run.name.replace('/', '-')}.log"
    log.parent.mkdir(parents=True, exist_ok=True)
    studies = output / "studies" / run.plant  # plants lie beside their studies: one folder per seed
    studies.mkdir(parents=True, exist_ok=True)
    shutil.copy(STUDIES / f"{run.study}.toml", studies)
    command = [binary, "run", studies / f"{run.study}.toml", "--profile", run.profile]
    command += [part for override in run.overrides for part in ("--set", override)]
    command += ["--output", output / "results" / run.name]
    begun = processor_secs()
    before = recorded(output).get(run.name, {})
    key = fingerprint(binary, run)
    spent = before.get("processor_secs", 0) if before.get("key") == key else 0
    code = None
    try:
        with log.open("w") as to:
            code = subprocess.run(command, stdout=to, stderr=subprocess.STDOUT).returncode
    finally:
        spent += processor_secs() - begun
        now = {run.name: {"key": key, "done": code in (0, 1), "processor_secs": round(spent, 1)}}
        (output / "times.json").write_text(json.dumps(recorded(output) | now, indent=2) + "\n")
    if code not in (0, 1):  # 1: for some models no setting is better than another
        raise SystemExit(f"paper_studies.py: {run.name} ends with {code}: see {log}")
    return spent


def bring_up_to_date(binary: Path, output: Path, run: Run) -> None:
    """Runs the study if it is not done, or was done with other inputs."""
    if run.plant == "bioreactor" and "CALIB_DATA" not in os.environ:
        print(f"{run.name}: left out, CALIB_DATA is not set", file=sys.stderr)
        return
    done = recorded(output).get(run.name, {})
    if not done.get("done") or done["key"] != fingerprint(binary, run):
        spent = execute(binary, output, run)
        print(f"{run.name}: {spent:.0f} s of processor time", file=sys.stderr, flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--calib", type=Path, help="the binary; not needed for --tables")
    parser.add_argument("--output", type=Path, required=True)
    parser.add_argument("--only", default="", metavar="PART")
    parser.add_argument("--tables", action="store_true")
    options = parser.parse_args()
    output = options.output.resolve()
    output.mkdir(parents=True, exist_ok=True)
    if not options.tables:
        if options.calib is None or not options.calib.is_file():
            parser.error("--calib: the binary of calib")
        for run in runs():
            if options.only in run.name:
                bring_up_to_date(options.calib.resolve(), output, run)
    print(paper_tables.page(output / "results", recorded(output)))


if __name__ == "__main__":
    main()
