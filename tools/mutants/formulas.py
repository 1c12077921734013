"""Which parts of a source file are not formulas, and are left as they are.

Left out: annotations, defaults of arguments and fields, decorators, formatted strings, everything that only builds or
guards an error of bad input, prints, warns or logs, representations, imports, choices of type,
whether a bar is shown.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator

Position = tuple[int, int]  # line from 1, column from 0 in characters
Span = tuple[Position, Position]

BAD_INPUT = {"InputError", "ValueError", "TypeError"}
TELLING = {"print", "warn", "debug", "info", "warning", "error", "exception", *BAD_INPUT}
DESCRIBING = {"__repr__", "__str__", "__format__"}


def left_out(source: str) -> list[Span]:
    """The spans of a module that hold no formula."""
    lines = source.splitlines()
    tree = list(ast.walk(ast.parse(source)))
    parts = [part for node in tree for part in _no_formula(node) if part is not None]
    heads = [(_span(x, lines)[0], _span(x.body[0], lines)[0]) for x in tree if isinstance(x, ast.FunctionDef)]
    return [*heads, *(_span(part, lines) for part in parts)]


def within(position: Position, spans: list[Span]) -> bool:
    """Whether a position lies in one of the spans."""
    return any(start <= position < end for start, end in spans)


def scopes(source: str) -> list[tuple[Span, str]]:
    """Functions and classes with their qualified names, the inner ones after the outer ones."""
    lines = source.splitlines()

    def below(node: ast.AST, prefix: str) -> Iterator[tuple[Span, str]]:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.FunctionDef | ast.ClassDef):
                yield _span(child, lines), prefix + child.name
                yield from below(child, f"{prefix}{child.name}.")
            else:
                yield from below(child, prefix)

    return list(below(ast.parse(source), ""))


def _no_formula(node: ast.AST) -> list:
    match node:
        case ast.FunctionDef(name=name) if name in DESCRIBING:
            return [node]
        case ast.FunctionDef():
            return node.decorator_list
        case ast.ClassDef():
            fields = [x.value for x in node.body if isinstance(x, ast.AnnAssign)]
            return [*node.bases, *node.keywords, *node.decorator_list, *fields]
        case ast.AnnAssign():
            return [node.annotation]
        case ast.Module():
            return [x.value for x in node.body if isinstance(x, ast.Assign) and _is_union(x.value)]
        case ast.Raise() | ast.JoinedStr() | ast.Import() | ast.ImportFrom():
            return [node]
        case ast.If(test=ast.Name(id="TYPE_CHECKING")):
            return [node]
        case ast.If(test=test, body=[ast.Raise(exc=ast.Call(func=func))]) if _name(func) in BAD_INPUT:
            return [test]
        case ast.Call(func=func) if _name(func) in TELLING:
            return [node]
        case ast.Call(func=ast.Name(id="isinstance"), args=[_, kind]):
            return [kind]
        case ast.keyword(arg="strict" | "disable"):
            return [node]
    return []


def _is_union(node: ast.AST) -> bool:
    return isinstance(node, ast.BinOp) and isinstance(node.op, ast.BitOr)


def _name(node: ast.AST) -> str:
    match node:
        case ast.Name(id=name) | ast.Attribute(attr=name):
            return name
    return ""


def _span(node, lines: list[str]) -> Span:
    def column(line: int, in_bytes: int) -> int:
        return len(lines[line - 1].encode()[:in_bytes].decode())

    return (
        (node.lineno, column(node.lineno, node.col_offset)),
        (node.end_lineno, column(node.end_lineno, node.end_col_offset)),
    )
