"""Closed forms of chains and strings without stiffness: hanging, folded and falling, and with a loop that travels."""

from __future__ import annotations

import numpy as np
from scipy.integrate import quad
from scipy.special import jn_zeros

FALL_RATIO = 0.8472  # of a folded chain's time to fall by its length, over that of a body that falls freely


def hanging_frequencies(length: float, gravity: float, count: int) -> np.ndarray:
    """Return the angular frequencies of a hanging uniform chain [rad/s], (count,): `j_{0,n} / 2 sqrt(g / L)` with the
    zeros of the Bessel function J0 (D. Bernoulli)."""
    return jn_zeros(0, count) / 2 * np.sqrt(gravity / length)


def lumped_frequencies(nodes: int, length: float, gravity: float, count: int) -> np.ndarray:
    """Return those of N equal masses at the ends of N equal massless links [rad/s], (count,): `sqrt(g N / L x_n)` with
    the zeros of the Laguerre polynomial L_N.

    The tension below node i is `(N - i) m g`: the eigenvalues of the chain are those of the recurrence of L_N.
    """
    i = np.arange(nodes)
    recurrence = np.diag(2.0 * i + 1) - np.diag(i[1:], 1) - np.diag(i[1:], -1)  # Golub and Welsch
    return np.sqrt(gravity * nodes / length * np.linalg.eigvalsh(recurrence)[:count])


def folded_speed(depth: np.ndarray | float, length: float, gravity: float) -> np.ndarray | float:
    """Return the speed of the tip of a folded chain that has fallen by a depth [m/s]: `v^2 = g y (2 L - y) / (L - y)`
    by conservation of energy (Calkin and March 1989)."""
    return np.sqrt(gravity * depth * (2 * length - depth) / (length - depth))


def folded_time(depth: float, length: float, gravity: float) -> float:
    """Return the time in which the tip of a folded chain falls by a depth of at most its length [s]."""

    def slowness(root: float) -> float:  # by the root of the depth, which takes the singularity away
        y = root**2
        return 2 * np.sqrt(max(length - y, 0.0) / (gravity * (2 * length - y)))

    return quad(slowness, 0.0, np.sqrt(depth))[0]


def moving_mass(place: float, taper: float) -> float:
    """Return the mass from a place, as a fraction of the length, to the tip of a round whip, over a uniform one's.

    Args:
        place: From the handle.
        taper: Thickness at the tip over that at the handle; mass per length goes with its square, geometrically.
    """
    if taper == 1:
        return 1 - place
    return (taper ** (2 * place) - taper**2) / (-2 * np.log(taper))


def loop_speed(place: float, start: float, taper: float) -> float:
    """Return the tip's speed over that at the start when the loop of a whip has come to a place.

    The handle's part rests and the tip's part moves along it, so that energy is conserved in the mass that still
    moves: `v = v0 sqrt(m0 / m)`. The loop moves with v / 2, the tension on both its sides is `mu v^2 / 4`, so that it
    travels at `sqrt(T / mu)`, and the momentum `m v` is what the hand takes up.
    """
    return float(np.sqrt(moving_mass(start, taper) / moving_mass(place, taper)))


def loop_time(place: float, start: float, taper: float, length: float, speed: float) -> float:
    """Return the time in which a loop comes from its start to a place [s]; lengths in metres, places as fractions."""
    slowness = quad(lambda x: 2 / loop_speed(x, start, taper), start, place)[0]
    return slowness * length / speed
