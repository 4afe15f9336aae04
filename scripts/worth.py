"""Is what calib proposes worth deploying? `calib init`, then `calib run`, on every log, beside simple predictors.

    CALIB_DATA=/path/to/logs python3 scripts/worth.py [--within 60s] [--calib target/release/calib] [--keep FOLDER]

It prints the table of docs/validity.md: for each predicted sensor the error of what calib says to deploy beside
the best simple predictor on the same held-out windows, with the 95 % interval of their ratio over windows. Sensors
that calib tells you to predict with a simple predictor count as that predictor.
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


def verdicts(summary):
    """The verdict of each sensor with its choice."""
    return zip(summary["choices"], summary["verdicts"])


def row(choice, verdict):
    """The best simple predictor beside what is deployed: its name, errors, and the ratio with its interval."""
    simple = [s for s in verdict.get("simple", []) if s.get("ratio")]
    if not simple:
        return None
    best = max(simple, key=lambda s: s["ratio"]["value"])
    ratio, interval = best["ratio"]["value"], best["ratio"].get("interval")
    deployed = "agent"
    if choice.get("simple_predictor"):
        deployed = choice["simple_predictor"]["predictor"]
        used = next(s for s in simple if s["predictor"] == deployed)
        # What is deployed is the simple predictor itself: both were scored on the same windows.
        ratio, interval = best["ratio"]["value"] / used["ratio"]["value"], None
    return best, ratio, interval, deployed


def percent(count, of):
    return f"{count} of {of} ({100 * count / max(of, 1):.0f} %)"


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
    print("| log | sensor | deployed | NRMSE | best simple predictor | its NRMSE | ratio (95 %) | whole run, later |")
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
        for choice, verdict in verdicts(summary):
            found = row(choice, verdict)
            if found is None:
                continue
            best, ratio, interval, deployed = found
            sensors += 1
            upper = interval["high"] if interval else ratio
            fine += upper <= NO_WORSE
            named += upper > NO_WORSE and choice.get("simple_predictor") is not None
            misled += choice["recommendation"].startswith("deploy") and bool(interval and interval["low"] > 1)
            parts = verdict.get("parts", [])
            near = max((p["chosen"] for p in parts), default=0) - min((p["chosen"] for p in parts), default=0) <= 1
            agree += near
            chosen = verdict["truth"]["choice"]["online_error"] if "online_error" in verdict["truth"]["choice"] else None
            own = chosen if chosen is not None else best["online_error"] * best["ratio"]["value"]
            values = ", ".join(f"{key} = {value}" for key, value in choice["values"].items())
            said = f"{ratio:.3f} ({interval['low']:.2f} to {interval['high']:.2f})" if interval else f"{ratio:.3f}"
            print(
                f"| {name} | {choice['sensor']} | {deployed if deployed != 'agent' else values} | {own:.3g} "
                f"| {best['predictor']} | {best['online_error']:.3g} | {said} | {'alike' if near else 'differ'} |",
                flush=True,
            )
    print()
    print(f"No worse than the best simple predictor (upper end at most {NO_WORSE}): {percent(fine, sensors)}.")
    if sensors > fine:
        print(f"Of the others, the verdict names a simple predictor instead: {percent(named, sensors - fine)}.")
    print(f"Told to deploy what a simple predictor beats beyond chance: {misled}.")
    print(f"Choices by the whole run and by its later parts are alike, or neighbours: {percent(agree, sensors)}.")


if __name__ == "__main__":
    main()
