"""Dampers and dry friction between rods, of numbers: who brakes whom by how much, at many instants at once.

The formulas are those of docs/derivations.md, "Damping of rods"; `rods` has the same ones link by link.
"""

from __future__ import annotations

from itertools import accumulate
from typing import NamedTuple

import numpy as np

from whiptool.dynamics.rods import FOLD, SWIVEL
from whiptool.models.parameters import WhipParameters


class RodDamping(NamedTuple):
    """What brakes the N joints of a whip of rods.

    Args:
        torques: On each rod, and from each on what is before it the opposite [N m], (..., N, 3); what two joints do to
            the rod between them has no part along it.
        power: That each joint takes [W], (..., N).
    """

    torques: np.ndarray
    power: np.ndarray


def rod_damping(whip: WhipParameters, directions: np.ndarray, turns: np.ndarray) -> RodDamping:
    """Return what brakes the joints of rods that turn.

    Args:
        whip: Of N rods.
        directions: Unit vectors: the hand's -z, and the rods, (..., N + 1, 3).
        turns: Angular velocities of hand and rods [rad/s], (..., N + 1, 3); what is along a rod does not count.
    """
    before, d = directions[..., :-1, :], directions[..., 1:, :]
    hand, across = turns[..., :1, :], turns[..., 1:, :] - _dot(turns[..., 1:, :], d) * d
    cosine = _dot(before, d)
    hold = (1 + cosine) ** 3 / ((1 + cosine) ** 4 + FOLD**4)
    hold[..., 0, :] = 0
    passed = cosine + hold * (1 - cosine**2)  # of a spin, or of a torque along the rod, from joint to joint
    passed[..., 0, :] = 1
    gained = (1 - hold * cosine) * _dot(np.concatenate([hand, across[..., :-1, :]], axis=-2), d)
    spins = _along(gained - hold * _dot(across, before), passed)
    slip = np.diff(np.concatenate([hand, across + spins * d], axis=-2), axis=-2)
    spun = np.cumprod(passed, axis=-2)
    per_spin = spun * (d - before / passed)
    per_spin[..., 0, :] = 0
    root = np.sqrt(_dot(slip, slip) + whip.friction_velocity**2)
    damping = whip.per_node("b")[:, None] + whip.per_node("dry_friction")[:, None] / root
    resistance = SWIVEL + (damping * _dot(per_spin, per_spin)).sum(axis=-2, keepdims=True)
    spin = -(damping * _dot(slip, per_spin)).sum(axis=-2, keepdims=True) / resistance  # of the first rod, (..., 1, 1)
    slip = slip + spin * per_spin
    power = damping * _dot(slip, slip)
    power[..., :1, :] += SWIVEL * spin**2

    couples = -damping * slip
    own = _dot(couples, before) - passed * _dot(couples, d)
    none = np.zeros_like(own[..., :1, :])
    from_tip = [np.flip(x, axis=-2) for x in (own[..., 1:, :], passed[..., 1:, :])]
    beyond = np.concatenate([np.flip(_along(*from_tip), axis=-2), none], axis=-2)  # by the next joint, along each rod
    twisting = (beyond - _dot(couples, d)) * (d + hold * (before - cosine * d))
    return RodDamping(couples + twisting, power[..., 0])


def _along(gained: np.ndarray, passed: np.ndarray) -> np.ndarray:
    """Return what there is after each of N joints (..., N, 1): what it passes on of what was there, and gains."""
    if gained.ndim == 2:  # of one instant, as at each step in MuJoCo: numbers are ten times faster than arrays of one
        each = zip(gained[:, 0].tolist(), passed[:, 0].tolist(), strict=True)
        return np.array(list(accumulate(each, _passed_on, initial=0.0))[1:])[:, None]
    found = np.empty_like(gained)
    there = np.zeros_like(gained[..., 0, :])
    for i in range(gained.shape[-2]):
        there = passed[..., i, :] * there + gained[..., i, :]
        found[..., i, :] = there
    return found


def _passed_on(there: float, joint: tuple[float, float]) -> float:
    gained, passed = joint
    return passed * there + gained


def _dot(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return inner products (..., 1) of vectors (..., 3)."""
    return np.vecdot(x, y)[..., None]
