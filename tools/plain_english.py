"""`python -m tools.plain_english`: words of our prose that are nearly always wrong, and what to write instead.

Looked at are the pages, the markdown of notebooks, and docstrings, comments and texts of more than one word in Python
files. Code between backticks is left out.
"""

from __future__ import annotations

import ast
import io
import json
import re
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
WORDS = {
    r"told": "known, given, stated",
    r"believed": "posterior mean",
    r"beside": "next to, together with",
    r"(is|are|so|too) sure|sure of|surer|surest|surely": "hit probability, standard error, certain",
    r"of (its|their|his|one's|somebody's) own|of somebody else's": "its own X, a separate X, X of the user",
    r"(is|as) no strike": "does not count as a strike",
    r"(is|are) (?-i:none)": "say what is missing: no floor, an unknown name, None without limits",
    r"foresees?|foreseen|foretells?|foretold": "predict",
    r"reckons?( with)?": "assume",
    r"somebody|nobody": "a person, the user, no one",
    r"lest": "so that ... not",
    r"anew": "again",
    r"but for": "except for",
    r"(was|is|were|be) broken off|broke off": "interrupted, diverged",
    r"(?<!there )(is|was) no (trial|hit|number|table|policy|node|recording|file|folder)": "is not a X; does not count",
    r"1 more": "log(1 + x)",
    r"where all is right|as one likes|that is meant|put aside": "say it in the field's words",
}
FORBIDDEN = re.compile("|".join(rf"(?P<w{i}>\b(?:{word})\b)" for i, word in enumerate(WORDS)), re.IGNORECASE)
CODE = re.compile(r"`[^`]*`|\{\w+[^}]*\}|^ +\w+(, \w+)*: ", re.MULTILINE)  # and names of arguments and in templates
PROSE = ("*.md", "docs/*.md", "docs/how-to/*.md", "docs/**/*.py", "examples/**/*.py", "notebooks/*.ipynb")
PYTHON = ("whiptool/**/*.py", "papers/**/*.py", "benchmarks/*.py", "tools/**/*.py")
EXEMPT = ("CHANGELOG.md", "tools/plain_english.py")  # what was released stays as it was written; the list itself


def markdown(text: str) -> str:
    """Return the prose of a page on its lines: of blocks of code, comments and what is printed."""

    def prose(match: re.Match[str]) -> str:
        _, *body, _ = match[0].split("\n")
        if match[1] != "text":
            body = [line[line.find("#") :] if "#" in line else "" for line in body]
        return "\n".join(["", *body, ""])

    text = re.sub(r"^```(\S*)[^\n]*\n.*?^```$", prose, text, flags=re.MULTILINE | re.DOTALL)
    return CODE.sub(lambda match: "\n" * match[0].count("\n"), text)


def python(source: str) -> Iterator[tuple[int, str]]:
    """Yield the comments and the texts of a module, each with the number of its line."""
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            yield token.start[0], token.string
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value:
            yield from enumerate(CODE.sub(lambda m: "\n" * m[0].count("\n"), node.value).split("\n"), node.lineno)


def lines_of(path: Path) -> Iterator[tuple[int, str]]:
    """Yield the lines of prose of a file, numbered; those of a notebook by cell."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".py":
        yield from python(text)
    elif path.suffix == ".md":
        yield from enumerate(markdown(text).split("\n"), 1)
    else:
        for number, cell in enumerate(json.loads(text)["cells"], 1):
            if cell["cell_type"] == "markdown":
                yield from ((number, line) for line in markdown("".join(cell["source"])).split("\n"))


def faults(path: Path) -> Iterator[str]:
    """Yield what is to be written otherwise in a file."""
    instead = list(WORDS.values())
    for number, line in lines_of(path):
        for match in FORBIDDEN.finditer(line):
            assert match.lastgroup is not None
            yield f"{path}:{number}: {match[0]!r}: {instead[int(match.lastgroup[1:])]}"


def files() -> list[Path]:
    """Return the files whose prose is looked at."""
    found = {path.relative_to(ROOT) for pattern in PROSE + PYTHON for path in ROOT.glob(pattern)}
    return sorted(path for path in found if str(path) not in EXEMPT)


if __name__ == "__main__":
    found = [fault for path in files() for fault in faults(path)]
    print(*found, sep="\n", end="\n" if found else "")
    sys.exit(bool(found))
