"""Goals of several strikes: positions and, if required, arrival directions and least speeds; the hit rule."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from whiptool.errors import InputError
from whiptool.models.numbers import NoArray

if TYPE_CHECKING:
    from whiptool.models.trajectory import Approach

CLAIMED = 0.9  # probability from which a hit is claimed of a strike whose miss was measured
CONE = math.radians(10.0)  # half-angle, as in "Point It, Strike It" (2026)
PACE = 0.05  # [s] in which the distance between the true and the expected path changes by its own size
_STILL = 1e-3  # [m/s], below which a tip has no direction
_ALONG = 1e-6  # sine of the angle from the vertical below which a line of sight has no upward direction across it


def probability_within(
    radius: float, miss: np.ndarray, scale: np.ndarray | float, freedom: float = np.inf
) -> np.ndarray:
    """Return the probability that a path passes within a radius of a target.

    Args:
        radius: Radius [m].
        miss: Expected miss distance [m], any shape.
        scale: Scale of the error across the path [m], a scalar or of the shape of `miss`; positive.
        freedom: Degrees of freedom of the error's Student's t distribution; infinite: a normal distribution.

    Returns:
        Probabilities, of the shape of `miss`.
    """
    from scipy.special import ndtr, stdtr

    low, high = (-radius - miss) / scale, (radius - miss) / scale
    within = ndtr(high) - ndtr(low) if freedom == np.inf else stdtr(freedom, high) - stdtr(freedom, low)
    return np.clip(within, 0.0, 1.0)  # stdtr errs in the last digits


def direction_error(error: np.ndarray | float, speed: np.ndarray) -> np.ndarray:
    """Return the standard error of the tip's direction [rad]: the position error over the distance that the tip moves
    in the time `PACE`.

    Args:
        error: Standard error of the position [m], a scalar or of the shape of `speed`.
        speed: Speed of the tip [m/s], any shape.
    """
    return np.arctan(error / (np.maximum(speed, _STILL) * PACE))


def angle_probability(angle: np.ndarray, cone: float, error: np.ndarray) -> np.ndarray:
    """Return the probability that a direction lies within a cone.

    Args:
        angle: Expected angle from the axis of the cone [rad], any shape.
        cone: Half-angle of the cone [rad].
        error: Standard error of the angle [rad], of the shape of `angle`; positive.
    """
    from scipy.special import ndtr

    return ndtr((cone - angle) / error) - ndtr((-cone - angle) / error)


@dataclass(frozen=True, eq=False)
class Goals(NoArray, instead="its positions"):
    """Goals of B strikes, or one common goal (B = 1), in d = 2 or 3 dimensions.

    Args:
        positions: Positions of the targets [m], (B, d).
        hit_radius: Largest distance between tip and target at a hit [m].
        directions: Unit vectors along which the tip has to arrive, (B, d); None: any.
        cone: Largest angle between the direction and the tip's velocity at the closest approach [rad].
        speed: Least speed at the closest approach [m/s], along the direction if there is one; None: any.
        sights: Unit vectors perpendicular to the directions, (B, d); the velocity component along them is ignored in
            the angle. None: the whole velocity counts.
        most_speed: Largest speed at the closest approach [m/s], likewise; None: any. It is above `speed`.
    """

    positions: np.ndarray
    hit_radius: float
    directions: np.ndarray | None = None
    cone: float = CONE
    speed: float | None = None
    sights: np.ndarray | None = None
    most_speed: float | None = None

    @property
    def only_points(self) -> bool:
        """Whether neither a direction nor a speed is asked for."""
        return self.directions is None and not self.bounds_speed

    @property
    def bounds_speed(self) -> bool:
        """Whether a least or a largest speed is asked for."""
        return self.speed is not None or self.most_speed is not None

    @property
    def largest_cost(self) -> float:
        """Largest amount that direction and speed add in quadrature to the miss distance [m]; 0 if neither is
        required.
        """
        of_direction = 0.0 if self.directions is None else 1 / math.sin(self.cone / 2)
        of_speed = 1.0 if self.bounds_speed else 0.0
        return self.hit_radius * math.hypot(of_direction, of_speed)

    def rows(self, which: np.ndarray) -> Goals:
        """Return the goals of some of the strikes, given by a mask (B,) or by indices (b,)."""
        return replace(self, **{name: None if x is None else x[which] for name, x in self._arrays().items()})

    def with_rows(self, which: np.ndarray, new: Goals) -> Goals:
        """Return the goals with b of them, given by a mask (B,) or by indices (b,), replaced by the goals `new`."""
        changed = {name: None if x is None else x.copy() for name, x in self._arrays().items()}
        for name, x in new._arrays().items():
            into = changed[name]
            if into is not None:
                into[which] = x
        return replace(self, **changed)

    def _arrays(self) -> dict[str, np.ndarray | None]:
        """What differs from goal to goal, by name."""
        return {"positions": self.positions, "directions": self.directions, "sights": self.sights}

    def angle(self, velocity: np.ndarray) -> np.ndarray:
        """Return the angle between direction and velocity [rad], (B,); NaN for goals without direction.

        For a tip at rest, as before a strike begins, the angle is pi.

        Args:
            velocity: Velocity of the tip [m/s], (B, d).
        """
        if self.directions is None:
            return np.full(len(velocity), np.nan)
        seen = self._seen(velocity)
        along = _dot(seen, self.directions)
        angle = np.arctan2(np.linalg.norm(seen - along[:, None] * self.directions, axis=1), along)
        return np.where(seen.any(axis=1), angle, np.pi)

    def arrival_speed(self, velocity: np.ndarray) -> np.ndarray:
        """Return the speed along the direction [m/s], (B,), negative against it; without a direction the magnitude."""
        if self.directions is None:
            return np.linalg.norm(velocity, axis=1)
        return _dot(velocity, self.directions)

    def arrives(self, velocity: np.ndarray) -> np.ndarray:
        """Return whether the velocities (B, d) [m/s] at the closest approach meet the required direction and speed,
        (B,).
        """
        arrives = np.ones(len(velocity), bool)
        for excess in self._arrival_excess(velocity).values():
            arrives &= excess <= 0
        return arrives

    def excess(self, distance: np.ndarray, velocity: np.ndarray) -> dict[str, np.ndarray]:
        """Return by how much strikes exceed each part of the goal, (B,) each; at most zero for parts that are met.

        The parts are `point` [m] and, if they are required, `direction` [rad] and `speed` [m/s].

        Args:
            distance, velocity: As in `hit`.
        """
        return {"point": distance - self.hit_radius, **self._arrival_excess(velocity)}

    def _arrival_excess(self, velocity: np.ndarray) -> dict[str, np.ndarray]:
        excess = {}
        if self.directions is not None:
            excess["direction"] = self.angle(velocity) - self.cone
        if self.bounds_speed:
            speed = self.arrival_speed(velocity)
            excess["speed"] = np.maximum(
                -np.inf if self.speed is None else self.speed - speed,
                -np.inf if self.most_speed is None else speed - self.most_speed,
            )
        return excess

    def speed_excess(self, velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return by which share of a bound the speed is beyond it, (B,), and the derivative by the speed [s/m], (B,).

        The share is at most zero within both bounds.
        """
        along = self.arrival_speed(velocity)
        slow = -np.inf if self.speed is None else 1 - along / self.speed
        fast = -np.inf if self.most_speed is None else along / self.most_speed - 1
        of_slow = 0.0 if self.speed is None else -1 / self.speed
        of_fast = 0.0 if self.most_speed is None else 1 / self.most_speed
        return np.maximum(slow, fast) + 0 * along, np.where(slow > fast, of_slow, of_fast) + 0 * along

    def hit(
        self, distance: np.ndarray, velocity: np.ndarray | None = None, error: np.ndarray | None = None
    ) -> np.ndarray:
        """Return which strikes hit, (B,): by point, direction and speed.

        All other code that shows, counts or rewards hits uses this function.

        Args:
            distance: Distance of the tip from the target at the closest approach [m], (B,); not finite for a diverged
                strike.
            velocity: Velocity of the tip at the closest approach [m/s], (B, d); None: unknown, and only goals without
                direction and speed can be hit.
            error: Standard error of a measured distance [m], (B,): a strike hits if its hit probability is at least
                `CLAIMED`. None: the distance is exact.
        """
        if error is not None:
            return self.hit_probability(distance, velocity, error) >= CLAIMED
        near = distance <= self.hit_radius
        if self.only_points:
            return near
        return near & (velocity is not None and self.arrives(velocity))

    def hit_probability(
        self, distance: np.ndarray, velocity: np.ndarray | None, error: np.ndarray | float, freedom: float = np.inf
    ) -> np.ndarray:
        """Return the hit probability of strikes whose tip position has an error, of the shape of `distance`.

        The error of the direction follows from that of the position, see `direction_error`; the speed is taken as
        exact.

        Args:
            distance: Expected distance of the tip from the target at the closest approach [m], any shape.
            velocity: Velocity of the tip at the closest approach [m/s], (..., d); None: unknown, and for a goal with
                direction or speed the probability is at most 0.5.
            error: Scale of the position's error [m], a scalar or of the shape of `distance`; positive.
            freedom: Degrees of freedom of the position's error, see `probability_within`.
        """
        within = probability_within(self.hit_radius, distance, error, freedom)
        if self.only_points:
            return within
        if velocity is None:
            return np.minimum(within, 0.5)
        flat = velocity.reshape(-1, velocity.shape[-1])
        if self.directions is not None:
            off = direction_error(np.broadcast_to(error, distance.shape).ravel(), np.linalg.norm(flat, axis=1))
            within = within * angle_probability(self.angle(flat), self.cone, off).reshape(distance.shape)
        if self.bounds_speed:
            within = within * (self._arrival_excess(flat)["speed"] <= 0).reshape(distance.shape)
        return within

    def hit_by(self, near: Approach) -> np.ndarray:
        """Return which of the strikes with these closest approaches hit, (B,): see `hit`.

        A strike that diverged does not count as a hit, nor a strike whose distance is within the hit radius by less
        than the estimated integration error.
        """
        return ~near.diverged & self.hit(near.farthest, near.velocity, near.error)

    def residuals(self, tip: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """Return the residuals between strikes and goals [m], (B, r); their norm is the cost that searches minimise.

        The parts are the position of the tip relative to the target; the hit radius times the difference between the
        unit vectors of the velocity and of the required direction, in units of that at the cone's edge; and the hit
        radius times the relative shortfall, or excess, of the speed, at most 1. For a hit the norm of each
        part is at most the hit radius.

        Args:
            tip, velocity: Position and velocity of the tip at the closest approach [m], [m/s], (B, d).
        """
        parts = [tip - self.positions]
        if self.directions is not None:
            seen = self._seen(velocity)
            length = np.linalg.norm(seen, axis=1, keepdims=True)
            unit = np.divide(seen, length, out=-np.broadcast_to(self.directions, seen.shape), where=length > 0)
            parts.append(self._chord * (unit - self.directions))
        if self.bounds_speed:
            missing = np.clip(self.speed_excess(velocity)[0], 0, 1)
            parts.append(self.hit_radius * missing[:, None])
        return np.concatenate(parts, axis=1)

    def cost(self, distance: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """Return the norm of the residuals [m], (B,); for goals that are only points it is the distance.

        Args:
            distance: Distance of the tip from the target at the closest approach [m], (B,).
            velocity: Velocity of the tip at the closest approach [m/s], (B, d).
        """
        if self.only_points:
            return distance
        of_arrival = self.residuals(np.broadcast_to(self.positions, velocity.shape), velocity)
        return np.hypot(distance, np.linalg.norm(of_arrival, axis=1))

    def residual_slopes(self, velocity: np.ndarray, dtip: np.ndarray, dvelocity: np.ndarray) -> np.ndarray:
        """Return the derivatives of the residuals by m parameters, (B, r, m).

        Args:
            velocity: Velocity of the tip at the closest approach [m/s], (B, d).
            dtip, dvelocity: Derivatives of the tip's position and velocity at the closest approach, (B, d, m).
        """
        parts = [dtip]
        if self.directions is not None:
            seen, dseen = self._seen(velocity), dvelocity
            if self.sights is not None:
                along = np.einsum("bd,bdm->bm", np.broadcast_to(self.sights, velocity.shape), dvelocity)
                dseen = dvelocity - self.sights[:, :, None] * along[:, None, :]
            length = np.linalg.norm(seen, axis=1)[:, None]
            unit = np.divide(seen, length, out=np.zeros_like(seen), where=length > 0)
            across = dseen - unit[:, :, None] * np.einsum("bd,bdm->bm", unit, dseen)[:, None, :]
            of_unit = np.divide(across, length[..., None], out=np.zeros_like(across), where=length[..., None] > 0)
            parts.append(self._chord * of_unit)
        if self.bounds_speed:
            beyond, by_speed = self.speed_excess(velocity)
            dbeyond = by_speed[:, None] * self.arrival_speed_slope(velocity, dvelocity)
            counts = (beyond > 0) & (beyond < 1)
            parts.append(np.where(counts[:, None], self.hit_radius * dbeyond, 0.0)[:, None, :])
        return np.concatenate(parts, axis=1)

    @property
    def _chord(self) -> float:
        """Residual per chord of unit vectors [m]: the hit radius where velocity and direction are a cone apart."""
        return self.hit_radius / (2 * math.sin(self.cone / 2))

    def _seen(self, velocity: np.ndarray) -> np.ndarray:
        """Return the part of velocities (B, d) that counts for the angle."""
        return velocity if self.sights is None else velocity - _dot(velocity, self.sights)[:, None] * self.sights

    def arrival_speed_slope(self, velocity: np.ndarray, dvelocity: np.ndarray) -> np.ndarray:
        """Return the derivatives of the arrival speeds by m parameters, (B, m).

        Args:
            velocity, dvelocity: Velocity of the tip at the closest approach [m/s], (B, d), and its derivatives, (B, d,
                m).
        """
        unit = self.directions
        if unit is None:
            speed = self.arrival_speed(velocity)[:, None]
            unit = np.divide(velocity, speed, out=np.zeros_like(velocity), where=speed > 0)
        return np.einsum("bd,bdm->bm", np.broadcast_to(unit, velocity.shape), dvelocity)


def arrival_directions(positions: np.ndarray, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
    """Return the unit vectors of arrival angles, (B, d), and the lines of sight, (B, d), which in the plane are None.

    In space, z' (the line of sight) points from the target to the base, x' is the upward direction made perpendicular
    to it, and y' = z' x x'; the angle is measured from x' towards y' ("Point It, Strike It", 2026), and velocity along
    z' is ignored. In the plane, the angle is measured from x (forward) towards y (up), and the whole velocity counts.

    Args:
        positions: Positions of the targets relative to the base [m], (B, d).
        angles: Arrival angles [rad], (B,).

    Raises:
        InputError: A target in space lies directly above or below the base, or at it.
    """
    cosine, sine = np.cos(angles)[:, None], np.sin(angles)[:, None]
    if positions.shape[1] == 2:
        return np.concatenate([cosine, sine], axis=1), None
    distance = np.linalg.norm(positions, axis=1, keepdims=True)
    aside = np.linalg.norm(positions[:, :2], axis=1, keepdims=True)
    bad = np.flatnonzero(aside <= _ALONG * distance)
    if len(bad):
        given = tuple(map(float, positions[bad[0]]))
        rule, fix = "one that is not straight above or below the base", "give a direction in place of the angle"
        raise InputError("target of an arrival angle", given, rule, fix)
    z = -positions / distance
    up = np.array([0.0, 0.0, 1.0]) - z[:, 2:] * z
    x = up / np.linalg.norm(up, axis=1, keepdims=True)
    return cosine * x + sine * np.cross(z, x), z


def arrival_angles(positions: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Return the arrival angles of vectors (B, d) at targets (B, d) [rad], (B,); see `arrival_directions`.

    Raises:
        InputError: A target in space lies directly above or below the base, or at it.
    """
    right_angle = np.full(len(positions), np.pi / 2)
    first, _ = arrival_directions(positions, 0 * right_angle)
    second, _ = arrival_directions(positions, right_angle)
    return np.arctan2(_dot(vectors, second), _dot(vectors, first))


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the products of vectors (B, d), row by row, (B,)."""
    return np.einsum("bd,bd->b", a, np.broadcast_to(b, a.shape))
