"""Help texts: `--help` prints the most used options on one screen, `--help-all` all options with their full
descriptions.

Options without effect, given the others on the command line, are left out of both and listed at the end.
"""

from __future__ import annotations

import ast
import inspect
import re
import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, Field, dataclass, fields
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

from whiptool.commands.options.option_group import HELP_ALL, Names, OptionGroup, flag
from whiptool.errors import WhiptoolError
from whiptool.words import counted

SCREEN = 40  # [lines]; a command with more in all has its most used options on the first screen
_WIDTH, _COLUMN = 100, 30  # [characters]
_METAVARS = {float: "X", int: "N", str: "NAME", Path: "PATH"}
_ITEM = re.compile(r"\n *- ")  # begins an item of a list in an option's documentation


@dataclass(frozen=True)
class _Shown:
    """An option as help shows it."""

    group: str  # heading of its group
    name: str  # of the field
    left: str  # how it is given
    meaning: str  # its documentation in one line, with its default


def help_text(given: OptionGroup, *, prog: str, description: str, whole: bool) -> str:
    """Return the text that `--help` prints or, if `whole`, `--help-all`.

    Args:
        given: Options of the command, as far as they are given; those that its groups name in `first` stand on the
            first screen.
        prog: The command, such as `whiptool optimize`.
        description: Description of the command.
        whole: Whether all options are shown, with their full descriptions.
    """
    options, idle = type(given), _without_effect(given)
    shown, first = [one for one in _shown(options) if one.name not in idle], options.named("first")
    positional = [one.left for one in shown if not one.left.startswith("-")]
    usage = " ".join(["usage:", prog, *positional, "[options]"])
    head = [*textwrap.wrap(usage, _WIDTH, subsequent_indent="  "), *textwrap.wrap(description, _WIDTH)]
    compact = [*head, *_in_groups(shown, short=False, gap=False), *_left_out(idle)]
    if len(compact) <= SCREEN or not first:
        return "\n".join(compact)
    if whole:
        return "\n".join([*head, *_in_groups(shown, short=False, gap=True), *_left_out(idle)])
    some = [one for one in shown if one.name in first]
    more = f"{len(shown) - len(some)} more options: {prog} {HELP_ALL}"
    return "\n".join([*head, *_in_groups(some, short=True, gap=False), more])


def _without_effect(given: OptionGroup) -> dict[str, str]:
    """Return the options that have no effect with those that are given, by name, and when they have one."""
    found = {}
    for f in fields(given):
        try:
            broken = given.broken_condition(f.name)
        except (WhiptoolError, OSError, TypeError):  # what is given is wrong, or not all of it
            continue
        if broken is not None and not given.given(f.name):
            found[f.name] = broken.words
    return found


def _left_out(idle: Mapping[str, str]) -> Iterator[str]:
    """Yield the lines that say which options are left out, and with which others they are shown."""
    if not idle:
        return
    by: dict[str, list[str]] = {}
    for name, words in idle.items():
        by.setdefault(words, []).append(flag(name))
    said = "; ".join(f"{', '.join(names)} ({words})" for words, names in by.items())
    yield ""
    yield from textwrap.wrap(
        f"{counted(len(idle), 'option')} without effect here: {said}", _WIDTH, break_on_hyphens=False
    )


def _in_groups(shown: list[_Shown], *, short: bool, gap: bool) -> Iterator[str]:
    """Yield the lines of some options, groups in the order of their first options, that of the result last, with empty
    lines between them if `gap`."""
    for group in sorted(dict.fromkeys(one.group for one in shown), key=lambda group: group == "result"):
        if gap:
            yield ""
        yield f"{group}:"
        for one in shown:
            if one.group == group:
                yield from _lines(one, short=short)


def _lines(one: _Shown, *, short: bool) -> Iterator[str]:
    """Yield the lines of an option: how it is given, and what it means; in short the first sentence of that."""
    meaning = one.meaning
    if short:
        default = re.search(r" \[default: [^]]*\]$", meaning)
        sentence = re.split(r"(?<=[a-z)\]])(?:\. (?!\d)|; )", meaning, maxsplit=1)[0].rstrip(".")
        value = default[0] if default and default[0] not in sentence else ""
        meaning = sentence + value
    lines = [line for part in meaning.split("\n") for line in textwrap.wrap(part, _WIDTH - _COLUMN)] or [""]
    if len(one.left) > _COLUMN - 4:
        yield from textwrap.wrap(
            one.left if len(one.left) < _WIDTH - 2 else one.left.replace(",", ", "),
            _WIDTH,
            initial_indent="  ",
            subsequent_indent="      ",
        )
    else:
        yield f"  {one.left:{_COLUMN - 2}s}{lines.pop(0)}".rstrip()
    for line in lines:
        yield " " * _COLUMN + line


def _shown(options: type[OptionGroup]) -> Iterator[_Shown]:
    """Yield a command's options, its own and then those of its groups."""
    hints, own = get_type_hints(options, include_extras=True), _documented(options)
    for f in sorted(fields(options), key=lambda f: (f.name not in own, "Positional" not in str(f.type))):
        group = next(x for x in options.__mro__ if f.name in inspect.get_annotations(x))
        heading = "options" if group is options else getattr(group, "heading", "options")
        yield _Shown(heading, f.name, _given(f, hints[f.name]), _meaning(f, _documented(group).get(f.name, "")))


def _documented(group: type) -> dict[str, str]:
    """Return the documentation of the fields that a class itself has, which stands behind each; items, which begin with
    a hyphen, are lines."""
    try:
        body = ast.parse(textwrap.dedent(inspect.getsource(group))).body[0]
    except (OSError, TypeError):  # there is no source
        return {}
    assert isinstance(body, ast.ClassDef)
    found = {}
    for field, behind in zip(body.body, [*body.body[1:], None], strict=True):
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
            said = behind.value if isinstance(behind, ast.Expr) else None
            text = said.value if isinstance(said, ast.Constant) else ""
            found[field.target.id] = "\n".join(" ".join(part.split()) for part in _ITEM.split(str(text)))
    return found


def _meaning(f: Field, documented: str) -> str:
    """Return an option's documentation with its default, unless it has no default, or the documentation names it."""
    default = f.default
    if default is True:
        return f"{documented} [default: {flag(f.name)}]"
    if default in (MISSING, None, (), "", False) or "default" in documented.lower():
        return documented
    values = default if isinstance(default, tuple) else (default,)
    return f"{documented} [default: {' '.join(map(_value, values))}]"


def _value(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _given(f: Field, kind: Any) -> str:
    """Return how an option is given: `--target X ...`, `--no-video`, or a positional argument."""
    if "Positional" in str(f.type):
        return _metavar(kind, f.name.upper())
    name = flag(f.name)
    if kind is bool:
        return f"{name}, --no-{name.removeprefix('--')}" if f.default is True else name
    short = "-o, " if f.name == "out" else ""
    return f"{short}{name} {_metavar(kind, f.name.upper())}"


def _metavar(kind: Any, name: str) -> str:
    """Return what stands for the value of an option."""
    if get_origin(kind) is Annotated:
        if isinstance(names := get_args(kind)[1], Names):
            listed = names.known()
            return "|".join(listed) if names.beside is None else f"{{{','.join(listed)}}}{names.beside}"
        given = next((x.metavar for x in get_args(kind)[1:] if getattr(x, "metavar", None)), None)
        return given or _metavar(get_args(kind)[0], name)
    if get_origin(kind) is Literal:
        return "|".join(map(str, get_args(kind)))
    if get_origin(kind) is tuple:
        parts = get_args(kind)
        if Ellipsis in parts:
            return f"{_metavar(parts[0], name)} ..."
        return " ".join(_metavar(part, name) for part in parts)
    some = [part for part in get_args(kind) if part is not NoneType]
    if some:
        return "|".join(_metavar(part, name) for part in some)
    return _METAVARS.get(kind, "VALUE")
