"""Models and arms as TOML files; errors name the key, and a file that was written reads back the same."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from os import PathLike, fspath
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from whiptool.errors import InputError, expect
from whiptool.given_files import build_from, read_toml
from whiptool.models.capsules import Capsule
from whiptool.models.mount import mounted, with_stick
from whiptool.models.parameters import LONGEST_NAME, AnyArm, ArmLink, ArmParameters, Model
from whiptool.models.presets import PRESETS, preset, presets, rope
from whiptool.models.profile import WhipProfile
from whiptool.models.robot_files import ArmChoice
from whiptool.models.scene import without_touching
from whiptool.models.spatial_arm import JointLimits, SpatialArm, SpatialLink
from whiptool.models.strike import FARTHEST_TURN
from whiptool.models.visuals import Look
from whiptool.models.whip import WhipParameters
from whiptool.whole_files import write_whole
from whiptool.words import as_named

ROBOT_FILES = (".urdf", ".xml")  # URDF, MJCF
FASTEST_TURN = 50.0  # [rad/s]; no joint of an arm is faster


def read_robot(path: Path | str, choice: ArmChoice | None = None) -> SpatialArm:
    """Read an arm from a robot's file in URDF or MJCF, see `read_urdf` and `read_mjcf`."""
    path = Path(path)
    if path.suffix.lower() == ".urdf":
        from whiptool.models.urdf import read_urdf

        return _units_asked(without_touching(read_urdf(path, choice), choice))
    if path.suffix.lower() == ".xml":
        from whiptool.models.mjcf import read_mjcf

        return _units_asked(without_touching(read_mjcf(path, choice), choice))
    raise InputError("file", str(path), "a robot's file: " + ", ".join(ROBOT_FILES))


def robot_looks(name: str | PathLike[str], arm: AnyArm, *, tip: str = "") -> list[Look] | None:
    """Return the visual shapes of a robot's base and moving links, in their frames, (a + 1,); None if it has none.

    `name` and `tip` are as for `load_model`; `arm` is what was read from it, as it is mounted and with its stick, which
    has no visual shape. Meshes of a URDF whose files are missing are left out.
    """
    path, choice = Path(name), ArmChoice(tip=tip)
    if path.suffix.lower() == ".toml":
        table = read_toml(path)
        table = table.get("model", table).get("arm")
        if not isinstance(table, Mapping) or not isinstance(table.get("file"), str):
            return None
        chosen = {f.name: table[f.name] for f in dataclasses.fields(ArmChoice) if f.name in table}
        path, choice = path.parent / table["file"], build_from(ArmChoice, chosen, "arm.")
    if path.suffix.lower() == ".urdf":
        from whiptool.models.urdf import read_urdf_looks

        looks = read_urdf_looks(path, choice)
    elif path.suffix.lower() == ".xml":
        from whiptool.models.mjcf import read_mjcf_looks

        looks = read_mjcf_looks(path, choice)
    else:
        return None
    if not any(looks):
        return None
    arm = arm.in_space()
    R = np.array(arm.links[0].rotation) @ np.array(read_robot(path, choice).links[0].rotation).T  # of the mounting
    sticks = arm.links[-1].capsules[-1:] if arm.stick[0] else ()
    return [tuple(shape.turned(R) for shape in looks[0]), *looks[1:-1], (*looks[-1], *sticks)]


def _units_asked(arm: SpatialArm) -> SpatialArm:
    """Return an arm with a note where limits are so far that degrees may have been taken for radians."""
    limits = {name: x.limits for name, x in zip(arm.names, arm.links, strict=True) if x.kind == "revolute"}
    ends = {name: [x for x in limit.position if math.isfinite(x)] for name, limit in limits.items()}
    far = [f"{name} ({max(map(abs, x)):g} rad)" for name, x in ends.items() if x and max(map(abs, x)) > FARTHEST_TURN]
    far += [f"{name} ({x.velocity:g} rad/s)" for name, x in limits.items() if FASTEST_TURN < x.velocity < math.inf]
    note = f"limits are farther than arms go: {', '.join(far)}; are they in degrees? They are taken as radians"
    return dataclasses.replace(arm, notes=(*arm.notes, note)) if far else arm


def arm_from_table(table: object, folder: Path) -> AnyArm:
    """Return the arm that a table describes: by its links, in space with a `position` each, in the plane without; or by
    a robot's `file`, relative to `folder`, and the choice of a chain in it.
    """
    if not isinstance(table, Mapping):
        return build_from(ArmParameters, table, "arm.")
    if "file" in table:
        return _robot_from_table(dict(table), folder)
    links = table.get("links")
    if not isinstance(links, list):
        return build_from(ArmParameters, table, "arm.")
    if not any(isinstance(link, Mapping) and "position" in link for link in links):
        planar = tuple(build_from(ArmLink, link, f"arm.links[{i}].") for i, link in enumerate(links))
        return build_from(ArmParameters, {**table, "links": planar}, "arm.")
    table = dict(table)
    mount, height = table.pop("mount", None), table.get("height")
    spatial = tuple(_link_from_table(link, f"arm.links[{i}].") for i, link in enumerate(links))
    base = _capsules_from_tables(table.get("base", []), "arm.base")
    arm = _units_asked(build_from(SpatialArm, {**table, "links": spatial, "base": base}, "arm."))
    return arm if mount is None else _mounted(arm, mount, height)


def _mounted(arm: SpatialArm, mount: Any, height: Any) -> SpatialArm:
    try:
        return mounted(arm, mount, height)
    except InputError as error:
        raise error.within("arm.") from None


def _capsules_from_tables(tables: object, place: str) -> tuple[Capsule, ...]:
    if not isinstance(tables, list):
        raise InputError(place, tables, "tables, each with start, end and radius")
    return tuple(build_from(Capsule, table, f"{place}[{i}].") for i, table in enumerate(tables))


def _link_from_table(table: object, place: str) -> SpatialLink:
    if isinstance(table, Mapping) and "limits" in table:
        table = {**table, "limits": build_from(JointLimits, table["limits"], place + "limits.")}
    if isinstance(table, Mapping) and "capsules" in table:
        table = {**table, "capsules": _capsules_from_tables(table["capsules"], place + "capsules")}
    return build_from(SpatialLink, table, place)


def _robot_from_table(table: dict[str, Any], folder: Path) -> SpatialArm:
    file, stick = table.pop("file"), table.pop("stick", None)
    mount, height = table.pop("mount", "floor"), table.pop("height", None)
    if "base" in table:
        raise InputError("arm.base", table["base"], "no value with a robot's file", "its mounting is `mount`")
    limits, speeds = table.pop("limits", {}), table.pop("speed_limits", ())
    if not isinstance(file, str):
        raise InputError("arm.file", file, "the path of a robot's file: " + ", ".join(ROBOT_FILES))
    choice = build_from(ArmChoice, table, "arm.")
    try:
        arm = read_robot(folder / file, choice)
    except InputError as error:
        raise error.within("arm: ") from None
    arm = _with_limits(arm, limits)
    try:
        arm = dataclasses.replace(arm, speed_limits=speeds)
    except InputError as error:
        raise error.within("arm.") from None
    arm = _mounted(arm, mount, height)
    if stick is None:
        return arm
    if not isinstance(stick, Mapping) or set(stick) - {"radius"} != {"length", "mass"}:
        raise InputError("arm.stick", stick, "a table with length [m] and mass [kg]; radius [m] may be given, too")
    return with_stick(arm, **stick)


def _with_limits(arm: SpatialArm, table: object) -> SpatialArm:
    """Return an arm with further limits, or others than its file has: for all joints, or in a table by joint."""
    fields = {f.name for f in dataclasses.fields(JointLimits)}
    if not isinstance(table, Mapping):
        raise InputError("arm.limits", table, f"a table of {', '.join(sorted(fields))}, or of such tables by joint")
    common = {name: value for name, value in table.items() if name in fields}
    own = {name: value for name, value in table.items() if name not in fields}
    links = []
    for joint, name, link in zip(arm.joints, arm.names, arm.links, strict=True):
        found, place = own.pop(name, own.pop(joint, {})), f"arm.limits.{name}."
        if not isinstance(found, Mapping):
            raise InputError(place.rstrip("."), found, f"a table of {', '.join(sorted(fields))}")
        limits = build_from(JointLimits, {**dataclasses.asdict(link.limits), **common, **found}, place)
        links.append(dataclasses.replace(link, limits=limits))
    for name in own:
        raise InputError(f"arm.limits.{name}", name, f"a joint ({', '.join(arm.names)}) or {', '.join(sorted(fields))}")
    return dataclasses.replace(arm, links=tuple(links))


def arm_to_table(arm: AnyArm) -> dict[str, Any]:
    """Return the arm as plain data; `arm_from_table` gives the same arm back."""
    table = _plain(dataclasses.asdict(arm))
    for link in table["links"] if arm.dimension == 3 else ():
        limits = {
            name: value for name, value in link.pop("limits").items() if np.isfinite(value).any() and np.any(value)
        }
        if limits:
            link["limits"] = limits
        if not link["capsules"]:
            del link["capsules"]
    for capsule in [*table.get("base", ()), *(c for link in table["links"] for c in link.get("capsules", ()))]:
        for name in ("flat", "width", "hull", "name"):
            if not capsule[name]:
                del capsule[name]
    table.pop("notes", None)
    for name in ("rate", "surface", "height"):
        if table.get(name) is None:
            table.pop(name, None)
    if table.get("names") == table["joints"]:
        del table["names"]
    if table.get("stick") == [0.0, 0.0]:
        del table["stick"]
    for name in ("base", "never_touch", "weightless", "speed_limits"):
        if not table.get(name, True):
            del table[name]
    return {"joints": table.pop("joints"), **table}


def _plain(value: Any) -> Any:
    """Return tuples, also nested ones, as lists."""
    if isinstance(value, dict):
        return {name: _plain(x) for name, x in value.items()}
    return [_plain(x) for x in value] if isinstance(value, (list, tuple)) else value


_WITH_PROFILE = {"joints": "joints", "node_inertia": "node_inertia", "clamp": "clamped"}  # keys, and arguments
ROUND = ("youngs_modulus", "diameter", "density")  # of a round whip, which give its mass and stiffness


def model_from_table(table: Mapping, folder: Path = Path()) -> Model:
    """Return a model from nested mappings, as in TOML; with `whip.profile` and `whip.N` the nodes are computed from a
    profile. The arm's file, if one is named, is relative to `folder`.
    """
    if not isinstance(table, Mapping):
        raise InputError("model", table, "a table")
    table = dict(table)
    whip = table.get("whip", {})
    if isinstance(whip, Mapping) and "profile" in whip:
        for key in whip:
            if key not in ("profile", "N", *_WITH_PROFILE):
                rule = f"only without whip.profile, with which a whip has only N, {', '.join(_WITH_PROFILE)}"
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
    """A profile from a table, which may give a round whip's material and diameter."""
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
        InputError: There is no such preset or file, or the file contains something that is not allowed.
    """
    expect(str, PathLike, name=name)
    name = fspath(name)
    if tip and not name.lower().endswith(ROBOT_FILES):
        rule = "a tip only with a robot's file: " + ", ".join(ROBOT_FILES)
        raise InputError("tip", tip, rule, "in a model file it is arm.tip")
    if as_named(name, PRESETS) in PRESETS:
        return preset(name)
    if name.lower().endswith(".toml"):
        return read_model(Path(name))
    if name.lower().endswith(ROBOT_FILES):
        return Model(rope(), read_robot(Path(name), ArmChoice(tip=tip)), name=_name(Path(name)))
    if as_named(name, presets()) in PRESETS:
        return preset(name)
    rule = "a preset (" + ", ".join(PRESETS) + ") or the path of a .toml file, or of a robot: " + ", ".join(ROBOT_FILES)
    raise InputError("model", name, rule)
