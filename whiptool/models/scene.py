"""The bodies of an arm and a whip as capsules over a floor, and how near they come: distances by Pinocchio's coal."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import coal
import numpy as np
import pinocchio as pin

from whiptool.models.capsules import Capsule
from whiptool.models.kinematics import arm_frames, joint_points, whip_motion
from whiptool.models.parameters import Model
from whiptool.models.spatial_arm import SpatialArm

NEAR_HAND = 3  # of the whip's segments next to the hand, which are not compared with the links that hold it
Of: TypeAlias = Literal["close", "apart", "whip"]
_HOLDING = 2  # last links of an arm, which hold the whip: a flange and what carries it
_BASE, _FLOOR, _WHIP = -1, -2, -3  # in place of a link's number


@dataclass(frozen=True)
class _Body:
    """A capsule that moves: of a link, the base (`_BASE`) or the whip (`_WHIP`).

    Args:
        name: For people.
        link: Its number.
        radius, length: [m]
        segment: Of the whip, from the hand.
    """

    name: str
    link: int
    radius: float
    length: float
    segment: int = 0


@dataclass(frozen=True)
class NearestPair:
    """Where two bodies are nearest to each other.

    Args:
        clearance: Their distance [m]; negative: how deep one is in the other.
        instant: Number of the state.
        names: Of both.
    """

    clearance: float
    instant: int
    names: tuple[str, str]


@dataclass
class Scene:
    """What of a model may touch what.

    It is of `close` links, that have one link between them and are always near each other; of `apart` links, that have
    more, and of the arm and the floor; or of the `whip`, and of arm and floor. Neighbours are not compared, nor the
    arm's `never_touch`, nor the whip's first segments with the links that hold it. Arms in the plane have no thickness
    and nothing to touch but a floor.

    Args:
        model: Arm and whip.
        floor: Its height [m]; None: there is none.
        of: Which of them.
    """

    model: Model
    floor: float | None = None
    of: Of = "whip"
    bodies: list[_Body] = field(init=False)

    def __post_init__(self) -> None:
        self._capsules = self._capsules_of_arm()
        self.bodies = [_Body(name, link, c.radius, c.length) for name, link, c in self._capsules]
        if self.of == "whip":
            lengths = self.model.whip.per_node("l")
            self.bodies += [_Body(f"the whip's node {i + 1}", _WHIP, 0.0, float(l), i) for i, l in enumerate(lengths)]
        self._flyers, self._geometry = pin.Model(), pin.GeometryModel()  # every body flies freely, the floor rests
        for i, body in enumerate(self.bodies):
            joint = self._flyers.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), f"{i}")
            self._add(f"{i}", joint, coal.Capsule(body.radius, body.length))
        self._add("floor", 0, coal.Halfspace(np.array([0.0, 0.0, 1.0]), self.floor or 0.0))
        self.pairs = list(self._pairs())
        for i, j in self.pairs:
            self._geometry.addCollisionPair(pin.CollisionPair(i, j))
        self._flown, self._data = self._flyers.createData(), self._geometry.createData()

    def _add(self, name: str, joint: int, shape: coal.CollisionGeometry) -> None:
        self._geometry.addGeometryObject(pin.GeometryObject(name, joint, pin.SE3.Identity(), shape))

    def _capsules_of_arm(self) -> list[tuple[str, int, Capsule]]:
        """Name, link and capsule of all that the arm consists of."""
        arm = self.model.arm
        if not isinstance(arm, SpatialArm):
            points = [(0.0, 0.0, 0.0), *((0.0, 0.0, -float(l)) for l in arm.per_link("length"))]
            return [
                (f"the link of {joint}", i, Capsule(points[0], points[i + 1], 0.0))
                for i, joint in enumerate(arm.joints)
            ]
        found = [("the base", _BASE, capsule) for capsule in arm.base]
        for i, (joint, link) in enumerate(zip(arm.joints, arm.links, strict=True)):
            found += [(f"the link of {joint}", i, capsule) for capsule in link.capsules]
        return found

    def _pairs(self) -> Iterator[tuple[int, int]]:
        """Yield the numbers of bodies that are compared; the floor's is one more than the last."""
        n, over_floor = len(self.bodies), {"close": (), "apart": range(self.model.arm.n), "whip": (_WHIP,)}[self.of]
        for i in range(n):
            for j in range(i + 1, n):
                if self._may_touch(self.bodies[i], self.bodies[j]):
                    yield i, j
            if self.floor is not None and self.bodies[i].link in over_floor:
                yield i, n

    def _may_touch(self, one: _Body, other: _Body) -> bool:
        """Whether two bodies are compared; the whip's come last."""
        arm = self.model.arm
        if not isinstance(arm, SpatialArm) or one.link == _WHIP:
            return False
        if self.of == "whip":
            far = other.segment >= NEAR_HAND or one.link < arm.n - _HOLDING
            return other.link == _WHIP and far
        never = [tuple(sorted(arm.joints.index(joint) for joint in pair)) for pair in arm.never_touch]
        between = other.link - one.link - 1
        asked = between == 1 if self.of == "close" else between > 1
        return asked and (one.link, other.link) not in never

    def segments(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return both ends of every body [m], (T, bodies, 3) each, of states q (T, n), or of an arm alone (T, a)."""
        arm, a = self.model.arm, self.model.arm.n
        if not isinstance(arm, SpatialArm):
            points = joint_points(self.model, q)
            points = np.stack([points[..., 0], np.zeros(points.shape[:-1]), points[..., 1]], axis=-1)
            return points[:, : len(self.bodies)], points[:, 1 : len(self.bodies) + 1]
        frames = arm_frames(arm, q[:, :a])
        starts, ends = [], []
        for _, link, capsule in self._capsules:
            for found, end in ((starts, capsule.start), (ends, capsule.end)):
                fixed = np.broadcast_to(np.array(end), (len(q), 3))
                found.append(fixed if link == _BASE else frames[link].origin + frames[link].rotation @ np.array(end))
        if self.of == "whip":
            nodes = np.concatenate(
                [frames[-1].origin[:, None], whip_motion(self.model, frames[-1], q[:, a:])[0]], axis=1
            )
            starts += list(np.moveaxis(nodes[:, :-1], 1, 0))
            ends += list(np.moveaxis(nodes[:, 1:], 1, 0))
        none = np.empty((len(q), 0, 3))
        return (np.stack(starts, axis=1), np.stack(ends, axis=1)) if starts else (none, none)

    def nearest(self, q: np.ndarray, *, enough: float = np.inf) -> NearestPair | None:
        """Return where two bodies come nearest over successive states q, (T, n); None: nothing is compared.

        Args:
            q: Joint positions, (T, n), of an arm alone (T, a).
            enough: Clearance from which it does not matter how large it is [m]: then that of some state is returned.
        """
        return self.nearest_of(*self.segments(q), enough=enough)

    def nearest_of(self, starts: np.ndarray, ends: np.ndarray, *, enough: float = np.inf) -> NearestPair | None:
        """Return the same of bodies whose ends are known.

        States that no motion could bring nearer than the nearest so far are not looked at.

        Args:
            starts, ends: Of the bodies [m], (T, bodies, 3) each; others may follow, as a whip's do on an arm's.
            enough: See `nearest`.
        """
        if not self.pairs:
            return None
        starts, ends = starts[:, : len(self.bodies)], ends[:, : len(self.bodies)]
        placed = _placements(starts, ends)
        travel = self._travel(starts, ends)
        first = (self._at(k, placed) for k in np.linspace(0, len(placed) - 1, min(len(placed), 16)).astype(int))
        best, k = min(first, key=lambda x: x.clearance), 0
        while k < len(placed):
            here = self._at(k, placed)
            best = min(best, here, key=lambda x: x.clearance)
            spare = here.clearance - min(best.clearance, enough)
            k = max(k + 1, int(np.searchsorted(travel, travel[k] + spare)))
        return best

    def links_of(self, pair: tuple[int, int]) -> tuple[int, int]:
        """Return the numbers of the links of a pair of bodies; negative: the base, the floor or the whip."""
        i, j = pair
        return self.bodies[i].link, _FLOOR if j == len(self.bodies) else self.bodies[j].link

    def distances(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return how near all pairs come at states q, (T, n).

        Returns:
            Distances (T, pairs) [m], negative where they overlap; the nearest points of both (T, pairs, 2, 3) [m]; unit
            vectors from the first body to the second, (T, pairs, 3).
        """
        placed = _placements(*self.segments(q))
        distances, points = np.empty((len(q), len(self.pairs))), np.empty((len(q), len(self.pairs), 2, 3))
        normals = np.empty((len(q), len(self.pairs), 3))
        for k in range(len(q)):
            self._at(k, placed)
            for p, found in enumerate(self._data.distanceResults):
                distances[k, p], normals[k, p] = found.min_distance, found.normal
                points[k, p] = found.getNearestPoint1(), found.getNearestPoint2()
        return distances, points, normals

    def _travel(self, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
        """How much nearer to each other bodies can have come since the first state [m], (T,): a bound.

        A point of a segment moves no farther than the farther of its ends, the whip against the arm no farther than
        both together.
        """
        moved = np.maximum(*(np.linalg.norm(np.diff(x, axis=0), axis=-1) for x in (starts, ends)))  # (T - 1, bodies)
        of_arm = moved[:, : len(self._capsules)].max(axis=1, initial=0.0)
        return np.concatenate([[0.0], np.cumsum(of_arm + moved.max(axis=1))])

    def _at(self, k: int, placed: np.ndarray) -> NearestPair:
        pair = pin.computeDistances(self._flyers, self._flown, self._geometry, self._data, placed[k])
        i, j = self.pairs[pair]
        names = self.bodies[i].name, "the floor" if j == len(self.bodies) else self.bodies[j].name
        return NearestPair(float(self._data.distanceResults[pair].min_distance), int(k), names)


def _placements(starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Return where bodies are as Pinocchio's free flyers have it, (T, 7 bodies): each one's middle and quaternion.

    The quaternion (its real part last) takes the z axis along the segment, either way.
    """
    along = ends - starts
    length = np.linalg.norm(along, axis=-1, keepdims=True)
    d = np.where(length > 0, along / np.where(length > 0, length, 1.0), np.array([0.0, 0.0, 1.0]))
    x, y, z = np.moveaxis(np.where(d[..., 2:] < 0, -d, d), -1, 0)
    turn = np.stack([-y, x, np.zeros_like(z), 1 + z], axis=-1) / np.sqrt(2 * (1 + z))[..., None]
    return np.concatenate([(starts + ends) / 2, turn], axis=-1).reshape(len(starts), -1)
