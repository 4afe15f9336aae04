"""Is what calib proposes worth deploying? `calib init`, then `calib run`, on every log, beside simple predictors.

    CALIB_DATA=/path/to/logs python3 scripts/worth.py [--within 60s] [--calib target/release/calib] [--keep FOLDER]
        [--public FOLDER]

It prints the table of docs/validity.md: for each predicted sensor what the verdict says to deploy, and the error of that,
and of the chosen agent, by the error of the best simple predictor on the same held-out windows, with 95 % intervals over
windows. The best simple predictor is found on these windows, in hindsight. What to deploy is chosen on the log.

--public adds four public logs, where FOLDER holds them:
    ett/      ETT-small/ETTh1.csv of github.com/zhouhaoyi/ETDataset
    skab/     the folder data of github.com/waico/SKAB
    solar/    the folder data of github.com/stritti/thermal-solar-plant-dataset
    haute/    la-haute-borne-data-2014-2015.csv of examples/data/la_haute_borne.zip in the source of openoa 3.2 (PyPI)
"""

import argparse
import json
import math
import os
import pathlib
import subprocess
import sys
import tempfile

import protocols

# Name, files below CALIB_DATA, and the options that `calib init` asks a user to add.
LOGS = [
    ("mbr-mines", "mbr-mines", []),
    ("3w-field-2017-08", "3w-field-2017-08", []),
    ("3w well 1", "3w-wells/well=WELL-00001", []),
    ("3w well 6", "3w-wells/well=WELL-00006", []),
    ("petrobras-historian", "petrobras-historian/2017-12-24_2018-01-04.parquet", []),
    ("solarmed-med", "solarmed-med", []),
    ("fixture-3h20", "fixture-3h20", []),
]
# The options are those that `calib init` asks for at its first call.
PUBLIC = [
    ("ett", "ett", []),
    ("skab", "skab", []),
    ("solar", "solar", ["--set", 'data.bad_rows="skip"']),
    ("wind", "haute/la-haute-borne-data-2014-2015.csv", ["--set", 'data.where={ "Wind_turbine_name" = "R80711" }']),
]
NO_WORSE = 1.02
PARTS = ["after_first_quarter", "final_quarter", "whole_run"]


def best_simple(verdict):
    """Returns the simple predictor with the least error on the held-out windows, or None if none was scored."""
    simple = [row for row in verdict.get("simple", []) if row.get("ratio")]
    return max(simple, key=lambda row: row["ratio"]["value"], default=None)


def against_best(predictor, best, sensor, part, scores):
    """Returns the error of one simple predictor divided by that of another: geometric mean over held-out windows, with its interval."""
    errors = {}
    for row in scores:
        if row["sensor"] == sensor and row["environment"] == "online" and row["predictor"] in (predictor, best):
            errors.setdefault(row["start_row"], {})[row["predictor"]] = row["scores"][part]["rmse"]
    logs = [math.log(window[predictor] / window[best]) for window in errors.values() if window[predictor] and window[best]]
    if not logs or predictor == best:
        return 1.0, (1.0, 1.0)
    value, low, high = map(math.exp, protocols.interval(logs))
    return value, (low, high) if len(logs) > 1 else None


def ratio_text(ratio, interval):
    return f"{ratio:.3f} ({interval[0]:.3g} to {interval[1]:.3g})" if interval else f"{ratio:.3f}"


def percent(count, total):
    return f"{count} of {total} ({100 * count / max(total, 1):.0f} %)"


def deployed(choice, verdict):
    """Returns the simple predictor to deploy, the place of an agent's setting in the grid, or the advice instead."""
    if choice["recommendation"] == "deploy":
        return verdict["chosen"]
    return choice.get("simple_predictor", {}).get("predictor", choice["recommendation"])


def by_parts(calib, study, summary):
    """Returns the deployment choice for each sensor, by each part of the runs."""
    parts = []
    for scored in PARTS:
        # Every run is already scored over all parts, so nothing is trained.
        done = subprocess.run([calib, "run", "-q", str(study), "--set", f"sweep.scored={scored}"], stdout=subprocess.DEVNULL)
        if done.returncode not in (0, 1):
            sys.exit(f"{study}: calib run stopped")
        found = json.loads(summary.read_text())
        parts.append([deployed(choice, verdict) for choice, verdict in zip(found["choices"], found["verdicts"])])
    return list(zip(*parts))


def is_alike(parts):
    """Whether the choices are the same predictor, or neighbouring settings of an agent."""
    if any(isinstance(part, str) for part in parts):
        return len(set(parts)) == 1
    return max(parts) - min(parts) <= 1


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--within", default="60s")
    parser.add_argument("--calib", default="target/release/calib")
    parser.add_argument("--public", help="a folder with four public logs")
    parser.add_argument("--keep", help="a folder for studies and results; finished ones are not run again")
    args = parser.parse_args()
    data = os.environ.get("CALIB_DATA")
    if not data or not pathlib.Path(data).is_dir():
        sys.exit("CALIB_DATA names no folder; set it to the folder of the logs")
    calib = str(pathlib.Path(args.calib).resolve())
    place = pathlib.Path(args.keep or tempfile.mkdtemp())
    studies = [("quickstart", None)]
    logs = [(name, pathlib.Path(data) / files, options) for name, files, options in LOGS]
    if args.public:
        logs += [(name, pathlib.Path(args.public) / files, options) for name, files, options in PUBLIC]
    for name, files, options in logs:
        folder = place / name.replace(" ", "-")
        folder.mkdir(parents=True, exist_ok=True)
        study = folder / "study.toml"
        if not study.exists():
            command = [calib, "init", "-q", str(files.resolve()), str(study), "--within", args.within]
            if subprocess.run(command + options).returncode != 0:
                print(f"{name}: calib init stopped", file=sys.stderr)
                continue
        studies.append((name, study))
    print("| log | sensor | to deploy | its error by the best simple predictor's (95 %) | agent's NRMSE | best simple predictor | its NRMSE | agent / predictor (95 %) | by all parts of runs |")
    print("|---|---|---|---|---|---|---|---|---|")
    sensors = fine = named = misled = agents = 0
    # Sensors for which what is deployed, and the agent's setting, are alike by the whole run and after its start-up, and by all parts.
    deployed_alike, chosen_alike = {"start-up": 0, "all": 0}, {"start-up": 0, "all": 0}
    for name, study in studies:
        if study is None:
            folder = place / "quickstart"
            folder.mkdir(parents=True, exist_ok=True)
            subprocess.run([calib, "quickstart", "-q"], cwd=folder, stdout=subprocess.DEVNULL)
        else:
            folder = study.parent
            subprocess.run([calib, "run", "-q", str(study)], stdout=subprocess.DEVNULL)
        summaries = list(folder.rglob("evaluate/summary.json"))
        if not summaries:
            print(f"{name}: calib run stopped", file=sys.stderr)
            continue
        summary = json.loads(summaries[0].read_text())
        simple = json.loads((summaries[0].parent.parent / "sweep" / "simple.json").read_text())
        parts = by_parts(calib, study or folder / "calib-quickstart" / "study.toml", summaries[0])
        for choice, verdict, of_parts in zip(summary["choices"], summary["verdicts"], parts):
            best = best_simple(verdict)
            if best is None:
                continue
            sensors += 1
            interval = best["ratio"].get("interval")
            interval = interval and (interval["low"], interval["high"])
            agent = (best["ratio"]["value"], interval)
            agents += (interval[1] if interval else agent[0]) <= NO_WORSE
            instead = choice.get("simple_predictor", {}).get("predictor")
            ratio = agent
            if instead:
                ratio = against_best(instead, best["predictor"], choice["sensor"], verdict["part"], simple["scores"])
            fine += (ratio[1][1] if ratio[1] else ratio[0]) <= NO_WORSE
            named += instead is not None
            misled += instead is None and choice["recommendation"] == "deploy" and bool(interval and interval[0] > 1)
            chosen = {part["part"]: part["chosen"] for part in verdict["parts"]}
            after, whole = chosen["after_first_quarter"], chosen["whole_run"]
            chosen_alike["start-up"] += abs(after - whole) <= 1
            chosen_alike["all"] += max(chosen.values()) - min(chosen.values()) <= 1
            deployed_alike["start-up"] += is_alike([of_parts[PARTS.index("after_first_quarter")], of_parts[PARTS.index("whole_run")]])
            alike = is_alike(of_parts)
            deployed_alike["all"] += alike
            own = verdict["truth"]["choice"]["online_error"]
            values = ", ".join(f"{key} = {value}" for key, value in choice["values"].items())
            advised = instead or (values if choice["recommendation"] == "deploy" else f"({values})")
            print(
                f"| {name} | {choice['sensor']} | {advised} | {ratio_text(*ratio)} | {own:.3g} | {best['predictor']} "
                f"| {best['online_error']:.3g} | {ratio_text(*agent)} | {'alike' if alike else 'differ: ' + ', '.join(map(str, of_parts))} |",
                flush=True,
            )
    print()
    print(f"What is deployed is no worse than the best simple predictor (upper end at most {NO_WORSE}): {percent(fine, sensors)}.")
    print(f"It is a simple predictor: {percent(named, sensors)}.")
    print(f"Agents no worse than the best simple predictor (upper end at most {NO_WORSE}): {percent(agents, sensors)}.")
    print(f"Told to deploy what a simple predictor beats beyond chance: {misled}.")
    for parts, name in {"start-up": "by the whole run and after its first quarter", "all": "by the whole run, after its first quarter and in its last"}.items():
        print(f"What is deployed is alike {name}: {percent(deployed_alike[parts], sensors)}.")
        print(f"The settings that are chosen for the agent are alike or neighbours {name}: {percent(chosen_alike[parts], sensors)}.")


if __name__ == "__main__":
    main()
