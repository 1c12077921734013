"""Capsules: rods with round ends, as which the bodies of an arm are taken where they may touch something."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from whiptool.errors import InputError
from whiptool.models.numbers import number, numbers

Point: TypeAlias = tuple[float, float, float]


@dataclass(frozen=True)
class Capsule:
    """All points that are no farther than a radius from a segment.

    Args:
        start, end: Of the segment, in the frame of the link that it belongs to [m], (3,) each; a ball, where they are
            the same.
        radius: [m]

    Raises:
        InputError: A number is not finite, or the radius is negative.
    """

    start: Point
    end: Point
    radius: float

    def __post_init__(self) -> None:
        for name in ("start", "end"):
            object.__setattr__(self, name, numbers(name, getattr(self, name), 3))
        object.__setattr__(self, "radius", number("radius", self.radius, low=0))

    @property
    def length(self) -> float:
        """Of the segment [m]."""
        return math.dist(self.start, self.end)

    @classmethod
    def along(cls, rotation: np.ndarray, position: np.ndarray, half: float, radius: float) -> Capsule:
        """Return the capsule about the z axis of a frame.

        Args:
            rotation, position: Of the frame in the link's, (3, 3) and (3,) [m].
            half: Length of the segment to either side of the frame's origin [m].
            radius: [m]
        """
        reach = half * np.asarray(rotation)[:, 2]
        return cls(tuple((position - reach).tolist()), tuple((position + reach).tolist()), radius)

    @classmethod
    def around_box(cls, rotation: np.ndarray, position: np.ndarray, halves: np.ndarray) -> Capsule:
        """Return a capsule that holds a box: along its longest side, and as thick as the diagonal across that.

        Args:
            rotation, position: Of the box in the link's frame, (3, 3) and (3,) [m].
            halves: Half of each side [m], (3,).
        """
        longest = int(np.argmax(halves))
        across = float(np.linalg.norm(np.delete(halves, longest)))
        turned = np.roll(np.asarray(rotation), 2 - longest, axis=1)  # the longest side becomes the last axis
        return cls.along(turned, position, float(halves[longest]), across)


def checked_capsules(name: str, given: object) -> tuple[Capsule, ...]:
    """Return capsules as a tuple.

    Raises:
        InputError: One of them is none.
    """
    if not isinstance(given, (list, tuple)) or not all(isinstance(x, Capsule) for x in given):
        raise InputError(name, given, "capsules, each a Capsule")
    return tuple(given)
