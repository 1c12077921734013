"""What an arm may be commanded: how fast, and with which acceleration and jerk, its joints follow Eq. 1."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from whiptool.models.spatial_arm import JointLimits, limit_unit
from whiptool.models.strike import FASTEST, LARGEST_ACCELERATION, LARGEST_JERK

_PEAKS = np.array([FASTEST, LARGEST_ACCELERATION, LARGEST_JERK])  # of the derivatives 1 to 3
_NAMES = ("velocity", "acceleration", "jerk")
ROUNDING = 1e-6  # share of limits that searches leave free, so that rounding takes no strike beyond them


@dataclass(frozen=True)
class CommandLimits:
    """Limits of velocity, acceleration and jerk of commanded paths, which are closed forms of a strike.

    The derivative k of a minimum-jerk path over a span in a duration D is at most a number times span / D^k: 15/8,
    10/sqrt(3) and 60.

    Args:
        joints: Limits of each joint; see `JointLimits`.
        share: Share of the velocity limits that searches command; the rest is left for how joints depart from the
            command.
        slides: Which joints slide, counted from 0; the others turn.
    """

    joints: tuple[JointLimits, ...]
    share: float = 1.0 - ROUNDING
    slides: tuple[int, ...] = ()

    @property
    def largest(self) -> np.ndarray:
        """Largest velocity, acceleration and jerk that searches command of each joint, (3, a); infinite for any."""
        limits = np.array([[getattr(joint, name) for joint in self.joints] for name in _NAMES])
        return limits * np.array([[self.share], [1 - ROUNDING], [1 - ROUNDING]])

    def farthest(self, D: np.ndarray) -> np.ndarray:
        """Return how far searches command each joint to move in given times [rad or m].

        Args:
            D: [s], (B,).

        Returns:
            (B, a); infinite where there is no limit.
        """
        powers = np.asarray(D, float)[:, None, None] ** np.array([1, 2, 3])[:, None]  # (B, 3, 1)
        return (self.largest * powers / _PEAKS[:, None]).min(axis=1)

    def shortened(self, strikes: np.ndarray) -> np.ndarray:
        """Return strikes, vectors (B, 2 a + 1), whose joints' ends come nearer to their starts where they move too far.

        They are within the limits; their starts and durations stay.
        """
        a = len(self.joints)
        q_i, q_f, D = np.split(strikes, [a, 2 * a], axis=1)
        farthest = self.farthest(D[:, 0])
        return np.hstack([q_i, np.clip(q_f, q_i - farthest, q_i + farthest), D])

    def constraints(self, strike: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return smooth functions of a strike that are <= 0 where it is within what searches command.

        They are `peak (q_f - q_i) - limit D^k` to either side, for each limit that there is.

        Args:
            strike: Vector, (2 a + 1,).

        Returns:
            The functions (m,), and their derivatives (m, 2 a + 1).
        """
        a, D = len(self.joints), strike[-1]
        orders, joints = np.nonzero(np.isfinite(self.largest))
        peaks, limits, k = _PEAKS[orders], self.largest[orders, joints], orders + 1
        move = peaks * (strike[a + joints] - strike[joints])
        allowed, slope = limits * D**k, limits * k * D ** (k - 1)
        rows = np.zeros((2, len(joints), len(strike)))
        for side, sign in zip(rows, (1, -1), strict=True):
            side[np.arange(len(joints)), joints] = -sign * peaks
            side[np.arange(len(joints)), a + joints] = sign * peaks
            side[:, -1] = -slope
        return np.concatenate([move - allowed, -move - allowed]), rows.reshape(-1, len(strike))

    def kept(self, strikes: np.ndarray) -> np.ndarray:
        """Return whether strikes (B, 2 a + 1) are within what searches command, (B,)."""
        a = len(self.joints)
        moves = np.abs(strikes[:, a : 2 * a] - strikes[:, :a])
        return np.all(moves <= self.farthest(strikes[:, -1]) + ROUNDING, axis=1)

    def usage(self, strikes: np.ndarray) -> np.ndarray:
        """Return how much strikes use of the limits of acceleration and jerk: 1 is at one, more is beyond.

        Args:
            strikes: Vectors, (B, 2 a + 1).

        Returns:
            (B, 2, a); 0 where there is no limit.
        """
        values = self._peaks_of(strikes)[:, 1:]
        limits = np.array([[getattr(joint, name) for joint in self.joints] for name in _NAMES[1:]])
        return values / limits

    def violation(self, strikes: np.ndarray) -> np.ndarray:
        """Return how far strikes (B, 2 a + 1) are beyond a limit of acceleration or jerk, in parts of it, (B,)."""
        return self.usage(strikes).max(axis=(1, 2)) - 1.0

    def explain(self, strike: np.ndarray, joints: Sequence[str]) -> str:
        """Return what one strike, (2 a + 1,), uses most of, in words."""
        usage = self.usage(strike[None])[0]
        what, j = (int(x) for x in np.unravel_index(usage.argmax(), usage.shape))
        value, name = self._peaks_of(strike[None])[0, what + 1, j], _NAMES[what + 1]
        limit, unit = getattr(self.joints[j], name), limit_unit(name, slides=j in self.slides)
        return f"the {name} of {joints[j]} is commanded up to {value:.2f} {unit}; its limit is {limit:g} {unit}"

    def _peaks_of(self, strikes: np.ndarray) -> np.ndarray:
        """Largest velocity, acceleration and jerk of each joint's command, (B, 3, a)."""
        a = len(self.joints)
        spans, D = np.abs(strikes[:, a : 2 * a] - strikes[:, :a]), strikes[:, -1]
        return _PEAKS[:, None] * spans[:, None] / D[:, None, None] ** np.array([1, 2, 3])[:, None]
