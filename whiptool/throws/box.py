"""Boxes: an opening that a thrown thing has to enter from above, as a target of searches."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from whiptool.errors import InputError
from whiptool.goals.goals import Goals
from whiptool.goals.target import Target
from whiptool.models.numbers import LARGEST, made_of_numbers, number, numbers
from whiptool.models.parameters import Model
from whiptool.throws.passage import FLATTEST

FASTEST_BOX = 10.0  # [m/s]
LEAST_UPWARD = 0.2  # upward component of the normal of an opening, so that a thing falls into it


@made_of_numbers(lambda place: (place,))
@dataclass(frozen=True, repr=False)
class Box(Target):
    """A round opening of a box, in the plane a gap, through which all of a thrown thing has to pass from above.

    `position` is the opening's centre, when the strike begins if the box moves, and `hit_radius` its radius less the
    thing's: the largest miss, see `passage`. The thing may be required to be at least `speed`, at most `most_speed`
    [m/s] fast, and to enter along a `direction` within a `cone`; these are judged when it enters. The opening may be
    out of the arm's reach.

    Args:
        normal: Vector out of the box, perpendicular to the opening, of any length; None: straight up.
        velocity: Constant velocity of the box [m/s], of at most `FASTEST_BOX`; None: it stands.
        most_speed: Largest speed at which the thing may enter [m/s], along the direction if there is one; None: any.

    Raises:
        InputError: A value is out of range, the opening does not face upward enough, or nothing enters it along the
            direction.
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
            if np.linalg.norm(self.drift) > FASTEST_BOX:
                raise InputError("velocity of the box", self.velocity, f"at most {FASTEST_BOX:g} m/s")
        if self.most_speed is not None:
            most = number("largest speed", self.most_speed, low=0.0, strict=True)
            if most <= (least := self.speed or 0.0):
                raise InputError("largest speed", most, f"a speed above the least speed, {least:g} m/s")
            object.__setattr__(self, "most_speed", most)
        self._check_direction_into()

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

    def _check_direction_into(self) -> None:
        """Refuse a direction along which nothing enters: flatter than is allowed, or out of the box."""
        if self.direction is None or self.sight is not None:
            return
        into = -np.array(self.normal)
        angle = math.acos(np.clip(np.dot(self.direction, into), -1, 1))
        flattest, steepest = FLATTEST, max(angle - self.cone, 0.0)
        if self.drift.any():  # the angle as seen from the box depends on the speed: only what cannot enter is refused
            speeds = np.array([self.speed or 0.0, self.most_speed or LARGEST])
            flattest = math.pi if (speeds * math.cos(steepest) > self.drift @ into).any() else -1.0
        if steepest > flattest:
            given = tuple(round(x, 4) for x in self.direction)
            rule = f"one that leads into the opening, at most {math.degrees(FLATTEST):.0f} degrees from its normal"
            why = (
                f"with a cone of {math.degrees(self.cone):g} degrees it is {math.degrees(steepest):.0f} degrees or more"
            )
            raise InputError("direction", given, rule, why)

    @property
    def drift(self) -> np.ndarray:
        """Velocity of the box, (d,) [m/s]; zero if it stands."""
        return np.zeros(len(self.position)) if self.velocity is None else np.array(self.velocity)

    def entry_angle(self, velocity: Sequence[float]) -> float:
        """Return the angle from the opening's normal at which a thing of a velocity (d,) [m/s] enters [rad]."""
        seen = np.array(velocity) - self.drift
        return math.acos(np.clip(-(seen @ np.array(self.normal)) / max(float(np.linalg.norm(seen)), 1e-12), -1, 1))

    def check_reach(self, model: Model) -> None:
        """Refuse a box that does not fit the model, see `check_fits`; it may be out of the arm's reach."""
        self.check_fits(model)
