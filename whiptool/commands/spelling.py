"""Spellings of a command line that mean the same: `-o` is `--out`, and values may have commas between them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, get_args, get_origin, get_type_hints

from whiptool.options import OptionGroup, flag

SHORT = {"-o": "--out"}


def usual_words(words: Sequence[str], options: type[OptionGroup]) -> list[str]:
    """Return a command line in the spelling that is parsed: long flags, and spaces between the values of an option.

    Args:
        words: As typed; `--target 1.25,0.2` and `--target=1.25,0.2` are `--target 1.25 0.2`.
        options: The command's. Paths may hold commas: options that take them are left as they are.
    """
    several = {flag(name) for name, kind in get_type_hints(options).items() if _takes_several(kind)}
    found: list[str] = []
    within = False  # the values of an option that takes several
    for word in words:
        name, equals, value = word.partition("=")
        name = SHORT.get(name, name)
        if name in SHORT.values() or name.startswith("--"):
            within = name.replace("_", "-") in several
            found += [name, *_values(value)] if within and equals else [name + equals + value]
        else:
            found += _values(word) if within else [word]
    return found


def _values(word: str) -> Iterator[str]:
    """Yield the values between the commas of a word; all of it where there are none."""
    parts = [part for part in word.split(",") if part]
    yield from parts or [word]


def _takes_several(kind: Any) -> bool:
    """Return whether an option of a type takes several values, none of them a path."""
    if get_origin(kind) is tuple:
        return Path not in get_args(kind)
    return any(_takes_several(part) for part in get_args(kind))
