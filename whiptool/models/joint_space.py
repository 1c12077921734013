"""Joint space: strikes described by where the joints begin and end."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from whiptool.errors import InputError
from whiptool.models.hand_strike import HandStrike
from whiptool.models.numbers import array_of
from whiptool.models.planar_arm import AnyArm
from whiptool.models.strike import Strike, StrikeBounds, default_bounds, strike_names

AnyStrike = Strike | HandStrike
FARTHEST_TURN = 4 * np.pi  # [rad] from 0; no arm turns farther


class StrikePath(Protocol):
    """Motion of the arm's joints in a strike: a `Strike`, or the `HandPath` of a strike in hand space."""

    @property
    def q_i(self) -> tuple[float, ...]:
        """Joint positions at the start [rad or m], (a,)."""
        ...

    @property
    def D(self) -> float:
        """Duration of the movement [s]."""
        ...

    def reference(self, t: float | np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Desired positions, velocities and accelerations of the joints at times t [s], each (*t.shape, a)."""
        ...


class JointSpace:
    """Strikes in joint space: vectors `[q_i, q_f, D]` (2 a + 1,), which simulators take unchanged.

    Args:
        arm: Arm with a joints.
    """

    def __init__(self, arm: AnyArm) -> None:
        self.arm = arm

    @property
    def kind(self) -> str:
        """`joint`, the kind of this space."""
        return "joint"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of a strike's coordinates; see `strike_names`."""
        return strike_names(self.arm)

    @property
    def width(self) -> int:
        """Length of a strike vector, 2 a + 1."""
        return 2 * self.arm.n + 1

    @property
    def layout(self) -> dict[str, int]:
        """Name and size of every block of a strike vector."""
        return joint_layout(self.arm.n)

    @property
    def bounds(self) -> StrikeBounds:
        """Default bounds for searches; see `default_bounds`.

        Raises:
            InputError: The arm has no default bounds.
        """
        return default_bounds(self.arm)

    def strike(self, vector: Sequence[float] | np.ndarray) -> Strike:
        """Return the strike of a vector (2 a + 1,)."""
        return Strike.from_vector(vector)

    def path(self, vector: np.ndarray) -> Strike:
        """Return the strike of a vector (2 a + 1,), which is also the path of the joints."""
        return Strike.from_vector(vector)

    def numbers(self, vectors: np.ndarray) -> np.ndarray:
        """Return the strike vectors (B, 2 a + 1) unchanged."""
        return vectors

    def slopes(self, vectors: np.ndarray) -> np.ndarray:
        """Return identity matrices, the derivatives of `numbers`, (B, 2 a + 1, 2 a + 1)."""
        return np.broadcast_to(np.eye(self.width), (len(vectors), self.width, self.width))

    def beyond(self, vectors: np.ndarray) -> np.ndarray:
        """Return zeros (B,): all strikes in joint space are feasible."""
        return np.zeros(len(vectors))

    def check_turns(self, name: str, vectors: Any) -> None:
        """Refuse strikes (2 a + 1,) or (B, 2 a + 1) with a joint angle more than two turns from 0; see
        `check_turns`."""
        check_turns(name, np.asarray(vectors)[..., :-1], self.arm)


def check_turns(name: str, positions: Any, arm: AnyArm) -> None:
    """Refuse joint angles that are implausibly large, as angles in degrees would be.

    Args:
        name: Name of the values for the user.
        positions: Positions of the arm's joints, k sets in a row, (k a,) or (B, k a); those of prismatic joints are not
            checked.
        arm: Arm with a joints.

    Raises:
        InputError: An angle is more than two turns from 0.
    """
    rows = np.reshape(positions, (-1, arm.n))
    refuse_far(name, rows, [joint not in arm.slides for joint in arm.joints], arm.joints)


def refuse_far(name: str, rows: np.ndarray, turning: Sequence[bool], of: Sequence[str]) -> None:
    """Refuse angles more than two turns from 0, as values in degrees would be.

    Args:
        name: Name of the values for the user.
        rows: Values, (B, k); angles in rad.
        turning: Which of the k values are angles, (k,).
        of: Name of each of the k values.

    Raises:
        InputError: There is such an angle.
    """
    far = np.argwhere((np.abs(rows) > FARTHEST_TURN) & np.array(turning))
    if len(far):
        row, column = far[0]
        given, rule = f"{rows[row, column]:g} rad of {of[column]}", "angles up to two turns (12.57 rad) from 0"
        raise InputError(name, given, rule, "angles are in radians; are these degrees?")


def joint_layout(a: int) -> dict[str, int]:
    """Return name and size of every block of a strike vector for an arm with a joints."""
    return {"q_i": a, "q_f": a, "D": 1}


def checked_vectors(strikes: Any, width: int, whose: str) -> np.ndarray:
    """Return strikes as vectors, (B, width).

    Args:
        strikes: One strike or many, or vectors of shape (B, width) or (width,).
        width: Length of a vector.
        whose: Description of the arm or space to which the strikes belong, for messages.

    Raises:
        InputError: The vectors have another length, a value is not finite, or a duration D is not positive.
    """
    given = array_of("strikes", strikes, f"a Strike, or an array of shape (B, {width}), for {whose}")
    vectors = np.ascontiguousarray(np.atleast_2d(given))
    if vectors.ndim != 2 or vectors.shape[1] != width:
        raise InputError("strikes", vectors.shape, f"an array of shape (B, {width}), for {whose}")
    if not np.isfinite(vectors).all() or not (vectors[:, -1] > 0).all():
        raise InputError("strikes", "a value that is not finite, or D <= 0", "finite angles and D > 0 s")
    return vectors
