"""Control in hand space (Sect. 4.2): impedance between the hand and its path, or joints that follow that path."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from whiptool.models.hand_space import HandSpace
from whiptool.models.numbers import number
from whiptool.models.parameters import ArmParameters
from whiptool.models.spatial_arm import SpatialArm

SINGULAR = 0.02  # [m/rad] below which a direction of the hand counts as one in which joints cannot move it


@dataclass(frozen=True)
class HandControl:
    """Control of the hand instead of the joints.

    With J the hand's Jacobian and a law's `F = K e + B de` (Eq. 2) of the hand's errors [m, m/s], the joints' torques
    are `J^T F` and gravity compensation, and what joints do that does not move the hand is braked by `null_damping`:
    `-b (1 - J^+ J) v`. Beside position control the joints follow the hand's path exactly.

    Args:
        posture: Home posture of the arm [rad or m], near which it holds the hand; default: see `home_posture`.
        null_damping: b [N m s/rad], of every joint; where a law gives torques.

    Raises:
        InputError: A number is not finite, or negative.
    """

    posture: tuple[float, ...] | None = None
    null_damping: float = 1.0

    def __post_init__(self) -> None:
        if self.posture is not None:
            angles = tuple(number(f"posture[{i}]", x) for i, x in enumerate(self.posture))
            object.__setattr__(self, "posture", angles)
        object.__setattr__(self, "null_damping", number("null_damping", self.null_damping, low=0))


@lru_cache(maxsize=32)
def hand_space(arm: ArmParameters | SpatialArm, hand: HandControl, *, led: bool) -> HandSpace:
    """Return the space of an arm's hand strikes, made once.

    Args:
        arm: In the plane or in space.
        hand: How its hand is controlled.
        led: Whether its joints follow the hand's path exactly.

    Raises:
        InputError: The arm has no such space.
    """
    return HandSpace(arm, posture=hand.posture, led=led)
