"""How the hand of an arm in space moves while its joints do, with exact derivatives by the joints' motion."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from whiptool.dynamics.serial_arm import SerialArm
from whiptool.dynamics.swing import SPATIAL_BASE
from whiptool.models.spatial_arm import SpatialArm

_PLACE = 3


class HandInputs(NamedTuple):
    """Motion of the hand at I instants.

    Args:
        inputs: Input vectors of `whiptool.dynamics.swing.SpatialSwing`, (I, 21).
        place: Position of the hand [m], (I, 3).
        by_joints: Derivatives of the 21 inputs and the 3 coordinates by positions, speeds and accelerations of the a
            joints, (I, 24, 3, a).
    """

    inputs: np.ndarray
    place: np.ndarray
    by_joints: np.ndarray


def hand_motion(arm: SpatialArm, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> HandInputs:
    """Return the hand's motion for I samples of the joints' positions, speeds and accelerations, (I, a) each [rad,
    s]."""
    found, slopes = _of_joints(arm)(q.T, v.T, a.T)
    values = found.full().T
    by_joints = slopes.full().reshape(SPATIAL_BASE + _PLACE, len(q), 3, arm.n).swapaxes(0, 1)
    return HandInputs(values[:, :SPATIAL_BASE], values[:, SPATIAL_BASE:], by_joints)


@lru_cache(maxsize=8)
def _of_joints(arm: SpatialArm) -> ca.Function:
    """Return the hand's numbers (24, 1) and their derivatives (24, 3 joints) as a function of one instant's joints."""
    serial = SerialArm.of(arm)
    q, v, a = (ca.SX.sym(name, arm.n) for name in "qva")
    posture, led = serial.posture(q), serial.led(q, v, a, 0.0)
    moves = ca.mtimes(led.jacobian, v)
    axes = ca.vec(posture.hand_turned.matrix)
    found = ca.densify(ca.vertcat(axes, moves, led.acceleration, posture.hand))
    slopes = ca.densify(ca.jacobian(found, ca.vertcat(q, v, a)))
    return ca.Function("hand_motion", [q, v, a], [found, slopes], {"cse": True})
