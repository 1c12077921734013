"""A strike of the hand: it moves from x_i to x_f in D seconds along a minimum-jerk path (Eq. 1)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from whiptool.errors import InputError
from whiptool.models.arrays import Vector


@dataclass(frozen=True)
class HandStrike(Vector):
    """Zero-torque trajectory of the hand, in m coordinates, see `HandKinematics`; as an array or a list, its `vector`.

    Args:
        x_i: Of the hand at the start: its place [m] and, where the strike holds its orientation, how it is turned from
            the home posture's [rad]; length m.
        x_f: At the end, likewise.
        D: Duration of the movement [s].

    Raises:
        InputError: A value is not finite, D is not positive, or the lengths differ.
    """

    x_i: tuple[float, ...]
    x_f: tuple[float, ...]
    D: float

    def __post_init__(self) -> None:
        for name in ("x_i", "x_f"):
            values = tuple(float(x) for x in getattr(self, name))
            if not values or not all(map(math.isfinite, values)):
                raise InputError(name, values, "finite coordinates of the hand in m, turns in rad")
            object.__setattr__(self, name, values)
        if len(self.x_i) != len(self.x_f):
            raise InputError("x_f", self.x_f, f"{len(self.x_i)} coordinates, as many as x_i")
        if not (math.isfinite(self.D) and self.D > 0):
            raise InputError("D", self.D, "a finite duration > 0 s")
        object.__setattr__(self, "D", float(self.D))

    def __repr__(self) -> str:
        start, end = (", ".join(f"{x:.4g}" for x in hand) for hand in (self.x_i, self.x_f))
        return f"HandStrike(x_i=({start}), x_f=({end}), D={self.D:.4g} s)"

    @classmethod
    def from_vector(cls, vector: Sequence[float] | np.ndarray) -> HandStrike:
        """From `[x_i, x_f, D]`, shape (2 m + 1,).

        Raises:
            InputError: The length is even, or a value breaks its rule.
        """
        values = [float(x) for x in vector]
        if len(values) < 3 or len(values) % 2 == 0:
            raise InputError("strike", values, "the hand's coordinates x_i, as many x_f, and D")
        m = len(values) // 2
        return cls(tuple(values[:m]), tuple(values[m : 2 * m]), values[-1])

    @property
    def vector(self) -> np.ndarray:
        """`[x_i, x_f, D]`, shape (2 m + 1,)."""
        return np.array([*self.x_i, *self.x_f, self.D])
