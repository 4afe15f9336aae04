#!/usr/bin/env python3
"""Check that docs/troubleshooting.md quotes messages that calib still prints.

    python3 scripts/messages.py

Under each heading of the page there is one `text` block with a message. Numbers and names in it are examples. The rest of
it must be in the sources: at least one run of words of 20 characters, or of a third of a short message, as it stands there.
"""

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "troubleshooting.md"
SHORTEST = 20


def sources() -> str:
    """Returns all Rust sources as one text, with strings over several lines joined."""
    files = [path for folder in ("crates", "src") for path in sorted((ROOT / folder).rglob("*.rs"))]
    text = "\n".join(path.read_text(encoding="utf-8") for path in files)
    text = re.sub(r"\\\n\s*", "", text).replace('\\"', '"')
    # Placeholders become a mark, and so do the numbers of an example.
    return re.sub(r"\{[^{}\n]*\}", "\0", text)


def is_printed(message: str, source: str) -> bool:
    """Whether some run of its words occurs in the sources."""
    words = message.split()
    least = min(SHORTEST, 0.35 * len(message))
    for first in range(len(words)):
        for last in range(first + 1, len(words) + 1):
            part = " ".join(words[first:last])
            if len(part) >= least:
                # If this run does not occur, no longer one does.
                if part in source:
                    return True
                break
    return False


def main() -> None:
    page, source = PAGE.read_text(encoding="utf-8"), sources()
    entries = re.findall(r"^### (.+?)\n\n```text\n(.*?)\n```", page, re.MULTILINE | re.DOTALL)
    headings = re.findall(r"^### (.+)$", page, re.MULTILINE)
    if not entries or len(entries) != len(headings) or len(set(headings)) != len(headings):
        raise SystemExit("messages.py: every heading of the third level needs a message, and a name of its own")
    stale = [heading for heading, message in entries if not is_printed(" ".join(message.split()), source)]
    if stale:
        raise SystemExit(f"messages.py: calib no longer prints the message under: {'; '.join(stale)}")
    print(f"{len(entries)} messages of docs/troubleshooting.md are in the sources")


if __name__ == "__main__":
    main()
