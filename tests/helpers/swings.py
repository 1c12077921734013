"""Passive swings for the tests of identification, by other code than the product's: Lagrange's equations, LSODA."""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root

from whiptool.models import Model


class Whip:
    """N point masses on massless links behind a base that stands still, in absolute angles; 0 hangs straight down.

    Args:
        model: Its whip and gravity.
        clamped: Whether half a link bends at the base (twice the stiffness and damping); else the hinge is free.
        direction: Where a clamp points [rad].
    """

    def __init__(self, model: Model, *, clamped: bool, direction: float = 0.0) -> None:
        whip = model.whip
        self.l, self.m, self.k, self.b = (np.array(whip.per_node(name)) for name in ("l", "m", "k", "b"))
        self.k[0], self.b[0] = (2 * self.k[1], 2 * self.b[1]) if clamped else (0.0, 0.0)
        beyond = self.m[::-1].cumsum()[::-1]  # mass that link i carries
        i, j = np.indices((len(self.l),) * 2)
        self._inertia = beyond[np.maximum(i, j)] * np.outer(self.l, self.l)
        self._weight = model.gravity * self.l * beyond
        self.direction = direction

    def _joints(self, theta: np.ndarray, base: float) -> np.ndarray:
        return np.diff(theta, prepend=base)

    def _torque(self, theta: np.ndarray, omega: np.ndarray) -> np.ndarray:
        joint = -self.k * self._joints(theta, self.direction) - self.b * self._joints(omega, 0.0)
        return joint - np.append(joint[1:], 0.0) - self._weight * np.sin(theta)

    def held_aside(self, force: tuple[float, float]) -> np.ndarray:
        """Angles at rest under a force at the tip [N], (2,)."""
        pull = lambda theta: self.l * (force[0] * np.cos(theta) + force[1] * np.sin(theta))  # noqa: E731
        torque = lambda theta: self._torque(theta, 0 * theta) + pull(theta)  # noqa: E731
        straight = np.full(len(self.l), np.arctan2(force[0], self._weight.mean() / self.l[0] - force[1]))
        found = root(torque, straight, tol=1e-9)
        assert np.abs(torque(found.x)).max() < 1e-7, found
        return found.x

    def released(self, theta: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Angles (T, N) at times t from rest at angles theta on."""
        n = len(theta)

        def rate(_, state: np.ndarray) -> np.ndarray:
            theta, omega = state[:n], state[n:]
            apart = theta[:, None] - theta
            centrifugal = (self._inertia * np.sin(apart)) @ omega**2
            return np.r_[
                omega, np.linalg.solve(self._inertia * np.cos(apart), self._torque(theta, omega) - centrifugal)
            ]

        path = solve_ivp(rate, (t[0], t[-1]), np.r_[theta, 0 * theta], "LSODA", t, rtol=1e-9, atol=1e-10)
        return path.y[:n].T

    def tip(self, theta: np.ndarray) -> np.ndarray:
        """Of angles (..., N), from the base [m], (..., 2)."""
        return (self.l[:, None] * np.stack([np.sin(theta), -np.cos(theta)], -1)).sum(-2)
