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
    """Control of the hand's motion instead of the joints'.

    With J the hand's Jacobian and a law's force `F = K e + B de` (Eq. 2) from the hand's errors [m, m/s], with
    orientation also its rotation errors [rad, rad/s] (see `rotation_left`), the joints' torques are `J^T F` plus
    gravity compensation plus damping of the null space, `-b (1 - J^+ J) v`. With position control the joints follow the
    hand's path exactly.

    Args:
        posture: Home posture of the arm [rad or m], (a,); of all postures with the same hand pose the nearest to it is
            taken. Default: see `home_posture`.
        null_damping: Damping b of the null space, for every joint [N m s/rad]; only for laws that give torques.
        orientation: Whether strikes prescribe the hand's orientation, too.

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
    """Return the space of strikes of an arm's hand; the result is cached.

    Args:
        arm: Arm in the plane or in space.
        hand: Control of the hand.
        led: Whether the joints follow the hand's path exactly (position control).

    Raises:
        InputError: The posture does not fit the arm or is singular, or the arm has too few joints for the hand's
            coordinates.
    """
    return HandSpace(arm, posture=hand.posture, orientation=hand.orientation, led=led)


def hand_impedance(model: Model, hand: HandControl | None = None, *, frequency: float = 3.0) -> ConstantImpedance:
    """Return the default stiffness and damping of the hand.

    In the home posture, with the whip's mass in the hand, they give the natural frequency `frequency` and critical
    damping. If only the hand's position is controlled (`hand.orientation` is false), both are multiples of the identity
    (d, d) [N/m, N s/m], computed from the largest effective mass in any direction. If its orientation is controlled,
    too, they are the hand's effective inertia matrix times w^2 and 2 w, w = 2 pi frequency; rotational entries are in
    N m/rad and N m s/rad. A single factor would not do there, because the inertia about the hand's own axis is very
    small.

    Args:
        model: Arm and whip.
        hand: Control of the hand; default: `HandControl()`.
        frequency: Natural frequency [Hz].
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
