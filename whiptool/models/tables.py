"""Tables of TOML files as dataclasses, every mistake named with its place."""

from __future__ import annotations

import dataclasses
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path

from whiptool.errors import InputError
from whiptool.given_files import read_text

_DEEPEST = 50  # tables in tables
_PART = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+"""
_LONG_KEY = re.compile(rf"(?<![\w-])(?:{_PART}\.[ \t]*+){{{_DEEPEST}}}")  # tomllib takes the square of their number


def build_from(cls: type, table: object, place: str, **ready):
    """Return `cls(**table, **ready)`; unknown or missing keys and values that are not allowed are named with
    `place`."""
    if not isinstance(table, Mapping):
        raise InputError(place.rstrip("."), table, "a table")
    names = {f.name: f for f in dataclasses.fields(cls)}
    for key in table:
        if key not in names:
            raise InputError(place + key, table[key], "one of the keys " + ", ".join(names))
    for name, f in names.items():
        required = f.default is dataclasses.MISSING and f.default_factory is dataclasses.MISSING
        if required and name not in table and name not in ready:
            raise InputError(place + name, None, f"a value; the key is missing, all keys are {', '.join(names)}")
    try:
        return cls(**{**table, **ready})
    except InputError as error:
        raise error.within(place) from None


def read_toml(path: Path | str) -> dict:
    """Return the content of a TOML file as nested mappings.

    Raises:
        InputError: The file cannot be read, or is not TOML.
    """
    text = read_text(path, "TOML")
    if _LONG_KEY.search(text):
        raise InputError("file", str(path), f"TOML whose keys have at most {_DEEPEST} parts")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise InputError("file", str(path), "TOML that is not nested as deeply") from None
    except ValueError as error:  # also of integers with thousands of digits
        raise InputError("file", str(path), f"valid TOML ({str(error)[:120]})") from None
