"""Models as TOML files: read with every mistake named, written so that they read back the same."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from os import PathLike, fspath
from pathlib import Path
from typing import Any

import tomli_w

from whiptool.errors import InputError, expect
from whiptool.models.arm_choice import ArmChoice
from whiptool.models.arm_files import ROBOT_FILES, arm_from_table, arm_to_table, read_robot
from whiptool.models.parameters import LONGEST_NAME, Model
from whiptool.models.presets import PRESETS, preset, presets
from whiptool.models.profile import WhipProfile
from whiptool.models.robots import rope
from whiptool.models.tables import build_from, read_toml
from whiptool.models.whip import WhipParameters
from whiptool.whole_files import write_whole
from whiptool.words import as_named

_WITH_PROFILE = {"joints": "joints", "node_inertia": "node_inertia", "clamp": "clamped"}  # keys, and arguments
ROUND = ("youngs_modulus", "diameter", "density")  # of a round whip, which give its mass and stiffness


def model_from_table(table: Mapping, folder: Path = Path()) -> Model:
    """Return a model from nested mappings, as in TOML; with `whip.profile` and `whip.N` the nodes are computed from a
    profile.

    Args:
        table: Table of a model.
        folder: Folder to which the arm's file is relative, if the table names one.

    Raises:
        InputError: A key is unknown or missing, or a value is not allowed; the key is named.
    """
    if not isinstance(table, Mapping):
        raise InputError("model", table, "a table")
    table = dict(table)
    whip = table.get("whip", {})
    if isinstance(whip, Mapping) and "profile" in whip:
        for key in whip:
            if key not in ("profile", "N", *_WITH_PROFILE):
                rule = f"where a profile is given, only profile, N, {', '.join(_WITH_PROFILE)}"
                raise InputError(f"whip.{key}", whip[key], rule)
        profile = _profile(whip["profile"])
        try:
            expect(bool, clamp=whip.get("clamp", False))
            others = {name: whip[key] for key, name in _WITH_PROFILE.items() if key in whip}
            nodes: Any = whip.get("N")  # `lump` refuses what is not a whole number
            table["whip"] = profile.lump(nodes, **others)
        except InputError as error:
            raise error.within("whip.") from None
    elif "whip" in table:
        table["whip"] = build_from(WhipParameters, whip, "whip.")
    if "arm" in table:
        table["arm"] = arm_from_table(table["arm"], folder)
    return build_from(Model, table, "")


def _profile(table: object) -> WhipProfile:
    """A profile from a table, which may give a round whip's material and diameter.

    Raises:
        InputError: A key is unknown or missing, or a value is not allowed; the key is named.
    """
    place = "whip.profile."
    if not (isinstance(table, Mapping) and set(ROUND) & set(table)):
        return build_from(WhipProfile, table, place)
    for key in ROUND:
        if key not in table:
            raise InputError(place + key, None, f"a value; a round whip has all of {', '.join(ROUND)}")
    for key in ("linear_density", "bending_stiffness"):
        if key in table:
            raise InputError(place + key, table[key], f"only without {', '.join(ROUND)}, which it follows from")
    material = {key: table[key] for key in ROUND}
    try:
        section = WhipProfile.round(**material, length=1.0, bending_damping=0.0)
    except InputError as error:
        raise error.within(place) from None
    ready = {"linear_density": section.linear_density, "bending_stiffness": section.bending_stiffness}
    return build_from(WhipProfile, {key: x for key, x in table.items() if key not in ROUND}, place, **ready)


def model_to_table(model: Model) -> dict:
    """The model as nested plain data; `model_from_table` gives the same model back."""
    whip = {k: list(v) if isinstance(v, tuple) else v for k, v in dataclasses.asdict(model.whip).items()}
    if model.dimension == 2:  # what is of space stays out of the plane
        for name in ("joints", *model.whip.kind.absent):
            del whip[name]
    return {"name": model.name, "gravity": model.gravity, "whip": whip, "arm": arm_to_table(model.arm)}


def read_model(path: Path | str) -> Model:
    """Return a model from a TOML file, or from the table `[model]` of the `config.toml` of a run folder.

    Raises:
        InputError: The file cannot be read, or a value is not allowed.
    """
    expect(str, PathLike, path=path)
    table = read_toml(path)
    if isinstance(table.get("model"), Mapping):
        table = table["model"]
    try:
        return model_from_table({"name": _name(Path(path)), **table}, Path(path).parent)
    except InputError as error:
        raise error.within(f"{path}: ") from None


def _name(path: Path) -> str:
    """Return a model's name after its file, whose name may hold what no text holds."""
    return "".join(x if x.isprintable() else "?" for x in path.stem)[:LONGEST_NAME]


def write_model(model: Model, path: Path | str) -> None:
    """Write a model as a TOML file that `read_model` reads back the same."""
    expect(Model, model=model)
    expect(str, PathLike, path=path)
    write_whole(Path(path), tomli_w.dumps(model_to_table(model)))


def load_model(name: str | PathLike[str], *, tip: str = "") -> Model:
    """Return a preset by its name, or a model from a file: TOML, or a robot in URDF or MJCF, to which the rope of the
    robot presets is added.

    Args:
        name: Name of the preset, in capital or small letters, or the file's path.
        tip: For a robot's file, the name of the link, body or site at which the hand is; empty: the only link that
            carries no other.

    Raises:
        InputError: Neither exists, or the file contains something that is not allowed.
    """
    expect(str, PathLike, name=name)
    name = fspath(name)
    if tip and not name.endswith(ROBOT_FILES):
        rule = "nothing but with a robot's file: " + ", ".join(ROBOT_FILES)
        raise InputError("tip", tip, rule, "in a model file it is arm.tip")
    if as_named(name, PRESETS) in PRESETS:
        return preset(name)
    if name.endswith(".toml"):
        return read_model(Path(name))
    if name.endswith(ROBOT_FILES):
        return Model(rope(), read_robot(Path(name), ArmChoice(tip=tip)), name=_name(Path(name)))
    if as_named(name, presets()) in PRESETS:
        return preset(name)
    rule = "a preset (" + ", ".join(PRESETS) + ") or the path of a .toml file, or of a robot: " + ", ".join(ROBOT_FILES)
    raise InputError("model", name, rule)
