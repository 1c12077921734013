"""How large and how tangled the package is: counts that a merge should lower.

python -m tools.house [--json]
"""

from __future__ import annotations

import ast
import json
import re
import sys
from collections import Counter
from functools import cache
from pathlib import Path

import grimp

ROOT = Path(__file__).resolve().parents[1]
LONG, MANY = 60, 8  # lines and parameters of a function
HIT_RULE = re.compile(r"<=?\s*[\w.]*(hit_radius|hitRadius)\b|\b(hit_radius|hitRadius)\b[\w.\[\], ]*\s*>=?\s")
ARM_KIND = re.compile(r"isinstance\([\w.]*arm\b|type\([\w.]*arm\)|case \w*Arm(Parameters)?\(")
DIMENSION = re.compile(r"\.dimension *(==|!=|<|>|in\b)|(==|!=) *[\w.]*\.dimension\b")
PLANNERS, PLANNING = {"planner", "planning", "aiming"}, {"plan", "replan", "aim", "intercept"}  # modules, functions
OTHER_SOURCES = (".js", ".css", ".html", ".cpp", ".c", ".h")
DOORS = {"__init__", "__main__"}


def lines(folder: Path) -> int:
    """Lines of Python files, comments and blank lines included."""
    return sum(len(file.read_text().splitlines()) for file in folder.rglob("*.py"))


def other_lines(folder: Path) -> int:
    """Lines of what is no Python, such as the script of a page."""
    return sum(len(file.read_text().splitlines()) for file in folder.rglob("*") if file.suffix in OTHER_SOURCES)


def plans(file: Path, tree: ast.Module) -> bool:
    """Whether a module plans strikes: it is named so, or defines a function that is."""
    return file.stem in PLANNERS or any(isinstance(x, ast.FunctionDef) and x.name in PLANNING for x in tree.body)


def longest_chain(package: str) -> list[str]:
    """The longest path of imports between modules, of which none is a cycle; imports inside functions count."""
    graph = grimp.build_graph(package)

    @cache
    def chain(module: str) -> tuple[str, ...]:
        below = sorted(graph.find_modules_directly_imported_by(module))
        return (module, *max(map(chain, below), key=len, default=()))

    return list(max((chain(x) for x in sorted(graph.modules)), key=len))


def functions(tree: ast.AST) -> list[ast.FunctionDef | ast.AsyncFunctionDef]:
    """All functions and methods of a module."""
    return [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]


def parameters(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """How many parameters a function takes, `self` left out."""
    names = function.args
    every = [x.arg for x in (*names.posonlyargs, *names.args, *names.kwonlyargs)]
    return len([x for x in every if x not in ("self", "cls")])


def repeated(names: list[str]) -> dict[str, int]:
    """Names that occur more than once, with how often."""
    return {name: count for name, count in sorted(Counter(names).items()) if count > 1}


def counts() -> dict[str, object]:
    """Every count by its name; lists where the places help to find them."""
    package = ROOT / "whiptool"
    files = sorted(package.rglob("*.py"))
    trees = {file: ast.parse(file.read_text()) for file in files}
    every = [(file, function) for file, tree in trees.items() for function in functions(tree)]
    classes = [x.name for tree in trees.values() for x in tree.body if isinstance(x, ast.ClassDef)]
    planners = [file for file, tree in trees.items() if plans(file, tree)]
    where = lambda file, function: f"{file.relative_to(ROOT)}:{function.lineno} {function.name}"  # noqa: E731
    texts = {file: file.read_text() for file in (*files, *package.rglob("*.js"))}
    rule = [
        f"{file.relative_to(ROOT)}:{number}"
        for file, text in texts.items()
        for number, line in enumerate(text.splitlines(), 1)
        if HIT_RULE.search(line)
    ]
    top = {
        x.stem: text for x, text in texts.items() if x.parent == package and x.suffix == ".py" and x.stem not in DOORS
    }
    doors = {name for name, text in top.items() if "from whiptool.commands" in text}
    return {
        "package lines": lines(package),
        "package lines in other languages": other_lines(package),
        "papers lines": lines(ROOT / "papers") if (ROOT / "papers").is_dir() else 0,
        "files": len(files),
        "longest import chain": len(longest_chain("whiptool")),
        "shared file names": repeated([x.name for x in files if x.stem not in DOORS]),
        "shared class names": repeated([x for x in classes if not x.startswith("_")]),
        "shared class names, private ones": repeated([x.lstrip("_") for x in classes]),
        "isinstance of an arm": sum(len(ARM_KIND.findall(x)) for x in texts.values()),
        "tests of a dimension": sum(len(DIMENSION.findall(x)) for x in texts.values()),
        "functions over 60 lines": [where(f, x) for f, x in every if (x.end_lineno or 0) - x.lineno >= LONG],
        "functions over 8 parameters": [where(f, x) for f, x in every if parameters(x) > MANY],
        "comparisons with a hit radius": rule,
        "planner modules": [str(x.relative_to(ROOT)) for x in planners],
        "modules on top without doors": len(top) - len(doors),
    }


def main() -> None:
    """Print the counts."""
    found = counts()
    if "--json" in sys.argv[1:]:
        print(json.dumps(found, indent=1))
        return
    for name, value in found.items():
        print(f"{name:32s} {len(value) if isinstance(value, dict | list) else value}")


if __name__ == "__main__":
    main()
