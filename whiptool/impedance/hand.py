"""Control in hand space (Sect. 4.2): impedance between the hand and its path, or joints that follow that path."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from whiptool.errors import InputError
from whiptool.impedance.constant import ConstantImpedance
from whiptool.models.hand_space import HandSpace
from whiptool.models.numbers import number
from whiptool.models.planar_arm import AnyArm

if TYPE_CHECKING:
    from whiptool.models.parameters import Model

SINGULAR = 0.02  # [m/rad] below which a direction of the hand counts as one in which joints cannot move it


@dataclass(frozen=True)
class HandControl:
    """Control of the hand instead of the joints.

    With J the hand's Jacobian and a law's `F = K e + B de` (Eq. 2) of the hand's errors [m, m/s], with orientation also
    of how far it is turned from its path [rad, rad/s] (see `rotation_left`), the joints' torques are `J^T F` and
    gravity compensation, and what joints do that does not move the hand is braked by `null_damping`: `-b (1 - J^+ J)
    v`. With position control the joints follow the hand's path exactly.

    Args:
        posture: Home posture of the arm [rad or m], near which it holds the hand; default: see `home_posture`.
        null_damping: b [N m s/rad], of every joint; where a law gives torques.
        orientation: Strikes hold the hand's orientation, too.

    Raises:
        InputError: A number is not finite, or negative, or `orientation` is neither true nor false.
    """

    posture: tuple[float, ...] | None = None
    null_damping: float = 1.0
    orientation: bool = False

    def __post_init__(self) -> None:
        if self.posture is not None:
            angles = tuple(number(f"posture[{i}]", x) for i, x in enumerate(self.posture))
            object.__setattr__(self, "posture", angles)
        object.__setattr__(self, "null_damping", number("null_damping", self.null_damping, low=0))
        if not isinstance(self.orientation, bool):
            raise InputError("orientation", self.orientation, "true or false")


@lru_cache(maxsize=32)
def hand_space(arm: AnyArm, hand: HandControl, *, led: bool) -> HandSpace:
    """Return the space of an arm's hand strikes, made once.

    Args:
        arm: Arm in the plane or in space.
        hand: How its hand is controlled.
        led: Whether its joints follow the hand's path exactly.

    Raises:
        InputError: The arm has no such space.
    """
    return HandSpace(arm, posture=hand.posture, orientation=hand.orientation, led=led)


def hand_impedance(model: Model, hand: HandControl | None = None, *, frequency: float = 3.0) -> ConstantImpedance:
    """Return the stiffness and damping of the hand where none are given [N/m, N s/m].

    In the home posture they give the arm and the whip's mass in its hand a natural frequency, and damp it critically:
    of its place alike in all directions, along that in which they are the heaviest; of a pose in all its motions, by
    the inertia that the hand feels [kg, kg m, kg m^2], since about its own axis a hand is so light that what holds the
    arm would tear it around.

    Args:
        model: Arm and whip.
        hand: How the hand is controlled; default: as usual.
        frequency: Frequency [Hz].
    """
    from whiptool.impedance.arm import Arm

    hand, d = hand or HandControl(), model.dimension
    kinematics = hand_space(model.arm, hand, led=False).kinematics
    q = kinematics.posture
    J = kinematics.jacobian(q)
    inertia = np.linalg.inv(J @ np.linalg.solve(Arm(model).inertia(q), J.T))  # that the hand feels
    inertia[:d, :d] += model.whip.mass * np.eye(d)
    if not hand.orientation:
        inertia = np.linalg.eigvalsh(inertia)[-1] * np.eye(d)
    omega = 2 * math.pi * frequency
    K, B = ((gain * (inertia + inertia.T) / 2).tolist() for gain in (omega**2, 2 * omega))
    return ConstantImpedance(tuple(map(tuple, K)), tuple(map(tuple, B)))
