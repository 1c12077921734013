"""A disturbed strike, linearised about the planned one by the engine's exact derivatives, and the estimate in it.

What disturbs the strike is a vector z of independent standard normal numbers, so many standard deviations of
`Disturbances` each: swings, numbers of the whip, kicks at several instants, pulses of the hand. Tip, arm and state at
any time are linear in z, and a reading that comes late is compared with what z means for its own time. With such a
vector, a Kalman filter's prediction is the identity, and its estimate is that of least squares over all readings.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from whiptool.correction.disturbances import (
    NUMBERS,
    PULSES,
    Disturbances,
    changed,
    kick_directions,
    loads,
    moved,
    pulses,
    swing_directions,
)
from whiptool.correction.rolled import INTERVAL, AnyStart, Begun, Submovements
from whiptool.errors import InputError, expect
from whiptool.models.numbers import number
from whiptool.models.parameters import Model
from whiptool.models.strike import T_STAY, Strike

KICKS = 8  # instants of a strike at which the estimate looks for a kick
_DRAWS = 32  # of disturbances, at which the linear miss is compared with the engine's
_STEP = 1e-3  # of a standard deviation, for differences of states


@dataclass(frozen=True)
class Sensing:
    """What is measured during a strike, and how late it is of use.

    Args:
        rate: Frames of the tip per second.
        tip_noise: Standard deviation of each coordinate of a filmed tip [m].
        joint_rate: Samples of the joint log per second.
        joint_noise: Standard deviation of each coordinate of the hand, and of the other links' ends, by the log [m].
        delay: Age of a reading when the arm first moves by it [s]: of camera, computation and servos together.
        doubt: Error of the linear model as a share of what it expects of a reading, which counts as noise.

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
    """The tip, arm and state of a strike as linear functions of what disturbs it.

    Args:
        simulator: Simulator of the model, see `AnyStart`.
        strike: Planned strike, in joint space.
        target: A `Target`, or its position (d,) [m].
        expected: Standard deviations of what is expected to disturb the strike; default: `Disturbances()`.

    Raises:
        InputError: The target has another dimension.

    Attributes:
        planned: Paths of the undisturbed strike (B = 1).
        tip: Derivatives of the tip by z [m], (S, d, m).
        arm: Derivatives of the arm's ends [m], (S, a d, m).
        hit_at: When the undisturbed tip is closest to the target [s].
        error: Median error of the linear miss [m] per mean square of z, at swings and errors of the whip's numbers.
    """

    def __init__(
        self, simulator: AnyStart, strike: Strike, target: object, expected: Disturbances | None = None
    ) -> None:
        expect(AnyStart, simulator=simulator)
        expect(Strike, strike=strike)
        self.simulator, self.strike, self.lasts = simulator, strike, strike.D + T_STAY
        self.target = target = check_target(target, simulator.model.dimension)
        self.expected, self.none = expected or Disturbances(), Submovements.none(1, simulator.model.arm.n)
        rest = simulator.rest(strike)[None]
        lasts = self.lasts
        begun = Begun(strike, rest, self.none, lasts)
        self.planned = simulator.paths(begun, target)
        self.states = simulator.rows(begun, "x")[0]
        self.hit_at = INTERVAL * int(np.linalg.norm(self.planned.tip[0] - target, axis=1).argmin())
        c, names = self._columns, list(NUMBERS.values())
        begun = Begun(strike, c.x0, pulses(0 * c.by, self.hit_at), lasts, c.since)
        tip, arm = simulator.slopes(begun, dx0=c.dx0, dby=pulses(c.by, self.hit_at).by, names=names)
        of_numbers = [getattr(self.expected, name) * self._number(name) for name in NUMBERS]
        scale = np.r_[np.ones(len(c.x0) - len(names)), of_numbers]
        first = np.round(c.since / INTERVAL).astype(int)
        self.tip = self._shifted(tip, first, scale)
        self.arm = self._shifted(arm.reshape(*arm.shape[:2], -1), first, scale)
        self.across = across(self.planned.tip, np.array([round(self.hit_at / INTERVAL)]))[0]
        self.error = self._error()

    def curved(self, z: np.ndarray) -> np.ndarray:
        """Return the expected errors of linear misses at estimates z (B, m) [m], (B,): they grow with z squared."""
        return self.error * (z[:, self._drawn] ** 2).mean(axis=1)

    @property
    def _drawn(self) -> np.ndarray:
        """Components of z that act from the beginning of a strike, without noise of the hand."""
        c = self._columns
        return np.flatnonzero(~c.by.any(axis=(1, 2)) & (c.since == 0))

    def _error(self) -> float:
        which, c, rng = self._drawn, self._columns, np.random.default_rng(0)
        z = rng.standard_normal((_DRAWS, len(which)))
        x0 = moved(self.simulator.model, np.repeat(self.states[:1], _DRAWS, axis=0), z @ c.dx0[which])
        models = [_off(self.simulator.model, self.expected, row[-len(NUMBERS) :]) for row in z]
        none = Submovements.none(_DRAWS, self.simulator.model.arm.n)
        true = self.simulator.paths(Begun(self.strike, x0, none, self.lasts, models=models), self.target)
        hit = round(self.hit_at / INTERVAL)
        off = true.tip[:, hit] - self.planned.tip[0, hit] - z @ self.tip[hit][:, which].T
        return float(np.median(np.linalg.norm(off @ self.across.T, axis=1) / (z**2).mean(axis=1)))

    def _number(self, name: str) -> float:
        return self.simulator.model.whip.common(NUMBERS[name].removeprefix("whip."))

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

    def of_submovements(self, since: float, lasts: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the derivatives of tip (S, d, a) and arm (S, a d, a) by the size of a submovement of each joint."""
        a = self.simulator.model.arm.n
        added = Submovements(np.full((a, 1), since), np.full((a, 1), lasts), np.zeros((a, 1, a)))
        begun = Begun(self.strike, np.tile(self.states[0], (a, 1)), added, self.lasts)
        tip, arm = self.simulator.slopes(begun, dby=np.eye(a)[:, None])
        return tip.transpose(1, 2, 0), arm.reshape(*arm.shape[:2], -1).transpose(1, 2, 0)

    def state_slopes(self, at: int) -> np.ndarray:
        """Return the derivatives of the state at an instant by z, (2 n, m), by differences of the engine's states."""
        c, ends, model = self._columns, [], self.simulator.model
        steps = np.maximum(at - np.round(c.since / INTERVAL).astype(int), 0)
        later = at * INTERVAL >= c.since
        for side in (-_STEP, _STEP):
            others = [_off(model, self.expected, row) for row in side * np.eye(len(NUMBERS))]
            models = [model] * (len(c.x0) - len(others)) + others
            x0, noise = moved(model, c.x0, side * c.dx0), pulses(side * c.by, self.hit_at)
            begun = Begun(self.strike, x0, noise, max(at, 1) * INTERVAL, c.since, models)
            ends.append(self.simulator.rows(begun, "x")[np.arange(len(steps)), steps])
        return (later[:, None] * (ends[1] - ends[0]) / (2 * _STEP)).T


@dataclass(frozen=True, eq=False)
class Estimator:
    """The estimate of z from the readings that are at hand at one instant; its gains do not depend on them.

    Args:
        frames, samples: Instants of the filmed tips and of the joint log, indices of a path.
        H: Derivatives of all readings by z, (r, m).
        variance: Of their errors [m^2], (r,).
        gains: Estimate per reading, (m, r).
        covariance: Of the estimate, (m, m).
    """

    frames: np.ndarray
    samples: np.ndarray
    H: np.ndarray
    variance: np.ndarray
    gains: np.ndarray
    covariance: np.ndarray

    @classmethod
    def at(cls, linear: LinearStrike, sensing: Sensing, time: float) -> Estimator:
        """Return the estimator at a time of the strike [s]."""
        last = time - sensing.delay
        frames, samples = (
            np.round(np.arange(max(0, int(last * rate + 1e-9) + 1)) / rate / INTERVAL).astype(int)
            for rate in (sensing.rate, sensing.joint_rate)
        )
        tip, arm = linear.tip[frames], linear.arm[samples]
        H = np.concatenate([x.reshape(-1, x.shape[2]) for x in (tip, arm)])
        noise = np.repeat([sensing.tip_noise, sensing.joint_noise], [tip[..., 0].size, arm[..., 0].size])
        variance = noise**2 + sensing.doubt**2 * (H**2).sum(axis=1)
        weighted = H.T / variance
        covariance = np.linalg.inv(np.eye(H.shape[1]) + weighted @ H)
        return cls(frames, samples, H, variance, covariance @ weighted, covariance)

    def mean(self, tip: np.ndarray, arm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the estimates of z, (B, m), and the mean squares of what they leave unexplained of the readings, in
        units of their variances, (B,): about 1 if the linear model holds.

        Args:
            tip: Filmed tips minus what they would be without disturbances, on all instants (B, S, d) [m]; only frames
                that are at hand are looked at.
            arm: Likewise the arm's ends by the joint log, (B, S, a d) [m].
        """
        B = len(tip)
        readings = [tip[:, self.frames].reshape(B, -1), arm[:, self.samples].reshape(B, -1)]
        y = np.hstack(readings)
        z = y @ self.gains.T
        return z, ((y - z @ self.H.T) ** 2 / self.variance).mean(axis=1)


def _off(model: Model, expected: Disturbances, z: np.ndarray) -> Model:
    """The model whose numbers are so many standard deviations off, (3,)."""
    return changed(model, {name: 1 + getattr(expected, name) * x for name, x in zip(NUMBERS, z, strict=True)})


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
