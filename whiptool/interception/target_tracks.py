"""Motions of a target in the plane or in space, their fit to frames, and predictions with covariances.

A target is at rest, moves at constant velocity, falls freely, or, in the plane, swings as the bob of a pendulum.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import least_squares
from scipy.special import ellipj, ellipkinc
from scipy.stats import chi2 as chi2_distribution

from whiptool.errors import InputError
from whiptool.models.numbers import float_array, number

GRAVITY = 9.81  # [m/s^2]
LENGTHS = (0.4, 1.0, 2.5)  # [m] of strings that a search starts from
_OVER_THE_TOP = 1 - 1e-9  # a bob with more energy than this part of the top's is not a pendulum's


@dataclass(frozen=True)
class TargetMotion(ABC):
    """A family of target motions with p parameters.

    Args:
        name: Name of the motion.
    """

    name: str

    @property
    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """Names of the p parameters."""

    @property
    def loosely(self) -> tuple[np.ndarray, np.ndarray]:
        """Weak prior of the parameters: means, and inverses of the standard errors (0: no prior), (p,) each."""
        return np.zeros(len(self.names)), np.zeros(len(self.names))

    @abstractmethod
    def positions(self, numbers: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Return the target's positions (..., T, d) [m] for parameters (..., p) and times (T,) [s]."""

    @abstractmethod
    def starts(self, t: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Return S initial guesses of the parameters for a fit, (S, p), from times (T,) [s] near 0 and positions (T, d)
        [m].
        """


@dataclass(frozen=True)
class Polynomial(TargetMotion):
    """A target at rest (order 0) or with an initial velocity (order 1), under a known acceleration. The parameters are
    the coordinates of its position and, for order 1, of its velocity at time 0.

    Args:
        name: Name of the motion.
        order: 0 or 1.
        acceleration: Acceleration, (d,) [m/s^2].
    """

    order: int
    acceleration: tuple[float, ...] = (0.0, 0.0)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters: position [m] and velocity [m/s]."""
        axes = "xyz"[: len(self.acceleration)]
        return (*axes, *(f"v{x}" for x in axes * self.order))

    def positions(self, numbers: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Return the target's positions, (..., T, d) [m], see `TargetMotion.positions`."""
        powers = np.asarray(t, float)[:, None] ** np.arange(self.order + 1)  # (T, order + 1)
        terms = np.reshape(numbers, (*np.shape(numbers)[:-1], self.order + 1, len(self.acceleration)))
        return powers @ terms + 0.5 * np.asarray(t)[:, None] ** 2 * np.array(self.acceleration)

    def starts(self, t: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Return zeros (1, p), because the fit is linear and needs no initial guess."""
        return np.zeros((1, len(self.names)))


@dataclass(frozen=True)
class PendulumMotion(TargetMotion):
    """A bob on a string that does not swing over the top: exact solution of theta'' = -(g / L) sin(theta).

    The parameters are the pivot x, y [m] unless it is known, log(L / 1 m), theta [rad] and its rate [rad/s] at time 0.
    theta is 0 straight below the pivot and positive towards +x. As half a second of a long swing does not determine the
    string, there is a weak prior (mean and standard deviation): log(L / 1 m) 0 +- 1, pivot 0 +- 10 m, theta 0 +- 3 rad,
    rate 0 +- 10 rad/s.

    Args:
        pivot: Pivot (x, y) [m]; None: unknown.
        gravity: Gravity [m/s^2].

    Source: A. J. Brizard, "A primer on elliptic functions with applications in classical mechanics", 2009.
    """

    name: str = field(default="pendulum", init=False)
    pivot: tuple[float, float] | None = None
    gravity: float = GRAVITY

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, in their order."""
        return (*(("pivot x", "pivot y") if self.pivot is None else ()), "log L", "theta", "rate")

    @property
    def loosely(self) -> tuple[np.ndarray, np.ndarray]:
        """Weak prior of the parameters: means, and inverses of the standard errors, (p,) each."""
        errors = np.array([10.0] * (len(self.names) - 3) + [1.0, 3.0, 10.0])
        return np.zeros(len(self.names)), 1 / errors

    def positions(self, numbers: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Return the target's positions (..., T, 2) [m]; see `TargetMotion.positions`."""
        numbers = np.asarray(numbers, float)
        L, theta, rate = np.exp(numbers[..., -3, None]), numbers[..., -2, None], numbers[..., -1, None]
        omega = np.sqrt(self.gravity / L)
        # sin(theta / 2) = k sn(u, k^2) and rate / (2 omega) = k cn(u, k^2) with u = u_0 + omega t
        sine, cosine = np.sin(theta / 2), rate / (2 * omega)
        m = np.minimum(sine**2 + cosine**2, _OVER_THE_TOP)
        sn = ellipj(ellipkinc(np.arctan2(sine, cosine), m) + omega * np.asarray(t, float), m)[0]
        theta = 2 * np.arcsin(np.sqrt(m) * sn)
        pivot = numbers[..., None, :2] if self.pivot is None else np.array(self.pivot)
        return pivot + L[..., None] * np.stack([np.sin(theta), -np.cos(theta)], axis=-1)

    def starts(self, t: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Return initial guesses (S, p): one if the pivot is known, else one for each of several string lengths, with
        the pivot in the direction of the bob's acceleration without gravity.
        """
        order = min(2, len(t) - 1)
        terms = np.zeros((3, 2))
        terms[: order + 1] = np.polynomial.polynomial.polyfit(t, points, order)
        at, velocity, acceleration = terms[0], terms[1], 2 * terms[2]
        if self.pivot is None:
            pull = acceleration + np.array([0.0, self.gravity])
            up = pull / max(float(np.hypot(*pull)), 1e-9)
            pivots = at + np.array(LENGTHS)[:, None] * up
        else:
            pivots = np.array([self.pivot])
        arm = at - pivots
        L, theta = np.hypot(*arm.T), np.arctan2(arm[:, 0], -arm[:, 1])
        rate = (np.cos(theta) * velocity[0] + np.sin(theta) * velocity[1]) / L
        own = np.stack([np.log(L), theta, rate], axis=1)
        return np.hstack([pivots, own]) if self.pivot is None else own


MOTIONS = {2: ("still", "straight", "ballistic", "pendulum"), 3: ("still", "straight", "ballistic")}  # by dimension


def find_motion(
    name: str, *, pivot: tuple[float, float] | None = None, gravity: float = GRAVITY, dimension: int = 2
) -> TargetMotion:
    """Return the motion called `name`; `pivot` (x, y) [m] and `gravity` [m/s^2] are as in `PendulumMotion`.

    Raises:
        InputError: No motion of that dimension has that name; the message lists them.
    """
    rest = (0.0,) * dimension
    known: dict[str, TargetMotion] = {
        "still": Polynomial("still", 0, rest),
        "straight": Polynomial("straight", 1, rest),
        "ballistic": Polynomial("ballistic", 1, (*rest[1:], -gravity)),
        "pendulum": PendulumMotion(pivot, gravity),
    }
    if name not in MOTIONS[dimension]:
        fix = "a pendulum swings in the plane" if name in known else ""
        raise InputError("motion", name, ", ".join(("auto", *MOTIONS[dimension])), fix)
    return known[name]


LEAST = 3  # frames that a motion is chosen from
DOUBTFUL = 4.0  # times the stated variance, from which a track warns
STEPS = 40  # of a fit, at most


@dataclass(frozen=True, eq=False)
class TargetTrack:
    """Estimate of a target's motion.

    Args:
        motion: Family of the motion.
        numbers: Parameters of the motion, (p,), with its time 0 at `epoch`.
        covariance: Covariance of the parameters, (p, p), for frames whose variance is multiplied by `misfit`.
        epoch: Time at which the motion's time is 0 [s].
        chi2: Sum of squared residuals in units of the measurement error.
        dof: Degrees of freedom: number of measured coordinates minus p.
        bic: chi2 + p log(number of measured coordinates); the motion with the smallest value is the most plausible
            (Schwarz 1978).
        last: Time of the last frame that shows the target [s]; -inf for a track that was given, not observed.
    """

    motion: TargetMotion
    numbers: np.ndarray
    covariance: np.ndarray
    epoch: float = 0.0
    chi2: float = 0.0
    dof: int = 0
    bic: float = 0.0
    last: float = -np.inf

    @classmethod
    def known(cls, motion: TargetMotion, numbers: np.ndarray, *, epoch: float = 0.0) -> TargetTrack:
        """Return the track of a motion whose parameters (p,) at the time `epoch` [s] are known exactly."""
        numbers = np.asarray(numbers, float)
        return cls(motion, numbers, np.zeros((len(numbers), len(numbers))), epoch)

    @property
    def p_value(self) -> float:
        """Probability of residuals at least this large if the motion is right; small if it is wrong."""
        return float(chi2_distribution.sf(self.chi2, self.dof)) if self.dof > 0 else 1.0

    @property
    def misfit(self) -> float:
        """Factor by which the variance of the frames exceeds the stated variance, `max(1, chi2 / dof)`."""
        return _misfit(self.chi2, self.dof)

    @property
    def warning(self) -> str:
        """A warning in a sentence if `misfit` is above 4: the frames lie more than twice as far from the fitted motion
        as their stated standard error; else an empty text."""
        if self.misfit <= DOUBTFUL:
            return ""
        return (
            f"The frames lie {self.misfit**0.5:.1f} times as far from a {self.motion.name} motion as sigma states: "
            "sigma is too small, or the target moves otherwise; what is said of the future is a guess."
        )

    def position(self, t: np.ndarray | float) -> np.ndarray:
        """Most probable position at times (T,) [s], (T, d) [m]."""
        return self.positions(self.numbers, t)

    def positions(self, numbers: np.ndarray, t: np.ndarray | float) -> np.ndarray:
        """Return the positions (..., T, d) [m] at times (T,) [s] for other parameters (..., p), such as samples."""
        return self.motion.positions(numbers, np.atleast_1d(np.asarray(t, float)) - self.epoch)

    def velocity(self, t: np.ndarray | float) -> np.ndarray:
        """Return the velocity at times (T,) [s], (T, d) [m/s]."""
        t, h = np.atleast_1d(np.asarray(t, float)), 1e-4
        return (self.position(t + h) - self.position(t - h)) / (2 * h)

    def derivatives(self, t: np.ndarray | float) -> np.ndarray:
        """Return the derivatives of the position by the parameters at times (T,) [s], (T, d, p)."""
        return derivatives(self.motion, self.numbers, np.atleast_1d(np.asarray(t, float)) - self.epoch)

    def covariance_at(self, t: np.ndarray | float) -> np.ndarray:
        """Return the covariance of the position at times (T,) [s], to first order, (T, d, d) [m^2]."""
        J = self.derivatives(t)
        return J @ self.covariance @ np.swapaxes(J, 1, 2)

    def sample(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Return random samples of the parameters, (count, p)."""
        return rng.multivariate_normal(self.numbers, self.covariance, count, method="eigh", check_valid="ignore")

    def after(self, t: np.ndarray, sigma: float) -> TargetTrack:
        """Return the track with the covariance that it will have after further frames at times t (T,) [s].

        To first order the covariance does not depend on the measured positions. `sigma` is the frames' stated standard
        error [m], which is multiplied by the square root of `misfit`.
        """
        J = self.derivatives(t).reshape(-1, len(self.numbers)) / (sigma * self.misfit**0.5)
        return replace(self, covariance=_inverse(_inverse(self.covariance) + J.T @ J))


def derivatives(motion: TargetMotion, numbers: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Return the derivatives of a motion's positions at times (T,) [s] by its parameters (p,), by central differences,
    (T, d, p).
    """
    steps = 1e-5 * np.maximum(1.0, np.abs(numbers))
    moved = np.vstack([numbers + np.diag(steps), numbers - np.diag(steps)])
    ahead, behind = np.split(motion.positions(moved, t), 2)
    return np.moveaxis((ahead - behind) / (2 * steps[:, None, None]), 0, 2)


def fit_track(
    t: np.ndarray,
    points: np.ndarray,
    *,
    sigma: float,
    motion: str = "auto",
    pivot: tuple[float, float] | None = None,
    gravity: float = GRAVITY,
) -> TargetTrack:
    """Fit a motion to noisy positions by least squares (Levenberg-Marquardt).

    For linear motions the result is that of a Kalman filter without process noise; a pendulum is fitted from several
    initial string lengths.

    If the residuals are larger than `sigma`, because it is understated or the motion is another one, the variance of
    the frames is multiplied by chi2 / dof (Birge 1932), so that predictions, samples and stated probabilities account
    for the misfit. This is adequate for small errors of the motion only; see `TargetTrack.warning`.

    Args:
        t: Times of the frames [s], (T,), increasing, possibly with gaps.
        points: Positions in the strike plane, (T, 2), or in space, (T, 3) [m]; NaN where the target was not seen.
        sigma: Standard error of each coordinate [m].
        motion: `still`, `straight`, `ballistic`, in the plane `pendulum`, or `auto`: the most plausible by BIC.
        pivot: Pivot of the pendulum (x, y) [m], if known.
        gravity: Gravity [m/s^2].

    Raises:
        InputError: Shapes do not match, times do not increase, the motion is unknown, or too few frames show the
            target.
    """
    t, points = float_array("times of the track", t), float_array("track", points)
    number("sigma", sigma, low=0, strict=True)
    if t.ndim != 1 or points.shape not in ((len(t), 2), (len(t), 3)):
        raise InputError("track", (t.shape, points.shape), "times (T,) and positions (T, 2), in space (T, 3)")
    if not np.isfinite(t).all() or (np.diff(t) <= 0).any():
        raise InputError("times of the track", "some that are not finite or do not increase", "finite, increasing [s]")
    d = points.shape[1]
    asked = MOTIONS[d] if motion == "auto" else (motion,)
    candidates = [find_motion(name, pivot=pivot, gravity=gravity, dimension=d) for name in asked]
    seen = np.isfinite(points).all(axis=1)
    needed = LEAST if motion == "auto" else -(-len(candidates[0].names) // d)
    if seen.sum() < needed:
        raise InputError("track", f"{seen.sum()} frames that show the target", f"at least {needed} for {motion}")
    return min((_fit(x, t[seen], points[seen], sigma) for x in candidates), key=lambda track: track.bic)


def _fit(motion: TargetMotion, t: np.ndarray, points: np.ndarray, sigma: float) -> TargetTrack:
    epoch, p = float(t.mean()), len(motion.names)
    mean, weight = motion.loosely
    known = weight > 0

    def residuals(x: np.ndarray) -> np.ndarray:
        return np.r_[(motion.positions(x, t - epoch) - points).ravel() / sigma, (weight * (x - mean))[known]]

    def slopes(x: np.ndarray) -> np.ndarray:
        return np.vstack([derivatives(motion, x, t - epoch).reshape(-1, p) / sigma, np.diag(weight)[known]])

    fits = [
        least_squares(residuals, x, jac=slopes, method="lm", max_nfev=STEPS) for x in motion.starts(t - epoch, points)
    ]
    best = min(fits, key=lambda fit: fit.cost)
    measured = points.size
    chi2, dof = float((residuals(best.x)[:measured] ** 2).sum()), measured - p
    J = slopes(best.x)
    J[:measured] /= _misfit(chi2, dof) ** 0.5  # what is known beforehand is not touched
    bic = chi2 + p * float(np.log(measured))
    return TargetTrack(motion, best.x, _inverse(J.T @ J), epoch, chi2, dof, bic, float(t[-1]))


def _misfit(chi2: float, dof: int) -> float:
    return max(1.0, chi2 / dof) if dof > 0 else 1.0


def _inverse(matrix: np.ndarray) -> np.ndarray:
    """Of a positive definite matrix, scaled first: its numbers differ by orders of magnitude."""
    scale = np.sqrt(np.diag(matrix))
    return np.linalg.inv(matrix / np.outer(scale, scale)) / np.outer(scale, scale)
