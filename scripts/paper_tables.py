"""The tables of docs/paper-studies.md, from what calib wrote (docs/formats.md); used by paper_studies.py."""

import json
from pathlib import Path
from statistics import fmean, median
from typing import Iterator

MODELS = {"euclidean": "Euclidean kNN", "laplacian": "Laplacian kNN", "nn": "NN", "gru": "GRU"}
STEADY, CHANGING = ("small", "tiny"), ("small-change", "tiny-change")


def read(path: Path):
    """Returns a JSON document, or None if it does not exist."""
    return json.loads(path.read_text()) if path.is_file() else None


def placed(results: Path, study: str, *profiles: str) -> Iterator[tuple[str, Path, dict]]:
    """Yields name, folder and summary of each existing run of a study, by profile and seed."""
    for profile in profiles:
        for folder in sorted((results / study).glob(f"{profile}-*")):
            plant = folder.name.removeprefix(f"{profile}-")
            if plant.startswith("change"):
                continue
            summary = read(folder / "evaluate" / "summary.json")
            if summary is not None:
                yield "bioreactor" if plant == "bioreactor" else f"`{profile}`, seed {plant}", folder, summary


def table(head: list[str], rows: list[list[str]]) -> str:
    lines = ["| " + " | ".join(cells) + " |" for cells in (head, *rows)]
    return "\n".join([lines[0], "|" + "---|" * len(head), *lines[1:]])


def number(value: float) -> str:
    """Formats a number with three digits."""
    return f"{value:#.3g}".rstrip(".").replace("-", "−").replace("e+0", "e")


def signed(value: float) -> str:
    """Formats a correlation or a skill."""
    return f"{value:.2f}".replace("-", "−")


def percent(share: float | None) -> str:
    if share is None:
        return "–"
    value = 100 * share
    if value == 0:
        return "0 %"
    return "<0.1 %" if 0 < value < 0.05 else f"{value:.1f} %" if abs(value) < 9.95 else f"{value:.0f} %"


def label(document: dict, position: int) -> str:
    """Returns a setting of the grid without the name of the key."""
    value = float(document["candidates"][position].split(" = ")[-1])
    return f"{value:g}" if value == 0 or value >= 0.01 else f"{value:.0e}".replace("e-0", "e-")


def baseline(verdict: dict, name: str) -> float | None:
    """Returns the regret of one of the baselines."""
    found = [entry["regret"]["value"] for entry in verdict["truth"]["baselines"] if entry["baseline"] == name and entry["regret"]]
    return found[0] if found else None


def verdicts(document: dict) -> dict[str, dict]:
    """Returns the verdicts of a model by sensor, for the judged sensors."""
    return {verdict["sensor"]: verdict for verdict in document["verdicts"] if verdict.get("truth")}


def standstill(manifest: dict, sensor: str) -> tuple[int, int]:
    """Returns the number of rollouts that are constant at the end, and the number of all rollouts."""
    found = next(entry for entry in manifest["collapse"]["sensors"] if entry["sensor"] == sensor)
    return found["collapsed"], manifest["collapse"]["rollouts"]


def collapse(manifest: dict, sensor: str) -> str:
    """Returns the same in words, with the median step from which they are constant, and the number that left the range of the data."""
    found = next(entry for entry in manifest["collapse"]["sensors"] if entry["sensor"] == sensor)
    stopped, of = standstill(manifest, sensor)
    since = f" at {found['median_step']:,.0f}" if stopped else ""
    ran_away = max(found["escaped"], len(manifest["collapse"]["ended"]))
    return f"{stopped} of {of}{since}" + (f", {ran_away} run away" if ran_away else "")


def warping(manifest: dict, sensor: str) -> dict:
    """Returns the normalised symmetric2 distance over start states."""
    found = next(entry for entry in manifest["comparison"]["sensors"] if entry["sensor"] == sensor)
    return next(entry["normalized_distance"] for entry in found["dtw"] if entry["step_pattern"] == "symmetric2")


def compared(results: Path) -> tuple[list[tuple[str, Path, dict]], list[str]]:
    """Returns the runs of a week, and all models that occur in them."""
    weeks = list(placed(results, "one-week", *STEADY))
    return weeks, [model for model in MODELS if any(model in summary["models"] for _, _, summary in weeks)]


def week_rollouts(results: Path) -> str:
    weeks, models = compared(results)
    rows, nearer, of_rows = [], {"nn": 0, "laplacian": 0}, 0
    for name, folder, summary in weeks:
        manifests = {model: read(folder / "models" / model / "rollout" / "manifest.json") for model in models if model in summary["models"]}
        for position, sensor in enumerate(manifests["euclidean"]["sensors"]):
            cells = [name if position == 0 else "", sensor]
            for model in models:
                if model not in manifests:
                    cells.append("–")
                    continue
                cells.append(f"{number(warping(manifests[model], sensor)['mean'])}; {collapse(manifests[model], sensor)}")
            rows.append(cells)
            distances = {model: warping(manifests[model], sensor)["mean"] for model in manifests}
            of_rows += 1
            nearer["nn"] += distances["euclidean"] < distances["nn"]
            nearer["laplacian"] += distances["laplacian"] < distances["euclidean"]
    said = f"Euclidean nearer than NN in {nearer['nn']}, Laplacian nearer than Euclidean in {nearer['laplacian']} of {of_rows} rows."
    return table(["data", "sensor", *(MODELS[model] for model in models)], rows) + "\n\n" + said


def spread(values: list[float | None], form: str = ",.0f") -> str:
    """Formats the smallest and the largest value; None is more than a million steps."""
    texts = [">1e6" if value is None else f"{value:{form}}" for value in sorted(values, key=lambda value: float("inf") if value is None else value)]
    return texts[0] if texts[0] == texts[-1] else f"{texts[0]} to {texts[-1]}"


def walks(results: Path) -> str:
    """Returns where rollouts of neighbour models end, over members."""
    rows = []
    for name, folder, _ in compared(results)[0]:
        for model in ("euclidean", "laplacian"):
            members = read(folder / "models" / model / "model" / "manifest.json")["members"]
            found = [member["recurrence"] for member in members]
            cells = [name if model == "euclidean" else "", MODELS[model]]
            cells.append(spread([100 * member["jumps"]["departure_rate"] for member in members], ".2g") + " %")
            cells.append(spread([of["before"]["traps"] for of in found]))
            cells.append(spread([100 * of["left_out"] / of["candidates"] for of in found], ".2g") + " %")
            cells.append(spread([of["exits"] for of in found]))
            cells.append(spread([100 * of["effective_rows"] / of["candidates"] for of in found], ".2g") + " %")
            cells.append(spread([of["mixing_steps"] for of in found]))
            rows.append(cells)
    head = ["data", "model", "jumps to another time", "traps as found", "left out", "led out of", "spread over", "mix in steps"]
    return table(head, rows)


def week_choices(results: Path) -> str:
    weeks, models = compared(results)
    rows, columns, ranks = [], {"spread between windows": [], "log replay": []} | {model: [] for model in models}, {model: [] for model in models}
    for name, _, summary in weeks:
        documents = summary["models"]
        by_model = {model: verdicts(document) for model, document in documents.items()}
        for position, (sensor, verdict) in enumerate(by_model["euclidean"].items()):
            truth = verdict["truth"]
            skill = truth["scores"]["skill"][truth["best"]]
            cells = [name if position == 0 else "", sensor, f"{label(documents['euclidean'], truth['best'])} ({signed(skill)})"]
            for title, of in (("spread between windows", "another_window"), ("log replay", "log_replay")):
                columns[title].append(baseline(verdict, of))
                cells.append(percent(columns[title][-1]))
            for model in models:
                choice = (by_model.get(model, {}).get(sensor) or {"truth": {"choice": None}})["truth"]["choice"]
                if choice is None:
                    cells.append("–")
                    continue
                regret, spearman = choice["regret"]["value"], choice["spearman"]
                cells.append(f"{label(documents[model], choice['chosen'])}, {percent(regret)}, {signed(spearman)}")
                columns[model].append(regret)
                ranks[model].append(spearman)
            rows.append(cells)
    said = []
    for title, regrets in columns.items():
        known = [regret for regret in regrets if regret is not None]
        if known:
            agreement = f", Spearman {signed(fmean(ranks[title]))}" if title in ranks else ""
            said.append(f"{MODELS.get(title, title)} {percent(fmean(known))} (median {percent(median(known))}, largest {percent(max(known))}{agreement}; {len(known)} rows)")
    head = ["data", "sensor", "best Online (skill)", "spread between windows", "log replay", *(MODELS[model] for model in models)]
    return table(head, rows) + "\n\nMean regrets: " + "; ".join(said) + "."


def pooled(manifests: list[dict], sensor: str) -> float:
    """Returns the mean over the start states of all deployments."""
    each = [warping(manifest, sensor) for manifest in manifests]
    return sum(of["clusters"] * of["mean"] for of in each) / sum(of["clusters"] for of in each)


def deployed(folder: Path, summary: dict, model: str) -> list[dict]:
    """Returns the manifests of a model's rollouts, one per deployment."""
    names = [entry["deployment"] for entry in summary["deployments"]]
    return [read(folder / "models" / model / "deployments" / name / "rollout" / "manifest.json") for name in names]


def difference(summary: dict, sensor: str) -> dict:
    """Returns week minus year, over the start states of all deployments."""
    together = next(
        pair for pair in summary["comparisons"]["rollouts"]
        if len(pair["deployments"]) == len(summary["deployments"]) and pair["models"] == ["week", "year"]
    )
    found = next(entry for entry in together["sensors"] if entry["sensor"] == sensor)
    return next(entry["normalized_distance"] for entry in found["dtw"] if entry["step_pattern"] == "symmetric2")


def year_rollouts(results: Path, profiles: tuple[str, ...]) -> str:
    rows, still = [], {}
    for name, folder, summary in placed(results, "twelve-months", *profiles):
        manifests = {model: deployed(folder, summary, model) for model in ("week", "year")}
        for position, sensor in enumerate(manifests["week"][0]["sensors"]):
            cells = [name if position == 0 else "", sensor]
            for each in manifests.values():
                apart = ", ".join(number(warping(manifest, sensor)["mean"]) for manifest in each)
                cells.append(f"{number(pooled(each, sensor))} ({apart})")
            between = difference(summary, sensor)
            half = (between["interval"]["high"] - between["interval"]["low"]) / 2
            cells.append(f"{number(between['mean'])} ± {number(half)}")
            cells.append(" : ".join(str(count) for count in between["smaller"]))
            rows.append(cells)
            for model, each in manifests.items():
                stopped = [standstill(manifest, sensor) for manifest in each]
                still.setdefault((sensor, model), []).extend(stopped)
    counts = [f"{model}, {sensor}: {sum(one for one, _ in of)} of {sum(of for _, of in of)}" for (sensor, model), of in still.items()]
    head = ["plant", "sensor", "week (April, May, July)", "year (April, May, July)", "week − year", "starts nearer"]
    return table(head, rows) + "\n\nStand still at the end: " + "; ".join(counts) + "."


def judged(summary: dict, models: tuple[str, str]) -> Iterator[tuple[str, str, dict, dict[str, dict]]]:
    """Yields deployment, sensor, the first model's document, and the verdicts of all models."""
    for entry in summary["deployments"]:
        documents = {model: entry["models"][model] for model in models}
        by_model = {model: verdicts(document) for model, document in documents.items()}
        for sensor in by_model[models[0]]:
            yield entry["deployment"], sensor, documents[models[0]], {model: by_model[model][sensor] for model in models}


def cost(verdict: dict) -> float:
    """Returns the regret of the choice."""
    return verdict["truth"]["choice"]["regret"]["value"]


def mean_and_largest(values: list[float | None]) -> str:
    known = [value for value in values if value is not None]
    return f"{percent(fmean(known))} ({percent(max(known))})" if known else "–"


def costs(results: Path, study: str, profiles: tuple[str, ...], models: tuple[str, str], kept: str) -> str:
    """Returns the cost of choosing: mean and largest over sensors and deployments."""
    rows = []
    for name, _, summary in placed(results, study, *profiles):
        cells = [entry[3] for entry in judged(summary, models)]
        first = [entry[models[0]] for entry in cells]
        zero = [verdict["truth"]["regrets"][0] for verdict in first] if kept == "rate 0" else [baseline(verdict, "default") for verdict in first]
        columns = [zero, [baseline(verdict, "another_window") for verdict in first], [baseline(verdict, "log_replay") for verdict in first]]
        columns += [[cost(entry[model]) for entry in cells] for model in models]
        rows.append([name, str(len(cells)), *(mean_and_largest(column) for column in columns)])
    head = ["plant", "verdicts", kept, "spread between windows", "log replay", *(f"{model}'s choice" for model in models)]
    shown = [column for column in range(len(head)) if any(row[column] != "–" for row in rows)]
    return table([head[column] for column in shown], [[row[column] for column in shown] for row in rows])


def fine_tuning(results: Path) -> str:
    rows = []
    for name, _, summary in placed(results, "fine-tuning", *STEADY):
        before = ("", "")
        for sensor in ("PIT300", "TIT101"):
            for deployment, of, document, by_model in judged(summary, ("month", "year")):
                if of != sensor:
                    continue
                truth = by_model["month"]["truth"]
                cells = [name if before[0] != name else "", sensor if before != (name, sensor) else "", deployment.title()]
                cells += [label(document, truth["best"]), percent(truth["regrets"][0]), percent(baseline(by_model["month"], "another_window"))]
                for verdict in by_model.values():
                    cells.append(f"{label(document, verdict['chosen'])}, {percent(cost(verdict))}")
                rows.append(cells)
                before = (name, sensor)
    return table(["plant", "sensor", "deployment", "best Online", "cost of 0", "spread between windows", "month starts", "year starts"], rows)


def one_step(results: Path) -> str:
    """Returns the one-step error of the temperature in deployments, by the model of the year before."""
    rows = []
    for profiles in (STEADY, CHANGING):
        for name, folder, summary in placed(results, "twelve-months", *profiles):
            names = [entry["deployment"] for entry in summary["deployments"]]
            files = [read(folder / "models" / "year" / "deployments" / one / "rollout" / "one_step.json") for one in names]
            errors = [next(entry["rmse"] for entry in of["sensors"] if entry["sensor"] == "TIT101") for of in files]
            rows.append([name, ", ".join(number(error) for error in errors), number(fmean(errors))])
    return table(["plant", "April, May, July", "mean"], rows)


def spent(times: dict) -> str:
    rows = [[name, f"{of['processor_secs']:.0f}" + ("" if of["done"] else " (not done)")] for name, of in times.items()]
    return table(["run", "processor time (s)"], rows)


def page(results: Path, times: dict) -> str:
    parts = {
        "One week: rollouts": week_rollouts(results),
        "One week: where walks end": walks(results),
        "One week: learning rates": week_choices(results),
        "Twelve months against one week: rollouts": year_rollouts(results, STEADY),
        "Twelve months against one week: what choosing costs": costs(results, "twelve-months", STEADY, ("week", "year"), "default"),
        "Fine-tuning": fine_tuning(results),
        "Fine-tuning: what choosing costs": costs(results, "fine-tuning", STEADY, ("month", "year"), "rate 0"),
        "On a plant that changes: twelve months against one week": year_rollouts(results, CHANGING),
        "On a plant that changes: what choosing a rate costs": costs(results, "twelve-months", CHANGING, ("week", "year"), "default"),
        "On a plant that changes: what fine-tuning costs": costs(results, "fine-tuning", CHANGING, ("month", "year"), "rate 0"),
        "One-step error of the temperature": one_step(results),
        "Processor time": spent(times),
    }
    return "\n\n".join(f"## {title}\n\n{part}" for title, part in parts.items())
