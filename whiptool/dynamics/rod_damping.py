"""Dampers and dry friction between rods, of numbers: who brakes whom by how much, at many instants at once.

The formulas are those of docs/derivations.md, "Damping of rods"; `rods` has the same ones link by link.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from whiptool.dynamics.rods import SWIVEL
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
    near = 1 + _dot(before, d)[..., 1:, :]  # of the joints between rods
    gains = (_dot(across[..., :-1, :], d[..., 1:, :]) - _dot(across[..., 1:, :], d[..., :-1, :])) / near
    spins = np.cumsum(np.concatenate([_dot(hand, d[..., :1, :]), gains], axis=-2), axis=-2)  # (..., N, 1)
    slip = np.diff(np.concatenate([hand, across + spins * d], axis=-2), axis=-2)
    per_spin = d - before
    per_spin[..., 0, :] = 0
    root = np.sqrt(_dot(slip, slip) + whip.friction_velocity**2)
    damping = whip.per_node("b")[:, None] + whip.per_node("dry_friction")[:, None] / root
    resistance = SWIVEL + (damping * _dot(per_spin, per_spin)).sum(axis=-2, keepdims=True)
    spin = -(damping * _dot(slip, per_spin)).sum(axis=-2, keepdims=True) / resistance  # the whole whip's, (..., 1, 1)
    slip = slip + spin * per_spin
    power = damping * _dot(slip, slip)
    power[..., :1, :] += SWIVEL * spin**2
    return RodDamping(_transmitted(-damping * slip, before, d), power[..., 0])


def _transmitted(couples: np.ndarray, before: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Return the joints' torques (..., N, 3): couples, and what of twist holds each rod's torque along itself."""
    own = _dot(couples, d)
    own[..., 0, :] = 0  # a ball joint's damper has none
    beyond = 2 * (own - np.flip(np.cumsum(np.flip(own, axis=-2), axis=-2), axis=-2))  # by the joint behind, along d
    twist = (beyond - own) / (1 + _dot(before, d)) * (before + d)
    twist[..., 0, :] = (beyond * d)[..., 0, :]
    return couples + twist


def _dot(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return inner products (..., 1) of vectors (..., 3)."""
    return (x * y).sum(axis=-1, keepdims=True)
