#!/usr/bin/env python3
"""The documents as a site, and every link between them checked.

    python3 scripts/site.py [FOLDER]

The pages are the Markdown files of the repository, where they are and under the names that they have: the site is a copy of them, with what
they link to, built by MkDocs into FOLDER (default: target/site). A link to a file or heading that is not there, and a page that the contents
below do not name, is an error. Headings have the addresses that GitHub gives them, so that links hold there too.
"""

import logging
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PINNED = "mkdocs==1.6.1"

CONTENTS = [
    {"calib": "README.md"},
    {
        "Start": [
            {"Your first study": "docs/guides/first-study.md"},
            {"Your own logs": "docs/guides/your-own-logs.md"},
            {"A real plant, from export to decision": "docs/real-plant.md"},
            {"calib from Python": "docs/guides/python.md"},
        ]
    },
    {
        "Concepts": [
            {"How calib works": "docs/how-calib-works.md"},
            {"When not to use calib": "docs/when-not.md"},
            {"Replay or model?": "docs/replay-or-model.md"},
            {"Gamma, steps and subsample": "docs/gamma-steps-subsample.md"},
            {"How much log do I need?": "docs/how-much-log.md"},
            {"Models": "docs/models.md"},
            {"Representations": "docs/representations.md"},
            {"Jump rates": "docs/jump-rates.md"},
            {"Questions": "docs/faq.md"},
        ]
    },
    {
        "How-to": [
            {"Exports of historians": "docs/guides/exports.md"},
            {"Interpret your verdict": "docs/guides/interpret-your-verdict.md"},
            {"Reading the report": "docs/guides/reading-the-report.md"},
            {"Troubleshooting": "docs/troubleshooting.md"},
            {"Which model, which distance": "docs/guides/which-model.md"},
            {"A year of data": "docs/guides/a-year-of-data.md"},
            {"Fine-tune a pre-trained agent": "docs/guides/fine-tune.md"},
            {"Tune your own agent": "docs/guides/tune-your-agent.md"},
            {"An agent that acts": "docs/guides/control.md"},
            {"Agents of any program": "docs/guides/external-agents.md"},
            {"Optuna and Ray Tune": "docs/optuna-and-ray.md"},
            {"More than one machine": "docs/guides/cluster.md"},
        ]
    },
    {
        "Reference": [
            {"Commands and exit codes": "docs/commands.md"},
            {"Every command and option": "docs/command-line.md"},
            {"Every key of a study": "docs/study.md"},
            {
                "Python": [
                    {"All names": "docs/python/index.md"},
                    {"Studies and verdicts": "docs/python/study.md"},
                    {"Models": "docs/python/models.md"},
                    {"Tuning agents that act": "docs/python/tune.md"},
                    {"Your own agents that predict": "docs/python/agents.md"},
                    {"Environments": "docs/python/gym.md"},
                    {"Functions": "docs/python/functions.md"},
                ]
            },
            {"What every number means": "docs/metrics.md"},
            {"Every file": "docs/formats.md"},
            {"Glossary": "docs/glossary.md"},
        ]
    },
    {
        "Evidence": [
            {"Does calib choose well?": "docs/validity.md"},
            {"Agents that act": "docs/control.md"},
            {"The paper's studies": "docs/paper-studies.md"},
            {"Fine-tuning": "docs/fine-tuning.md"},
            {"Performance": "docs/performance.md"},
            {"Reliability": "docs/reliability.md"},
        ]
    },
    {
        "Project": [
            {"Why things are so": "DESIGN.md"},
            {"Where things are": "ARCHITECTURE.md"},
            {"From the paper to the code": "docs/paper-map.md"},
            {"Contributing": "CONTRIBUTING.md"},
            {"Style": "STYLE.md"},
            {"Security": "SECURITY.md"},
            {"Changes": "CHANGELOG.md"},
        ]
    },
]


def pages(contents: list) -> list[str]:
    """Returns the files of the contents, in order."""
    found = []
    for entry in contents:
        for what in entry.values():
            found += [what] if isinstance(what, str) else pages(what)
    return found


def interpreter() -> Path:
    """Returns a Python that has MkDocs."""
    # The path is not resolved: an environment may be a link.
    home = Path(os.path.abspath(os.environ.get("CALIB_TOOLS", ROOT / "target" / "tools"))) / "site"
    python = home / "bin" / "python"
    if not (home / PINNED).exists():
        subprocess.run([sys.executable, "-m", "venv", home], check=True)
        subprocess.run([python, "-m", "pip", "install", "--quiet", PINNED], check=True)
        (home / PINNED).touch()
    return python


def address(heading: str, separator: str = "-") -> str:
    """Returns the anchor of a heading, as GitHub builds it."""
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", separator)


def gather(copy: Path) -> None:
    """Copies the pages, and the files that they link to, to the same paths as in the repository."""
    known = pages(CONTENTS)
    there = {str(page.relative_to(ROOT)) for page in [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]}
    if there != set(known):
        raise SystemExit(f"site.py: the contents and the pages differ in {sorted(there ^ set(known))}")
    wanted = list(known)
    for page in known:
        for link in re.findall(r"\]\(([^)#\s]+)", (ROOT / page).read_text()):
            if "://" not in link:
                target = (ROOT / page).parent.joinpath(link).resolve()
                if target.is_file() and target.is_relative_to(ROOT):
                    wanted.append(str(target.relative_to(ROOT)))
    copy.mkdir(parents=True)
    shutil.copyfile(ROOT / "scripts" / "site.css", copy / "site.css")
    for name in dict.fromkeys(wanted):
        (copy / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / name, copy / name)


def build(copy: Path, out: Path) -> None:
    from mkdocs.commands.build import build as build_site
    from mkdocs.config.base import load_config

    class Counter(logging.Handler):
        """Records that there were warnings; all of them are shown before the end."""

        warned = False

        def emit(self, record: logging.LogRecord) -> None:
            if record.levelno >= logging.WARNING:
                Counter.warned = True
                print(f"site.py: {record.getMessage()}", file=sys.stderr)

    logging.getLogger("mkdocs").addHandler(Counter())
    config = load_config(
        config_file=str(ROOT / "scripts" / "site.yml"),
        docs_dir=str(copy),
        site_dir=str(out),
        nav=CONTENTS,
    )
    config.mdx_configs["toc"] = {"slugify": address, "permalink": True, "toc_depth": 3}
    build_site(config)
    if Counter.warned:
        raise SystemExit(1)


def main() -> None:
    out = Path(sys.argv[1] if len(sys.argv) > 1 else ROOT / "target" / "site").resolve()
    python = interpreter()
    if Path(sys.prefix) != python.parents[1]:
        raise SystemExit(subprocess.run([python, __file__, out]).returncode)
    copy = out.with_name(f"{out.name}-pages")
    shutil.rmtree(copy, ignore_errors=True)
    gather(copy)
    build(copy, out)
    shutil.rmtree(copy)
    print(f"{len(pages(CONTENTS))} pages in {out}")


if __name__ == "__main__":
    main()
