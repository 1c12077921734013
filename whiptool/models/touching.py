"""Shapes of a robot's file that touch where all joints are at 0: such pairs are not compared, as in MoveIt."""

from __future__ import annotations

import dataclasses

import numpy as np

from whiptool.models.arm_choice import ArmChoice
from whiptool.models.parameters import Model
from whiptool.models.spatial_arm import BASE, SpatialArm
from whiptool.models.whip import WhipParameters

_WHIP = WhipParameters(N=1, l=0.1, m=0.01, k=0, b=0, joints="rod")  # any: it is not compared


def without_touching(arm: SpatialArm, choice: ArmChoice | None) -> SpatialArm:
    """Return an arm in which pairs of links that touch in the zero posture are not checked for contact; `notes` lists
    them.

    In the zero posture all joints are at 0, or as near to it as their ranges allow. Links that touch in every posture
    touch in it.

    Args:
        arm: Arm as read from a file.
        choice: If its `never_touch` is given, these pairs are used instead.

    Raises:
        InputError: The choice names a joint that the arm does not have.
    """
    if choice is not None and choice.never_touch is not None:
        return dataclasses.replace(arm, never_touch=tuple(choice.never_touch))
    if not any(link.capsules for link in arm.links):
        return arm
    from whiptool.models.scene import Scene

    rest = np.array([np.clip(0.0, *link.limits.position) for link in arm.links])
    names = (*arm.joints, BASE)
    scene = Scene(Model(_WHIP, arm), of=("close", "apart"))
    links = [scene.links_of(pair) for pair in scene.pairs]
    distances = scene.distances(rest[None])[0][0] if links else []
    pairs = sorted({both for both, distance in zip(links, distances, strict=True) if distance < 0})
    if not pairs:
        return arm
    touching = tuple((names[one], names[other]) for one, other in pairs)  # the base, -1, is the last name
    said = ", ".join(f"{one} and {other}" for one, other in touching)
    note = f"shapes that touch where all joints are at 0 are not compared, of the links of {said}; arm.never_touch in a"
    notes = (*arm.notes, f"{note} model file says otherwise")
    return dataclasses.replace(arm, never_touch=touching, notes=notes)
