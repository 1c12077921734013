"""Interface of limits, their smooth constraints, and limits of commanded paths (Eq. 1)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Protocol

import numpy as np

from whiptool.limits.slowing import Slowing
from whiptool.models.excess import Excess
from whiptool.models.parameters import Model
from whiptool.models.spatial_arm import JointLimits, limit_unit
from whiptool.models.strike import FASTEST, LARGEST_ACCELERATION, LARGEST_JERK, Strike
from whiptool.models.trajectory import Approach, Trajectory

_PEAKS = np.array([FASTEST, LARGEST_ACCELERATION, LARGEST_JERK])  # of the derivatives 1 to 3
_NAMES = ("velocity", "acceleration", "jerk")
_FIELDS = ("fastest", "acceleration", "jerk")  # of `JointLimits`
_INSTANTS = 1000  # of a commanded path that exceeds a limit, of which the worst is stated
_NOWHERE = 1e-9  # [rad or m], a smaller movement counts as rest
ROUNDING = 1e-6  # share of limits that searches leave free, so that rounding takes no strike beyond them


@dataclass(frozen=True)
class CommandLimits:
    """Limits of velocity, acceleration and jerk of commanded paths; their usage is a closed form of a strike.

    The largest k-th derivative of a minimum-jerk path over a span in a duration D is span / D^k times 15/8, 10/sqrt(3)
    and 60 for k = 1, 2, 3. For limits of velocity that depend on the position, see `Slowing`.
    """

    joints: tuple[JointLimits, ...]  # limits of each joint; see `JointLimits`
    share: float = 1.0 - ROUNDING  # fraction of the velocity limits for searches; the rest allows for deviations
    slides: tuple[int, ...] = ()  # indices of the prismatic joints, from 0; the others are revolute

    @property
    def largest(self) -> np.ndarray:
        """Largest velocity, acceleration and jerk that searches command for each joint, (3, a); infinite without a
        limit.
        """
        limits = np.array([[getattr(joint, name) for joint in self.joints] for name in _FIELDS])
        return limits * np.array([[self.share], [1 - ROUNDING], [1 - ROUNDING]])

    def farthest(self, D: np.ndarray) -> np.ndarray:
        """Return the largest movement that searches command for each joint in durations (B,) [s], (B, a) [rad or m];
        infinite without a limit.
        """
        powers = np.asarray(D, float)[:, None, None] ** np.array([1, 2, 3])[:, None]  # (B, 3, 1)
        return (self.largest * powers / _PEAKS[:, None]).min(axis=1)

    @cached_property
    def slowing(self) -> Slowing:
        """Limits of velocity that depend on the position."""
        return Slowing(self.joints)

    def spans(self, strikes: np.ndarray) -> np.ndarray:
        """Return the largest movements downwards and upwards that searches command from the start of strikes
        (B, 2 a + 1), (B, 2, a) [rad or m], at least 0; infinite without a limit.
        """
        farthest = np.repeat(self.farthest(strikes[:, -1])[:, None], 2, axis=1)
        if len(which := self.slowing.which):
            farthest[..., which] = np.minimum(farthest[..., which], self.slowing.reach(strikes, self.share).span)
        return farthest

    def shortened(self, strikes: np.ndarray) -> np.ndarray:
        """Return strikes (B, 2 a + 1) whose end positions are moved towards the start positions if they are too far.

        The strikes then keep the limits; start positions and durations are unchanged.
        """
        a = len(self.joints)
        q_i, q_f, D = np.split(strikes, [a, 2 * a], axis=1)
        down, up = self.spans(strikes).swapaxes(0, 1)
        return np.hstack([q_i, np.clip(q_f, q_i - down, q_i + up), D])

    def constraints(self, strike: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return smooth functions (m,) of a strike (2 a + 1,), which are at most 0 if it keeps the limits for searches,
        and their derivatives (m, 2 a + 1).

        The functions are `peak (q_f - q_i) - limit D^k` in both directions, for each finite limit of the k-th
        derivative, whose largest value on a path of length and duration 1 is `peak`; and the movement minus the largest
        one, for each limit of velocity that depends on the position.
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
        values, slopes = self._slowed(strike)
        return np.concatenate([move - allowed, -move - allowed, values]), np.vstack([*rows, slopes])

    def _slowed(self, strike: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Movements beyond the largest ones by limits that depend on the position, (2 k,), and their derivatives."""
        a, which = len(self.joints), self.slowing.which
        if not len(which):
            return np.zeros(0), np.zeros((0, len(strike)))
        reach, k = self.slowing.reach(strike[None], self.share), np.arange(len(which))
        move, rows = strike[a + which] - strike[which], np.zeros((2, len(which), len(strike)))
        for i, (side, sign) in enumerate(zip(rows, (-1, 1), strict=True)):
            side[k, a + which] = sign
            side[k, which] = -sign + sign * reach.by_distance[0, i]  # upwards, the distance decreases with q_i
            side[:, -1] = -reach.by_duration[0, i]
        return np.concatenate([-move, move]) - reach.span[0].ravel(), rows.reshape(-1, len(strike))

    def kept(self, strikes: np.ndarray) -> np.ndarray:
        """Return whether the joints of strikes (B, 2 a + 1) move no farther than `spans` allows, (B,)."""
        a = len(self.joints)
        moves = strikes[:, a : 2 * a] - strikes[:, :a]
        down, up = self.spans(strikes).swapaxes(0, 1)
        return np.all((-moves <= down + ROUNDING) & (moves <= up + ROUNDING), axis=1)

    def usage(self, strikes: np.ndarray) -> np.ndarray:
        """Return the fraction of the limits of acceleration and jerk, and of the largest movement by limits of velocity
        that depend on the position, that strikes (B, 2 a + 1) use, (B, 3, a), velocity first; above 1 they exceed it, 0
        without a limit.
        """
        a, which = len(self.joints), self.slowing.which
        limits = np.array([[getattr(joint, name) for joint in self.joints] for name in _FIELDS])
        limits[0] = np.inf  # judged on the simulated motion
        used = self._peaks_of(strikes) / limits
        if len(which):
            down, up = self.slowing.reach(strikes, 1.0).span.swapaxes(0, 1)
            move = (strikes[:, a : 2 * a] - strikes[:, :a])[:, which]
            moved = np.where(np.abs(move) < _NOWHERE, 0.0, np.abs(move))
            used[:, 0, which] = moved / np.maximum(np.where(move < 0, down, up), _NOWHERE)
        return used

    def violation(self, strikes: np.ndarray) -> np.ndarray:
        """Return the largest relative excess of strikes (B, 2 a + 1) over the limits of `usage`, (B,)."""
        return self.usage(strikes).max(axis=(1, 2)) - 1.0

    def explain(self, strike: np.ndarray, joints: Sequence[str]) -> Excess:
        """Return a description of the limit that a strike (2 a + 1,) uses most."""
        usage = self.usage(strike[None])[0]
        what, j = (int(x) for x in np.unravel_index(usage.argmax(), usage.shape))
        value, name = self._peaks_of(strike[None])[0, what, j], _NAMES[what]
        limit, unit = getattr(self.joints[j], _FIELDS[what]), limit_unit(name, slides=j in self.slides)
        if what == 0:
            q, v, _ = (x[:, j] for x in Strike.from_vector(strike).reference(np.linspace(0, strike[-1], _INSTANTS)))
            lowest, highest = self.joints[j].velocities(q)
            i = int(np.maximum(v - highest, lowest - v).argmax())
            where = f"{q[i]:+.2f} {limit_unit('position', slides=j in self.slides)}"
            value = f"{v[i]:+.2f} {unit} at {where}; its limit there is {lowest[i]:.2f} to {highest[i]:.2f} {unit}"
            return Excess(f"the velocity of {joints[j]} is commanded to be {value}")
        return Excess(f"the {name} of {joints[j]} is commanded up to {value:.2f} {unit}; its limit is {limit:g} {unit}")

    def _peaks_of(self, strikes: np.ndarray) -> np.ndarray:
        """Largest velocity, acceleration and jerk of each joint's command, (B, 3, a)."""
        a = len(self.joints)
        spans, D = np.abs(strikes[:, a : 2 * a] - strikes[:, :a]), strikes[:, -1]
        return _PEAKS[:, None] * spans[:, None] / D[:, None, None] ** np.array([1, 2, 3])[:, None]


class Commanded(Protocol):
    """Limits of commanded paths in joint space, such as `CommandLimits`."""

    def shortened(self, strikes: np.ndarray, /) -> np.ndarray:
        """Return strikes (B, 2 a + 1) whose end positions are moved towards the start positions if they are too far."""
        ...

    def violation(self, strikes: np.ndarray, /) -> np.ndarray:
        """Return the largest relative excess of strikes (B, 2 a + 1) over a limit, (B,)."""
        ...

    def explain(self, strike: np.ndarray, joints: Sequence[str], /) -> Excess:
        """Return a description of the limit that a strike (2 a + 1,) uses most."""
        ...


class Smooth(Protocol):
    """Differentiable constraints of a strike: functions that are at most 0 if the strike keeps a limit."""

    def constraints(self, strike: np.ndarray, /) -> tuple[np.ndarray, np.ndarray]:
        """Return the functions (m,) and their derivatives (m, 2 a + 1) at a strike, (2 a + 1,)."""
        ...

    def kept(self, strikes: np.ndarray, /) -> np.ndarray:
        """Return whether strikes (B, 2 a + 1) keep the constraints, (B,)."""
        ...


class Limits(ABC):
    """Limits that a strike has to keep: `MotorLimits`, the `ArmLimits` of joints, `Clearance`.

    Attributes:
        judges: Name of the limits in the outcome of a refused strike, such as `joint`.
        by_peaks: Whether the peak values of a strike suffice to check it.
    """

    judges: ClassVar[str]
    by_peaks: ClassVar[bool]

    @property
    @abstractmethod
    def words(self) -> str:
        """Name of the limits for people, such as "the arm's limits"."""

    def of_model(self, model: Model) -> Limits:
        """Return these limits for the strikes of another model, of an identified whip for instance."""
        return self

    @property
    def command(self) -> Commanded | None:
        """Limits of the commanded path; None if it has no limits."""
        return None

    @property
    def smooth(self) -> Sequence[Smooth]:
        """The limits as smooth constraints, which a search keeps before it simulates a strike."""
        return ()

    @property
    def positions(self) -> np.ndarray | None:
        """Lowest and highest position of each joint [rad or m], (2, a); None: no limits."""
        return None

    @property
    def of_candidates(self) -> bool:
        """Whether strikes that would be hits or the best have to be checked along their whole trajectory."""
        return False

    def violation_of_peaks(self, near: Approach) -> np.ndarray:
        """Return the excess of strikes over the limits as far as peak values show it, (B,): -1 if they show nothing,
        infinite for strikes that diverged."""
        return np.where(np.asarray(near.diverged), np.inf, -1.0)

    @abstractmethod
    def violation(self, trajectory: Trajectory) -> float:
        """Return the excess of a strike over the limits; at most 0 if it keeps them."""

    @abstractmethod
    def explain(self, trajectory: Trajectory, joints: Sequence[str]) -> Excess:
        """Return a description of the limit that a strike uses most."""
