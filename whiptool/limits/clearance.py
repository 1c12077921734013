"""Clearance between arm, whip and floor over a strike, and its smooth constraints for searches."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from whiptool.dynamics.posture import start_posture
from whiptool.errors import InputError
from whiptool.limits.limits import Limits
from whiptool.limits.postures import least_beyond
from whiptool.models.excess import Excess
from whiptool.models.kinematics import arm_poses, joint_points
from whiptool.models.numbers import LARGEST_GAP, LONGEST, metres
from whiptool.models.parameters import Model
from whiptool.models.scene import NearestPair, Scene
from whiptool.models.trajectory import Trajectory

_UNDER_CEILING = 0.3  # [m] that an arm on a ceiling needs above the hand, about
_BENDS = 4.0  # of the length over which a hanging whip bends downward from any direction of the hand


class HangingWhip:
    """Constraint: before a strike the whip that hangs from an arm in space keeps the distance `least` [m] from the
    floor.

    A heavy whip bends downward within a few times the length `sqrt(EI / (m g))`, with EI its largest bending stiffness
    and m g its weight. This length is subtracted, so that no feasible strike is excluded.
    """

    def __init__(self, model: Model, floor: float, least: float = 0.0) -> None:
        self._arm, self._lowest = model.arm.in_space(), floor + least + _depth(model)
        self._turns, self._floor, self._length = model.arm.turns, floor, model.whip.length
        self._hung = (self._arm.surface or (0.0, 0.0, 0.0))[2] < -1 + 1e-9  # from a ceiling, which the hand is below

    def constraints(self, strike: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return by how much the whip of a strike (2 a + 1,) hangs too low [m], (1,), at most 0 if it keeps the
        distance, and the derivatives (1, 2 a + 1)."""
        a = self._arm.n
        origins, rotations = arm_poses(self._arm, strike[None, :a])
        axes = np.einsum("jik,jk->ji", rotations[0, :-1], self._arm.per_link("axis"))
        turning = np.cross(axes, origins[0, -1] - origins[0, :-1])
        upward = np.where(self._turns, turning[:, 2], axes[:, 2])
        slopes = np.concatenate([-upward, np.zeros(a + 1)])
        return self._lowest - origins[0, -1, 2:], slopes[None]

    def check_box(self, lower: np.ndarray, upper: np.ndarray) -> None:
        """Refuse a whip that hangs too low in all postures of a box, whose corners are given as strikes (2 a + 1,)."""
        a = self._arm.n
        lacking = least_beyond(lambda q: float(self.constraints(np.r_[q, q, 0.0])[0][0]), lower[:a], upper[:a])[0]
        highest = self._lowest - lacking
        highest = min(highest, 0.0) if self._hung else highest
        if highest < self._lowest:
            room, length = highest - self._floor, self._length
            above = f"rises to {room:.3g} m above the floor at most"
            below = f"stays at least {-room:.3g} m below the floor"
            given = f"a whip of {length:.3g} m on an arm whose hand {above if room > 0 else below}"
            needed = length + (_UNDER_CEILING if self._hung else 0.0)
            higher = f"a base higher above the floor, such as {math.ceil(10 * needed - 1e-9) / 10:g} m"
            shorter = f"a shorter whip, such as {room / 2:.2g} m, or {higher}"
            fix = f"give {shorter if room > 0.02 else f'{higher}, or a lower floor'}"
            raise InputError("whip and mount", given, "a whip that hangs above the floor in some posture", fix)

    def kept(self, strikes: np.ndarray) -> np.ndarray:
        """Return whether the whips of strikes (B, 2 a + 1) hang high enough, (B,)."""
        return arm_poses(self._arm, strikes[:, : self._arm.n])[0][:, -1, 2] >= self._lowest


def _depth(model: Model) -> float:
    """Return how far the tip hangs below the hand at least [m]; 0 of a whip that is stiff, or without gravity."""
    whip, weight = model.whip, model.whip.mass * model.gravity
    stiffness = float((whip.per_node("k") * whip.per_node("l")).max())
    return max(0.0, whip.length - _BENDS * math.sqrt(stiffness / weight)) if weight > 0 else 0.0


FRACTIONS = np.linspace(0.0, 1.0, 16)  # of the way, at which the arm is looked at
SPARE = 5e-3  # [m] that a search keeps besides, for what lies between and for how joints depart from the command


class PathClearance:
    """Constraints: on the commanded path the links of an arm in space, without its whip, keep the distance `least` [m]
    from each other and from the floor of a height [m]; None: no floor.

    The joints move along a straight line from `q_i` to `q_f`, so the path does not depend on the duration.
    """

    def __init__(self, model: Model, floor: float | None = None, least: float = 0.0) -> None:
        self._arm = model.arm.in_space()
        self._turns = model.arm.turns
        self._scene = Scene(model, floor, ("close", "apart"))
        pairs = zip(self._scene.kinds, map(self._scene.links_of, self._scene.pairs), strict=True)
        of_pairs = [(0.0 if kind == "close" else least + SPARE, *links) for kind, links in pairs]
        kept = sorted(set(of_pairs))  # what each two links keep, and which they are
        self._groups = np.array([kept.index(each) for each in of_pairs], int)
        self._least, self._links = np.array([x[0] for x in kept]), np.array([x[1:] for x in kept], int).reshape(-1, 2)

    def constraints(self, strike: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return for each pair of links (or link and floor) the allowed distance minus the smallest one of a strike
        (2 a + 1,) [m]: the functions (m,), at most 0 if the distance is kept, and their derivatives (m, 2 a + 1). A
        function has a kink where another instant or capsule becomes the nearest."""
        a, m = self._arm.n, len(self._links)
        if not m:
            return np.zeros(0), np.zeros((0, 2 * a + 1))
        q = self._path(strike)
        contacts = [x for x in self._scene.contacts(q, self._groups, [np.inf] * m) if x is not None]
        at = np.array([contact.instant for contact in contacts])
        normals = np.stack([contact.normal for contact in contacts])
        points = np.stack([contact.points for contact in contacts])
        by_q = self._slopes(q[at], points, np.stack([normals, -normals], axis=1))
        share = FRACTIONS[at, None]
        values = self._least - np.array([contact.distance for contact in contacts])
        return values, np.hstack([(1 - share) * by_q, share * by_q, np.zeros((m, 1))])

    def kept(self, strikes: np.ndarray) -> np.ndarray:
        """Return whether the arm keeps the distances in strikes (B, 2 a + 1), (B,)."""
        found = [self._scene.contacts(self._path(strike), self._groups, self._least.tolist()) for strike in strikes]
        near = [[np.inf if x is None else x.distance for x in contacts] for contacts in found]
        return np.all(np.reshape(near, (len(strikes), len(self._least))) >= self._least, axis=1)

    def _path(self, strike: np.ndarray) -> np.ndarray:
        """Return positions of the joints on the commanded path, (T, a)."""
        a = self._arm.n
        return strike[:a] + FRACTIONS[:, None] * (strike[a : 2 * a] - strike[:a])

    def _slopes(self, q: np.ndarray, points: np.ndarray, toward: np.ndarray) -> np.ndarray:
        """Return how fast points (m, 2, 3) of two links approach each other along directions from each to the other,
        by each joint's position q (m, a), (m, a); base and floor, whose numbers are negative, do not move."""
        origins, rotations = arm_poses(self._arm, q)
        axes = np.einsum("mjik,jk->mji", rotations[:, :-1], self._arm.per_link("axis"))[:, None]
        arms = points[:, :, None] - origins[:, None, :-1]  # (m, 2, a, 3)
        velocities = np.where(self._turns[:, None], np.cross(axes, arms), axes)
        moved = np.arange(self._arm.n) <= self._links[:, :, None]  # (m, 2, a)
        return (np.einsum("meji,mei->mej", velocities, toward) * moved).sum(axis=1)


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
            raise InputError("clearance", "an arm without capsules, and no floor", "an arm with capsules, or a floor")

    def of_model(self, model: Model) -> Clearance:
        """Return the same distance for another model, whose whip may be longer or shorter; see `Limits.of_model`."""
        return self if model == self.model else replace(self, model=model)

    @property
    def of_candidates(self) -> bool:
        return True

    @staticmethod
    def is_of(model: Model) -> bool:
        """Whether a model's arm has capsules, or things stand next to it."""
        arm = model.arm.in_space()
        return model.dimension == 3 and any((*(link.capsules for link in arm.links), *(x.name for x in arm.base)))

    @property
    def words(self) -> str:
        kept = f" of {1e3 * self.least:g} mm" if self.least else ""
        arm = self.model.arm.in_space()
        others = ["the surface at its base"] * (arm.surface is not None) + list(arm.bodies[arm.n + 1 :])
        floor = "".join(f", {other}" for other in others) + (
            "" if self.floor is None else f" and the floor at {self.floor:g} m"
        )
        return f"the distance{kept} from arm and whip to the arm{floor}"

    @cached_property
    def _scene(self) -> Scene:
        """What is looked at over a strike."""
        return Scene(self.model, self.floor, ("close", "apart", "whip"))

    @cached_property
    def _scene_of_arm(self) -> Scene:
        """What of it is of the arm without its whip."""
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

        path = PathClearance(self.model, self.floor, self.least)
        return (path,) if self.floor is None else (HangingWhip(self.model, self.floor, self.least), path)

    def check_box(self, lower: np.ndarray, upper: np.ndarray) -> None:
        """Refuse a model whose arm or hanging whip is too close to something in all postures of a box, whose corners
        are given as strikes (2 a + 1,); see `least_beyond` for those that are tried.
        """
        for smooth in self.smooth:
            if isinstance(smooth, HangingWhip):
                smooth.check_box(lower, upper)
        low, high = lower[: self.model.arm.n], upper[: self.model.arm.n]
        nearest = lambda q: self._nearest(start_posture(self.model, q[None]), self.least, self._scene)  # noqa: E731
        beyond, q, tried = least_beyond(lambda q: self._beyond(nearest(q)), low, high)
        if beyond <= 0 or (pair := nearest(q)) is None:
            return
        found = self._said(pair, 0.0)
        given = f"an arm and a whip that are too close to something in all of {tried} postures tried"
        rule = f"a posture in which arm and hanging whip keep {self.words}; at best {found.words}"
        fix = "give a shorter whip, a base higher above the floor, a lower floor, or another mount"
        alone = "; where shapes of the arm's file touch in every posture, name their links in arm.never_touch"
        raise InputError("whip and mount", given, rule, fix + alone * found.overlap)

    def nearest(self, trajectory: Trajectory, *, enough: float = math.inf) -> tuple[NearestPair | None, float]:
        """Return the closest pair of bodies over a strike (None if nothing is compared) and the time [s]; neighbouring
        links only if they overlap. A distance above `enough` [m] need not be exact.
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
        return self._beyond(self.nearest(trajectory, enough=self.least)[0])

    def _beyond(self, found: NearestPair | None) -> float:
        return -math.inf if found is None else (self.least - found.clearance) / UNIT

    def explain(self, trajectory: Trajectory, joints: Sequence[str]) -> Excess:
        """Return a description of the closest pair of bodies."""
        found, at = self.nearest(trajectory)
        if found is None:
            return Excess("nothing is near anything")
        return self._said(found, at)

    def beyond_on_way(self, t: np.ndarray, q: np.ndarray) -> Excess | None:
        """Return a description of the body that an arm without its whip comes too close to on a path of joints (T, a)
        [rad or m] at times (T,) [s]; None: it keeps the clearance.
        """
        found = self._nearest(q, self.least, self._scene_of_arm) if self.model.dimension == 3 else None
        if found is None or self._beyond(found) <= 0:
            return None
        return self._said(found, t[found.instant])

    def above_floor(self, q: np.ndarray, model: Model) -> np.ndarray | None:
        """Return how high above the floor the model's whip ends while it hangs still from an arm in postures (T, a)
        [rad or m], (T,) [m]: negative where it lies on the floor; None: there is no floor, or the arm is in the plane.
        """
        if self.floor is None or model.dimension == 2:
            return None
        hanging = joint_points(model, start_posture(model, q))[:, model.arm.n :]  # from the hand to the tip
        return hanging[..., 2].min(axis=1) - self.floor

    def whip_on_way(self, t: np.ndarray, q: np.ndarray, model: Model) -> Excess | None:
        """Return a description of how low the model's whip comes while it hangs still from an arm on a slow path (T, a)
        [rad or m]; None: it keeps the clearance from the floor. Where the path begins the whip may lie on the floor,
        until lifted.
        """
        kept = self.above_floor(q, model)
        if kept is None:
            return None
        lifted = np.flatnonzero(kept >= self.least)
        first = int(lifted[0]) if len(lifted) else 0
        at = first + int(kept[first:].argmin())
        if kept[at] >= self.least:
            return None
        return self._said(NearestPair(float(kept[at]), at, ("the hanging whip", "the floor")), t[at])

    def _said(self, found: NearestPair, t: float) -> Excess:
        one, other = found.names
        distance = 1e3 * abs(found.clearance)
        if found.clearance < 0:
            where = "below" if other == "the floor" else "inside"
            return Excess(f"{one} is {distance:.0f} mm {where} {other}", float(t), overlap=where == "inside")
        kept = f"; it has to keep {1e3 * self.least:g} mm" if found.clearance < self.least else ""
        return Excess(f"{one} is {distance:.0f} mm from {other}{kept}", float(t))
