#!/usr/bin/env python3
"""Run the commands of the guides, so that they stay true.

    python3 scripts/guides.py [CALIB]

Every page of docs/guides is run in a folder of its own, which has nothing but `python` of the checkout: its
`sh` blocks, in order, as one shell script that stops at the first failure. CALIB is the binary, by default target/release/calib.
`read_outputs.py` is run on what the page about the report leaves.
"""

import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
GUIDES = ROOT / "docs" / "guides"
PINNED = ["polars==2.1.0", "numpy==2.4.6"]


def python_with_polars() -> Path:
    """Returns an interpreter with the pinned packages."""
    home = Path(os.environ.get("CALIB_TOOLS", ROOT / "target" / "tools")) / "guides"
    python = home / "bin" / "python"
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", home], check=True)
    subprocess.run([python, "-m", "pip", "install", "--quiet", *PINNED], check=True)
    return python


def main() -> None:
    binary = Path(sys.argv[1] if len(sys.argv) > 1 else ROOT / "target" / "release" / "calib").resolve()
    pages = sorted(GUIDES.glob("*.md"))
    if not pages or not binary.is_file():
        raise SystemExit(f"guides.py: no pages in {GUIDES}, or no binary {binary}")
    environment = {**os.environ, "PATH": f"{binary.parent}{os.pathsep}{os.environ['PATH']}", "NO_COLOR": "1"}
    for page in pages:
        blocks = re.findall(r"^```sh\n(.*?)^```$", page.read_text(), re.MULTILINE | re.DOTALL)
        if not blocks:
            raise SystemExit(f"guides.py: {page.name} has no commands")
        with tempfile.TemporaryDirectory() as folder:
            begun = time.monotonic()
            (Path(folder) / "python").symlink_to(ROOT / "python")
            script = "set -euo pipefail\n" + "".join(blocks)
            done = subprocess.run(["bash", "-c", script], cwd=folder, env=environment, capture_output=True, text=True)
            if done.returncode != 0:
                raise SystemExit(f"guides.py: {page.name} fails ({done.returncode}):\n{done.stdout[-2000:]}\n{done.stderr[-4000:]}")
            print(f"{page.name}: {len(blocks)} blocks in {time.monotonic() - begun:.0f} s")
            if page.stem == "reading-the-report":
                reader = [python_with_polars(), GUIDES / "read_outputs.py", "first/results"]
                subprocess.run(reader, cwd=folder, check=True, stdout=subprocess.DEVNULL)
                print("read_outputs.py: reads them")


if __name__ == "__main__":
    main()
