"""The bodies of arm, whip and floor as capsules, and the distances between them."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Any, Literal, TypeAlias

import numpy as np

from whiptool.models.capsules import Capsule, nearest_points
from whiptool.models.kinematics import arm_poses, whip_places
from whiptool.models.mount import level_links
from whiptool.models.parameters import Model
from whiptool.models.robot_files import ArmChoice
from whiptool.models.spatial_arm import BASE, SpatialArm
from whiptool.models.whip import WhipParameters

NEAR_HAND = 3  # of the whip's segments next to the hand, which are not compared with the links that hold it
Of: TypeAlias = Literal["close", "apart", "whip"]
_HOLDING = 2  # last links of an arm, which hold the whip: a flange and what carries it
_BASE, _FLOOR, _WHIP = -1, -2, -3  # in place of a link's number; smaller ones are of things next to the robot
_AT_ONCE = 4096  # states that are looked at together: bounds the memory
_BLOCK = 16  # successive states that are held in one ball around each body
_DOWN = np.array([0.0, 0.0, -1.0])


@dataclass(frozen=True)
class _Body:
    """A capsule that moves: of a link, the base (`_BASE`) or the whip (`_WHIP`)."""

    name: str  # for people
    link: int  # its number
    capsule: Capsule  # in the link's frame; for the whip one of its length anywhere
    segment: int = 0  # of the whip, from the hand


@dataclass(frozen=True)
class NearestPair:
    """The closest pair of bodies over several states."""

    clearance: float  # distance [m]; negative: penetration depth
    instant: int  # index of the state
    names: tuple[str, str]  # names of both bodies


@dataclass(frozen=True)
class Contact:
    """The closest pair of bodies of one group of pairs, over several states."""

    distance: float  # [m]; negative if they overlap
    instant: int  # index of the state
    pair: int  # index of the pair in `Scene.pairs`
    points: np.ndarray  # nearest points of both bodies [m], (2, 3)
    normal: np.ndarray  # unit vector from the first body to the second, (3,)


class Solids:
    """Shapes of bodies as objects of the library coal, followed by surfaces, each given by its unit normal (3,) and how
    far from the origin it is along it [m].
    """

    def __init__(self, shapes: Sequence[Capsule], surfaces: Sequence[tuple[np.ndarray, float]]) -> None:
        import coal

        self._shapes: list[Any] = [shape.solid() for shape in shapes]
        self._bodies = len(self._shapes)
        self._shapes += [coal.Halfspace(normal, offset) for normal, offset in surfaces]

    def distance(
        self, bodies: tuple[int, int], poses: Sequence[tuple[np.ndarray, np.ndarray]]
    ) -> tuple[float, np.ndarray, np.ndarray]:
        """Return the distance of two bodies [m], their nearest points (2, 3) [m], and the unit vector between them,
        (3,). Their poses are axes (3, 3) and centre (3,) [m]; for surfaces, which follow the last body, they are
        ignored.
        """
        import coal

        posed = [coal.Transform3s(np.asarray(R, float), np.asarray(p, float)) for R, p in poses]
        if bodies[1] >= self._bodies:
            posed[1] = coal.Transform3s.Identity()
        found = coal.DistanceResult()
        one, other = (self._shapes[i] for i in bodies)
        apart = coal.distance(one, posed[0], other, posed[1], coal.DistanceRequest(), found)
        return apart, np.stack([found.getNearestPoint1(), found.getNearestPoint2()]), np.array(found.normal)


@dataclass
class Scene:
    """The pairs of bodies of a model that are checked for contact.

    Kinds of pairs: `close` links, with exactly one link between them; `apart`, links with more between them, and arm
    and floor; `whip`, the whip with arm and floor. Not checked are neighbouring links, the arm's `never_touch`, the
    whip's first segments with the links that hold it, and the floor with links that never change their height. The
    surface of an arm, a wall or ceiling, is compared as the floor is, except with the first link. Planar arms have no
    thickness and can only touch a floor.

    `pairs` are the indices of the two bodies of each pair, floor and surface counted after the last body, and `kinds`
    the kinds of the pairs.
    """

    model: Model
    floor: float | None = None  # height of the floor [m]; None: no floor
    of: Of | tuple[Of, ...] = "whip"  # kind of pairs to check, or several
    bodies: list[_Body] = field(init=False)  # all bodies, those of the whip last

    def __post_init__(self) -> None:
        self._arm, self._flat = self.model.arm.in_space(), self.model.dimension == 2
        self._numbers = numbers_of(self._arm)
        self.bodies = [_Body(name, link, capsule) for name, link, capsule in self._capsules_of_arm()]
        asked = (self.of,) if isinstance(self.of, str) else self.of
        if "whip" in asked:
            lengths = self.model.whip.per_node("l")
            rods = [Capsule((0.0, 0.0, 0.0), (0.0, 0.0, -float(l)), 0.0) for l in lengths]
            self.bodies += [_Body(f"the whip's node {i + 1}", _WHIP, rod, i) for i, rod in enumerate(rods)]
        compared = [(pair, kind) for pair, kind in self._compared() if kind in asked]
        self.pairs, self.kinds = [pair for pair, _ in compared], [kind for _, kind in compared]
        self._first, self._second = np.array(self.pairs, int).reshape(-1, 2).T
        up, out = np.array([0.0, 0.0, 1.0]), np.array(self._arm.surface or (0.0, 0.0, 1.0))
        self._surfaces = [(up, self.floor or 0.0), (out, 0.0)]
        self._floor = self._second >= len(self.bodies)  # of pairs: whether the second is a surface
        of = np.maximum(self._second - len(self.bodies), 0)
        self._normal = np.array([normal for normal, _ in self._surfaces])[of]
        self._height = np.array([offset for _, offset in self._surfaces])[of]
        self._other = np.where(self._floor, self._first, self._second)  # of a surface any body: it is replaced
        self._radii = np.array([*(body.capsule.radius for body in self.bodies), 0.0, 0.0])  # the last: of surfaces
        inner = np.array([*(body.capsule.inner_radius for body in self.bodies), 0.0, 0.0])
        outer = self._radii + np.array([*(body.capsule.length / 2 for body in self.bodies), 0.0, 0.0])
        self._inner, self._outer = (size[self._first] + size[self._second] for size in (inner, outer))  # of pairs
        exact = np.array([*(body.capsule.exact for body in self.bodies), True, True])
        self._inexact = ~(exact[self._first] & exact[self._second])
        local: dict[int, list] = {body.link: [] for body in self.bodies if body.link != _WHIP}
        for body in self.bodies:
            if body.link != _WHIP:
                start, end = body.capsule.start, body.capsule.end
                local[body.link].append((start, end, start + body.capsule.rotation[:, 0]))
        self._local = {link: np.array(points) for link, points in local.items()}  # in each link's frame, (bodies, 3, 3)

    def _capsules_of_arm(self) -> list[tuple[str, int, Capsule]]:
        """Name, link and capsule of all that the arm consists of."""
        arm = self._arm
        shapes = [link.capsules for link in arm.links]
        if self._flat:
            shapes = [(Capsule((0.0, 0.0, 0.0), (0.0, 0.0, -float(l)), 0.0),) for l in self.model.arm.lengths]
        found = [(x.name or "the base", self._numbers[x.name or BASE], x) for x in arm.base]
        for i, (joint, of_link) in enumerate(zip(arm.joints, shapes, strict=True)):
            found += [(f"the link of {joint}", i, capsule) for capsule in of_link]
        if arm.stick[0] and shapes[-1]:  # the last capsule of the last link, see `with_stick`
            found[-1] = ("the stick", *found[-1][1:])
        return found

    def _compared(self) -> Iterator[tuple[tuple[int, int], Of]]:
        """Yield the numbers of bodies that may be compared, and of which kind that is."""
        n, level = len(self.bodies), level_links(self._arm)
        for i, body in enumerate(self.bodies):
            for j in range(i + 1, n):
                kind = self._kind(body, self.bodies[j])
                if kind is not None:
                    yield (i, j), kind
            if self.floor is not None and (body.link == _WHIP or body.link >= level):
                yield (i, n), "whip" if body.link == _WHIP else "apart"
            if self._arm.surface is not None and (body.link == _WHIP or body.link >= 1):
                yield (i, n + 1), "whip" if body.link == _WHIP else "apart"

    def _kind(self, one: _Body, other: _Body) -> Of | None:
        """Return of which kind two bodies are that are compared, the whip's being the second; None: they are not."""
        arm = self._arm
        if self._flat or one.link == _WHIP:
            return None
        if other.link == _WHIP:
            return "whip" if other.segment >= NEAR_HAND or one.link < arm.n - _HOLDING else None
        never = [{self._numbers[name] for name in pair} for pair in arm.never_touch]
        between = other.link - one.link - 1
        if other.link < 0 or between < 1 or {one.link, other.link} in never:
            return None
        return "close" if between == 1 else "apart"

    def segments(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return start and end of every body's segment [m], (T, bodies, 3) each, for states q (T, n), or (T, a) for an
        arm alone.
        """
        places = self._places(q, points=2)
        return places[:, :, 0], places[:, :, 1]

    def _places(self, q: np.ndarray, *, points: int = 3) -> np.ndarray:
        """Return points of every body [m], (T, bodies, points, 3).

        They are its ends and, of the arm's bodies, one at the side of the first end along `Capsule.rotation`'s x.
        """
        a, T = self._arm.n, len(q)
        origins, rotations = arm_poses(self._arm, q[:, :a])
        found = [np.empty((T, 0, points, 3))]
        for link, local in self._local.items():
            local = local[:, :points]
            if link < 0:
                found.append(np.broadcast_to(local, (T, *local.shape)))
            else:
                moved = (rotations[:, link].reshape(-1, 3) @ local.reshape(-1, 3).T).reshape(T, 3, -1)
                at = moved + origins[:, link, :, None]
                found.append(at.transpose(0, 2, 1).reshape(T, *local.shape))
        if any(body.link == _WHIP for body in self.bodies):
            hand = origins[:, -1], rotations[:, -1]
            found.append(
                _along(np.concatenate([hand[0][:, None], whip_places(self.model, *hand, q[:, a:])], 1), points)
            )
        return np.concatenate(found, axis=1)

    def links_of(self, pair: tuple[int, int]) -> tuple[int, int]:
        """Return the indices of the links of a pair of bodies; negative values mean the base, the floor or the whip."""
        i, j = pair
        return self.bodies[i].link, self.bodies[j].link if j < len(self.bodies) else _FLOOR

    def names_of(self, pair: tuple[int, int]) -> tuple[str, str]:
        """Return the names of a pair of bodies, for messages."""
        i, j = pair
        if j < len(self.bodies):
            names = self.bodies[i].name, self.bodies[j].name
            return names[::-1] if self.bodies[i].link < _WHIP else names  # the thing last, which stands still
        mount = "the ceiling" if self._surfaces[1][0][2] < 0 else "the wall"
        return self.bodies[i].name, "the floor" if j == len(self.bodies) else mount

    def nearest(self, q: np.ndarray, *, enough: float = np.inf) -> NearestPair | None:
        """Return the closest pair of bodies over successive states q (T, n), or (T, a) for an arm alone; None if no
        pairs are checked. If all are farther apart than `enough` [m], the distance in any state is returned.
        """
        return self.nearest_of_groups(q, np.zeros(len(self.pairs), int), [enough])[0]

    def nearest_of_groups(self, q: np.ndarray, groups: np.ndarray, enough: Sequence[float]) -> list[NearestPair | None]:
        """Return the closest pair of each group of pairs over states q (T, n), None for an empty group; arguments are
        those of `contacts`. States are processed in parts, so that memory does not grow with their number.
        """
        best: list[NearestPair | None] = [None] * len(enough)
        for first in range(0, len(q), _AT_ONCE):
            limits = [most if x is None else min(x.clearance, most) for x, most in zip(best, enough, strict=True)]
            for i, contact in enumerate(self.contacts(q[first : first + _AT_ONCE], groups, limits)):
                known = best[i]
                if contact is not None and (known is None or contact.distance < known.clearance):
                    names = self.names_of(self.pairs[contact.pair])
                    best[i] = NearestPair(contact.distance, first + contact.instant, names)
        return best

    def contacts(self, q: np.ndarray, groups: np.ndarray, enough: Sequence[float]) -> list[Contact | None]:
        """Return the closest contact of each group of pairs over successive states q (T, n); None for an empty group.

        `groups` (pairs,) is each pair's group; beyond the distance `enough` [m] of a group its exact value is not
        needed. Exact distances are only computed if bounding spheres are near, first those of bodies over several
        states, then those of single states.
        """
        starts, ends = self.segments(q)
        instants, pairs = self._candidates((starts + ends) / 2, groups, np.array(enough))
        distances, points, normals = self._distances(starts, ends, instants, pairs)
        order = np.lexsort((distances, groups[pairs]))
        begins = np.searchsorted(groups[pairs[order]], np.arange(len(enough) + 1))
        found: list[Contact | None] = []
        for limit, (first, last) in zip(enough, pairwise(begins), strict=True):
            best: Contact | None = None
            for i in order[first:last]:  # what holds the bodies comes no nearer than these
                if best is not None and distances[i] >= min(best.distance, limit):
                    break
                k, p = int(instants[i]), int(pairs[i])
                contact = Contact(float(distances[i]), k, p, points[i], normals[i])
                if self._inexact[p]:
                    distance, *where = self._of_solids(self._places(q[k : k + 1])[0], p)
                    contact = Contact(distance, k, p, *where)
                if best is None or contact.distance < best.distance:
                    best = contact
            found.append(best)
        return found

    def _candidates(self, middles: np.ndarray, groups: np.ndarray, enough: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return instants and pairs, (C,) each, among which the nearest of each group of `contacts` is, by the middles
        of the bodies [m], (T, bodies, 3).
        """
        T = len(middles)
        size = min(_BLOCK, max(1, T // _BLOCK))
        of_blocks = middles[np.minimum(np.arange(0, T, size)[:, None] + np.arange(size), T - 1)]
        centres = of_blocks[:, size // 2]
        spread = np.sqrt(((of_blocks - centres[:, None]) ** 2).sum(axis=-1).max(axis=1))
        blocks, pairs = (x.ravel() for x in np.indices((len(centres), len(self.pairs))))
        near = self._near(centres, spread, blocks, pairs, groups, enough)
        instants = blocks[near, None] * size + np.arange(size)
        pairs = np.broadcast_to(pairs[near, None], instants.shape)[instants < T]
        instants = instants[instants < T]
        near = self._near(middles, np.zeros(middles.shape[:2]), instants, pairs, groups, enough)
        return instants[near], pairs[near]

    def _near(
        self,
        middles: np.ndarray,
        spread: np.ndarray,
        rows: np.ndarray,
        pairs: np.ndarray,
        groups: np.ndarray,
        enough: np.ndarray,
    ) -> np.ndarray:
        """Return among which pairs (C,), in which rows (C,), the nearest of each group of `contacts` may be, by balls
        around bodies and in them, whose middles (R, bodies, 3) go so far, `spread` (R, bodies) [m].
        """
        first, other, floor = self._first[pairs], self._other[pairs], self._floor[pairs]
        one = middles[rows, first]
        between = one - middles[rows, other]
        above = np.einsum("ci,ci->c", one, self._normal[pairs]) - self._height[pairs]
        apart = np.where(floor, above, np.sqrt(np.einsum("ci,ci->c", between, between)))
        lower = apart - self._outer[pairs] - spread[rows, first] - np.where(floor, 0.0, spread[rows, other])
        least, limit = (np.full(len(enough), np.inf) for _ in range(2))
        np.minimum.at(least, groups[pairs], lower)
        np.minimum.at(limit, groups[pairs], apart - self._inner[pairs])
        limit = np.maximum(np.minimum(limit, enough), least)
        return lower <= limit[groups[pairs]]

    def distances(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the distances of all pairs in states q (T, n) [m], (T, pairs), negative for overlap; nearest points of
        both bodies [m], (T, pairs, 2, 3); unit vectors from the first body to the second, (T, pairs, 3).
        """
        places, shape = self._places(q), (len(q), len(self.pairs))
        instants, pairs = (x.ravel() for x in np.indices(shape))
        distances, points, normals = self._distances(places[:, :, 0], places[:, :, 1], instants, pairs)
        for i in np.flatnonzero(self._inexact[pairs]):
            distances[i], points[i], normals[i] = self._of_solids(places[instants[i]], int(pairs[i]))
        return distances.reshape(shape), points.reshape(*shape, 2, 3), normals.reshape(*shape, 3)

    @cached_property
    def _solids(self) -> Solids:
        return Solids([body.capsule for body in self.bodies], self._surfaces)

    def _of_solids(self, places: np.ndarray, pair: int) -> tuple[float, np.ndarray, np.ndarray]:
        """Return how near a pair of which one is a cylinder or a box comes at `_places` (bodies, 3, 3)."""
        bodies = int(self._first[pair]), int(self._second[pair])
        poses = [_pose(*places[i]) if i < len(places) else (np.eye(3), np.zeros(3)) for i in bodies]
        return self._solids.distance(bodies, poses)

    def _distances(
        self, starts: np.ndarray, ends: np.ndarray, instants: np.ndarray, pairs: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return how near pairs (C,) come at instants (C,), as `distances` does, by the bodies' starts and ends [m],
        (T, bodies, 3) each.
        """
        first, second, floor = self._first[pairs], self._second[pairs], self._floor[pairs]
        start, end = starts[instants, first], ends[instants, first]
        out = self._normal[pairs]
        first_high, last_high = (np.einsum("ci,ci->c", x, out) for x in (start, end))
        lowest = np.where((first_high < last_high)[:, None], start, end)
        above = np.minimum(first_high, last_high) - self._height[pairs]
        below = lowest - above[:, None] * out
        other = self._other[pairs]
        one, two = nearest_points(start, end, starts[instants, other], ends[instants, other])
        one, two = np.where(floor[:, None], lowest, one), np.where(floor[:, None], below, two)
        apart = np.linalg.norm(two - one, axis=-1)
        normals = np.divide(two - one, apart[:, None], out=np.tile(_DOWN, (len(one), 1)), where=apart[:, None] > 0)
        apart = np.where(floor, above, apart)
        normals[floor] = -out[floor]
        own, its = self._radii[first], self._radii[second]
        points = np.stack([one + own[:, None] * normals, two - its[:, None] * normals], axis=1)
        return apart - own - its, points, normals


def _along(nodes: np.ndarray, points: int) -> np.ndarray:
    """Return points of the rods between successive nodes (T, N + 1, 3), see `Scene._places`, (T, N, points, 3)."""
    return np.stack([nodes[:, :-1], nodes[:, 1:], nodes[:, :-1]][:points], axis=2)


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


def numbers_of(arm: SpatialArm) -> dict[str, int]:
    """Return the numbers of links by `SpatialArm.bodies`; those of things next to the robot are below `_WHIP`."""
    things = arm.bodies[arm.n + 1 :]
    return (
        {name: i for i, name in enumerate(arm.joints)}
        | {BASE: _BASE}
        | {x: _WHIP - 1 - i for i, x in enumerate(things)}
    )


_SMALL_WHIP = WhipParameters(N=1, l=0.1, m=0.01, k=0, b=0, joints="rod")  # any: it is not compared


def without_touching(arm: SpatialArm, choice: ArmChoice | None) -> SpatialArm:
    """Return an arm in which pairs of links that touch in the zero posture, or instead those of the `never_touch` of
    `choice`, are not checked for contact; `notes` lists them.

    In the zero posture all joints are at 0, or as near to it as their ranges allow. This finds links that touch in
    every posture.
    """
    if choice is not None and choice.never_touch is not None:
        return dataclasses.replace(arm, never_touch=tuple(choice.never_touch))
    if not any(link.capsules for link in arm.links):
        return arm

    rest = np.array([np.clip(0.0, *link.limits.position) for link in arm.links])
    names = {number: name for name, number in numbers_of(arm).items()}
    scene = Scene(Model(_SMALL_WHIP, arm), of=("close", "apart"))
    links = [scene.links_of(pair) for pair in scene.pairs]
    distances = scene.distances(rest[None])[0][0] if links else []
    pairs = sorted({both for both, distance in zip(links, distances, strict=True) if distance < 0})
    if not pairs:
        return arm
    touching = tuple((names[one], names[other]) for one, other in pairs)
    said = ", ".join(f"{one} and {other}" for one, other in touching)
    note = f"shapes that touch where all joints are at 0 are not compared, of the links of {said}; arm.never_touch in a"
    notes = (*arm.notes, f"{note} model file says otherwise")
    return dataclasses.replace(arm, never_touch=touching, notes=notes)
