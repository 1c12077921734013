"""Parsing of a command line, alternative spellings included, and the errors of words that do not parse.

`-o` is `--out`, values may be separated by commas, and choices may be in capital letters.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from whiptool.commands.options.option_group import HELP_ALL, OptionGroup, flag, names_of
from whiptool.errors import NOTHING, InputError, alike
from whiptool.given_files import number_in
from whiptool.words import as_named

T = TypeVar("T", bound=OptionGroup)
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
    long = ""
    for word in words:
        name, equals, value = word.partition("=")
        name = SHORT.get(name, name)
        if name in SHORT.values() or name.startswith("--"):
            long = name.replace("_", "-")
            within, listed = long in several, [x for x in choices(kinds.get(long)) if isinstance(x, str)]
            value = as_named(value, listed)
            found += [name, *_values(value, listed)] if within and equals else [name + equals + value]
        else:
            value = word
            found += _values(word, listed) if within else [as_named(word, listed)]
        if any(map(_otherwise_written, value.split(","))) and _takes_numbers(kinds.get(long)):
            fix = "write numbers without underscores, and with the digits 0 to 9"
            raise InputError(long, value, _kind_in_words(kinds[long]), fix)
    return found


def _otherwise_written(word: str) -> bool:
    """Return whether Python reads a word as a number that is not in the notation of `number_in`, such as `1_0`."""
    try:
        float(word)
    except ValueError:
        return False
    try:
        number_in(word)
    except ValueError:
        return True
    return False


def _takes_numbers(kind: Any) -> bool:
    """Return whether an option of a type takes numbers."""
    return kind in (int, float) or any(_takes_numbers(part) for part in get_args(kind))


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


_LONGEST_WORD, _DEEPEST = 4000, 200  # [characters], [folders]


_COUNTS = {2: "two", 3: "three"}


def partial_options(options: type[T], words: list[str]) -> T:
    """Return the options that words give. Without words, or if one is wrong, return the defaults, else None."""
    if words:
        try:
            return options_from(options, words)
        except (InputError, SystemExit):
            pass
    found = object.__new__(options)
    for f in dataclasses.fields(options):
        object.__setattr__(found, f.name, None if f.default is dataclasses.MISSING else f.default)
    return found


def options_from(options: type[T], words: list[str], default: T | None = None) -> T:
    """Return the options that words give; raise an error for the first word that is wrong."""
    import tyro
    from tyro import _errors as tyro_errors

    def refuse(event: Any) -> None:
        raise _refusal(event, options, words)

    given = given_flags(words)
    with tyro_errors.on_parse_error(refuse):
        extra: dict[str, Any] = {} if default is None else {"default": default}
        parsed = tyro.cli(options, args=words, add_help=False, **extra)
    for f in dataclasses.fields(parsed):
        needs = f.name not in options.named("may_be_empty")
        if needs and flag(f.name) in given and getattr(parsed, f.name) == ():
            raise InputError(flag(f.name), NOTHING, "one value or more")
    return _spelled(parsed, given)


def _spelled(parsed: T, given: Sequence[str]) -> T:
    """Return options with the names that are given in the spelling of the library, which has to know them."""
    found: dict[str, Any] = {}
    for name, kind in get_type_hints(type(parsed), include_extras=True).items():
        if flag(name) in given and (names := names_of(kind)):
            value, option = getattr(parsed, name), flag(name)
            one = isinstance(value, str)
            found[name] = names.name(option, value) if one else tuple(names.name(option, x) for x in value or ())
    return dataclasses.replace(parsed, **found) if found else parsed


def _refusal(event: Any, options: type[OptionGroup], words: list[str]) -> InputError:
    """Return the error that says what tyro found wrong."""
    from tyro import _errors as tyro_errors

    argument: Any = getattr(event, "argument", None)
    name = argument.lowered.name_or_flags[0] if argument is not None else "command line"
    if isinstance(event, tyro_errors.UnrecognizedArgs):
        unknown = next((x for x in event.tokens if x.startswith("-")), "command line")
        return InputError(unknown, " ".join(event.tokens), "the options that --help lists", _meant(unknown, options))
    if isinstance(event, tyro_errors.MissingArgs):
        return _missing(event.missing_arguments[0].arg)
    if isinstance(event, tyro_errors.InvalidChoice):
        allowed = choices(get_type_hints(options)[event.argument.field.intern_name])
        return InputError(name, event.value, ", ".join(map(str, allowed)))
    if isinstance(event, tyro_errors.BadValue):
        given = NOTHING if event.offending_value is None else event.offending_value
        return InputError(name, given, "a value (see --help)")
    if isinstance(event, tyro_errors.InstantiationFailure) and argument is not None:
        kind = get_type_hints(options, include_extras=True).get(argument.field.intern_name)
        return InputError(name, _given(name, words), _kind_in_words(kind))
    return InputError("command line", " ".join(words), "options and values as in --help")


def check_words(words: Sequence[str]) -> None:
    """Refuse words that are not text in the terminal's encoding, and words that are too long for a path.

    Raises:
        InputError: There is such a word.
    """
    for word in words:
        if len(word) > _LONGEST_WORD or word.count("/") > _DEEPEST:
            rule = f"words of at most {_LONGEST_WORD} characters, paths of at most {_DEEPEST} folders"
            raise InputError("command line", word, rule)
        if any("\ud800" <= x <= "\udfff" for x in word):
            raise InputError("command line", word, "text in the terminal's encoding", "export LC_ALL=C.UTF-8")


def _kind_in_words(kind: Any) -> str:
    """Return what an option of a type takes, such as `a number` or `two of miss, effort`."""
    if get_origin(kind) in (UnionType, Union):
        return _kind_in_words(next(part for part in get_args(kind) if part is not NoneType))
    registered = names_of(kind)
    if get_origin(kind) is tuple:
        parts = get_args(kind)
        names = ", ".join(registered.known() if registered else map(str, choices(parts[0])))
        count = "" if Ellipsis in parts else f"{_COUNTS.get(len(parts), len(parts))} "
        return f"{count or 'one or more '}of {names}" if names else f"{count}numbers with a space or comma between them"
    names = ", ".join(registered.known() if registered else map(str, choices(kind)))
    return names or {int: "a whole number", float: "a number"}.get(kind, "a value of its type")


def _meant(unknown: str, options: type[OptionGroup]) -> str:
    """Return the question which option was meant; empty where none is like what was given.

    `--zone` is short for `--zone-radius`, and `--no-videos` a misspelling of `--no-video`.
    """
    kinds = get_type_hints(options)
    known = ["help", HELP_ALL[2:], *(flag(f.name)[2:] for f in dataclasses.fields(options))]
    known += [f"no-{name}" for name in known if kinds.get(name.replace("-", "_")) is bool]
    given = unknown.split("=")[0].replace("_", "-").lstrip("-")
    longer = [name for name in known if set(given.split("-")) <= set(name.split("-"))]
    meant = longer[:3] or [name for name in [alike(given, known)] if name]
    return f"did you mean {' or '.join(f'--{name}' for name in meant)}?" if meant else ""


def _missing(argument: Any) -> InputError:
    """Return the error that says which argument is missing, and what it means."""
    field = argument.field
    positional = field.argconf.metavar or field.intern_name.upper()
    name = positional if argument.is_positional() else argument.lowered.name_or_flags[0]
    meaning = field.helptext() if callable(field.helptext) else field.helptext
    return InputError(name, NOTHING, (meaning or "a value").rstrip("."), "--help tells more")


def given_flags(words: Sequence[str]) -> list[str]:
    """Return the names of the options on a command line; `--no-video` is returned as `--video`.

    Raises:
        InputError: An option is given twice.
    """
    found: list[str] = []
    for word in words:
        if word.startswith("--"):
            given = flag(word.split("=")[0].removeprefix("--").replace("_", "-").removeprefix("no-"))
            if given in found:
                raise InputError(given, "twice", "an option once")
            found.append(given)
    return found


def _given(flag: str, words: list[str]) -> str:
    """What stood behind a flag on the command line."""
    joined = next((word for word in words if word.startswith(flag + "=")), None)
    if joined is not None:
        return joined.partition("=")[2]
    if flag not in words:
        return ""
    behind = words[words.index(flag) + 1 :]
    return " ".join(behind[: next((i for i, word in enumerate(behind) if word.startswith("--")), len(behind))])
