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
    """A strike as its arm's joints make it: a `Strike` is its own, a `HandPath` one of the hand's."""

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
    """Strikes of an arm's joints: vectors `[q_i, q_f, D]` of 2 a + 1 numbers, which rollouts take as they are.

    Args:
        arm: Arm of a joints.
    """

    def __init__(self, arm: AnyArm) -> None:
        self.arm = arm

    @property
    def kind(self) -> str:
        """`joint`."""
        return "joint"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of a strike's numbers; see `strike_names`."""
        return strike_names(self.arm)

    @property
    def width(self) -> int:
        """Numbers of a strike vector."""
        return 2 * self.arm.n + 1

    @property
    def layout(self) -> dict[str, int]:
        """Name and size of every block of a strike vector."""
        return joint_layout(self.arm.n)

    @property
    def bounds(self) -> StrikeBounds:
        """Bounds in which strikes are searched; see `default_bounds`.

        Raises:
            InputError: The arm has none.
        """
        return default_bounds(self.arm)

    def strike(self, vector: Sequence[float] | np.ndarray) -> Strike:
        """Return the strike of a vector (2 a + 1,)."""
        return Strike.from_vector(vector)

    def path(self, vector: np.ndarray) -> Strike:
        """Return the strike of a vector (2 a + 1,), which is its joints' own path."""
        return Strike.from_vector(vector)

    def numbers(self, vectors: np.ndarray) -> np.ndarray:
        """Return the strikes' own numbers."""
        return vectors

    def slopes(self, vectors: np.ndarray) -> np.ndarray:
        """Return the derivatives of `numbers` by themselves, (B, 2 a + 1, 2 a + 1)."""
        return np.broadcast_to(np.eye(self.width), (len(vectors), self.width, self.width))

    def beyond(self, vectors: np.ndarray) -> np.ndarray:
        """Return zeros (B,): every strike of the joints can be made."""
        return np.zeros(len(vectors))

    def check_turns(self, name: str, vectors: Any) -> None:
        """Refuse strikes (2 a + 1,) or (B, 2 a + 1) that turn a joint farther than any arm does; see `check_turns`."""
        check_turns(name, np.asarray(vectors)[..., :-1], self.arm)


def check_turns(name: str, positions: Any, arm: AnyArm) -> None:
    """Refuse positions that turn a joint farther than any arm does, as angles in degrees would.

    Args:
        name: Name of the values for the user.
        positions: Positions of the arm's joints in their order, once or several times in a row, (k a,) or (B, k a); of
            joints that slide they are lengths, and not looked at.
        arm: Arm of a joints.

    Raises:
        InputError: An angle is more than two turns from 0.
    """
    rows = np.reshape(positions, (-1, arm.n))
    refuse_far(name, rows, [joint not in arm.slides for joint in arm.joints], arm.joints)


def refuse_far(name: str, rows: np.ndarray, turning: Sequence[bool], of: Sequence[str]) -> None:
    """Refuse an angle that is more than two turns from 0, as degrees would be.

    Args:
        name: Name of the values for the user.
        rows: Numbers, (B, k) [rad where they are angles].
        turning: Which of the k values are angles, (k,).
        of: Name of each of the k values.

    Raises:
        InputError: There is one.
    """
    far = np.argwhere((np.abs(rows) > FARTHEST_TURN) & np.array(turning))
    if len(far):
        row, column = far[0]
        given, rule = f"{rows[row, column]:g} rad of {of[column]}", "angles up to two turns (12.57 rad) from 0"
        raise InputError(name, given, rule, "angles are in radians; are these degrees?")


def joint_layout(a: int) -> dict[str, int]:
    """Return name and size of every block of a strike vector of a joints."""
    return {"q_i": a, "q_f": a, "D": 1}


def checked_vectors(strikes: Any, width: int, whose: str) -> np.ndarray:
    """Return strikes as vectors, (B, width).

    Args:
        strikes: One strike or many, or vectors of shape (B, width) or (width,).
        width: Numbers of a vector.
        whose: Owner of the strikes, in words.

    Raises:
        InputError: They are of another width, a value is not finite, or a duration D is not positive.
    """
    given = array_of("strikes", strikes, f"a Strike, or an array of shape (B, {width}), for {whose}")
    vectors = np.ascontiguousarray(np.atleast_2d(given))
    if vectors.ndim != 2 or vectors.shape[1] != width:
        raise InputError("strikes", vectors.shape, f"an array of shape (B, {width}), for {whose}")
    if not np.isfinite(vectors).all() or not (vectors[:, -1] > 0).all():
        raise InputError("strikes", "a value that is not finite, or D <= 0", "finite angles and D > 0 s")
    return vectors
