"""A stick in the hand of an arm, as a tool that holds the whip."""

from __future__ import annotations

import dataclasses

import numpy as np

from whiptool.models.capsules import Capsule
from whiptool.models.numbers import metres, number
from whiptool.models.spatial_arm import SpatialArm, SpatialLink

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
    last = _welded(arm.links[-1], mass, at + along * length / 2, inertia)
    x, y, z = (at + along * length).tolist()
    if any(link.capsules for link in arm.links):
        stick = Capsule(tuple(at.tolist()), (x, y, z), radius)
        last = dataclasses.replace(last, capsules=(*last.capsules, stick))
    return dataclasses.replace(arm, links=(*arm.links[:-1], last), hand_position=(x, y, z))


def _welded(link: SpatialLink, mass: float, com: np.ndarray, inertia: np.ndarray) -> SpatialLink:
    """A link with one more body fixed to it: its mass [kg], centre of mass (3,) [m] and inertia about that (3, 3)."""
    total = link.mass + mass
    if total == 0:
        return link
    centre = (link.mass * np.array(link.com) + mass * com) / total
    moments = np.zeros((3, 3))
    for part, at, own in ((link.mass, np.array(link.com), link.inertia_matrix), (mass, com, inertia)):
        d = at - centre
        moments += own + part * (d @ d * np.eye(3) - np.outer(d, d))  # the theorem of parallel axes
    x, y, z = centre.tolist()
    upper = moments[(0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)]
    return dataclasses.replace(link, mass=total, com=(x, y, z), inertia=tuple(upper.tolist()))
