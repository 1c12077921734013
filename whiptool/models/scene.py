"""The bodies of an arm and a whip as capsules over a floor, and how near they come."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Literal, TypeAlias

import numpy as np

from whiptool.models.capsules import Capsule
from whiptool.models.kinematics import arm_frames, joint_points, whip_motion
from whiptool.models.parameters import Model
from whiptool.models.segment_distances import nearest_points
from whiptool.models.solids import Solids
from whiptool.models.spatial_arm import BASE, SpatialArm

NEAR_HAND = 3  # of the whip's segments next to the hand, which are not compared with the links that hold it
Of: TypeAlias = Literal["close", "apart", "whip"]
_HOLDING = 2  # last links of an arm, which hold the whip: a flange and what carries it
_BASE, _FLOOR, _WHIP = -1, -2, -3  # in place of a link's number
_AT_ONCE = 200_000  # pairs of bodies, counted in all states, that are compared together: some 50 MB
_DOWN = np.array([0.0, 0.0, -1.0])


@dataclass(frozen=True)
class _Body:
    """A capsule that moves: of a link, the base (`_BASE`) or the whip (`_WHIP`).

    Args:
        name: For people.
        link: Its number.
        capsule: In the link's frame; of the whip one of its length anywhere.
        segment: Of the whip, from the hand.
    """

    name: str
    link: int
    capsule: Capsule
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


@dataclass(frozen=True)
class Contact:
    """Where a group of pairs is nearest.

    Args:
        distance: [m], negative where they overlap.
        instant, pair: Numbers of the state and of the pair.
        points: Nearest points of both bodies [m], (2, 3).
        normal: Unit vector from the first body to the second, (3,).
    """

    distance: float
    instant: int
    pair: int
    points: np.ndarray
    normal: np.ndarray


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
        self.bodies = [_Body(name, link, capsule) for name, link, capsule in self._capsules_of_arm()]
        if self.of == "whip":
            lengths = self.model.whip.per_node("l")
            rods = [Capsule((0.0, 0.0, 0.0), (0.0, 0.0, -float(l)), 0.0) for l in lengths]
            self.bodies += [_Body(f"the whip's node {i + 1}", _WHIP, rod, i) for i, rod in enumerate(rods)]
        self.pairs = list(self._pairs())
        self._first, self._second = np.array(self.pairs, int).reshape(-1, 2).T
        self._floor, self._height = self._second == len(self.bodies), self.floor or 0.0
        self._radii = np.array([*(body.capsule.radius for body in self.bodies), 0.0])  # the last: of the floor
        self._inner = np.array([*(body.capsule.inner_radius for body in self.bodies), 0.0])
        self._outer = self._radii + np.array([*(body.capsule.length / 2 for body in self.bodies), 0.0])
        exact = np.array([*(body.capsule.exact for body in self.bodies), True])
        self._inexact = ~(exact[self._first] & exact[self._second])
        ends: dict[int, list] = {body.link: [] for body in self.bodies if body.link != _WHIP}
        for body in self.bodies:
            if body.link != _WHIP:
                start, end = body.capsule.start, body.capsule.end
                ends[body.link].append((start, end, start + body.capsule.rotation[:, 0]))
        self._local = {link: np.array(points) for link, points in ends.items()}  # in each link's frame, (bodies, 3, 3)

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
        numbers = {BASE: _BASE} | {joint: i for i, joint in enumerate(arm.joints)}
        never = [tuple(sorted(numbers[name] for name in pair)) for pair in arm.never_touch]
        between = other.link - one.link - 1
        asked = between == 1 if self.of == "close" else between > 1
        return asked and (one.link, other.link) not in never

    def segments(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return both ends of every body [m], (T, bodies, 3) each, of states q (T, n), or of an arm alone (T, a)."""
        places = self._places(q)
        return places[:, :, 0], places[:, :, 1]

    def _places(self, q: np.ndarray) -> np.ndarray:
        """Return both ends of every body and, of the arm's, a point beside the first one along `Capsule.rotation`'s x,
        (T, bodies, 3, 3) [m]."""
        arm, a = self.model.arm, self.model.arm.n
        if not isinstance(arm, SpatialArm):
            points = joint_points(self.model, q)
            points = np.stack([points[..., 0], np.zeros(points.shape[:-1]), points[..., 1]], axis=-1)
            ends = points[:, : len(self.bodies)], points[:, 1 : len(self.bodies) + 1]
            return np.stack([*ends, ends[0]], axis=2)
        frames = arm_frames(arm, q[:, :a])
        ends = [np.empty((len(q), 0, 3, 3))]
        for link, local in self._local.items():
            if link == _BASE:
                ends.append(np.broadcast_to(local, (len(q), *local.shape)))
            else:
                moved = np.einsum("tij,bej->tbei", frames[link].rotation, local)
                ends.append(moved + frames[link].origin[:, None, None])
        if self.of == "whip":
            nodes = np.concatenate(
                [frames[-1].origin[:, None], whip_motion(self.model, frames[-1], q[:, a:])[0]], axis=1
            )
            ends.append(np.stack([nodes[:, :-1], nodes[:, 1:], nodes[:, :-1]], axis=2))
        return np.concatenate(ends, axis=1)

    def links_of(self, pair: tuple[int, int]) -> tuple[int, int]:
        """Return the numbers of the links of a pair of bodies; negative: the base, the floor or the whip."""
        i, j = pair
        return self.bodies[i].link, _FLOOR if j == len(self.bodies) else self.bodies[j].link

    def names_of(self, pair: tuple[int, int]) -> tuple[str, str]:
        """Return the names of a pair of bodies, for people."""
        i, j = pair
        return self.bodies[i].name, "the floor" if j == len(self.bodies) else self.bodies[j].name

    def nearest(self, q: np.ndarray, *, enough: float = np.inf) -> NearestPair | None:
        """Return where two bodies come nearest over successive states q, (T, n); None: nothing is compared.

        States are looked at in parts, so that memory does not grow with their number.

        Args:
            q: Joint positions, (T, n), of an arm alone (T, a).
            enough: Clearance from which it does not matter how large it is [m]: then that of some state is returned.
        """
        if not self.pairs:
            return None
        together, at_once = np.zeros(len(self.pairs), int), max(1, _AT_ONCE // len(self.pairs))
        best: NearestPair | None = None
        for first in range(0, len(q), at_once):
            limit = enough if best is None else min(best.clearance, enough)
            (contact,) = self.contacts(q[first : first + at_once], together, enough=limit)
            if best is None or contact.distance < best.clearance:
                names = self.names_of(self.pairs[contact.pair])
                best = NearestPair(contact.distance, first + contact.instant, names)
        return best

    def contacts(self, q: np.ndarray, groups: np.ndarray, *, enough: float = np.inf) -> list[Contact]:
        """Return where the pairs of each group come nearest; distances are computed where balls around bodies are near.

        Args:
            q: States, (T, n).
            groups: Of each pair the number of its group, all numbers from 0 to the largest, (pairs,).
            enough: Distance from which it does not matter how large it is [m].
        """
        places = self._places(q)
        ends = places[:, :, 0], places[:, :, 1]
        lower, upper = self._bounds(*ends)
        least, limit = (np.full(groups.max() + 1, np.inf) for _ in range(2))
        np.minimum.at(least, groups, lower.min(axis=1))
        np.minimum.at(limit, groups, upper.min(axis=1))
        limit = np.maximum(np.minimum(limit, enough), least)
        pairs, instants = np.nonzero(lower <= limit[groups, None])
        distances, points, normals = self._distances(*ends, instants, pairs)
        order = np.lexsort((distances, groups[pairs]))
        begins = np.searchsorted(groups[pairs[order]], np.arange(len(least) + 1))
        found = []
        for first, last in pairwise(begins):
            best: Contact | None = None
            for i in order[first:last]:  # what holds the bodies comes no nearer than these
                if best is not None and distances[i] >= min(best.distance, enough):
                    break
                k, p = int(instants[i]), int(pairs[i])
                contact = Contact(float(distances[i]), k, p, points[i], normals[i])
                if self._inexact[p]:
                    distance, *where = self._of_solids(places[k], p)
                    contact = Contact(distance, k, p, *where)
                if best is None or contact.distance < best.distance:
                    best = contact
            assert best is not None
            found.append(best)
        return found

    def distances(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return how near all pairs come at states q, (T, n).

        Returns:
            Distances (T, pairs) [m], negative where they overlap; the nearest points of both (T, pairs, 2, 3) [m]; unit
            vectors from the first body to the second, (T, pairs, 3).
        """
        places, shape = self._places(q), (len(q), len(self.pairs))
        instants, pairs = (x.ravel() for x in np.indices(shape))
        distances, points, normals = self._distances(places[:, :, 0], places[:, :, 1], instants, pairs)
        for i in np.flatnonzero(self._inexact[pairs]):
            distances[i], points[i], normals[i] = self._of_solids(places[instants[i]], int(pairs[i]))
        return distances.reshape(shape), points.reshape(*shape, 2, 3), normals.reshape(*shape, 3)

    @cached_property
    def _solids(self) -> Solids:
        return Solids([body.capsule for body in self.bodies], self._height)

    def _of_solids(self, places: np.ndarray, pair: int) -> tuple[float, np.ndarray, np.ndarray]:
        """Return how near a pair of which one is a cylinder or a box comes, as `_distances` does.

        Args:
            places: Of the bodies at one state, see `_places`, (bodies, 3, 3).
            pair: Its number.
        """
        bodies = int(self._first[pair]), int(self._second[pair])
        poses = [_pose(*places[i]) if i < len(places) else (np.eye(3), np.zeros(3)) for i in bodies]
        return self._solids.distance(bodies, poses)

    def _bounds(self, starts: np.ndarray, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return what distances are at least and at most [m], (pairs, T) each, by balls around bodies and in them.

        Args:
            starts, ends: Of the bodies [m], (T, bodies, 3) each.
        """
        first, second, floor = self._first, self._second, self._floor
        middles = np.ascontiguousarray((starts + ends).T) / 2  # (3, bodies, T)
        between = middles[:, first] - middles[:, np.where(floor, first, second)]
        apart = np.sqrt(np.einsum("xpt,xpt->pt", between, between))
        apart[floor] = middles[2, first[floor]] - self._height
        upper, lower = (apart - (size[first] + size[second])[:, None] for size in (self._inner, self._outer))
        return lower, upper

    def _distances(
        self, starts: np.ndarray, ends: np.ndarray, instants: np.ndarray, pairs: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return how near pairs come at instants, as `distances` does, (C, ...) each.

        Args:
            starts, ends: Of the bodies [m], (T, bodies, 3) each.
            instants, pairs: Numbers of the states and of the pairs, (C,) each.
        """
        first, second, floor = self._first[pairs], self._second[pairs], self._floor[pairs]
        start, end = starts[instants, first], ends[instants, first]
        lowest = np.where(start[:, 2:] < end[:, 2:], start, end)
        below = lowest * (1.0, 1.0, 0.0) + (0.0, 0.0, self._height)
        other = np.where(floor, first, second)  # of the floor any: it is replaced
        one, two = nearest_points(start, end, starts[instants, other], ends[instants, other])
        one, two = np.where(floor[:, None], lowest, one), np.where(floor[:, None], below, two)
        apart = np.linalg.norm(two - one, axis=-1)
        normals = np.divide(two - one, apart[:, None], out=np.tile(_DOWN, (len(one), 1)), where=apart[:, None] > 0)
        apart = np.where(floor, lowest[:, 2] - self._height, apart)
        normals[floor] = _DOWN
        own, its = self._radii[first], self._radii[second]
        points = np.stack([one + own[:, None] * normals, two - its[:, None] * normals], axis=1)
        return apart - own - its, points, normals


def _pose(start: np.ndarray, end: np.ndarray, side: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the axes (3, 3) and the middle (3,) of a body between two ends, its x axis towards the side (3,)."""
    length = float(np.linalg.norm(end - start))
    z = (end - start) / length if length else np.array([0.0, 0.0, 1.0])
    for towards in (side - start, *np.eye(3)[:2]):  # of the whip any across it
        x = towards - (towards @ z) * z
        if np.linalg.norm(x) > 1e-6:
            break
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z]), (start + end) / 2
