"""Arms as tables of TOML files, which may name a robot's file in URDF or MJCF."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from whiptool.errors import InputError
from whiptool.models.arm_choice import ArmChoice
from whiptool.models.capsules import Capsule
from whiptool.models.joint_space import FARTHEST_TURN
from whiptool.models.mount import mounted
from whiptool.models.planar_arm import AnyArm, ArmLink, ArmParameters
from whiptool.models.spatial_arm import JointLimits, SpatialArm, SpatialLink
from whiptool.models.stick import with_stick
from whiptool.models.tables import build_from
from whiptool.models.touching import without_touching

ROBOT_FILES = (".urdf", ".xml")  # URDF, MJCF
FASTEST_TURN = 50.0  # [rad/s]; no joint of an arm is faster


def read_robot(path: Path | str, choice: ArmChoice | None = None) -> SpatialArm:
    """Read an arm from a robot's file, URDF or MJCF.

    Raises:
        InputError: The file is neither URDF nor MJCF, or `read_urdf` or `read_mjcf` refuses it.
    """
    path = Path(path)
    if path.suffix == ".urdf":
        from whiptool.models.urdf import read_urdf

        return _units_asked(without_touching(read_urdf(path, choice), choice))
    if path.suffix == ".xml":
        from whiptool.models.mjcf import read_mjcf

        return _units_asked(without_touching(read_mjcf(path, choice), choice))
    raise InputError("file", str(path), "a robot's file: " + ", ".join(ROBOT_FILES))


def _units_asked(arm: SpatialArm) -> SpatialArm:
    """Return an arm with a note where limits are so far that degrees may have been taken for radians."""
    limits = {name: x.limits for name, x in zip(arm.names, arm.links, strict=True) if x.kind == "revolute"}
    ends = {name: [x for x in limit.position if math.isfinite(x)] for name, limit in limits.items()}
    far = [f"{name} ({max(map(abs, x)):g} rad)" for name, x in ends.items() if x and max(map(abs, x)) > FARTHEST_TURN]
    far += [f"{name} ({x.velocity:g} rad/s)" for name, x in limits.items() if FASTEST_TURN < x.velocity < math.inf]
    note = f"limits are farther than arms go: {', '.join(far)}; are they in degrees? They are taken as radians"
    return dataclasses.replace(arm, notes=(*arm.notes, note)) if far else arm


def arm_from_table(table: object, folder: Path) -> AnyArm:
    """Return the arm that a table describes: by its links, or by a robot's `file` and the choice of a chain in it.

    Links in space have a `position`; those in the plane have none.

    Args:
        table: Table of an arm.
        folder: Folder to which `file` is relative.

    Raises:
        InputError: A key is unknown or missing, or a value is not allowed; the key is named.
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
    spatial = tuple(_link_from_table(link, f"arm.links[{i}].") for i, link in enumerate(links))
    base = _capsules_from_tables(table.get("base", []), "arm.base")
    return _units_asked(build_from(SpatialArm, {**table, "links": spatial, "base": base}, "arm."))


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
    file, stick, base = table.pop("file"), table.pop("stick", None), table.pop("base", "floor")
    if not isinstance(file, str):
        raise InputError("arm.file", file, "the path of a robot's file: " + ", ".join(ROBOT_FILES))
    choice = build_from(ArmChoice, table, "arm.")
    try:
        arm = read_robot(folder / file, choice)
    except InputError as error:
        raise error.within("arm: ") from None
    try:
        arm = mounted(arm, base)
    except InputError as error:
        raise error.within("arm.") from None
    if stick is None:
        return arm
    if not isinstance(stick, Mapping) or set(stick) - {"radius"} != {"length", "mass"}:
        raise InputError("arm.stick", stick, "a table with length [m] and mass [kg]; radius [m] may be given, too")
    return with_stick(arm, **stick)


def arm_to_table(arm: AnyArm) -> dict[str, Any]:
    """Return the arm as plain data; `arm_from_table` gives the same arm back."""
    table = _plain(dataclasses.asdict(arm))
    for link in table["links"] if arm.dimension == 3 else ():
        limits = {name: value for name, value in link.pop("limits").items() if not _unlimited(value)}
        if limits:
            link["limits"] = limits
        if not link["capsules"]:
            del link["capsules"]
    for capsule in [*table.get("base", ()), *(c for link in table["links"] for c in link.get("capsules", ()))]:
        for name in ("flat", "width"):
            if not capsule[name]:
                del capsule[name]
    table.pop("notes", None)
    if table.get("names") == table["joints"]:
        del table["names"]
    for name in ("base", "never_touch", "weightless"):
        if not table.get(name, True):
            del table[name]
    return {"joints": table.pop("joints"), **table}


def _unlimited(value: float | list[float]) -> bool:
    return all(map(math.isinf, value)) if isinstance(value, list) else math.isinf(value)


def _plain(value: Any) -> Any:
    """Return tuples, also nested ones, as lists."""
    if isinstance(value, dict):
        return {name: _plain(x) for name, x in value.items()}
    return [_plain(x) for x in value] if isinstance(value, (list, tuple)) else value
