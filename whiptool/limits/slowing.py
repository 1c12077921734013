"""Largest movements along minimum-jerk paths (Eq. 1) of joints whose largest velocity decreases towards their ends."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from whiptool.models.spatial_arm import JointLimits
from whiptool.models.strike import eased

_STEPS = 32  # of a path, among which its critical instant is looked for
_FINER = (1 / 32, 1 / 64, 1 / 256, 1 / 1024, 1 / 4096, 1 / 8192)  # distances of three instants whose parabola finds it


class Reach(NamedTuple):
    """Largest movements of k joints, downwards and upwards, and their derivatives; (B, 2, k) each."""

    span: np.ndarray  # largest movements [rad or m], at least 0
    by_distance: np.ndarray  # derivatives by the start's distance from the end of the range to which the joint moves
    by_duration: np.ndarray  # derivatives by the duration [rad/s or m/s]


class Slowing:
    """Limits of velocity that depend on the position, for minimum-jerk paths; see `JointLimits.velocities`.

    After a fraction s of its duration D, a path over a span x has moved by x m(s) with the velocity x w(s) / D. At the
    distance r of its start from the end of the range it keeps the limit if, for all s,
    `(x w(s) / D + o)^2 <= 2 d (r - x m(s))`, with d the deceleration and o the sum of offset and margin. For each s the
    largest such x is the root of a quadratic equation; the least of them is the largest movement. `which` are the
    indices of the k joints with such limits.
    """

    def __init__(self, joints: Sequence[JointLimits]) -> None:
        self.which = np.array([j for j, joint in enumerate(joints) if joint.by_position], int)
        chosen = [joints[j] for j in self.which]
        margins = np.outer((1, -1), [joint.position_margin for joint in chosen])
        self._ends = np.array([joint.position for joint in chosen]).reshape(-1, 2).T + margins  # (2, k)
        self._d = np.array([joint.deceleration for joint in chosen])
        self._o = np.array([joint.velocity_offset + joint.velocity_margin for joint in chosen])

    def reach(self, strikes: np.ndarray, share: float) -> Reach:
        """Return the largest movements of the joints in `which` for strikes (B, 2 a + 1) that use a share of the
        velocity limits.
        """
        q_i, D = strikes[:, self.which], strikes[:, -1]
        r = np.stack([q_i - self._ends[0], self._ends[1] - q_i], axis=1)  # (B, 2, k)
        duration = (share * D)[:, None, None]
        s = (1 + self._spans(r, duration, self._grid).argmin(axis=0)) / _STEPS  # (B, 2, k)
        for step in _FINER:
            s = self._vertex(r, duration, np.clip(s, 2 * step, 1 - step), step)
        m, w, _ = eased(s, 1.0)
        x = self._spans(r, duration, (m, w))
        a = w / duration
        slope = 2 * a * (a * x + self._o) + 2 * self._d * m  # of the left side minus the right one, by x
        by_duration = 2 * (a * x + self._o) * x * a / D[:, None, None] / slope
        return Reach(x, np.where(x > 0, 2 * self._d / slope, 0.0), by_duration)

    @cached_property
    def _grid(self) -> tuple[np.ndarray, np.ndarray]:
        m, w, _ = eased(np.arange(1, _STEPS + 1) / _STEPS, 1.0)
        return m[:, None, None, None], w[:, None, None, None]

    def _spans(self, r: np.ndarray, duration: np.ndarray, at: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        """The largest spans x by the condition at instants (m, w)."""
        m, w = at
        a = w / duration
        half = a * self._o + self._d * m  # the equation is a^2 x^2 + 2 half x = c
        c = np.maximum(2 * self._d * r - self._o**2, 0.0)
        return c / (half + np.sqrt(half**2 + a**2 * c))

    def _vertex(self, r: np.ndarray, duration: np.ndarray, s: np.ndarray, step: float) -> np.ndarray:
        """The instants (B, 2, k) of the least spans, by parabolas through three instants around s."""
        at = s + step * np.array([-1, 0, 1])[:, None, None, None]
        left, middle, right = self._spans(r, duration, eased(at, 1.0)[:2])
        bend = left - 2 * middle + right
        side = np.sign(left - right)  # where there is no parabola with a least value, the lower side
        return s + step * np.where(bend > 0, np.clip((left - right) / np.where(bend > 0, 2 * bend, 1), -1, 1), side)
