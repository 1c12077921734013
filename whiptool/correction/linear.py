"""A strike that is disturbed, and the estimate of what disturbs it.

What disturbs the strike is a vector z of independent standard normal numbers, so many standard deviations of
`Disturbances` each: swings, kicks at several instants, pulses of the hand, numbers of the whip. The engine simulates
the strike at any z, and a reading that comes late is compared with what z means for its own time. With such a vector, a
Kalman filter's prediction is the identity, and its estimate is that of least squares over all readings, which is
repeated about itself (Gauss-Newton, with Levenberg's damping).
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from whiptool.correction.disturbances import (
    PULSES,
    Disturbances,
    kick_directions,
    loads,
    moved,
    pulses,
    swing_directions,
)
from whiptool.correction.rolled import INTERVAL, NUMBERS, AnyStart, Begun, Paths, Submovements
from whiptool.errors import InputError, expect
from whiptool.models.numbers import number
from whiptool.models.strike import T_STAY, Strike

KICKS = 8  # instants of a strike at which the estimate looks for a kick
_STEP = 1e-2  # of a standard deviation, for differences
_FARTHEST = 6.0  # standard deviations to which an estimate may go


@dataclass(frozen=True)
class Sensing:
    """What is measured during a strike, and how late it is of use.

    Args:
        rate: Frames of the tip per second.
        tip_noise: Standard deviation of each coordinate of a filmed tip [m].
        joint_rate: Samples of the joint log per second.
        joint_noise: Standard deviation of each coordinate of the hand, and of the other links' ends, by the log [m].
        delay: Age of a reading when the arm first moves by it [s]: of camera, computation and servos together.
        doubt: Error of what is linear (kicks) as a share of what it expects of a reading, which counts as noise.

    Raises:
        InputError: A number is out of range.
    """

    rate: float = 200.0
    tip_noise: float = 0.005
    joint_rate: float = 125.0
    joint_noise: float = 0.001
    delay: float = 0.03
    doubt: float = 0.1

    def __post_init__(self) -> None:
        for field in fields(self):
            positive = field.name not in ("delay", "doubt")
            number(field.name, getattr(self, field.name), low=0, strict=positive)
        for name in ("rate", "joint_rate"):
            number(name, getattr(self, name), high=1 / INTERVAL)


@dataclass(frozen=True, eq=False)
class _Columns:
    """How each component of z begins: state, its change, since when, and the noise of the hand (m, ...)."""

    x0: np.ndarray
    dx0: np.ndarray
    since: np.ndarray
    by: np.ndarray


class LinearStrike:
    """A planned strike, and the same strike disturbed, with derivatives by what disturbs it.

    Args:
        simulator: Simulator of the model, see `AnyStart`.
        strike: Planned strike, in joint space.
        target: A `Target`, or its position (d,) [m].
        expected: Standard deviations of what is expected to disturb the strike; default: `Disturbances()`.
        rehearsed: Measured paths of the undisturbed strike (B = 1), if it was made before; how far they are from the
            model's is added to all that the model predicts.

    Raises:
        InputError: The target has another dimension, or the paths have not as many instants as the model's.

    Attributes:
        planned: Paths of the undisturbed strike (B = 1), as it was rehearsed.
        offset: How far its tip and arm are from the model's [m], (1, S, d) and (1, S, a, d).
        tip: Derivatives of the tip by z [m], (S, d, m).
        arm: Derivatives of the arm's ends [m], (S, a d, m).
        hit_at: When the undisturbed tip is closest to the target [s].
    """

    def __init__(
        self,
        simulator: AnyStart,
        strike: Strike,
        target: object,
        expected: Disturbances | None = None,
        rehearsed: Paths | None = None,
    ) -> None:
        expect(AnyStart, simulator=simulator)
        expect(Strike, strike=strike)
        self.simulator, self.strike, self.lasts = simulator, strike, strike.D + T_STAY
        self.target = target = check_target(target, simulator.model.dimension)
        self.expected, self.none = expected or Disturbances(), Submovements.none(1, simulator.model.arm.n)
        rest = simulator.rest(strike)[None]
        lasts = self.lasts
        begun = Begun(strike, rest, self.none, lasts)
        model = simulator.paths(begun, target)
        self.planned = rehearsed or model
        if self.planned.tip.shape != model.tip.shape:
            raise InputError("rehearsed", self.planned.tip.shape, f"tips {model.tip.shape}")
        self.offset = self.planned.tip - model.tip, self.planned.arm - model.arm
        self.states = simulator.rows(begun, "x")[0]
        self.hit_at = INTERVAL * int(np.linalg.norm(self.planned.tip[0] - target, axis=1).argmin())
        c = self._columns
        begun = Begun(strike, c.x0, pulses(0 * c.by, self.hit_at), lasts, c.since)
        tip, arm = simulator.slopes(begun, dx0=c.dx0, dby=pulses(c.by, self.hit_at).by, numbers=True)
        scale = np.r_[np.ones(len(c.x0) - len(NUMBERS)), self._off]
        first = np.round(c.since / INTERVAL).astype(int)
        self.tip = self._shifted(tip, first, scale)
        self.arm = self._shifted(arm.reshape(*arm.shape[:2], -1), first, scale)
        self.across = across(self.planned.tip, np.array([round(self.hit_at / INTERVAL)]))[0]
        self.swung = np.flatnonzero(~c.by.any(axis=(1, 2)) & (c.since == 0))  # swings and numbers
        self.kicked = np.flatnonzero(c.since > 0)

    def paths(self, z: np.ndarray, added: Submovements, lasts: float | None = None) -> Paths:
        """Return the paths of strikes disturbed by z (B, m) that last so long [s], with submovements.

        All but kicks are simulated; a kick does as much as to the planned strike. The miss is that of the simulation.
        """
        c, lasts = self._columns, lasts or self.lasts
        by = z[:, self.swung] @ c.dx0[self.swung]
        x0 = moved(self.simulator.model, np.repeat(self.states[:1], len(z), axis=0), by)
        noise = pulses(np.einsum("bm,mka->bka", z, c.by), self.hit_at)
        off = np.maximum(z[:, -len(NUMBERS) :] * self._off, -0.5)
        found = self.simulator.paths(Begun(self.strike, x0, noise.and_(added), lasts, off=off), self.target)
        kicks, S = z[:, self.kicked].T, found.tip.shape[1]
        tip, arm = ((x[:S, :, self.kicked] @ kicks).transpose(2, 0, 1) for x in (self.tip, self.arm))
        tip, arm = (x + y[:, :S] for x, y in zip((tip, arm.reshape(found.arm.shape)), self.offset, strict=True))
        return Paths(found.tip + tip, found.arm + arm, found.miss)

    def about(self, z: np.ndarray, added: Submovements, lasts: float) -> tuple[np.ndarray, ...]:
        """Return tips (B, S, d) and arm's ends (B, S, a d) at z (B, m), see `paths`, and their derivatives by z.

        Those by swings and the whip's numbers are differences at z, the others the planned strike's.
        """
        (B, m), count = z.shape, 1 + len(self.swung)
        every = np.concatenate([z, *(z + _STEP * row for row in np.eye(m)[self.swung])])
        repeated = (np.concatenate([x] * count) for x in (added.since, added.lasts, added.by))
        paths, found = self.paths(every, Submovements(*repeated), lasts), []
        for seen, planned in ((paths.tip, self.tip), (paths.arm, self.arm)):
            seen = seen.reshape(count, B, seen.shape[1], -1)
            slopes = np.repeat(planned[None, : seen.shape[2]], B, axis=0)
            slopes[..., self.swung] = np.moveaxis((seen[1:] - seen[0]) / _STEP, 0, -1)
            found += [seen[0], slopes]
        return found[0], found[2], found[1], found[3]

    @property
    def _off(self) -> np.ndarray:
        """Standard deviations of the whip's numbers, (3,)."""
        return np.array([getattr(self.expected, name) for name in NUMBERS])

    @cached_property
    def _columns(self) -> _Columns:
        """Swings, kicks, pulses of the hand, then the whip's numbers."""
        simulator, expected, a = self.simulator, self.expected, self.simulator.model.arm.n
        swings = expected.swing * swing_directions(simulator.model, self.strike)
        at = np.round(self.hit_at * (np.arange(KICKS) + 0.5) / KICKS / INTERVAL).astype(int)
        kicks = expected.kick / np.sqrt(KICKS) * kick_directions(simulator.model, self.states[at])
        d, width = kicks.shape[1:]
        kicks = kicks.reshape(-1, width)
        sizes = expected.hand * loads(simulator, self.strike, self.hit_at)
        counts = len(swings), len(kicks), PULSES * a, len(NUMBERS)
        by = np.zeros((sum(counts), PULSES, a))
        by[sum(counts[:2]) : sum(counts[:3])] = np.eye(PULSES * a).reshape(-1, PULSES, a) * sizes
        since = np.concatenate([np.zeros(counts[0]), np.repeat(at, d), np.zeros(sum(counts[2:]))]).astype(int)
        dx0 = np.concatenate([swings, kicks, np.zeros((sum(counts[2:]), width))])
        return _Columns(self.states[since], dx0, since * INTERVAL, by)

    def _shifted(self, slopes: np.ndarray, first: np.ndarray, scale: np.ndarray) -> np.ndarray:
        """Derivatives (m, S, k), each from the instant at which it begins, as (S, k, m)."""
        found = np.zeros_like(slopes)
        for column, values, begins, factor in zip(found, slopes, first, scale, strict=True):
            column[begins:] = factor * values[: len(values) - begins]
        return found.transpose(1, 2, 0)

    def of_submovements(self, since: float, lasts: float) -> np.ndarray:
        """Return the derivatives of the tip (S, d, a) by the size of a submovement of each joint."""
        a = self.simulator.model.arm.n
        added = Submovements(np.full((a, 1), since), np.full((a, 1), lasts), np.zeros((a, 1, a)))
        begun = Begun(self.strike, np.tile(self.states[0], (a, 1)), added, self.lasts)
        return self.simulator.slopes(begun, dby=np.eye(a)[:, None])[0].transpose(1, 2, 0)


@dataclass(frozen=True, eq=False)
class Estimate:
    """What is known of B disturbed strikes at one instant.

    Args:
        z: Means, (B, m), in standard deviations.
        covariance: Of z, (B, m, m).
        doubt: Mean squares of what z leaves unexplained of the readings, in units of their variances, (B,): about 1 if
            the model holds, 0 without readings.
        tip: Tips at z with the corrections that were made [m], (B, S, d).
        slopes: Their derivatives by z, (B, S, d, m).
    """

    z: np.ndarray
    covariance: np.ndarray
    doubt: np.ndarray
    tip: np.ndarray
    slopes: np.ndarray


class Estimator:
    """Estimates z from the readings that are at hand at one instant.

    Args:
        linear: The planned strike.
        sensing: What is measured.
        time: Of the strike [s].

    Attributes:
        frames, samples: Instants of the filmed tips and of the joint log, indices of a path.
        variance: Of the readings' errors [m^2], (r,).
    """

    def __init__(self, linear: LinearStrike, sensing: Sensing, time: float) -> None:
        self.linear, last = linear, time - sensing.delay
        self.frames, self.samples = (
            np.round(np.arange(max(0, int(last * rate + 1e-9) + 1)) / rate / INTERVAL).astype(int)
            for rate in (sensing.rate, sensing.joint_rate)
        )
        tip, arm = linear.tip[self.frames], linear.arm[self.samples]
        noise = np.repeat([sensing.tip_noise, sensing.joint_noise], [tip[..., 0].size, arm[..., 0].size])
        kicks = self._readings(linear.tip[None, ..., linear.kicked], linear.arm[None, ..., linear.kicked])[0]
        self.variance = noise**2 + sensing.doubt**2 * (kicks**2).sum(axis=1)

    def estimate(
        self, tip: np.ndarray, arm: np.ndarray, added: Submovements, z: np.ndarray, lasts: float, passes: int
    ) -> Estimate:
        """Return the best of so many estimates, each by least squares about the best before.

        Args:
            tip, arm: Filmed tips on all instants (B, S, d), of which only those at hand are read, and the arm's ends by
                the joint log (B, S, a d) [m].
            added: Corrections that were made.
            z: Estimates from which it begins, (B, m).
            lasts: Time for which tips are predicted [s].
            passes: At least 1, that of z itself.
        """
        B, m = z.shape
        measured = self._readings(tip[..., None], arm[..., None])[..., 0]
        least, damping = np.full(B, np.inf), np.zeros(B)
        best: list[np.ndarray] = []
        information = np.empty((B, m, m))
        for _ in range(passes):
            tips, arms, tip_slopes, arm_slopes = self.linear.about(z, added, lasts)
            left = measured - self._readings(tips[..., None], arms[..., None])[..., 0]
            H = self._readings(tip_slopes, arm_slopes)
            cost = np.nan_to_num((left**2 / self.variance).sum(axis=1) + (z**2).sum(axis=1), nan=np.inf)
            better, new = cost < least, [z, left, H, tips, tip_slopes]
            pairs = zip(new, best or new, strict=True)
            best = [np.where(better.reshape(-1, *[1] * (x.ndim - 1)), x, y) for x, y in pairs]
            least, damping = np.minimum(cost, least), np.where(better, damping / 4, np.maximum(8 * damping, 3))
            weighted = best[2].transpose(0, 2, 1) / self.variance
            information = np.eye(m) + weighted @ best[2]
            step = (weighted @ best[1][..., None])[..., 0] - best[0]
            step = np.linalg.solve(information + damping[:, None, None] * np.eye(m), step[..., None])[..., 0]
            z = np.clip(best[0] + step, -_FARTHEST, _FARTHEST)
        doubt = (best[1] ** 2 / self.variance).sum(axis=1) / max(len(self.variance), 1)
        return Estimate(best[0], np.linalg.inv(information), doubt, best[3], best[4])

    def _readings(self, tip: np.ndarray, arm: np.ndarray) -> np.ndarray:
        """Rows of the readings at hand, (B, r, ...), of what is (B, S, d, ...) and (B, S, a d, ...)."""
        both = tip[:, self.frames], arm[:, self.samples]
        return np.concatenate([x.reshape(len(x), -1, x.shape[3]) for x in both], axis=1)


def across(path: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return unit vectors across the velocities of paths (B, S, d) at instants (B,), (B, d - 1, d)."""
    rows, later = np.arange(len(path)), np.minimum(at + 1, path.shape[1] - 1)
    velocity = path[rows, later] - path[rows, np.maximum(later - 2, 0)]
    return np.linalg.svd(velocity[:, None])[2][:, 1:]


def check_target(target: object, dimension: int) -> np.ndarray:
    """Return the position of a target (d,) [m]."""
    point = np.asarray(getattr(target, "position", target), float)
    if point.shape != (dimension,) or not np.isfinite(point).all():
        raise InputError("target", target, f"a Target, or {dimension} finite coordinates [m]")
    return point
