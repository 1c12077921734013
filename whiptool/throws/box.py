"""Boxes: an opening that a thrown thing has to enter from above, as a target of searches."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from whiptool.errors import InputError
from whiptool.goals.goals import Goals
from whiptool.goals.target import Target
from whiptool.models.numbers import made_of_numbers, number, numbers
from whiptool.models.parameters import Model

LEAST_UPWARD = 0.2  # upward component of the normal of an opening, so that a thing falls into it


@made_of_numbers(lambda place: (place,))
@dataclass(frozen=True, repr=False)
class Box(Target):
    """A round opening of a box, in the plane a gap, through which the centre of a thrown thing has to pass from above.

    `position` is the opening's centre, when the strike begins if the box moves, and `hit_radius` its radius less the
    thing's. The thing may be required to be at least `speed`, at most `most_speed` [m/s] fast, and to enter along a
    `direction` within a `cone`; these are judged when it enters. The opening may be out of the arm's reach.

    Args:
        normal: Vector out of the box, perpendicular to the opening, of any length; None: straight up.
        velocity: Constant velocity of the box [m/s]; None: it stands.
        most_speed: Largest speed at which the thing may enter [m/s], along the direction if there is one; None: any.

    Raises:
        InputError: A value is out of range, or the opening does not face upward enough.
    """

    normal: tuple[float, ...] | None = None
    velocity: tuple[float, ...] | None = None
    most_speed: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        d = len(self.position)
        normal = numbers("normal of the box", (0.0,) * (d - 1) + (1.0,) if self.normal is None else self.normal, d)
        length = math.hypot(*normal)
        if not length or normal[-1] < LEAST_UPWARD * length:
            rule = f"a vector at most {math.degrees(math.acos(LEAST_UPWARD)):.0f} degrees from straight up"
            raise InputError("normal of the box", normal, rule, "things fall into an opening that faces upward")
        object.__setattr__(self, "normal", tuple(x / length for x in normal))
        if self.velocity is not None:
            object.__setattr__(self, "velocity", numbers("velocity of the box", self.velocity, d))
        if self.most_speed is not None:
            most = number("largest speed", self.most_speed, low=self.speed or 0.0, strict=True)
            object.__setattr__(self, "most_speed", most)

    def __repr__(self) -> str:
        said = super().__repr__().removeprefix("Target")
        moves = "" if self.velocity is None else f", moving at ({', '.join(f'{x:g}' for x in self.velocity)}) m/s"
        return f"Box{said[:-1]}{moves})"

    @property
    def goals(self) -> Goals:
        return replace(super().goals, most_speed=self.most_speed)

    @property
    def outline(self) -> np.ndarray:
        """Rim and walls of the box, (K, d) [m]."""
        n, centre = np.array(self.normal), np.array(self.position)
        first = np.array([n[1], -n[0]]) if len(n) == 2 else np.cross([0.0, 1.0, 0.0], n) + np.array([1e-12, 0.0, 0.0])
        first /= np.linalg.norm(first)
        turns = np.array([np.pi, 0.0]) if len(n) == 2 else np.linspace(0, 2 * np.pi, 25)
        second = np.zeros(2) if len(n) == 2 else np.cross(n, first)
        rim = centre + self.hit_radius * (np.cos(turns)[:, None] * first + np.sin(turns)[:, None] * second)
        floor = rim - 2 * self.hit_radius * n
        return np.concatenate([rim, floor[::-1], rim[:1]]) if len(n) == 3 else np.array([rim[0], *floor, rim[1]])

    def at(self, time: float) -> Box:
        """Return the box as it stands at a time [s], without its velocity."""
        place = np.array(self.position) + self.drift * time
        return replace(self, position=tuple(map(float, place)), velocity=None)

    @property
    def drift(self) -> np.ndarray:
        """Velocity of the box, (d,) [m/s]; zero if it stands."""
        return np.zeros(len(self.position)) if self.velocity is None else np.array(self.velocity)

    def check_reach(self, model: Model) -> None:
        """Refuse a box that does not fit the model, see `check_fits`; it may be out of the arm's reach."""
        self.check_fits(model)
