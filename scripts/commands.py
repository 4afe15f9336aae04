#!/usr/bin/env python3
"""Every command with its options, as `--help` prints them.

    python3 scripts/commands.py [CALIB]            # write docs/command-line.md
    python3 scripts/commands.py --check [CALIB]    # whether it is what would be written, and docs/commands.md has every command

CALIB is the binary, by default target/release/calib, built without libtorch.
"""

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "command-line.md"
TABLE = ROOT / "docs" / "commands.md"
BEFORE = """\
# Every command and option

`calib COMMAND --help` prints the same text, and `calib man DIR` writes it as man pages. The options
`--quiet`, `--verbose`, `--log` and `--color`, which every command has, are only
[under calib](#calib). [Commands and exit codes](commands.md) has a shorter list.
`scripts/commands.py` makes this page.

"""


def help_of(binary: Path, *command: str) -> str:
    """Returns the output of `calib COMMAND --help`."""
    # calib prints the name with which it was called.
    with tempfile.TemporaryDirectory() as folder:
        called = Path(folder) / "calib"
        called.symlink_to(binary)
        environment = {key: value for key, value in os.environ.items() if key not in ("COLUMNS", "CALIB_DATA")}
        done = subprocess.run([called, *command, "--help"], capture_output=True, text=True, check=True, env=environment)
    return "\n".join(line.rstrip() for line in done.stdout.splitlines()).strip()


def commands(text: str) -> list[str]:
    """Returns the commands that a help text lists."""
    listed = re.search(r"^Commands:\n(.*?)(?:\n\n|\Z)", text, re.MULTILINE | re.DOTALL)
    names = re.findall(r"^  ([a-z][a-z-]*)\b", listed[1], re.MULTILINE) if listed else []
    return [name for name in names if name != "help"]


def brief(text: str) -> str:
    """Removes the options that every command has, and their heading if no other option is under it."""
    option = r"\n+ (?: -\w, |     )--"
    text = re.sub(rf"{option}(?:quiet|verbose|log|color)\b.*?(?={option}|\n\n\S|\Z)", "", text, flags=re.DOTALL)
    text = re.sub(r"\n\nWhat is shown:(?=\n\n\S|\Z)", "", text)
    text = text.replace("\nWhat is shown:\n\n", "\nWhat is shown:\n")
    return re.sub(r"\n\n? +-(?:h, --help|V, --version)\n? +Print (?:help|version)[^\n]*", "", text)


def section(binary: Path, *command: str) -> str:
    text = help_of(binary, *command)
    level = "#" * (1 + len(command))
    own = f"{level} calib {' '.join(command)}\n\n```text\n{brief(text)}\n```\n"
    return "\n".join([own, *(section(binary, *command, below) for below in commands(text))])


def main() -> None:
    arguments = [argument for argument in sys.argv[1:] if argument != "--check"]
    binary = Path(arguments[0] if arguments else ROOT / "target" / "release" / "calib").resolve()
    if not binary.is_file():
        raise SystemExit(f"commands.py: there is no binary {binary}")
    whole = help_of(binary)
    names = commands(whole)
    page = BEFORE + f"## calib\n\n```text\n{whole}\n```\n\n" + "\n".join(section(binary, name) for name in names)
    table = TABLE.read_text(encoding="utf-8")
    missing = [name for name in names if f"`calib {name}" not in table]
    if missing:
        raise SystemExit(f"commands.py: docs/commands.md lacks {', '.join(missing)}")
    if "--check" in sys.argv[1:]:
        if not PAGE.exists() or PAGE.read_text(encoding="utf-8") != page:
            raise SystemExit("commands.py: docs/command-line.md is not what --help prints; run it without --check")
    else:
        PAGE.write_text(page, encoding="utf-8")
    print(f"{len(names)} commands in docs/command-line.md")


if __name__ == "__main__":
    main()
