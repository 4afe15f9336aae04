"""Is what calib proposes worth deploying? `calib init`, then `calib run`, on every log, beside simple predictors.

    CALIB_DATA=/path/to/logs python3 scripts/worth.py [--within 60s] [--calib target/release/calib] [--keep FOLDER]

It prints the table of docs/validity.md: for each predicted sensor the error of the chosen agent by that of the best
simple predictor on the same held-out windows, with the 95 % interval over windows, and what the verdict says to deploy.
The best simple predictor is found on these windows, so that a verdict which names it cannot be wrong here.
"""

import argparse
import json
import os
import pathlib
import subprocess
import sys
import tempfile

# Name, files below CALIB_DATA, and what `calib init` asks a user to add.
LOGS = [
    ("mbr-mines", "mbr-mines", []),
    ("3w-field-2017-08", "3w-field-2017-08", []),
    ("3w well 1", "3w-wells/well=WELL-00001", []),
    ("3w well 6", "3w-wells/well=WELL-00006", []),
    ("petrobras-historian", "petrobras-historian/2017-12-24_2018-01-04.parquet", []),
    ("solarmed-med", "solarmed-med", []),
]
NO_WORSE = 1.02


def best_simple(verdict):
    """The simple predictor with the least error on the held-out windows, or None where none was scored."""
    simple = [row for row in verdict.get("simple", []) if row.get("ratio")]
    return max(simple, key=lambda row: row["ratio"]["value"], default=None)


def percent(count, total):
    return f"{count} of {total} ({100 * count / max(total, 1):.0f} %)"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--within", default="60s")
    parser.add_argument("--calib", default="target/release/calib")
    parser.add_argument("--keep", help="a folder for studies and results; finished ones are not run again")
    args = parser.parse_args()
    data = os.environ.get("CALIB_DATA")
    if not data or not pathlib.Path(data).is_dir():
        sys.exit("CALIB_DATA names no folder; set it to the folder of the logs")
    calib = str(pathlib.Path(args.calib).resolve())
    place = pathlib.Path(args.keep or tempfile.mkdtemp())
    studies = [("quickstart", None)]
    for name, files, options in LOGS:
        folder = place / name.replace(" ", "-")
        folder.mkdir(parents=True, exist_ok=True)
        study = folder / "study.toml"
        if not study.exists():
            command = [calib, "init", "-q", str(pathlib.Path(data) / files), str(study), "--within", args.within]
            if subprocess.run(command + options).returncode != 0:
                print(f"{name}: calib init stopped", file=sys.stderr)
                continue
        studies.append((name, study))
    print("| log | sensor | agent's NRMSE | best simple predictor | its NRMSE | agent / predictor (95 %) | to deploy | whole run, later |")
    print("|---|---|---|---|---|---|---|---|")
    sensors = fine = named = agree = misled = 0
    for name, study in studies:
        if study is None:
            folder = place / "quickstart"
            folder.mkdir(parents=True, exist_ok=True)
            subprocess.run([calib, "quickstart", "-q"], cwd=folder, stdout=subprocess.DEVNULL)
            summaries = list(folder.rglob("evaluate/summary.json"))
        else:
            subprocess.run([calib, "run", "-q", str(study)], stdout=subprocess.DEVNULL)
            summaries = list(study.parent.rglob("evaluate/summary.json"))
        if not summaries:
            print(f"{name}: calib run stopped", file=sys.stderr)
            continue
        summary = json.loads(summaries[0].read_text())
        for choice, verdict in zip(summary["choices"], summary["verdicts"]):
            best = best_simple(verdict)
            if best is None:
                continue
            sensors += 1
            ratio, interval = best["ratio"]["value"], best["ratio"].get("interval")
            is_fine = (interval["high"] if interval else ratio) <= NO_WORSE
            instead = choice.get("simple_predictor")
            fine += is_fine
            named += not is_fine and instead is not None
            misled += choice["recommendation"] == "deploy" and bool(interval and interval["low"] > 1)
            chosen = [part["chosen"] for part in verdict["parts"]]
            near = max(chosen) - min(chosen) <= 1
            agree += near
            own = verdict["truth"]["choice"]["online_error"]
            values = ", ".join(f"{key} = {value}" for key, value in choice["values"].items())
            deployed = instead["predictor"] if instead else values
            said = f"{ratio:.3f} ({interval['low']:.3g} to {interval['high']:.3g})" if interval else f"{ratio:.3f}"
            print(
                f"| {name} | {choice['sensor']} | {own:.3g} | {best['predictor']} | {best['online_error']:.3g} "
                f"| {said} | {deployed} | {'alike' if near else 'differ'} |",
                flush=True,
            )
    print()
    print(f"Agents no worse than the best simple predictor (upper end at most {NO_WORSE}): {percent(fine, sensors)}.")
    print(f"Of the others, the verdict names a simple predictor instead: {percent(named, sensors - fine)}.")
    print(f"Told to deploy what a simple predictor beats beyond chance: {misled}.")
    print(f"Choices by the whole run and by its later parts are alike, or neighbours: {percent(agree, sensors)}.")


if __name__ == "__main__":
    main()
