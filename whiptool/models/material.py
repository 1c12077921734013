"""A round whip of one material in the place of another."""

from __future__ import annotations

from whiptool.errors import InputError
from whiptool.models.profile import WhipProfile
from whiptool.models.whip import WhipParameters


def of_material(whip: WhipParameters, *, youngs_modulus: float, diameter: float, density: float) -> WhipParameters:
    """Return a round whip of one material with the length, number and kind of nodes of another whip.

    The ratio of damping to stiffness is that of the other whip at its first joint between nodes. The hinge at the hand
    is free if the other's is. The new whip has neither drag nor friction.

    Args:
        whip: The other whip.
        youngs_modulus: Young's modulus [Pa].
        diameter: Diameter [m].
        density: Density [kg/m^3].

    Raises:
        InputError: A number is out of range, or the other whip has no stiffness, so that the damping ratio is
            undefined.
    """
    stiffness, damping = whip.per_node("k"), whip.per_node("b")
    if whip.N < 2 or stiffness[1] <= 0:
        rule = "a whip whose second joint has a stiffness, with which its damping is compared"
        raise InputError("whip.k", whip.k, rule, "give the whip as a profile in a file")
    material = {"youngs_modulus": youngs_modulus, "diameter": diameter, "density": density}
    undamped = WhipProfile.round(length=whip.length, bending_damping=0.0, **material)
    ratio = float(damping[1] / stiffness[1])  # [s]
    profile = undamped.changed({"bending_damping": ratio * undamped.bending_stiffness})
    inertia = profile.linear_density * whip.length / whip.N * diameter**2 / 8 if whip.joints == "universal" else 0.0
    return profile.lump(whip.N, joints=whip.joints, node_inertia=inertia, clamped=bool(stiffness[0]))
