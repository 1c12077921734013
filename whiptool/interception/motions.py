"""How a target may move in the strike plane: at rest, straight on, as a thrown ball, as the bob of a pendulum."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field

import numpy as np
from scipy.special import ellipj, ellipkinc

from whiptool.errors import InputError

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
        """Return the target's positions (..., T, 2) [m] for parameters (..., p) and times (T,) [s]."""

    @abstractmethod
    def starts(self, t: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Return S initial guesses of the parameters for a fit, (S, p), from times (T,) [s] near 0 and positions (T, 2)
        [m].
        """


@dataclass(frozen=True)
class Polynomial(TargetMotion):
    """A target at rest (order 0) or with an initial velocity (order 1), under a known acceleration. Its parameters are
    x, y, then vx, vy at time 0.

    Args:
        name: Name of the motion.
        order: 0 or 1.
        acceleration: Acceleration (x, y) [m/s^2].
    """

    order: int
    acceleration: tuple[float, float] = (0.0, 0.0)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters: position [m] and velocity [m/s]."""
        return ("x", "y", "vx", "vy")[: 2 * (self.order + 1)]

    def positions(self, numbers: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Return the target's positions, (..., T, 2) [m], see `TargetMotion.positions`."""
        powers = np.asarray(t, float)[:, None] ** np.arange(self.order + 1)  # (T, order + 1)
        terms = np.reshape(numbers, (*np.shape(numbers)[:-1], self.order + 1, 2))
        return powers @ terms + 0.5 * np.asarray(t)[:, None] ** 2 * np.array(self.acceleration)

    def starts(self, t: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Return zeros (1, p): the fit is linear and needs no initial guess."""
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
        """Return initial guesses (S, p): several string lengths along the bob's acceleration without gravity, or one
        guess if the pivot is known.
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


MOTIONS = ("still", "straight", "ballistic", "pendulum")


def find_motion(name: str, *, pivot: tuple[float, float] | None = None, gravity: float = GRAVITY) -> TargetMotion:
    """Return the motion called `name`.

    Raises:
        InputError: No motion has that name; the message lists them.
    """
    known: dict[str, TargetMotion] = {
        "still": Polynomial("still", 0),
        "straight": Polynomial("straight", 1),
        "ballistic": Polynomial("ballistic", 1, (0.0, -gravity)),
        "pendulum": PendulumMotion(pivot, gravity),
    }
    if name not in known:
        raise InputError("motion", name, ", ".join(("auto", *MOTIONS)))
    return known[name]
