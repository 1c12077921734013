"""The hand of a position-controlled robot: its joints follow the command's reference behind a first-order lag."""

from __future__ import annotations

import numpy as np

from whiptool.dynamics.swing import hand_motion
from whiptool.identification.motion import Moved
from whiptool.models.spatial_arm import SpatialArm
from whiptool.models.strike import Strike

USUAL, SPREAD = 0.02, 0.05  # [s] a lag a priori, and its standard error: industrial arms lag by 5 to 50 ms
_LEAST = 1e-5  # [s]
_STEP = 1e-20  # of a complex number's imaginary part: derivatives without a difference
_QUINTIC = np.array([0.0, 0.0, 0.0, 10.0, -15.0, 6.0])  # Eq. 1, by powers of t / D


class LaggedReference:
    """Motion of joints that follow a strike's reference with a first-order lag, `lag dq/dt = reference - q`, in closed
    form.

    Args:
        strike: The command in joint space.
        arm: Arm with a joints, in space.
        instants: Times at which the hand's motion is computed [s], (I,), not below 0.

    Attributes:
        start, rows, mean: As of a `BaseMotion`; the one coefficient is the lag [s].
    """

    def __init__(self, strike: Strike, arm: SpatialArm, instants: np.ndarray) -> None:
        self._strike, self._arm, self._t = strike, arm, instants
        self.start = np.array([USUAL])
        self.rows, self.mean = np.array([[1 / SPREAD]]), np.array([USUAL / SPREAD])

    def at(self, c: np.ndarray) -> Moved:
        """Return the motion for a lag c (1,) [s]; the sign of c is ignored."""
        sign, lag = (-1.0 if c[0] < 0 else 1.0), max(abs(float(c[0])), _LEAST)
        share = _lagging(self._t, self._strike.D, lag + 1j * _STEP)  # (3, I)
        span = np.subtract(self._strike.q_f, self._strike.q_i)
        joints = share.real[..., None] * span  # (3, I, a)
        by_lag = sign * share.imag[..., None] / _STEP * span
        found = hand_motion(self._arm, joints[0] + self._strike.q_i, joints[1], joints[2])
        moved = np.einsum("ioka,kia->io", found.by_joints, by_lag)[None]  # (1, I, 24)
        width = found.inputs.shape[1]
        d_inputs, d_q_i = np.ascontiguousarray(moved[..., :width]), np.zeros((1, self._arm.n))
        return Moved(found.inputs, d_inputs, found.place, moved[..., width:], np.array(self._strike.q_i), d_q_i)


def _lagging(t: np.ndarray, D: float, lag: complex) -> np.ndarray:
    """Return how far of its way from q_i to q_f a joint is at times t (I,), and its first and second rates, (3, I).

    While the reference is a polynomial, so is what follows it, except a part that fades: the sum of the reference's
    derivatives times powers of -lag, less its value at the start.
    """
    powers = np.arange(len(_QUINTIC))
    polynomial = np.polynomial.Polynomial(_QUINTIC / D**powers)
    following = sum(((-lag) ** k * polynomial.deriv(k) for k in powers), np.polynomial.Polynomial([0.0]))
    rates = [following, following.deriv(), following.deriv(2)]
    s, over = np.minimum(t, D), np.maximum(t - D, 0.0)
    fading = np.exp(-s / lag)
    moving = [rate(s) - rates[0](0.0) * (-1 / lag) ** i * fading for i, rate in enumerate(rates)]
    left = (moving[0] - 1) * np.exp(-over / lag)  # behind the end of the way
    after = [1 + left, -left / lag, left / lag**2]
    return np.where(t <= D, np.stack(moving), np.stack(after))
