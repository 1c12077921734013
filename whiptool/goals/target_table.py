"""Targets as tables of TOML files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from whiptool.errors import InputError
from whiptool.goals.target import Target

KEYS = tuple(f.name for f in fields(Target))


def target_to_table(target: Target) -> dict[str, Any]:
    """Return a target as a table, in SI units; what is not required is left out."""
    numbers = {name: getattr(target, name) for name in KEYS}
    return {
        name: list(value) if isinstance(value, tuple) else value for name, value in numbers.items() if value is not None
    }


def target_from_table(table: Mapping[str, Any]) -> Target:
    """Return the target of a table that `target_to_table` made.

    Raises:
        InputError: A key is unknown, the position is missing, or a value is not allowed.
    """
    for key in table:
        if key not in KEYS:
            raise InputError(f"target.{key}", table[key], f"only {', '.join(KEYS)}")
    if "position" not in table:
        raise InputError("target.position", None, "coordinates [m]")
    numbers: dict[str, Any] = dict(table)
    try:
        return Target(**numbers)
    except TypeError as error:
        raise InputError("target", str(table)[:80], "the numbers of a target", f"reason: {error}") from None
