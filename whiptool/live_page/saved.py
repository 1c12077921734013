"""Files that the studio has saved, opened again with the controller, the target and the strike they name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from whiptool.errors import InputError
from whiptool.given_files import read_toml
from whiptool.goals.target import Target
from whiptool.goals.target_table import target_from_table
from whiptool.impedance.controller import Controller, read_controller
from whiptool.models.parameters import Model
from whiptool.models.strike import T_STAY, strike_names


@dataclass(frozen=True)
class Saved:
    """What a file of the studio names in addition to its model.

    Args:
        controller: Controller of the arm.
        target: The target.
        strike: Strike vector.
        t_stay: Time after the movement in which the tip can still hit [s].
    """

    controller: Controller
    target: Target
    strike: tuple[float, ...]
    t_stay: float


def read_saved(path: Path | str, model: Model) -> Saved | None:
    """Return what a file that `settings_toml` made names in addition to its model; None: it has no table `[strike]`.

    Raises:
        InputError: A table or a number is missing, unknown or not allowed.
    """
    content = read_toml(path)
    if "strike" not in content:
        return None
    goal, strike = (_table(path, content, name) for name in ("target", "strike"))
    names = strike_names(model.arm)
    _check_strike(path, strike, names)
    try:
        target = target_from_table({key: value for key, value in goal.items() if key != "t_stay"})
        target.check_fits(model)
    except InputError as error:
        raise error.within(f"{path}: ") from None
    vector = tuple(_number(path, f"strike.{name}", strike[name]) for name in names)
    return Saved(read_controller(path), target, vector, _number(path, "target.t_stay", goal.get("t_stay", T_STAY)))


def _table(path: Path | str, content: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    table = content.get(name)
    if not isinstance(table, Mapping):
        raise InputError(f"{path}: {name}", table, f"a table [{name}], as the studio saves it with [strike]")
    return table


def _check_strike(path: Path | str, table: Mapping[str, Any], names: Sequence[str]) -> None:
    for key in table:
        if key not in names:
            raise InputError(f"{path}: strike.{key}", table[key], f"only {', '.join(names)}")
    for key in names:
        if key not in table:
            raise InputError(f"{path}: strike.{key}", None, "a number")


def _number(path: Path | str, name: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{path}: {name}", value, "a number")
    return float(value)
