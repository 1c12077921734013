"""A profile's nodes as a function of its numbers, and their derivatives, by CasADi."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from whiptool.models.profile import WhipProfile, lump

PROFILE = tuple(WhipProfile(1.0, 1.0, 1.0, 0.0).numbers)
LUMPED = ("l", "m", "k", "b", "rest_angle", "drag", "hinge_mass")  # what a profile gives


def profile_slopes(profile: WhipProfile, N: int, clamped: bool = False) -> dict[str, dict[str, np.ndarray]]:
    """Return the derivatives of the nodes' parameters (`whip.l`, ...) by each parameter of a profile (`profile.length`,
    ...).
    """
    jacobians = [J.full() for J in lumping(N, clamped)[1](np.array([*profile.numbers.values()]))]
    return {
        f"profile.{name}": {f"whip.{block}": J[:, i] for block, J in zip(LUMPED, jacobians, strict=True)}
        for i, name in enumerate(PROFILE)
    }


@lru_cache(maxsize=8)
def lumping(N: int, clamped: bool = False) -> tuple[ca.Function, ca.Function]:
    """Return a profile's node parameters, the blocks of `LUMPED`, as a function of its parameters, and their Jacobians.

    Both functions take one vector, in the order of the profile's fields. If the whip is clamped, the hinge has its
    share of the bending stiffness.
    """
    z = ca.SX.sym("profile", len(PROFILE))
    blocks = lump(dict(zip(PROFILE, ca.vertsplit(z), strict=True)), N, clamped=clamped, constant=ca.DM)
    of_profile = [ca.SX(blocks[name]) for name in LUMPED]
    jacobians = [ca.jacobian(block, z) for block in of_profile]
    return ca.Function("lump", [z], of_profile), ca.Function("slopes", [z], jacobians)
