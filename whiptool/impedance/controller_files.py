"""Controllers as TOML tables and files: read with every mistake named, written so that they read back the same."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from whiptool.errors import InputError
from whiptool.given_files import read_toml
from whiptool.impedance.controller import Controller, HandControl
from whiptool.impedance.laws import LAWS, Law
from whiptool.whole_files import write_whole

_LARGEST = 1e6  # of K [N m/rad] and B [N m s/rad]: far beyond any arm
TABLE = "controller"  # name of the table in a file
_OPTIONS = tuple(f.name for f in dataclasses.fields(Controller) if f.name != "law")
_KEYS = {"law", *_OPTIONS, *(f.name for law in LAWS.values() for f in dataclasses.fields(law))}


def controller_to_table(controller: Controller) -> dict[str, Any]:
    """Return the controller as plain data: the law's name and parameters, and those options that are set."""
    numbers = dataclasses.asdict(controller.law)
    options = {name: getattr(controller, name) for name in _OPTIONS}
    table = {"law": controller.law.kind, **numbers, **options}
    return {key: _plain(value) for key, value in table.items() if value is not None}


def controller_from_table(table: Mapping[str, Any]) -> Controller:
    """Return the controller that `controller_to_table` described.

    Raises:
        InputError: The law or a key is unknown, or a value is not allowed; the key is named.
    """
    numbers = dict(table)
    law = numbers.pop("law", None)
    law = LAWS.name(law)
    options = {key: numbers.pop(key) for key in _OPTIONS if key in numbers}
    if "hand" in options:
        options["hand"] = _hand(options["hand"])
    known = [f.name for f in dataclasses.fields(LAWS[law])]
    for key in numbers:
        if key not in known:
            raise InputError(f"controller.{key}", numbers[key], "one of " + ", ".join(("law", *known, *_OPTIONS)))
    try:
        return Controller(law=LAWS[law](**numbers), **options)
    except InputError as error:
        raise error.within("controller.") from None
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError("controller", str(table)[:80], f"a controller's numbers ({error})") from None


def read_controller(path: Path | str) -> Controller:
    """Return the controller in the table `[controller]` of a TOML file, such as the `config.toml` of a run folder.

    Raises:
        InputError: The file cannot be read, has no such table, or a value is not allowed.
    """
    content = read_toml(path)
    table = content.get(TABLE)
    if not isinstance(table, Mapping):
        raise InputError("controller", str(path), f"a TOML file with a table [{TABLE}]")
    for key in sorted(_KEYS & set(content)):
        raise InputError(
            f"{path}: {key}", content[key], f"{key} below the line [{TABLE}]", "above it, it has no effect"
        )
    try:
        controller = controller_from_table(table)
        _check_gains(controller.law)
    except InputError as error:
        raise error.within(f"{path}: ") from None
    return controller


def write_controller(controller: Controller, path: Path | str) -> None:
    """Write a controller as a TOML file that `read_controller` reads back the same."""
    write_whole(path, tomli_w.dumps({TABLE: controller_to_table(controller)}))


def _check_gains(law: Law) -> None:
    """Refuse gains that no arm has."""
    for name, numbers in law.parameters().items():
        if (np.abs(numbers) > _LARGEST).any():
            raise InputError(f"controller.{name}", numbers.tolist(), f"numbers up to {_LARGEST:g}")


def _hand(table: Any) -> HandControl:
    """Return the control of the hand that a table `[controller.hand]` holds.

    Raises:
        InputError: It is not a table, a key is unknown, or a value is not allowed.
    """
    known = [f.name for f in dataclasses.fields(HandControl)]
    if not isinstance(table, Mapping):
        raise InputError("controller.hand", table, "a table with some of " + ", ".join(known))
    for key in table:
        if key not in known:
            raise InputError(f"controller.hand.{key}", table[key], "one of " + ", ".join(known))
    try:
        return HandControl(**table)
    except InputError as error:
        raise error.within("controller.hand.") from None
    except TypeError:
        raise InputError("controller.hand.posture", table["posture"], "a list of numbers") from None


def _plain(value: Any) -> Any:
    """Return tuples, also nested ones, as lists; what a hand's control holds as a table."""
    if isinstance(value, HandControl):
        return {key: _plain(x) for key, x in dataclasses.asdict(value).items() if x is not None}
    return [_plain(x) for x in value] if isinstance(value, tuple) else value
