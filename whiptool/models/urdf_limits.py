"""Limits of joints in URDF files, including those that Pinocchio does not read: acceleration, jerk, and velocities that
depend on the position.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import replace

from whiptool.errors import InputError
from whiptool.models.spatial_arm import JointLimits

_BY_POSITION = "position_based_velocity_limits"  # an extension of Franka's files
VELOCITY_MARGIN, POSITION_MARGIN = 1e-3, 1e-2  # [rad/s], libfranka's; [rad], chosen, of the deviation from the command
RESERVES = f"reserves of {VELOCITY_MARGIN:g} rad/s and {1e3 * POSITION_MARGIN:g} mrad"


def number_of(element: ET.Element | None, name: str, absent: str = "0") -> float:
    """Return a number of an element, `absent` if it is not given; `check_numbers` has seen that it is one."""
    return float(absent if element is None else element.get(name, absent))


def position_limits(joint: ET.Element) -> tuple[float, float]:
    """Return the lowest and highest position of a joint [rad or m]; infinite if it states none, or is continuous."""
    limit = joint.find("limit")
    if limit is None or joint.get("type") == "continuous":
        return -math.inf, math.inf
    low, high = (number_of(limit, end) for end in ("lower", "upper"))
    return (low, high) if low < high else (-math.inf, math.inf)


def zero_limit(joint: ET.Element) -> bool:
    """Return whether a joint's limit of speed or torque is written as 0."""
    limit = joint.find("limit")
    return limit is not None and any(
        limit.get(x) is not None and number_of(limit, x) <= 0 for x in ("velocity", "effort")
    )


def keeps_off(joint: ET.Element) -> bool:
    """Return whether a joint has soft limits within its range."""
    soft, limit = joint.find("safety_controller"), joint.find("limit")
    low, high = number_of(soft, "soft_lower_limit"), number_of(soft, "soft_upper_limit")
    return low < high and (low > number_of(limit, "lower") or high < number_of(limit, "upper"))


def by_position(joint: ET.Element) -> bool:
    """Return whether a joint's limit of speed depends on its position."""
    return joint.find(_BY_POSITION) is not None


def with_all_limits(joint: ET.Element, limits: JointLimits) -> JointLimits:
    """Return a joint's limits with those that only the file's text has: `acceleration`, `deceleration` and `jerk` of
    `<limit>` (URDF 1.2), of which the smaller of the first two holds for both, and Franka's
    `<position_based_velocity_limits>`, with reserves.
    """
    limit, slowing = joint.find("limit"), joint.find(_BY_POSITION)
    faster, slower, jerk = (number_of(limit, name) or math.inf for name in ("acceleration", "deceleration", "jerk"))
    acceleration = slower if slower < faster else faster  # 0 is no limit
    try:
        limits = replace(limits, acceleration=acceleration, jerk=jerk)
        if slowing is None:
            return limits
        d, offset = number_of(slowing, "deceleration_limit", "nan"), number_of(slowing, "velocity_offset")
        margins = {"velocity_margin": VELOCITY_MARGIN, "position_margin": POSITION_MARGIN}
        return replace(limits, deceleration=d, velocity_offset=offset, **margins)
    except InputError as error:
        raise error.within(f"joint {joint.get('name', '')}: ") from None
