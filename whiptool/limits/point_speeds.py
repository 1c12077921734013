"""Limits of the speeds of points of an arm, as the safety configurations of robots have them.

Universal Robots' controllers limit the speeds of the elbow, of the flange, and of tool positions that are configured.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from whiptool.errors import InputError
from whiptool.given_files import number_in
from whiptool.limits.limits import ROUNDING, Limits
from whiptool.models.excess import Excess
from whiptool.models.kinematics import arm_frames
from whiptool.models.parameters import AnyArm
from whiptool.models.spatial_arm import SpatialArm
from whiptool.models.trajectory import Trajectory

_INSTANTS = np.linspace(0.0, 1.0, 33)  # of a commanded path, as fractions of its duration
_WAY = np.polynomial.Polynomial([0, 0, 0, 10, -15, 6])  # Eq. 1
_TRIES = 8  # times that a path is shortened; its points are then within the limits, as a rule


def point_speeds(arm: SpatialArm, names: Sequence[str], q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return the speeds [m/s], (..., P), of the P named points of an arm, see `SpatialArm.points`, at joint positions
    [rad or m] and speeds [rad/s or m/s], (..., a).
    """
    frames, numbers = arm_frames(arm, q, v), [arm.points[name] for name in names]
    return np.stack([np.linalg.norm(frames[i].velocity, axis=-1) for i in numbers], axis=-1)


@dataclass(frozen=True)
class PathSpeeds:
    """Limits of the speeds of points on commanded paths; arguments as of `PointSpeeds`."""

    arm: SpatialArm
    most: tuple[tuple[str, float], ...]

    def usage(self, strikes: np.ndarray) -> np.ndarray:
        """Return the fraction of the limits that strikes (B, 2 a + 1) use at 33 instants, (B, 33, P)."""
        a = self.arm.n
        spans, D = (strikes[:, a : 2 * a] - strikes[:, :a])[:, None], strikes[:, -1, None, None]
        q = strikes[:, None, :a] + _WAY(_INSTANTS)[:, None] * spans
        v = _WAY.deriv()(_INSTANTS)[:, None] * spans / D
        names, limits = zip(*self.most, strict=True)
        return point_speeds(self.arm, names, q, v) / np.array(limits)

    def violation(self, strikes: np.ndarray) -> np.ndarray:
        """Return the largest relative excess of strikes (B, 2 a + 1) over a limit, (B,)."""
        return self.usage(strikes).max(axis=(1, 2)) - 1.0

    def shortened(self, strikes: np.ndarray) -> np.ndarray:
        """Return strikes (B, 2 a + 1) whose end positions are moved towards the start if points are too fast."""
        a, strikes = self.arm.n, strikes.copy()
        for _ in range(_TRIES):
            used = self.violation(strikes) + 1.0
            fast = used > 1.0
            if not fast.any():
                break
            share = (1.0 - ROUNDING) / used[fast, None]
            strikes[fast, a : 2 * a] = (1 - share) * strikes[fast, :a] + share * strikes[fast, a : 2 * a]
        return strikes

    def explain(self, strike: np.ndarray, joints: Sequence[str]) -> Excess:
        """Return a description of the limit that a strike (2 a + 1,) uses most."""
        usage = self.usage(strike[None])[0]
        i, k = (int(x) for x in np.unravel_index(usage.argmax(), usage.shape))
        name, limit = self.most[k]
        words = f"the {name} is commanded at {usage[i, k] * limit:.2f} m/s; its limit is {limit:g} m/s"
        return Excess(words, float(_INSTANTS[i] * strike[-1]))


@dataclass(frozen=True)
class PointSpeeds(Limits):
    """Limits of the speeds of points of an arm; checked on the commanded path, and on the motion of candidates."""

    arm: SpatialArm  # in space
    most: tuple[tuple[str, float], ...]  # points, see `SpatialArm.points`, and their largest speeds [m/s]

    judges: ClassVar[str] = "speed"
    by_peaks: ClassVar[bool] = True

    @classmethod
    def of(cls, arm: AnyArm, given: Sequence[str] = (), *, keep_free: float = 0.0) -> PointSpeeds | None:
        """Return the limits of an arm, with the given limits, such as `elbow=1.5`, in place of those of the arm, and
        the fraction `keep_free` of each unused; None without limits.
        """
        if not isinstance(arm, SpatialArm):
            if given:
                raise InputError("speed limits", given, "none for an arm in the plane")
            return None
        most = dict(arm.speed_limits)
        for text in given:
            name, _, value = text.partition("=")
            if name not in arm.points:
                raise InputError("speed limits", text, f"POINT=SPEED with a point among {', '.join(arm.points)}")
            most[name] = speed(text, value)
        return cls(arm, tuple((name, (1 - keep_free) * x) for name, x in most.items())) if most else None

    @property
    def words(self) -> str:
        return "the speeds of " + ", ".join(f"{name} ({limit:g} m/s)" for name, limit in self.most)

    @property
    def command(self) -> PathSpeeds:
        """Limits of the commanded path."""
        return PathSpeeds(self.arm, self.most)

    @property
    def of_candidates(self) -> bool:
        """True, as peak values do not show speeds of points."""
        return True

    def violation(self, trajectory: Trajectory) -> float:
        """Return the largest relative excess of a trajectory over a limit; at most 0 within all limits."""
        return np.inf if trajectory.diverged else float(self._usage(trajectory).max()) - 1.0

    def explain(self, trajectory: Trajectory, joints: Sequence[str]) -> Excess:
        """Return a description of the instant at which a trajectory uses a limit most."""
        usage = self._usage(trajectory)
        i, k = (int(x) for x in np.unravel_index(usage.argmax(), usage.shape))
        name, limit = self.most[k]
        words = f"the {name} moves at {usage[i, k] * limit:.2f} m/s; its limit is {limit:g} m/s"
        return Excess(words, float(trajectory.t[i]))

    def _usage(self, trajectory: Trajectory) -> np.ndarray:
        a = self.arm.n
        names, limits = zip(*self.most, strict=True)
        return point_speeds(self.arm, names, trajectory.q[:, :a], trajectory.v[:, :a]) / np.array(limits)


def speed(text: str, value: str) -> float:
    """Return a speed [m/s] as it is written."""
    try:
        found = number_in(value)
    except ValueError:
        found = float("nan")
    if not 0 < found < np.inf:
        raise InputError("speed limits", text, "POINT=SPEED with a speed > 0 [m/s]")
    return found
