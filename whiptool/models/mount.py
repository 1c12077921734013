"""Mounting of an arm in space, its floor, and a stick in its hand that holds the whip."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from whiptool.errors import NOTHING, InputError
from whiptool.models.capsules import Capsule, turned_point
from whiptool.models.kinematics import arm_frames, rotation_about
from whiptool.models.numbers import metres, number, numbers
from whiptool.models.parameters import AnyArm
from whiptool.models.spatial_arm import RigidBody, SpatialArm, welded
from whiptool.models.strike import refuse_far

MOUNTS = {  # roll, pitch, yaw of the base [rad]
    "floor": (0.0, 0.0, 0.0),  # or a table
    "pedestal": (0.0, 0.0, 0.0),
    "wall": (0.0, math.pi / 2, 0.0),  # the base's z points forward, its x down
    "ceiling": (math.pi, 0.0, 0.0),  # its z points down, its x still forward
}
SURFACES = ("wall", "ceiling")  # of mounts, that arm and whip must not touch; a floor may be lower than the base
COLUMN = 0.1  # [m], radius of the pedestal of an arm whose base has no shape
MOUNT_RULE = f"{', '.join(MOUNTS)} and its height [m], or three numbers: roll pitch yaw [rad]"


def mount_rotation(given: str | Sequence[float]) -> np.ndarray:
    """Return the rotation (3, 3) of a base given as one of `MOUNTS`, or as roll, pitch, yaw [rad] as in URDF."""
    if isinstance(given, str) and given not in MOUNTS:
        raise InputError("mount", given, MOUNT_RULE)
    try:
        roll, pitch, yaw = MOUNTS[given] if isinstance(given, str) else numbers("mount", tuple(given), 3)
    except (InputError, TypeError):
        raise InputError("mount", given, MOUNT_RULE) from None
    refuse_far("mount", np.array([[roll, pitch, yaw]]), [True] * 3, ("roll", "pitch", "yaw"))
    about = [rotation_about(axis, angle) for axis, angle in zip(np.eye(3), (roll, pitch, yaw), strict=True)]
    return about[2] @ about[1] @ about[0]


def mounted(arm: SpatialArm, given: str | Sequence[float], height: float | None = None) -> SpatialArm:
    """Return the arm with its base rotated about the origin.

    A wall or ceiling at the base is the arm's `surface`. A pedestal is a column below the base, as thick as the base
    is, and one of the arm's fixed parts.

    Args:
        arm: Arm whose base's z axis points up.
        given: See `mount_rotation`.
        height: Height of the base above the floor [m]. A pedestal requires it; on a floor or table it is 0. None:
            unknown.

    Raises:
        InputError: `given` is not a rotation, or the height is missing, negative or not that of a floor.
    """
    R = mount_rotation(given)
    if given == "pedestal" and height is None:
        raise InputError("height", NOTHING, "the height of the pedestal [m]")
    if height is not None:
        height = metres("height", height, strict=False)
    if given == "floor" and height:
        raise InputError("height", height, "0 on a floor", "a base above the floor is on a pedestal, wall or ceiling")
    first = arm.links[0]
    turned = dataclasses.replace(
        first, position=turned_point(R, first.position), rotation=tuple(map(tuple, (R @ first.rotation).tolist()))
    )
    base = tuple(capsule.turned(R) for capsule in arm.base)
    if given == "pedestal" and height:
        radius = max((x.radius for x in arm.base if not x.name), default=COLUMN)
        base += (Capsule((0.0, 0.0, -height), (0.0, 0.0, 0.0), radius, flat=True),)
    surface, notes = None, arm.notes
    if given in SURFACES:
        surface = turned_point(R, (0.0, 0.0, 1.0))
        if height is None:
            notes += (f"the height of the {given} mount is not given: unless a floor is given, none is checked",)
    return dataclasses.replace(
        arm, links=(turned, *arm.links[1:]), base=base, surface=surface, height=height, notes=notes
    )


_LEAST_HEIGHT = 1e-3  # [m] of a shoulder above a floor: less is a turn of the base that was written with few digits
_LEVEL = 1e-9  # of an axis: by how much it may be off the vertical or the horizontal


def level_links(arm: SpatialArm) -> int:
    """Return the number of an arm's first links that never change their height, as their joints rotate about the
    vertical.
    """
    at_zero = arm_frames(arm, np.zeros(arm.n))
    for i, (link, frame) in enumerate(zip(arm.links, at_zero, strict=False)):
        upward = abs(float(frame.rotation[2] @ link.axis))
        if (1.0 - upward if link.kind == "revolute" else upward) > _LEVEL:
            return i
    return arm.n


def turns_as_a_whole(arm: AnyArm) -> bool:
    """Whether an arm's first joint rotates the whole arm about the vertical through the base."""
    first = arm.in_space().links[0]
    axis = np.array(first.rotation) @ np.array(first.axis)
    return first.kind == "revolute" and first.position[:2] == (0.0, 0.0) and bool(axis[2] == 1.0)


def default_floor(arm: AnyArm) -> float | None:
    """Return the height of the floor [m], or None if none is known.

    It is the arm's `height` below its base, or, where that is not given, 0 if the robot stands on a floor.

    A robot stands on a floor if the first joint that changes a height is above the base; not if that joint is at the
    base (a person's shoulder), next to it (on a wall) or below it (on a ceiling).
    """
    arm = arm.in_space()
    if arm.height is not None:
        return -arm.height
    if (first := level_links(arm)) == arm.n:
        return None
    height = float(arm_frames(arm, np.zeros(arm.n))[first].origin[2])
    return 0.0 if height > _LEAST_HEIGHT else None


RADIUS = 8e-3  # [m], of a stick that is 16 mm thick


def with_stick(arm: SpatialArm, *, length: float, mass: float, radius: float = RADIUS) -> SpatialArm:
    """Return the arm with a thin uniform stick along the hand's -z; the stick's far end becomes the hand.

    Args:
        arm: Arm that holds the stick.
        length: Length of the stick [m].
        mass: Mass [kg].
        radius: Radius of the stick's capsule, if the arm has capsules [m]; the inertia is that of a thin rod.

    Raises:
        InputError: A number is negative or not finite.
    """
    length, mass = metres("stick length", length, strict=False), number("stick mass", mass, low=0)
    axes, at = np.array(arm.hand_rotation), np.array(arm.hand_position)
    along = -axes[:, 2]
    inertia = mass * length**2 / 12 * (np.eye(3) - np.outer(along, along))
    last, (x, y, z) = arm.links[-1], (at + along * length).tolist()
    stick_body = RigidBody(mass, at + along * length / 2, inertia)
    both = welded([RigidBody(last.mass, np.array(last.com), last.inertia_matrix), stick_body])
    if both.mass:
        last = dataclasses.replace(last, mass=both.mass, com=tuple(both.com.tolist()), inertia=both.moments)
    if any(link.capsules for link in arm.links):
        stick = Capsule(tuple(at.tolist()), (x, y, z), radius)
        last = dataclasses.replace(last, capsules=(*last.capsules, stick))
    return dataclasses.replace(arm, links=(*arm.links[:-1], last), hand_position=(x, y, z), stick=(length, mass))
