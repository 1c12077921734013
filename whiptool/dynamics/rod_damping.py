"""Dampers and dry friction between rods, of numbers: who brakes whom by how much, at many instants at once.

The formulas are those of docs/derivations.md, "Damping of rods"; `rods` has the same ones link by link.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from whiptool.dynamics.rods import FOLD, SWIVEL
from whiptool.models.parameters import WhipParameters


class RodDamping(NamedTuple):
    """Damping and friction at the N joints of a whip of rods.

    Args:
        torques: Torque of each joint on its rod [N m], (..., N, 3), the opposite acts on the previous rod; the sum of
            both joints' torques on a rod has no component along it.
        power: Power that each joint dissipates [W], (..., N).
    """

    torques: np.ndarray
    power: np.ndarray


def rod_damping(whip: WhipParameters, directions: np.ndarray, turns: np.ndarray) -> RodDamping:
    """Return damping and friction at the joints of rotating rods.

    Args:
        whip: Whip of N rods.
        directions: Unit vectors along the hand's -z and along the rods, (..., N + 1, 3).
        turns: Angular velocities of hand and rods [rad/s], (..., N + 1, 3); the component along a rod is ignored.
    """
    before, d = directions[..., :-1, :], directions[..., 1:, :]
    hand, turned = turns[..., :1, :], turns[..., 1:, :]
    across = turned - _dot(turned, d)[..., None] * d
    cosine = _dot(before, d)
    once = 1 + cosine
    cube = once * once * once
    hold = cube / (cube * once + FOLD**4)
    hold[..., 0] = 0
    passed = cosine + hold * (1 - cosine * cosine)  # of a spin, or of a torque along the rod, from joint to joint
    passed[..., 0] = 1
    gained = (1 - hold * cosine) * _dot(np.concatenate([hand, across[..., :-1, :]], axis=-2), d)
    spins = _along(gained - hold * _dot(across, before), passed)
    moved = np.concatenate([hand, across + spins[..., None] * d], axis=-2)
    slip = moved[..., 1:, :] - moved[..., :-1, :]
    spun = np.cumprod(passed, axis=-1)
    per_spin = spun[..., None] * (d - before / passed[..., None])
    per_spin[..., 0, :] = 0
    root = np.sqrt(_dot(slip, slip) + whip.friction_velocity**2)
    damping = whip.per_node("b") + whip.per_node("dry_friction") / root
    resistance = SWIVEL + (damping * _dot(per_spin, per_spin)).sum(axis=-1, keepdims=True)
    spin = -(damping * _dot(slip, per_spin)).sum(axis=-1, keepdims=True) / resistance  # of the first rod, (..., 1)
    slip += spin[..., None] * per_spin
    power = damping * _dot(slip, slip)
    power[..., :1] += SWIVEL * spin**2

    couples = -damping[..., None] * slip
    along = _dot(couples, d)
    own = _dot(couples, before) - passed * along
    beyond = np.zeros_like(own)  # what the next joint does, along each rod
    beyond[..., :-1] = _along(own[..., :0:-1], passed[..., :0:-1])[..., ::-1]
    twisted = d + hold[..., None] * (before - cosine[..., None] * d)
    return RodDamping(couples + (beyond - along)[..., None] * twisted, power)


def _along(gained: np.ndarray, passed: np.ndarray) -> np.ndarray:
    """Return what there is after each of N joints (..., N): what it passes on of what was there, and gains."""
    if gained.ndim == 1:  # of one instant, as at each step in MuJoCo: numbers are ten times faster than arrays of one
        there = 0.0
        return np.array(
            [there := share * there + gain for gain, share in zip(gained.tolist(), passed.tolist(), strict=True)]
        )
    found = np.empty_like(gained)
    one = np.zeros_like(gained[..., 0])
    for i in range(gained.shape[-1]):
        one = passed[..., i] * one + gained[..., i]
        found[..., i] = one
    return found


_dot = np.vecdot  # inner products (...) of vectors (..., 3)
