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
    """Smallest allowed distance between arm, whip and floor, whose shapes are capsules; see `Scene`.

    Links with only one link between them are always close: they must not touch, but need no further distance. The whole
    trajectory is checked only for strikes that would be hits or the best.

    Args:
        model: Model of arm and whip.
        floor: Height of the floor, z = floor (in the plane y = floor) [m]; None: no floor.
        least: Smallest allowed distance [m], at most 1 m.

    Raises:
        InputError: There is nothing to check because the arm has no capsules and there is no floor; or a number is out
            of range.
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
        """Whether the whole trajectory has to be checked for strikes that would be hits or the best: yes."""
        return True

    @staticmethod
    def is_of(model: Model) -> bool:
        """Whether a model's arm has capsules."""
        return model.dimension == 3 and any(link.capsules for link in model.arm.in_space().links)

    @property
    def words(self) -> str:
        """Description of the limits."""
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
        """Constraints that a search can keep without simulation, for an arm in space: the hanging whip, and the arm's
        path.
        """
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
        """Return the closest pair of bodies over a strike and the time [s]; neighbouring links only if they overlap.

        Args:
            trajectory: Trajectory of the strike.
            enough: Distance above which the exact value is not needed [m].

        Returns:
            The pair (None if nothing is compared), and the time.
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
        """Return by how much a strike falls below the allowed distance, in units of 0.1 m; at most 0 if it is kept."""
        if trajectory.diverged:
            return math.inf
        found = self.nearest(trajectory, enough=self.least)[0]
        return -math.inf if found is None else self._beyond(found)

    def violation_of_peaks(self, near: Approach) -> np.ndarray:
        """Return -1 for each strike, (B,), as peak values contain no distances; infinity for one that diverged."""
        return np.where(near.diverged, math.inf, -1.0)

    def _beyond(self, found: NearestPair) -> float:
        return (self.least - found.clearance) / UNIT

    def explain(self, trajectory: Trajectory, joints: Sequence[str]) -> str:
        """Return a description of the closest pair of bodies."""
        found, at = self.nearest(trajectory)
        if found is None:
            return "nothing is near anything"
        return f"at {at:.3f} s {self._said(found)}"

    def beyond_on_way(self, t: np.ndarray, q: np.ndarray) -> str | None:
        """Return a description of what an arm without its whip comes too close to on a path; None: nothing.

        Args:
            t: Times [s], (T,).
            q: Positions of the arm's joints [rad or m], (T, a).
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
