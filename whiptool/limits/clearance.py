"""What an arm and its whip must not touch: the arm itself, the floor, and the whip the arm."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from whiptool.errors import InputError
from whiptool.limits.limits import Limits
from whiptool.models.numbers import LARGEST_GAP, LONGEST, metres
from whiptool.models.parameters import Model
from whiptool.models.trajectory import Approach, Trajectory

if TYPE_CHECKING:
    from whiptool.limits.path_clearance import PathClearance
    from whiptool.models.hanging_whip import HangingWhip
    from whiptool.models.scene import NearestPair, Scene

SAMPLED = 1e-3  # [s] between the states that are looked at, about
UNIT = 0.1  # [m] of a distance that counts as much as a whole limit


@dataclass(frozen=True)
class Clearance(Limits):
    """The distance that arm, whip and floor keep from each other, as capsules; see `Scene`.

    Links that have but one between them are always near each other: they have to be apart, but need not keep more.
    Whole strikes are judged where they would be hits or the best.

    Args:
        model: Arm and whip.
        floor: Its height, of the plane z (in the plane y) = floor [m]; None: no floor.
        least: Distance to be kept [m], at most 1 m.

    Raises:
        InputError: There is nothing to touch, as the arm has no capsules and there is no floor; or a number is out of
            range.
    """

    model: Model
    floor: float | None = None
    least: float = 0.0

    judges: ClassVar[str] = "clearance"
    by_peaks: ClassVar[bool] = True  # which never convict

    def __post_init__(self) -> None:
        if self.floor is not None:
            object.__setattr__(self, "floor", metres("floor", self.floor, low=-LONGEST, strict=False))
        object.__setattr__(self, "least", metres("least", self.least, longest=LARGEST_GAP, strict=False))
        if not self.is_of(self.model) and self.floor is None:
            raise InputError("clearance", "none", "an arm with capsules, or a floor")

    @property
    def of_candidates(self) -> bool:
        """Whether whole strikes have to be judged where they would be hits or the best: yes."""
        return True

    @staticmethod
    def is_of(model: Model) -> bool:
        """Whether a model's arm has capsules."""
        return model.dimension == 3 and any(link.capsules for link in model.arm.in_space().links)

    @property
    def words(self) -> str:
        """The limits for people."""
        kept = f" of {1e3 * self.least:g} mm" if self.least else ""
        floor = "" if self.floor is None else f" and the floor at {self.floor:g} m"
        return f"the distance{kept} from arm and whip to the arm{floor}"

    @cached_property
    def _scene(self) -> Scene:
        """What is looked at over a strike."""
        from whiptool.models.scene import Scene

        return Scene(self.model, self.floor, ("close", "apart", "whip"))

    @cached_property
    def _scene_of_arm(self) -> Scene:
        """What of it is of the arm without its whip."""
        from whiptool.models.scene import Scene

        return Scene(self.model, self.floor, ("close", "apart"))

    @property
    def smooth(self) -> tuple[HangingWhip | PathClearance, ...]:
        """What a search can keep beforehand, of an arm in space: where its whip hangs, and its own commanded path."""
        return self._smooth

    @cached_property
    def _smooth(self) -> tuple[HangingWhip | PathClearance, ...]:
        if self.model.dimension == 2:
            return ()
        from whiptool.limits.path_clearance import PathClearance
        from whiptool.models.hanging_whip import HangingWhip

        path = PathClearance(self.model, self.floor, self.least)
        return (path,) if self.floor is None else (HangingWhip(self.model, self.floor, self.least), path)

    def nearest(self, trajectory: Trajectory, *, enough: float = math.inf) -> tuple[NearestPair | None, float]:
        """Return where bodies come nearest over a strike, and when [s]; close links only where they overlap.

        Args:
            trajectory: Trajectory of the strike.
            enough: Clearance from which it does not matter how large it is [m].

        Returns:
            None, where nothing is compared.
        """
        step = float(np.median(np.diff(trajectory.t))) if len(trajectory.t) > 1 else SAMPLED
        stride = max(1, int(SAMPLED / step + 1e-9))
        found = self._nearest(trajectory.q[::stride], enough, self._scene)
        return found, 0.0 if found is None else float(trajectory.t[::stride][found.instant])

    def _nearest(self, q: np.ndarray, enough: float, scene: Scene) -> NearestPair | None:
        overlapping, kept = 0, 1  # close links have to be apart, and need not keep more
        groups = np.array([overlapping if kind == "close" else kept for kind in scene.kinds], int)
        overlap, nearest = scene.nearest_of_groups(q, groups, [0.0, enough])
        found = [nearest] if nearest is not None else []
        found += [overlap] if overlap is not None and overlap.clearance < 0 else []
        return min(found, key=lambda x: x.clearance, default=None)

    def violation(self, trajectory: Trajectory) -> float:
        """Return how far a strike comes nearer than it may, in tenths of a metre; <= 0: not."""
        if trajectory.diverged:
            return math.inf
        found = self.nearest(trajectory, enough=self.least)[0]
        return -math.inf if found is None else self._beyond(found)

    def violation_of_peaks(self, near: Approach) -> np.ndarray:
        """Return -1 for each strike, (B,), as peaks say nothing of distances; infinity where it diverged."""
        return np.where(near.diverged, math.inf, -1.0)

    def _beyond(self, found: NearestPair) -> float:
        return (self.least - found.clearance) / UNIT

    def explain(self, trajectory: Trajectory, joints: Sequence[str]) -> str:
        """Return in words what comes nearest to what."""
        found, at = self.nearest(trajectory)
        if found is None:
            return "nothing is near anything"
        return f"at {at:.3f} s {self._said(found)}"

    def beyond_on_way(self, t: np.ndarray, q: np.ndarray) -> str | None:
        """Return what an arm without its whip comes too near to on a way, in words; None: nothing.

        Args:
            t: Times [s], (T,).
            q: Positions of its joints [rad or m], (T, a).
        """
        found = self._nearest(q, self.least, self._scene_of_arm) if self.model.dimension == 3 else None
        if found is None or self._beyond(found) <= 0:
            return None
        return f"at {t[found.instant]:.3f} s {self._said(found)}"

    def _said(self, found: NearestPair) -> str:
        one, other = found.names
        distance = 1e3 * abs(found.clearance)
        if found.clearance < 0:
            where = "below" if other == "the floor" else "inside"
            return f"{one} is {distance:.0f} mm {where} {other}"
        kept = f"; it has to keep {1e3 * self.least:g} mm" if found.clearance < self.least else ""
        return f"{one} is {distance:.0f} mm from {other}{kept}"
