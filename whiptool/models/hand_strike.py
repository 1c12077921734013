"""A strike of the hand: it moves from x_i to x_f in D seconds along a minimum-jerk path (Eq. 1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, overload

import numpy as np

from whiptool.errors import InputError
from whiptool.models.arrays import Vector, made_of_numbers
from whiptool.models.numbers import ends_and_duration, number, numbers

_VECTOR = "the hand's coordinates x_i, as many x_f, and D"


@made_of_numbers(lambda row: ends_and_duration(row, _VECTOR))
@dataclass(frozen=True)
class HandStrike(Vector):
    """Reference trajectory of the hand in m coordinates, see `HandKinematics`; it converts to an array, its `vector`.

    `HandStrike(0.1, 0.2, 0.3, 0.4, 0.5)` is the same as `HandStrike((0.1, 0.2), (0.3, 0.4), 0.5)`.

    Args:
        x_i: Coordinates of the hand at the start, (m,): its position [m] and, if the strike prescribes it, its rotation
            relative to the home posture [rad].
        x_f: Coordinates of the hand at the end, (m,).
        D: Duration of the movement [s].

    Raises:
        InputError: A value is not finite, D is not positive, or the lengths differ.
    """

    x_i: tuple[float, ...]
    x_f: tuple[float, ...]
    D: float

    if TYPE_CHECKING:

        @overload
        def __init__(self, x_i: Sequence[float], x_f: Sequence[float], D: float) -> None: ...
        @overload
        def __init__(self, vector: Sequence[float] | np.ndarray, /) -> None: ...
        @overload
        def __init__(self, *vector: float) -> None: ...

    def __post_init__(self) -> None:
        for name in ("x_i", "x_f"):
            object.__setattr__(self, name, numbers(name, getattr(self, name)))
        if len(self.x_i) != len(self.x_f):
            raise InputError("x_f", self.x_f, f"{len(self.x_i)} coordinates, as many as x_i")
        object.__setattr__(self, "D", number("D", self.D, low=0, strict=True))

    def __repr__(self) -> str:
        start, end = (", ".join(f"{x:.4g}" for x in hand) for hand in (self.x_i, self.x_f))
        return f"HandStrike(x_i=({start}), x_f=({end}), D={self.D:.4g} s)"

    @classmethod
    def from_vector(cls, vector: Sequence[float] | np.ndarray) -> HandStrike:
        """From `[x_i, x_f, D]`, shape (2 m + 1,).

        Raises:
            InputError: The length is even, or a value is not allowed.
        """
        return cls(*ends_and_duration(vector, _VECTOR))

    @property
    def vector(self) -> np.ndarray:
        """`[x_i, x_f, D]`, shape (2 m + 1,)."""
        return np.array([*self.x_i, *self.x_f, self.D])
