"""What of a URDF file is assumed, or has no part in the arm, in lines for people."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Callable, Collection, Sequence

from whiptool.models.urdf_shapes import DENSITY, with_meshes

_BY_POSITION = "position_based_velocity_limits"  # an extension of Franka's files


def assumed(
    robot: ET.Element,
    movers: Collection[str],
    moved: Collection[str],
    weighed: Collection[str],
    without_mass: Sequence[str],
) -> tuple[str, ...]:
    """Return notes on what was assumed or ignored in a URDF file, one line for each kind.

    Args:
        robot: Root element of the file.
        movers: Names of the arm's joints.
        moved: Names of the arm's links, its base included.
        weighed: Names of its moving links whose mass was computed from their shapes.
        without_mass: Names of the joints whose links have an inertia but no mass.
    """

    def of(has: Callable[[ET.Element], bool]) -> str:
        joints = [joint for joint in robot.findall("joint") if joint.get("name") in movers and has(joint)]
        return ", ".join(joint.get("name", "") for joint in joints)

    def follow(joint: ET.Element) -> bool:
        mimic = joint.find("mimic")
        return mimic is not None and mimic.get("joint") in movers

    light, water = ", ".join(without_mass), ", ".join(sorted(weighed))
    following = ", ".join(joint.get("name", "") for joint in robot.findall("joint") if follow(joint))
    soft, free, meshes = of(_keeps_off), of(_zero_limit), ", ".join(sorted(with_meshes(robot) & set(moved)))
    fast, rubbing = of(lambda joint: joint.find(_BY_POSITION) is not None), of(_rubs)
    said = {
        f"no <inertial> in {water}: taken as {DENSITY:g} kg/m3 of their shapes, a guess that torques depend on": water,
        f"the inertia of what {light} moves is left out, as its mass is 0: no body has one without the other": light,
        f"speed limits that depend on the position of {fast} are not judged, only the largest speeds": fast,
        f"what mimics joints of the arm does not move with them, but is held: {following}": following,
        f"a velocity or effort of 0 in the <limit> of {free} is taken as no limit": free,
        f"collision shapes of {meshes} that are meshes are not looked at: nothing is judged to touch them": meshes,
        f"soft limits of {soft} (<safety_controller>) are not kept, only those of <limit>": soft,
        f"dry friction of {rubbing} has no part in the model, only its damping has": rubbing,
    }
    return tuple(note for note, names in said.items() if names)


def _rubs(joint: ET.Element) -> bool:
    """Whether a joint has dry friction."""
    return _number(joint.find("dynamics"), "friction") > 0


def _zero_limit(joint: ET.Element) -> bool:
    """Whether a joint's limit of speed or torque is written as 0."""
    limit = joint.find("limit")
    return limit is not None and any(
        limit.get(x) is not None and _number(limit, x) <= 0 for x in ("velocity", "effort")
    )


def _keeps_off(joint: ET.Element) -> bool:
    """Whether a joint is to stay within less than its range."""
    soft, limit = joint.find("safety_controller"), joint.find("limit")
    low, high = _number(soft, "soft_lower_limit"), _number(soft, "soft_upper_limit")
    return low < high and (low > _number(limit, "lower") or high < _number(limit, "upper"))


def _number(element: ET.Element | None, name: str) -> float:
    """A number of an element: 0 where it is not given, NaN where it is not a number."""
    try:
        return 0.0 if element is None else float(element.get(name, "0"))
    except ValueError:
        return math.nan
