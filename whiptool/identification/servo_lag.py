"""How the joints of a robot lag behind commanded positions, fitted to a recording of both.

Universal Robots' `servoj` accelerates a joint by a gain times the difference of the command and the position projected
forward by a look-ahead time. With the time until a command has an effect, that is a model of three numbers:
`q'' = stiffness (u(t - delay) - q - lag q')`, whose lag at low frequencies is `lag + delay`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Polynomial
from scipy.linalg import expm
from scipy.optimize import least_squares
from scipy.signal import lfilter, ss2tf

from whiptool.errors import InputError
from whiptool.models.numbers import number

PERIOD = 0.002  # [s] of commands, by default
_MEMORY = 0.1  # [s] over which residuals are taken to be correlated
_LEAST = 20  # samples
_QUINTIC = np.array([0.0, 0.0, 0.0, 10.0, -15.0, 6.0])  # Eq. 1, by powers of t / D


@dataclass(frozen=True)
class ServoLag:
    """Lag of joints behind their commands, `q'' = stiffness (u(t - delay) - q - lag q')`."""

    lag: float  # time by which a moving joint is behind [s]
    stiffness: float  # acceleration per distance from the command [1/s^2]
    delay: float = 0.0  # time until a command has an effect [s]
    errors: tuple[float, float, float] = (0.0, 0.0, 0.0)  # standard errors of these three; zeros: not fitted
    rms: float = 0.0  # root mean square of the positions' residuals [rad]

    def __post_init__(self) -> None:
        number("lag", self.lag, low=0)
        number("stiffness", self.stiffness, low=0, strict=True)
        number("delay", self.delay, low=0)

    def __str__(self) -> str:
        lag, stiffness, delay = self.errors
        return (
            f"the joints lag {1e3 * self.lag:.2f} +- {1e3 * lag:.2f} ms behind their commands, which have an effect "
            f"after {1e3 * self.delay:.2f} +- {1e3 * delay:.2f} ms; stiffness {self.stiffness:.0f} +- {stiffness:.0f} "
            f"1/s^2; residual RMS {1e3 * self.rms:.3f} mrad"
        )

    @property
    def total(self) -> float:
        """Time by which a joint at a steady speed is behind its command [s]."""
        return self.lag + self.delay

    def leading(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return the commanded positions (T, n) [rad or m] with which joints follow a motion exactly, but later by the
        delay: positions q [rad or m], velocities v [per s] and accelerations a [per s^2], (T, n) each."""
        return q + self.lag * v + a / self.stiffness

    def following(self, commands: np.ndarray, period: float = PERIOD) -> np.ndarray:
        """Return the positions (T, n) of joints that begin at rest at the first of the commanded positions (T, n), each
        of which is held for a period [s]."""
        whole, part = divmod(self.delay / period, 1.0)
        late = np.concatenate([np.repeat(commands[:1], int(whole), axis=0), commands])[: len(commands)] - commands[0]
        before = np.concatenate([late[:1], late[:-1]])
        A = np.array([[0.0, 1.0], [-self.stiffness, -self.stiffness * self.lag]])
        first, rest = expm(part * period * A), expm((1 - part) * period * A)  # the old command, then the new one
        one = np.eye(2)
        found = np.zeros_like(late)
        for entry, given in ((rest @ (one - first), before), (one - rest, late)):
            above, below = ss2tf(rest @ first, entry[:, :1], one[:1], np.zeros((1, 1)))
            found += lfilter(above[0], below, given, axis=0)
        return commands[0] + found

    def behind(self, t: np.ndarray, D: float) -> np.ndarray:
        """Return how far of its way a joint is at times t (T,) [s] whose command goes from 0 to 1 along a minimum-jerk
        path (Eq. 1) of duration D [s], and its first and second rates, (3, T), in closed form.

        While the command is a polynomial, so is what follows it, except a part that fades.
        """
        s = np.maximum(t - self.delay, 0.0)
        path = following = Polynomial(_QUINTIC / D ** np.arange(6))
        last, factor = 0.0, 1.0
        for _ in range(5):  # the coefficients of the series of 1 / (1 + lag p + p^2 / stiffness)
            last, factor = factor, -self.lag * factor - last / self.stiffness
            path = path.deriv()
            following = following + factor * path
        rates = [following, following.deriv(), following.deriv(2)]
        begins = np.array([rate(0.0) for rate in rates[:2]])
        moving = np.stack([rate(np.minimum(s, D)) for rate in rates]) - self._free(begins, np.minimum(s, D))
        ends = np.array([rate(D) for rate in rates[:2]]) - self._free(begins, np.array([D]))[:2, 0]
        after = self._free(ends - (1.0, 0.0), np.maximum(s - D, 0.0))
        after[0] += 1.0
        return np.where(s <= D, moving, after)

    def _free(self, state: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Positions behind a resting command, and their first and second rates, (3, T), after a state (2,) of these."""
        w, m = self.stiffness, self.stiffness * self.lag / 2
        square = m**2 - w
        if square > 0:  # exponents together: each alone overflows where the joint is stiff
            root = math.sqrt(square)
            slow = np.exp(-w / (m + root) * t)
            even, odd = slow * (1 + np.exp(-2 * root * t)) / 2, slow * -np.expm1(-2 * root * t) / (2 * root)
        else:
            root, fading = math.sqrt(-square), np.exp(-m * t)
            even, odd = fading * np.cos(root * t), fading * t * np.sinc(root * t / np.pi)
        x, v = state
        position, rate = even * x + odd * (v + m * x), even * v - odd * (w * x + m * v)
        return np.stack([position, rate, -w * position - 2 * m * rate])


def fit_servo_lag(t: np.ndarray, commands: np.ndarray, q: np.ndarray, *, period: float = PERIOD) -> ServoLag:
    """Fit a lag to a recording that begins at rest, by least squares over all joints; each may have an offset.

    The standard errors allow for residuals that are correlated over 0.1 s (Newey and West, 1987). The commands (T, n)
    [rad] were sent, one a period [s], at the times t (T,) [s] of the measured positions q (T, n) [rad]; some samples
    may be missing.
    """
    if len(t) < _LEAST or commands.shape != q.shape or len(q) != len(t):
        raise InputError("recording", q.shape, f"{_LEAST} samples or more of commands and positions")
    if np.ptp(commands, axis=0).max() < 1e-3 or np.ptp(q, axis=0).max() < 1e-3:
        raise InputError("recording", "joints at rest", "joints that move by 1 mrad or more")
    steps = np.rint((t - t[0]) / period).astype(int)
    held = np.searchsorted(steps, np.arange(steps[-1] + 1), side="right") - 1
    sent = commands[held]  # a lost sample's command is the one before

    def residuals(x: np.ndarray) -> np.ndarray:
        lag, softness, delay = np.abs(x) * _SCALES
        left = q - ServoLag(lag, 1 / max(softness, 1e-6), delay).following(sent, period)[steps]
        return (left - left.mean(axis=0)).ravel()

    fit = least_squares(residuals, np.array([1.0, 1.0, 1.0]), x_scale=1.0, diff_step=1e-4)
    lag, softness, delay = np.abs(fit.x) * _SCALES
    errors = _errors(fit.jac.reshape(len(q), -1, 3), fit.fun.reshape(len(q), -1), int(_MEMORY / period)) * _SCALES
    rms = float(np.sqrt(np.mean(fit.fun**2)))
    stiffness = 1 / max(softness, 1e-6)
    return ServoLag(lag, stiffness, delay, (errors[0], errors[1] * stiffness**2, errors[2]), rms)


_SCALES = np.array([0.05, 1 / 400, 0.004])  # usual values, from which the search begins


def _errors(slopes: np.ndarray, residuals: np.ndarray, memory: int) -> np.ndarray:
    """Standard errors (3,) by slopes (T, n, 3) and residuals (T, n) that are correlated over some samples."""
    scores = np.einsum("tji,tj->ti", slopes, residuals)
    middle = scores.T @ scores
    for lag in range(1, min(memory, len(scores) - 1)):
        both = scores[lag:].T @ scores[:-lag]
        middle += (1 - lag / memory) * (both + both.T)
    bread = np.linalg.pinv(np.einsum("tji,tjk->ik", slopes, slopes))
    return np.sqrt(np.maximum(np.diag(bread @ middle @ bread), 0.0))
