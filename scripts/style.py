#!/usr/bin/env python3
"""How plain the pages are: lengths of sentences, semicolons, long lines, banned phrasings.

    python3 scripts/style.py                 a table, page by page and group by group
    python3 scripts/style.py --longest 5     with the longest sentences of each page
    python3 scripts/style.py --check         fails at what STYLE.md does not allow, with file and line
    python3 scripts/style.py --wrap FILE...  wraps the prose of pages at 100 columns
    python3 scripts/style.py --self-test     tests the splitting of pages, sentences and strings

Only prose is measured: paragraphs and list items of four words or more. Code, tables and headings are not, except that
banned phrasings are looked for in tables and headings too, and that sentences in cells have a limit. Inline code counts as one word. Messages of the program are
looked at for banned phrasings alone: string literals of more than two words, the help of its commands, and what the
schema of a study says of its keys.
"""

import argparse
import re
import sys
from dataclasses import dataclass, field, replace
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
COLUMNS = 100


@dataclass(frozen=True)
class Limits:
    """Limits of a page."""

    mean: float  # words per sentence
    longest: int  # words in any sentence
    semicolons: float  # per 100 sentences; one is always allowed
    wrapped: bool = True  # whether its prose ends at column 100


TIGHT = Limits(mean=17, longest=35, semicolons=3)
LOOSE = Limits(mean=20, longest=45, semicolons=8)

# Lists of names need some semicolons; more of them join unrelated facts.
CELL_SEMICOLONS = 3

# In the order of the table. A page belongs to the first group with a matching pattern.
GROUPS = [
    ("README", TIGHT, ["README.md", "python/README.md"]),
    ("guides", TIGHT, ["docs/guides/*.md"]),
    ("reference", LOOSE, [f"docs/{page}.md" for page in ("study", "formats", "metrics", "models", "representations", "commands")]),
    (
        "evidence",
        LOOSE,
        [
            f"docs/{page}.md"
            for page in ("validity", "control", "paper-map", "paper-studies", "fine-tuning", "performance", "reliability")
        ],
    ),
    ("questions", TIGHT, ["docs/*.md", "docs/*/*.md"]),
    ("design", LOOSE, ["DESIGN.md", "ARCHITECTURE.md"]),
    ("project", LOOSE, ["STYLE.md", "CONTRIBUTING.md", "SECURITY.md", "CHANGELOG.md", "crates/*/README.md"]),
]

# Banned phrasings, each with its replacement. STYLE.md lists the same.
BANNED = [
    (r"\blikewise\b", "name it again, or: also"),
    (r"(?<!there )\b(?:is|are) none\b", "is not one, or: there is no …"),
    (r"\b(?:a|one) (?:row|column|file|line|job|task|array|channel|page|record) an? (?!(?:few|time\b))\w+", "one … per …"),
    (r"\bwhat nobody\b", "name it: the default, an unused key"),
    (r"\bsays so\b|\bsaying so\b|\bsay so\b", "warns, reports, prints …"),
    (r"\bsays what it takes\b", "estimates time and memory"),
    (r"\bstands? still\b|\bstood still\b|\bstandstills?\b", "is constant, does not change"),
    (r"(?:\bit|\bthat|\bwhich|\bcalib|`|\bCODE|\bstate|\bwindow) wants\b", "needs"),
    (r"\bas far as the logs? can tell\b", "on this evidence"),
    (r"\bled out of\b", "given an exit"),
    (r"\bspared\b", "saved, skipped"),
    (r"\bother draws\b", "resamples"),
    (r"\bthe same of\b", "the same for"),
    (r"\bhas no sense\b", "makes no sense"),
    (r"\bin vain\b", "it will fail again"),
    (r"(?:^|(?<=[.!?:] ))Of (?:several|approximate|these|those|such|them)\b", "start with the subject"),
    (r"(?:^|(?<=[.!?] ))Who [a-z]+s\b", "If you …"),
    (r"(?:^|(?<=[.!?] ))What (?:is|was|are|were) (?!\w+\?)[^?.]*[^?.]{20}\.", "start with the thing itself"),
    (r"\bbehind \*?Why\b", "under *Why*"),
    (r"\bwhat is held out\b", "the held-out period"),
    (r"\bnobody has to\b|\bnobody learns\b|\bno value learns\b", "no setting learns; you need not"),
]

EXAMPLES = re.compile(r"\b(?:for example|for instance|such as)\b|\be\.g\.", re.IGNORECASE)
YOU = re.compile(r"\b(?:you|your|yours)\b", re.IGNORECASE)
ITEM = re.compile(r"^(\s*)([-*+]|\d+[.)])\s+")
ABBREVIATIONS = ("e.g.", "i.e.", "cf.", "vs.", "etc.", "App.", "Fig.", "Eq.", "Sec.", "No.", "et al.", "resp.", "approx.")


@dataclass(frozen=True)
class Breach:
    """Place where a rule is broken."""

    line: int
    what: str
    file: str = ""


# Pages -----------------------------------------------------------------------------------------------------------------


@dataclass
class Block:
    """Lines of a page that belong together."""

    kind: str  # paragraph, item, table, heading, code, blank, raw
    first: int  # number of the first line, from 1
    lines: list[str] = field(default_factory=list)

    @property
    def is_prose(self) -> bool:
        return self.kind in ("paragraph", "item")

    def text(self) -> str:
        """Returns the words of prose as one line."""
        lines = [line.strip().removeprefix("> ") for line in self.lines]
        if self.kind == "item":
            lines[0] = ITEM.sub("", lines[0])
        return " ".join(lines)


def is_numbered_later(line: str) -> bool:
    """Whether a line looks like an item of a list that does not begin with 1: it cannot interrupt a paragraph."""
    number = re.match(r"\s*(\d+)[.)]\s", line)
    return number is not None and int(number.group(1)) != 1


def blocks(page: str) -> list[Block]:
    """Splits a page into its blocks."""
    found: list[Block] = []
    fence = None
    in_list = False
    for number, line in enumerate(page.splitlines(), start=1):
        bare = line.strip()
        last = found[-1] if found else None
        indent = len(line) - len(line.lstrip())
        if fence is not None:
            last.lines.append(line)
            if bare.startswith(fence) and not bare.strip(fence[0]):
                fence = None
            continue
        if opening := re.match(r"^\s*(`{3,}|~{3,})", line):
            fence = opening.group(1)
            found.append(Block("code", number, [line]))
            in_list = in_list and indent > 0
            continue
        continues = last is not None and last.first + len(last.lines) == number
        if not bare:
            found.append(Block("blank", number, [line]))
        elif bare.startswith("|"):
            if continues and last.kind == "table":
                last.lines.append(line)
            else:
                found.append(Block("table", number, [line]))
            in_list = False
        elif re.match(r"^#{1,6} ", line):
            found.append(Block("heading", number, [line]))
            in_list = False
        elif bare.startswith(("<", "![", "[^")) or re.match(r"^(-{3,}|={3,}|\[[^\]]+\]: )", bare):
            found.append(Block("raw", number, [line]))
        elif ITEM.match(line) and not (continues and last.kind == "paragraph" and is_numbered_later(line)):
            found.append(Block("item", number, [line]))
            in_list = True
        elif continues and last.is_prose:
            last.lines.append(line)
        elif indent >= 4 and not in_list:
            if continues and last.kind == "code":
                last.lines.append(line)
            else:
                found.append(Block("code", number, [line]))
        else:
            found.append(Block("paragraph", number, [line]))
            in_list = in_list and indent > 0
    return found


def plain(text: str) -> str:
    """Returns prose as it is read: code is one word, and links are their text."""
    text = re.sub(r"(`+)(?!`).+?(?<!`)\1(?!`)", "CODE", text)
    text = re.sub(r"!\[[^\]]*\]\([^)]*\)", "", text)
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text)
    text = re.sub(r"<[^>]+>", "", text)
    return re.sub(r"\*\*|(?<!\w)[*_]|[*_](?!\w)", "", text)


def sentences(text: str) -> list[str]:
    """Returns the sentences of a line of plain prose."""
    found, begin = [], 0
    for end in re.finditer(r"[.!?][\"')\]]*(?=\s+[\"'(\[]*(?:[A-Z0-9γψ…]|calib\b))", text):
        so_far = text[begin : end.end()]
        if so_far.rstrip("\"')]").endswith(ABBREVIATIONS) or re.search(r"^\d+\.$|(?:^|\s)[A-Z]\.$", so_far):
            continue
        found.append(so_far.strip())
        begin = end.end()
    found.append(text[begin:].strip())
    return [sentence for sentence in found if sentence]


def words(sentence: str) -> int:
    """Counts the words."""
    return sum(1 for word in sentence.split() if re.search(r"\w", word))


# Measures --------------------------------------------------------------------------------------------------------------


@dataclass
class Measure:
    """Measurements of a page or a group."""

    lengths: list[int] = field(default_factory=list)
    semicolons: int = 0
    you: int = 0
    examples: int = 0
    outputs: int = 0
    long_lines: int = 0
    banned: int = 0

    def add(self, other: "Measure") -> None:
        self.lengths += other.lengths
        for name in ("semicolons", "you", "examples", "outputs", "long_lines", "banned"):
            setattr(self, name, getattr(self, name) + getattr(other, name))

    @property
    def mean(self) -> float:
        return sum(self.lengths) / max(1, len(self.lengths))

    def per_100_sentences(self, count: int) -> float:
        return 100 * count / max(1, len(self.lengths))

    def row(self, name: str) -> str:
        over = self.per_100_sentences(sum(1 for length in self.lengths if length > 30))
        return (
            f"{name:<44}{sum(self.lengths):>7}{len(self.lengths):>6}{self.mean:>7.1f}{max(self.lengths, default=0):>6}{over:>6.0f}"
            f"{self.per_100_sentences(self.semicolons):>7.1f}{1000 * self.you / max(1, sum(self.lengths)):>6.1f}"
            f"{self.per_100_sentences(self.examples):>6.1f}{self.outputs:>5}{self.long_lines:>7}{self.banned:>7}"
        )


HEADER = f"{'page':<44}{'words':>7}{'sent.':>6}{'mean':>7}{'max':>6}{'>30 %':>6}{'; /100':>7}{'you‰':>6}{'e.g.%':>6}{'out':>5}{'>100':>7}{'banned':>7}"


@dataclass
class Sentence:
    """A sentence of a page."""

    line: int
    words: int
    text: str


@dataclass
class Page:
    """Measurements of a page, and the places where it breaks a rule."""

    measure: Measure
    sentences: list[Sentence]  # the longest first
    breaches: list[Breach]


def line_of(block: Block, sentence: str) -> int:
    """Returns the line of a block in which a sentence begins, as found by its first words."""
    first = " ".join(sentence.split()[:2])
    for place, line in enumerate(block.lines):
        if first in plain(line):
            return block.first + place
    return block.first


def banned_in(text: str) -> list[str]:
    """Returns the banned phrasings of a text, each with its replacement."""
    found = []
    for pattern, cure in BANNED:
        # A phrasing at the beginning of a sentence has a capital letter.
        flags = 0 if pattern.startswith("(?:^") else re.IGNORECASE
        found += [f"“{hit.group(0).strip()}”: {cure}" for hit in re.finditer(pattern, text, flags)]
    return found


def is_list_of_phrasings(block: Block) -> bool:
    """Whether this is the table of banned phrasings in STYLE.md."""
    return block.kind == "table" and block.lines[0] == "| not | but |"


def long_cell(cell: str, limits: Limits) -> list[str]:
    """Returns what is too long in a table cell. Sentences have the limit of the page, and semicolons that of a cell."""
    found = [
        f"{words(sentence)} words in a sentence of a cell, at most {limits.longest}: {sentence[:60]}…"
        for sentence in sentences(cell)
        if words(sentence) > limits.longest
    ]
    if cell.count(";") > CELL_SEMICOLONS:
        found.append(f"{cell.count(';')} semicolons in a cell, at most {CELL_SEMICOLONS}: {cell[:60]}…")
    return found


def is_long(line: str) -> bool:
    """Whether a line of prose could end earlier."""
    return len(line) > COLUMNS and len(tokens(line.strip())) > 1 + bool(ITEM.match(line))


def measured(text: str, limits: Limits) -> Page:
    """Measures a page against its limits."""
    measure = Measure()
    found: list[Sentence] = []
    breaches: list[Breach] = []
    before = Block("blank", 0)
    for block in blocks(text):
        if block.kind in ("table", "heading", "raw") and not is_list_of_phrasings(block):
            for place, line in enumerate(block.lines):
                shown = plain(line)
                for cell in shown.strip("|").split(" | ") if block.kind == "table" else [shown]:
                    breaches += [Breach(block.first + place, what) for what in banned_in(cell.strip())]
                    if block.kind == "table":
                        breaches += [Breach(block.first + place, what) for what in long_cell(cell.strip(), limits)]
        if block.kind == "item" and before.kind in ("paragraph", "heading") and is_numbered_later(block.lines[0]):
            if before.kind == "heading" or not before.lines[0].startswith(" "):
                breaches.append(Breach(block.first, "a list that does not begin with 1, or a sentence that was cut"))
        if block.kind != "blank":
            before = block
        if block.kind == "code" and block.lines[0].strip() in ("```text", "```console"):
            measure.outputs += 1
        if not block.is_prose:
            continue
        for place, line in enumerate(block.lines):
            if is_long(line):
                measure.long_lines += 1
                if limits.wrapped:
                    breaches.append(Breach(block.first + place, f"{len(line)} columns, at most {COLUMNS}"))
        prose = plain(block.text())
        if words(prose) < 4:
            continue
        measure.you += len(YOU.findall(prose))
        measure.examples += len(EXAMPLES.findall(prose))
        for sentence in sentences(prose):
            line = line_of(block, sentence)
            length = words(sentence)
            measure.lengths.append(length)
            measure.semicolons += sentence.count(";")
            found.append(Sentence(line, length, sentence))
            if length > limits.longest:
                told = f"{length} words in a sentence, at most {limits.longest}: {sentence[:60]}…"
                breaches.append(Breach(line, told))
            breaches += [Breach(line, what) for what in banned_in(sentence)]
    measure.banned = sum(1 for breach in breaches if breach.what.startswith("“"))
    if measure.mean > limits.mean:
        breaches.append(Breach(1, f"{measure.mean:.1f} words a sentence on average, at most {limits.mean:g}"))
    if measure.semicolons > max(1, limits.semicolons * len(measure.lengths) / 100):
        per = measure.per_100_sentences(measure.semicolons)
        breaches.append(Breach(1, f"{per:.0f} semicolons in 100 sentences, at most {limits.semicolons:g}"))
    return Page(measure, sorted(found, key=lambda sentence: -sentence.words), breaches)


# Messages --------------------------------------------------------------------------------------------------------------


def messages(source: str) -> list[tuple[int, str]]:
    """Returns the string literals of Rust code that users may read, with their lines: those of more than two words outside tests."""
    code = source.split("#[cfg(test)]", 1)[0]
    found = []
    pattern = re.compile(
        r"""//[^\n]*|/\*.*?\*/|'(?:[^'\\\n]|\\.[^']*)'|r(?P<marks>\#*)"(?P<raw>.*?)"(?P=marks)|"(?P<text>(?:[^"\\]|\\.)*)\"""",
        re.DOTALL,
    )
    for literal in pattern.finditer(code):
        text = literal.group("text") if literal.group("raw") is None else literal.group("raw")
        before = code[max(0, literal.start() - 12) : literal.start()]
        if text is None or re.search(r"(?:expect|panic!|unreachable!|assert\w*!)\(\s*$", before):
            continue
        text = re.sub(r"\\\n\s*", "", text).replace('\\"', '"')
        if len(text.split()) > 2:
            found.append((code.count("\n", 0, literal.start()) + 1, text))
    return found


def helps(source: str) -> list[tuple[int, str]]:
    """Returns the documentation of the command line's grammar, which clap prints."""
    return [
        (number, line.strip().removeprefix("///").strip())
        for number, line in enumerate(source.splitlines(), start=1)
        if line.strip().startswith("///")
    ]


def message_breaches() -> list[Breach]:
    """Returns banned phrasings in the messages of the program."""
    found: list[Breach] = []
    for path in sorted([*ROOT.glob("crates/*/src/**/*.rs"), *ROOT.glob("src/**/*.rs")]):
        name = path.relative_to(ROOT).as_posix()
        if "/tests" in name or path.stem in ("tests", "test"):
            continue
        source = path.read_text()
        told = messages(source)
        if name.startswith("src/cli"):
            told += helps(source)
        found += [Breach(line, what, name) for line, text in told for what in banned_in(text)]
    schema = "configs/study.schema.json"
    for line, text in enumerate((ROOT / schema).read_text().splitlines(), start=1):
        if described := re.match(r'\s*"description": "(.*)"', text):
            found += [Breach(line, what, schema) for what in banned_in(plain(described.group(1)))]
    return found


# Wrapping --------------------------------------------------------------------------------------------------------------


TOKEN = re.compile(r"(?:(`+)(?!`).+?(?<!`)\1(?!`)|\[[^\]]*\]\([^)]*\)|\]\([^)]*\)|[^\s`]|`)+")


def tokens(text: str) -> list[str]:
    """Splits a line where it may be wrapped: into words, with code and links kept whole."""
    return [found.group(0) for found in TOKEN.finditer(text)]


# Tokens that would have another meaning at the beginning of a line.
BEGINS_A_BLOCK = re.compile(r"^(?:[-+*]$|[>|<]|=+$|-+$|~~~|#{1,6}$|\d+[.)]$|!\[|\[\^|```)")


def wrap(page: str) -> str:
    """Returns the page with its prose wrapped."""
    out = []
    for block in blocks(page):
        if not block.is_prose or any(line.endswith(("  ", "\\")) for line in block.lines):
            out += block.lines
            continue
        first = block.lines[0]
        marker = ITEM.match(first)
        lead = marker.group(0) if block.kind == "item" else first[: len(first) - len(first.lstrip())]
        quote = "> " if first.lstrip().startswith("> ") else ""
        rest = " " * len(lead) + quote
        lines: list[list[str]] = [[]]
        for token in tokens(block.text()):
            width = len(lead + quote) + sum(len(word) + 1 for word in lines[-1]) + len(token)
            if lines[-1] and width > COLUMNS:
                carried = [token]
                while BEGINS_A_BLOCK.match(carried[0]) and len(lines[-1]) > 1:
                    carried.insert(0, lines[-1].pop())
                lines.append(carried)
            else:
                lines[-1].append(token)
        out += [(rest if place else lead + quote) + " ".join(line) for place, line in enumerate(lines)]
    return "\n".join(out) + "\n"


# The commands ----------------------------------------------------------------------------------------------------------


def grouped() -> list[tuple[str, Limits, list[str]]]:
    """Returns the pages of each group."""
    taken: set[str] = set()
    found = []
    for name, limits, patterns in GROUPS:
        paths = [path for pattern in patterns for path in sorted(ROOT.glob(pattern))]
        pages = [path.relative_to(ROOT).as_posix() for path in paths]
        pages = list(dict.fromkeys(page for page in pages if page not in taken))
        taken.update(pages)
        found.append((name, limits, pages))
    return found


def self_test() -> None:
    """Tests the functions that the measurements use."""
    cases = {
        "One. Two": ["One.", "Two"],
        "It costs 3.5 % more. calib says why.": ["It costs 3.5 % more.", "calib says why."],
        "Use a kNN, e.g. Euclidean. See App. B for more.": ["Use a kNN, e.g. Euclidean.", "See App. B for more."],
        "Is it? Yes! (It is.) Good.": ["Is it?", "Yes!", "(It is.)", "Good."],
        "Set it to 1. Run it with K. Smith.": ["Set it to 1.", "Run it with K. Smith."],
        "Set CODE to one. CODE is next.": ["Set CODE to one.", "CODE is next."],
        "a sentence that ends in lower case. then goes on": ["a sentence that ends in lower case. then goes on"],
        "γ is near 1.0. ψ is a map.": ["γ is near 1.0.", "ψ is a map."],
    }
    for text, expected in cases.items():
        assert sentences(text) == expected, (text, sentences(text))
    assert plain("**Read** [the `a b` page](x.md#y), *please* `x = 1`.") == "Read the CODE page, please CODE."
    assert plain("gap_tolerance and _this_") == "gap_tolerance and this"
    assert words("a – b — c1 CODE, (d)") == 5
    page = "# T\n\nOne two three four;\nfive.\n\n- item `a\n  b` c\n\n  more of it\n\n```sh\nx; y\n```\n\n    code\n\n| a | b |\n|---|---|\n| c | d |\n"
    kinds = [(block.kind, block.first) for block in blocks(page) if block.kind != "blank"]
    expected = [("heading", 1), ("paragraph", 3), ("item", 6), ("paragraph", 9), ("code", 11), ("code", 15), ("table", 17)]
    assert kinds == expected, kinds
    measure = measured(page, TIGHT).measure
    assert measure.semicolons == 1 and measure.lengths[0] == 5, measure
    assert [breach.line for breach in measured("x y z w " * 20, TIGHT).breaches] == [1, 1, 1]
    cut = "What it costs (rate\n0) is known.\n"
    assert [block.kind for block in blocks(cut)] == ["paragraph"] and wrap(cut) == "What it costs (rate 0) is known.\n"
    assert [breach.line for breach in measured("What it costs (rate\n\n0) is known.\n", TIGHT).breaches] == [3]
    assert not measured("Some words: a list\n\n1. one\n2. two\n", TIGHT).breaches
    assert len(measured("| a |\n|---|\n| " + "word " * 36 + "|\n| a; b; c; d; e |\n", TIGHT).breaches) == 2
    long = "- " + "word " * 30 + "`code that is kept whole` [a link](to/a/page.md) - 1. end"
    wrapped = wrap(long)
    assert all(len(line) <= COLUMNS for line in wrapped.splitlines()) and "`code that is kept whole`" in wrapped
    assert not re.search(r"\n\s*(?:- |1\. )", wrapped[1:]) and wrap(wrapped) == wrapped
    assert wrapped.split() == long.split()
    source = 'fn a() { b("one two three \\\n    four"); c(\'"\', "is none of it"); x.expect("it is none"); } // "is none"\n#[cfg(test)] "is none"'
    assert messages(source) == [(1, "one two three four"), (2, "is none of it")], messages(source)
    assert banned_in("A sensor that stands still, likewise.") and not banned_in("What is a setting? It is a value.")
    told = re.findall(r"^\| (.+?) \| .+ \|$", (ROOT / "STYLE.md").read_text().split("## Banned phrasings")[1].split("\n## ")[0], re.MULTILINE)
    for phrase in told[1:]:
        assert banned_in(plain(phrase).strip("“”")), f"STYLE.md bans “{phrase}”, and style.py does not"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="fail where a rule of STYLE.md is broken")
    parser.add_argument("--longest", type=int, default=0, metavar="N", help="show the longest sentences of each page")
    parser.add_argument("--messages", action="store_true", help="list banned phrasings in messages of the program")
    parser.add_argument("--self-test", action="store_true", help="test this script")
    parser.add_argument("--wrap", nargs="+", metavar="FILE", help="wrap the prose of these pages")
    parser.add_argument("pages", nargs="*", help="only these pages of the repository")
    asked = parser.parse_args()
    if asked.self_test:
        self_test()
        return 0
    if asked.wrap:
        for name in asked.wrap:
            Path(name).write_text(wrap(Path(name).read_text()))
        return 0
    breaches: list[Breach] = []
    print(HEADER)
    for group, limits, pages in grouped():
        total = Measure()
        for name in pages:
            if asked.pages and name not in asked.pages:
                continue
            page = measured((ROOT / name).read_text(), limits)
            total.add(page.measure)
            breaches += [replace(breach, file=name) for breach in page.breaches]
            print(page.measure.row(name))
            for sentence in page.sentences[: asked.longest]:
                print(f"    {name}:{sentence.line}: {sentence.words} words: {sentence.text}")
        if total.lengths and not asked.pages:
            print(total.row(f"= {group}"))
    if not asked.pages:
        breaches += message_breaches()
    if asked.check or asked.messages:
        self_test()
        shown = [breach for breach in breaches if asked.check or breach.file.endswith(".rs")]
        for breach in shown:
            print(f"{breach.file}:{breach.line}: {breach.what}", file=sys.stderr)
        if shown and asked.check:
            print(f"style.py: {len(shown)} breaches of STYLE.md", file=sys.stderr)
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
