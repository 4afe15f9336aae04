#!/usr/bin/env python3
"""The reference of the Python package, made of its docstrings.

    python3 scripts/python_api.py            # write docs/python/*.md
    python3 scripts/python_api.py --check    # whether they are what would be written, and every public name is complete

The package is read, and not imported. Every public function says its arguments and what it returns, and every class and
function has an example.
"""

import ast
import re
import sys
import textwrap
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "python" / "calib_rl"
PAGES = ROOT / "docs" / "python"

# Pages: title, subject, the module that users import from, and the names in their order.
CONTENTS = {
    "study": (
        "Studies and verdicts",
        "Run a study from Python and read its results.",
        "calib_rl",
        ["Study", "Verdict", "ControlVerdict", "Runs", "Rollouts", "Observer", "Printed", "CalibError", "StudyError", "CalibWarning"],
    ),
    "models": (
        "Models",
        "Build a model of a frame, an array or a log, and read it as arrays.",
        "calib_rl",
        ["build_model", "Model", "ActionModel", "Action", "Decisions", "Recorded"],
    ),
    "tune": (
        "Tuning agents that act",
        "Choose the settings of an agent that acts. The guide is\n[tune your own agent](../guides/tune-your-agent.md).",
        "calib_rl",
        ["tune", "Tuned", "Failure", "ControlAgent", "Training", "AgentAction"],
    ),
    "agents": (
        "Your own agents that predict",
        "Run agents of your own in the environments of a study. The guide is\n[calib from Python](../guides/python.md#agents-of-your-own).",
        "calib_rl.agents",
        ["Agent", "Task", "Sweep", "AgentRuns", "evaluate", "grid", "Streams", "Stream", "optuna_objective", "serve"]
        + ["SimplePredictor", "Mean", "Persistence", "Ridge", "LeastSquaresTD"],
    ),
    "gym": (
        "Environments",
        "Models as environments of Gymnasium. They need the extra `gym`:\n`pip install './python[gym]'` in a checkout.",
        "calib_rl.gym",
        ["make", "make_vec", "of_path", "vector_of_path", "CalibrationEnv", "CalibrationVectorEnv"],
    ),
    "functions": (
        "Functions without a study",
        "Nearest neighbours, time warping and a simulated plant.",
        "calib_rl",
        ["knn_join", "dtw", "Warping", "simulate", "set_threads"],
    ),
}
# Names that the reference leaves out: the version, and types of arguments.
BESIDE = {"__version__", "Factory", "Values"}
SECTIONS = ("Args", "Returns", "Raises", "Warns", "Examples", "Attributes")
Definition = ast.FunctionDef | ast.ClassDef


def definitions() -> dict[str, tuple[Path, Definition]]:
    """Returns the public functions and classes of the package by name; of overloaded ones, the last."""
    found: dict[str, tuple[Path, Definition]] = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, (ast.FunctionDef, ast.ClassDef)) and not node.name.startswith("_"):
                # Names used between modules may occur twice: the public one has a docstring.
                if node.name not in found or ast.get_docstring(node):
                    found[node.name] = (path, node)
    return found


def exported(module: Path) -> set[str]:
    """Returns the names in ``__all__``; of a module without it, its public functions and classes."""
    tree = ast.parse(module.read_text(encoding="utf-8"))
    for node in tree.body:
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "__all__":
            return set(ast.literal_eval(node.value))
    public = [node for node in tree.body if isinstance(node, (ast.FunctionDef, ast.ClassDef))]
    return {node.name for node in public if not node.name.startswith("_")}


def divided(text: str) -> dict[str, str]:
    """Splits a docstring: its beginning under the empty name, then its sections."""
    parts, name = {"": []}, ""
    for line in text.splitlines():
        if (heading := line.rstrip(":")) in SECTIONS and line.endswith(":"):
            name = heading
            parts[name] = []
        else:
            parts[name].append(line)
    return {name: textwrap.dedent("\n".join(lines)).strip() for name, lines in parts.items()}


def marked(text: str) -> str:
    """Converts the reStructuredText of docstrings to Markdown."""
    text = re.sub(r"``(.+?)``", r"`\1`", text)
    return text.replace("<", "&lt;").replace("|", "\\|") if "`" not in text else text


def listed(text: str) -> list[tuple[str, str]]:
    """Returns names with their descriptions."""
    entries: list[tuple[str, str]] = []
    for line in text.splitlines():
        if (begins := re.match(r"([\w*]+): (.*)", line)) and not line.startswith(" "):
            entries.append((begins[1], begins[2]))
        elif entries:
            entries[-1] = (entries[-1][0], f"{entries[-1][1]}\n{line}")
    return entries


def wrapped(text: str, indent: str, lead: int) -> str:
    """Wraps to lines of at most 100 characters; the first line follows ``lead`` other characters."""
    lines = textwrap.wrap(
        text, 100, initial_indent=" " * lead, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
    )
    return "\n".join(lines).lstrip(" ")


def paragraphs(text: str, indent: str = "", lead: int = 0) -> str:
    """Returns wrapped paragraphs and lists; ``indent`` is that of all lines except the first."""
    out = []
    for block in re.split(r"\n\s*\n", textwrap.dedent(text)):
        for item in re.split(r"\n(?=\s*- )", block):
            is_item = item.lstrip().startswith("- ")
            first = not out
            part = wrapped(marked(" ".join(item.split())), indent + ("  " if is_item else ""), lead if first else len(indent))
            joint = "" if first else "\n" if is_item and out[-1].strip().startswith("- ") else "\n\n"
            out.append(f"{joint}{'' if first else indent}{part}")
    return "".join(out)


def signature(node: ast.FunctionDef, name: str) -> str:
    """Returns the signature, with one argument per line if one line is too long."""
    arguments = ast.parse(ast.unparse(node)).body[0].args  # type: ignore[attr-defined]
    for group in (arguments.posonlyargs, arguments.args):
        group[:] = [argument for argument in group if argument.arg not in ("self", "cls")]
    returned = f" -> {ast.unparse(node.returns)}" if node.returns is not None and node.name != "__init__" else ""
    text = re.sub(r"(?<=[\w\]])=(?=[\w'(\[{-])", " = ", ast.unparse(arguments)).replace("_MAX_STEPS", "1000")
    text = re.sub(r"\bText\b", "str | os.PathLike[str]", text)
    if len(name) + len(text) + len(returned) < 96:
        return f"{name}({text}){returned}"
    parts, depth, start = [], 0, 0
    for at, sign in enumerate(text):
        depth += (sign in "([{") - (sign in ")]}")
        if sign == "," and depth == 0:
            parts.append(text[start:at].strip())
            start = at + 1
    parts.append(text[start:].strip())
    return f"{name}(\n" + "".join(f"    {part},\n" for part in parts) + f"){returned}"


def described(documented: dict[str, str]) -> str:
    """Returns the content of a docstring as Markdown."""
    out = [paragraphs(documented[""])]
    for section, title in (("Args", "Arguments"), ("Attributes", "Attributes"), ("Raises", "Raises"), ("Warns", "Warns")):
        if entries := listed(documented.get(section, "")):
            rows = "\n".join(f"- `{name}`: {paragraphs(text, '    ', len(name) + 6)}" for name, text in entries)
            out.append(f"**{title}**\n\n{rows}")
        if section == "Args" and "Returns" in documented:
            out.append(f"**Returns**\n\n{paragraphs(documented['Returns'])}")
    if "Examples" in documented:
        for place, block in enumerate(re.split(r"\n\s*\n", documented["Examples"])):
            before = "**Example**\n\n" if place == 0 else ""
            is_code = block.lstrip().startswith(">>>")
            shown = re.sub(r" +# doctest: .*", "", block)
            out.append(before + (f"```pycon\n{shown}\n```" if is_code else paragraphs(block)))
    return "\n\n".join(out)


def is_property(node: ast.FunctionDef) -> bool:
    return any(getattr(decorator, "id", "") == "property" for decorator in node.decorator_list)


class Reference:
    """Writes pages, and collects names with incomplete documentation."""

    def __init__(self) -> None:
        self.found = definitions()
        self.missing: list[str] = []

    def function(self, node: ast.FunctionDef, name: str, level: str, title: str, wants_example: bool) -> str:
        documented = divided(ast.get_docstring(node) or "")
        taken = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
        wanted = {of.arg for of in taken if of.arg not in ("self", "cls")}
        wanted |= {of.arg for of in (node.args.vararg, node.args.kwarg) if of is not None}
        said = {entry for entry, _ in listed(documented.get("Args", ""))}
        returns = node.returns is not None and ast.unparse(node.returns) not in ("None", "Any") or "Returns" in documented
        self.require(bool(documented[""]), name, "a docstring")
        self.require(wanted <= said, name, f"arguments {', '.join(sorted(wanted - said))}")
        self.require(not returns or "Returns" in documented, name, "what it returns")
        self.require(not wants_example or "Examples" in documented, name, "an example")
        return f"{level} {title}\n\n```python\n{signature(node, name)}\n```\n\n{described(documented)}"

    def require(self, holds: bool, name: str, what: str) -> None:
        if not holds:
            self.missing.append(f"{name}: {what}")

    def class_of(self, node: ast.ClassDef, name: str) -> str:
        documented = divided(ast.get_docstring(node) or "")
        self.require(bool(documented[""]), name, "a docstring")
        self.require("Examples" in documented, name, "an example")
        methods = [of for of in node.body if isinstance(of, ast.FunctionDef)]
        out = [f"## {node.name}"]
        initial = next((of for of in methods if of.name == "__init__"), None)
        if initial is not None and "Args" in documented:
            out.append(f"```python\n{signature(initial, name)}\n```")
        out.append(described(documented))
        fields = self.fields(node, name)
        properties = [of for of in methods if is_property(of) and not of.name.startswith("_")]
        for of in properties:
            self.require(bool(ast.get_docstring(of)), f"{name}.{of.name}", "a docstring")
            told = paragraphs(divided(ast.get_docstring(of) or "")[""], "    ", len(of.name) + 6)
            fields.append(f"- `{of.name}`: {told}")
        if fields:
            out.append("**Attributes**\n\n" + "\n".join(fields))
        for of in methods:
            if not of.name.startswith("_") and not is_property(of):
                title = f"{node.name}.{of.name}"
                out.append(self.function(of, f"{name.rsplit('.', 1)[-1]}.{of.name}", "###", title, wants_example=False))
        return "\n\n".join(out)

    def fields(self, node: ast.ClassDef, name: str) -> list[str]:
        """Returns the fields of a named tuple or of a data class, with the text below each."""
        fields = []
        for at, of in enumerate(node.body):
            if isinstance(of, ast.AnnAssign) and isinstance(of.target, ast.Name) and "ClassVar" not in ast.unparse(of.annotation):
                after = node.body[at + 1] if at + 1 < len(node.body) else None
                is_told = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
                if of.target.id != "metadata":
                    self.require(is_told, f"{name}.{of.target.id}", "a text")
                    told = after.value.value if is_told else ""  # type: ignore[union-attr]
                    fields.append(f"- `{of.target.id}`: {paragraphs(str(told), '    ', len(of.target.id) + 6)}")
        return fields

    def page(self, title: str, about: str, module: str, names: list[str]) -> str:
        out = [f"# {title}", about, f"```python\nimport {module}\n```", "\n".join(f"[{name}](#{name.lower()})" + (" ·" if name != names[-1] else "") for name in names)]
        for name in names:
            path, node = self.found[name]
            full = f"{module}.{name}"
            if isinstance(node, ast.ClassDef):
                out.append(self.class_of(node, full))
            else:
                out.append(self.function(node, full, "##", name, wants_example=True))
        return "\n\n".join(out) + "\n"

    def index(self) -> str:
        rows = []
        for page, (title, _, module, names) in CONTENTS.items():
            links = ", ".join(f"[{name}]({page}.md#{name.lower()})" for name in names)
            rows.append(f"| [{title}]({page}.md) | `{module}` | {links} |")
        table = "\n".join(["| page | module | names |", "|---|---|---|", *rows])
        return (
            "# Python reference\n\n"
            "Every public name of the package, with its arguments, what it returns and an example. The\n"
            "[guide](../guides/python.md) shows how they fit together.\n\n"
            f"{table}\n\n"
            "These pages are made of the docstrings by `scripts/python_api.py`. The project's tests run the\n"
            "examples. Names that begin with an underscore make small data there, and are not for you.\n"
        )


def main() -> None:
    reference = Reference()
    pages = {f"{name}.md": reference.page(*of) for name, of in CONTENTS.items()} | {"index.md": reference.index()}
    public = exported(PACKAGE / "__init__.py") | exported(PACKAGE / "agents" / "__init__.py") | exported(PACKAGE / "gym.py")
    named = {name for _, _, _, names in CONTENTS.values() for name in names}
    reference.missing += [f"{name}: a page" for name in sorted(public - named - BESIDE)]
    if reference.missing:
        raise SystemExit("python_api.py: " + "\n".join(["these lack something:", *reference.missing]))
    PAGES.mkdir(exist_ok=True)
    there = {path.name: path.read_text(encoding="utf-8") for path in PAGES.glob("*.md")}
    if "--check" in sys.argv[1:]:
        stale = sorted(name for name in {*pages, *there} if pages.get(name) != there.get(name))
        if stale:
            raise SystemExit(f"python_api.py: run it without --check; these differ: {', '.join(stale)}")
    else:
        for name, text in pages.items():
            (PAGES / name).write_text(text, encoding="utf-8")
    print(f"{len(named)} names on {len(CONTENTS)} pages of docs/python")


if __name__ == "__main__":
    main()
