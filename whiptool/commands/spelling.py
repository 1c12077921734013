"""Alternative spellings on the command line.

`-o` is `--out`, values may be separated by commas, and choices may be in capital letters.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Literal, get_args, get_origin, get_type_hints

from whiptool.commands.options.option_group import OptionGroup, flag
from whiptool.words import as_named

SHORT = {"-o": "--out"}


def usual_words(words: Sequence[str], options: type[OptionGroup]) -> list[str]:
    """Return a command line in the spelling that the parser accepts.

    Short flags are replaced by long flags, values are separated by spaces, and choices are spelt as listed.

    Args:
        words: Words as typed; `--target 1.25,0.2` and `--target=1.25,0.2` are `--target 1.25 0.2`.
        options: Class of the command's options; options that take paths are unchanged, as paths may contain commas.
    """
    kinds = {flag(name): kind for name, kind in get_type_hints(options).items()}
    several = {name for name, kind in kinds.items() if _takes_several(kind)}
    found: list[str] = []
    within, listed = False, []  # whether the values of an option that takes several follow; of which words they are
    for word in words:
        name, equals, value = word.partition("=")
        name = SHORT.get(name, name)
        if name in SHORT.values() or name.startswith("--"):
            long = name.replace("_", "-")
            within, listed = long in several, [x for x in choices(kinds.get(long)) if isinstance(x, str)]
            value = as_named(value, listed)
            found += [name, *_values(value, listed)] if within and equals else [name + equals + value]
        else:
            found += _values(word, listed) if within else [as_named(word, listed)]
    return found


def choices(kind: Any) -> list[Any]:
    """Return the values of all `Literal` types within a type, in their order."""
    if get_origin(kind) is Literal:
        return list(get_args(kind))
    return [value for part in get_args(kind) for value in choices(part)]


def _values(word: str, listed: Sequence[str]) -> Iterator[str]:
    """Yield the values between the commas of a word, or the whole word if it has no commas."""
    parts = [part for part in word.split(",") if part] or [word]
    yield from (as_named(part, listed) for part in parts)


def _takes_several(kind: Any) -> bool:
    """Return whether an option of a type takes several values, none of them a path."""
    if get_origin(kind) is tuple:
        return Path not in get_args(kind)
    return any(_takes_several(part) for part in get_args(kind))
