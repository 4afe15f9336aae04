"""Lays golden numbers out so that a diff can be read."""

import json

WIDTH = 400


def laid_out(value, indent=""):
    """Returns JSON with one array of numbers, one record or one short case per line."""
    line = json.dumps(value)
    is_row = isinstance(value, list) and not any(isinstance(each, list | dict) for each in value[:1])
    if len(line) <= WIDTH or is_row or not isinstance(value, list | dict):
        return line
    inner = indent + " "
    if isinstance(value, dict):
        lines = [f"{inner}{json.dumps(key)}: {laid_out(each, inner)}" for key, each in value.items()]
    else:
        lines = [inner + laid_out(each, inner) for each in value]
    opening, closing = "{}" if isinstance(value, dict) else "[]"
    return opening + "\n" + ",\n".join(lines) + f"\n{indent}{closing}"


def write(path, golden):
    """Writes the numbers, and prints the size of the file."""
    text = laid_out(golden) + "\n"
    assert json.loads(text) == golden
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    print(f"{path.name}: {len(text) / 1000:.0f} kB")
