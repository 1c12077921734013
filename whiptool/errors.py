"""Errors that a user can correct: the given value, the allowed values and the fix, in one line."""

from __future__ import annotations

import difflib
import inspect
import re
from collections.abc import Callable, Iterable, Mapping
from os import PathLike

_LONGEST = 400  # [characters] of a name, and of what was given, as they are shown


class WhiptoolError(Exception):
    """Base class of every error that whiptool raises on purpose."""


class _Nothing:
    """What was given where nothing was."""

    def __repr__(self) -> str:
        return "nothing"


NOTHING = _Nothing()


class InputError(WhiptoolError, ValueError):
    """A value given by the user that is not allowed.

    Args:
        name: Name of the value for the user (option, key, argument).
        given: The value as given.
        allowed: What is allowed.
        fix: How to correct it, if `allowed` does not say so; default: "did you mean ...?" if a word in `allowed`
            resembles the value.
    """

    def __init__(self, name: str, given: object, allowed: str, fix: str = "") -> None:
        fix = fix or _meant(given, allowed)
        self.name, self.given, self.allowed, self.fix = name, given, allowed, fix
        message = f"{cut(name)}: got {_shown(given)}; allowed: {allowed}" + (f"; {fix}" if fix else "")
        super().__init__(" ".join(message.split()))  # always one line

    def within(self, place: str) -> InputError:
        """Return the same error with `place`, such as `whip.` or `model.toml: `, before its name."""
        return self.renamed(place + self.name)

    def renamed(self, name: str, fix: str = "") -> InputError:
        """Return the same error under another name, and with `fix` if it has no correction yet."""
        return InputError(name, self.given, self.allowed, self.fix or fix)

    def advising(self, advice: str) -> InputError:
        """Return the same error with advice added to its reason or correction."""
        return InputError(self.name, self.given, self.allowed, f"{self.fix}; {advice}" if self.fix else advice)


def _meant(given: object, allowed: str) -> str:
    """Ask whether one of the names that are allowed was meant; empty where none of them is like what was given. A name
    stands alone between commas and the like, unlike a word of a sentence.
    """
    if not isinstance(given, str):
        return ""
    parts = [part.strip() for part in re.split(r"[,;:()]\s|\s(?:or|and)\s|$", allowed)]
    words = {part.lower(): part for part in parts if len(part) > 2 and " " not in part}
    if given.lower() in words:  # it is wrong for another reason
        return ""
    found = alike(given.lower(), words)
    return f"did you mean {words[found]}?" if found else ""


def alike(given: str, names: Iterable[str]) -> str:
    """Return the one of `names` of which `given` is probably a misspelling; empty if no name is similar.

    Both have to begin with the same letter: `zone` is not taken for `cone`.
    """
    possible = [name for name in names if name[:1] == given[:1]]
    return next(iter(difflib.get_close_matches(given, possible, n=1, cutoff=0.7)), "")


def _shown(given: object) -> str:
    """What was given, its middle left out where it is long."""
    try:
        text = repr(given)
    except Exception:  # an integer of thousands of digits; tables in tables in ...; a class whose own repr fails
        return f"what cannot be shown, of type {type(given).__name__}"
    return cut(text)


def cut(text: str) -> str:
    """Return a text without its middle if it is long."""
    half = _LONGEST // 2
    return text if len(text) <= _LONGEST else f"{text[:half]} ... {text[-half:]}"


class _Told:
    """A value that stands in a message for what it is."""

    def __init__(self, value: object) -> None:
        self.kind = type(value).__name__

    def __repr__(self) -> str:
        return self.kind


_SHOWN = (str, bytes, int, float, complex, list, tuple, dict, set, type, type(None))  # as they are written
_WORDS = {str: "text", bool: "true or false", type(None): "none", Mapping: "a dict", PathLike: "a path"}


def expect(*kinds: type, **arguments: object) -> None:
    """Refuse arguments that are not instances of the allowed classes; the error names the argument.

    Args:
        kinds: Classes that are allowed.
        arguments: Values by their names.

    Raises:
        InputError: A value is an instance of none of these.
    """
    for name, value in arguments.items():
        if not isinstance(value, kinds):
            given = value if isinstance(value, _SHOWN) else _Told(value)
            raise InputError(name, given, " or ".join(_WORDS.get(kind, kind.__name__) for kind in kinds))


def no_attribute(owner: object, name: str, cures: Mapping[str, str] | None = None) -> AttributeError:
    """Return the AttributeError for a missing attribute, with a hint at the right one if `cures` has it.

    Args:
        owner: The object.
        name: Name of the attribute.
        cures: Hints by the wrong names that users try.
    """
    cure = (cures or {}).get(name)
    said = f"{type(owner).__name__} has no attribute {name!r}"
    return AttributeError(said if cure is None else f"{said}; {cure}", name=name, obj=owner)


_OTHERS_NAMES = {  # of arguments, as other libraries have them
    **dict.fromkeys(("budget", "trials", "n_trials", "max_evals", "maxfev", "maxiter", "iterations"), "max_trials"),
    **dict.fromkeys(("timeout", "time_limit", "maxtime"), "max_time"),
}


def refuse_call(whose: str, callee: Callable[..., object], *args: object, **named: object) -> None:
    """Refuse a call whose arguments do not fit the function's signature; the function is not called.

    Args:
        whose: The function's name for the user.
        callee: The function.
        args, named: Arguments of the call.

    Raises:
        InputError: An argument is unknown, missing or given twice.
    """
    signature = inspect.signature(callee)
    try:
        signature.bind(*args, **named)
    except TypeError as error:
        known = [name for name in signature.parameters if name != "self"]
        unknown = [name for name in named if name not in known]
        if unknown:
            other = _OTHERS_NAMES.get(unknown[0], "")
            meant = other if other in known else alike(unknown[0], known)
            fix = f"did you mean {meant}?" if meant else ""
            raise InputError(f"argument of {whose}", unknown[0], ", ".join(known), fix) from None
        raise InputError(f"arguments of {whose}", ", ".join(named) or NOTHING, ", ".join(known), str(error)) from None
