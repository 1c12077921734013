"""Hand space (Sect. 4.2): strikes in coordinates of the hand, and the path of the joints for them."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from functools import cached_property, lru_cache
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.polynomial import chebyshev

from whiptool.errors import InputError
from whiptool.models.kinematics import (
    HandKinematics,
    HandMotion,
    HandPose,
    quaternion_of,
    rotation_left,
    rotation_of,
    rotation_vector,
    skew,
    turning,
)
from whiptool.models.numbers import numbers
from whiptool.models.parameters import AnyArm
from whiptool.models.strike import HandStrike, JointSpace, StrikeBounds, check_turns, default_bounds, eased, refuse_far


class HandWay:
    """Straight paths of the hand between two poses, with the shortest rotation in space; all in the base's frame.

    `ends` (..., 2, m) are the coordinates of the hand at the start and at the end, see `HandKinematics`. `start` is the
    pose at the start; `moves` [m] and `turns` [rad], (..., 3) each, are the displacement and the rotation vector from
    there to the end, `turns` zero without orientation.
    """

    def __init__(self, kinematics: HandKinematics, ends: np.ndarray) -> None:
        self.kinematics, self._ends = kinematics, np.asarray(ends, float)
        place, rotation = kinematics.poses(self._ends)
        self.start = HandPose(place[..., 0, :], None if rotation is None else rotation[..., 0, :, :])
        self.moves = place[..., 1, :] - place[..., 0, :]
        self.turns = np.zeros_like(self.moves)
        if rotation is not None and kinematics.dimension == 2:  # angles may differ by more than half a turn
            self.turns = (self._ends[..., 1, 2:] - self._ends[..., 0, 2:]) * kinematics.rows[2, 3:]
        elif rotation is not None:
            self.turns = rotation_vector(rotation[..., 1, :, :] @ np.swapaxes(rotation[..., 0, :, :], -1, -2))

    @property
    def motion(self) -> np.ndarray:
        """Displacement and rotation from start to end in the m coordinates, (..., m); divided by the duration they are
        the hand's mean velocity and angular velocity.
        """
        return np.concatenate([self.moves, self.turns], axis=-1) @ self.kinematics.rows.T

    def at(self, share: np.ndarray) -> HandPose:
        """Return the poses at fractions (K,) of the path: position (..., K, 3) [m] and rotation (..., K, 3, 3)."""
        place = self.start.place[..., None, :] + share[:, None] * self.moves[..., None, :]
        if self.start.rotation is None:
            return HandPose(place, None)
        turned = rotation_of(share[:, None] * self.turns[..., None, :])
        return HandPose(place, turned @ self.start.rotation[..., None, :, :])

    def slopes(self, share: np.ndarray) -> np.ndarray:
        """Return the derivatives (..., K, m, 2 m) of the hand's pose at fractions (K,) of the path by the coordinates
        in `ends`, the start's first; rows of the orientation are rotations in the base's axes [rad].
        """
        d, m = self.kinematics.dimension, self.kinematics.size
        slopes = np.zeros((*self._ends.shape[:-2], len(share), m, 2 * m))
        slopes[..., :d, :d], slopes[..., :d, m : m + d] = (s[:, None, None] * np.eye(d) for s in (1 - share, share))
        if m > d:
            of_start, of_turns = self.turn_slopes()
            start = rotation_of(share[:, None] * self.turns[..., None, :]) @ of_start[..., None, :, :]
            along = turning(share[:, None] * self.turns[..., None, :]) @ of_turns[..., None, :, :]
            turned = self.kinematics.rows[d:, 3:] @ (start + share[:, None, None] * along)
            slopes[..., d:, d:m], slopes[..., d:, m + d :] = np.split(turned, 2, axis=-1)
        return slopes

    def turn_slopes(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the derivatives of the start's rotation and of `turns` by the r orientation coordinates of the start,
        then of the end, (..., 3, 2 r) each.
        """
        d, r = self.kinematics.dimension, self.kinematics.size - self.kinematics.dimension
        spins = self.kinematics.rows[d:, 3:].T @ self.kinematics.spins(self._ends)[..., d:, d:]  # (..., 2, 3, r)
        at_start, at_end = spins[..., 0, :, :], spins[..., 1, :, :]
        of_start = np.concatenate([at_start, np.zeros_like(at_end)], axis=-1)
        left = np.concatenate([-rotation_of(self.turns) @ at_start, at_end], axis=-1)
        assert of_start.shape[-1] == 2 * r
        return of_start, np.linalg.solve(turning(self.turns), left)

    def start_slopes(self) -> np.ndarray:
        """Return the derivatives (..., 3, 3, 2 r) of the start's rotation matrix by the r orientation coordinates of
        the start, then of the end.
        """
        assert self.start.rotation is not None
        of_start, _ = self.turn_slopes()
        return np.moveaxis(skew(np.swapaxes(of_start, -1, -2)) @ self.start.rotation[..., None, :, :], -3, -1)


DEGREE = 12  # of the polynomials
NODES = (1 - np.cos(np.pi * np.arange(DEGREE + 1) / DEGREE)) / 2  # of Chebyshev and Lobatto, shares of the path
TO_SERIES = np.linalg.inv(chebyshev.chebvander(2 * NODES - 1, DEGREE))  # of values at the nodes
_EACH = np.eye(DEGREE + 1)
TO_POWERS = np.array([np.pad(chebyshev.cheb2poly(row), (0, DEGREE - i)) for i, row in enumerate(_EACH)]).T


class HandPath:
    """Path of an arm's a joints for a strike in hand space: the hand follows its straight path `way`, at whose
    interpolation nodes the joint positions are `nodes`, (DEGREE + 1, a).
    """

    def __init__(self, strike: HandStrike, nodes: np.ndarray, way: HandWay) -> None:
        self.strike, self.D, self.q_i, self.way = strike, strike.D, tuple(map(float, nodes[0])), way
        self._series = [TO_SERIES @ nodes]
        for _ in range(2):
            self._series.append(2 * chebyshev.chebder(self._series[-1], axis=0))  # by the share of the path

    def reference(self, t: float | np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the desired positions [rad or m], velocities [per s] and accelerations [per s^2] of the joints at
        times t [s] after the start of the strike, each (*t.shape, a)."""
        s, ds, dds = (np.asarray(x, float)[..., None] for x in eased(np.asarray(t, float), self.D))
        q, by_s, twice = (np.moveaxis(chebyshev.chebval(2 * s[..., 0] - 1, c), 0, -1) for c in self._series)
        return q, by_s * ds, twice * ds**2 + by_s * dds

    def hand(self, t: float | np.ndarray) -> tuple[HandPose, np.ndarray]:
        """Return the desired pose of the hand at times t [s], position (*t.shape, 3) [m] and rotation (*t.shape, 3, 3)
        in the base's frame, and its velocity [m/s] and angular velocity [rad/s], (*t.shape, m); Eq. 1.
        """
        s, ds, _ = eased(np.asarray(t, float), self.D)
        place, rotation = self.way.at(np.ravel(s))
        rotation = None if rotation is None else rotation.reshape(*s.shape, 3, 3)
        return HandPose(place.reshape(*s.shape, 3), rotation), ds[..., None] * self.way.motion

    def errors(self, t: float | np.ndarray, hand: HandMotion, speed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the errors of the hand's pose and of its velocity at times t [s], desired minus present, from which a
        control law computes forces.

        Both are (*t.shape, m), as is the present `speed` of the hand: position [m], and with orientation
        `rotation_left` [rad]; velocity [m/s] and angular velocity [rad/s] along the base's axes.
        """
        wanted, motion = self.hand(t)
        left = wanted.place - hand.position
        turn = np.zeros_like(left) if wanted.rotation is None else rotation_left(wanted.rotation, hand.rotation)
        return np.concatenate([left, turn], axis=-1) @ self.way.kinematics.rows.T, motion - speed


def hand_poses(kinematics: HandKinematics, q: np.ndarray) -> np.ndarray:
    """Return the poses of the hand for joint positions (T, a), (T, 7): position x, y, z [m] in the base's frame and
    unit quaternion x, y, z, w with a continuous sign. A planar arm moves in the vertical plane y = 0.
    """
    at = kinematics.motion(q)
    quaternions = quaternion_of(at.rotation)
    flips = np.vecdot(quaternions[1:], quaternions[:-1]) < 0
    signs = np.where(np.r_[False, np.cumsum(flips) % 2 == 1], -1.0, 1.0)
    return np.hstack([at.position, signs[:, None] * quaternions])


EXACT = 1e-4  # [m or rad] by which the hand may leave its path between the nodes of these polynomials
TURNED = 0.25  # [rad] by which searches turn the hand from the home posture's orientation about any axis
_D, _FAST = (0.4, 1.5), 0.2  # [s], of searches; their shortest where no joint has a limit of speed
_QUARTER = np.pi / 4
_SAMPLES = 100  # along each axis, for the bounds
_EASY = 0.2  # the hand's least speed per unit of the joints' there, in that at home, at least

_BETWEEN = (NODES[1:] + NODES[:-1]) / 2
_AT_BETWEEN = chebyshev.chebvander(2 * _BETWEEN - 1, DEGREE) @ TO_SERIES


def hand_layout(a: int, dimension: int, *, orientation: bool, led: bool) -> dict[str, int]:
    """Return name and size of every block of a hand strike's parameters for simulators, in order.

    `x_i` and `x_f` are the hand's positions at the start and the end; in space `R_i` is its rotation matrix at the
    start, row by row, and `turns` the rotation vector from there to the end. With `led` the arm's a joints follow the
    hand's path exactly (position control).
    """
    if led:
        return {"q_i": a, "path": a * (DEGREE + 1), "D": 1}
    turned = {"R_i": 9, "turns": 3} if orientation else {}
    return {"q_i": a, "x_i": dimension, "x_f": dimension, **turned, "D": 1}


class _Found(NamedTuple):
    """Of B strikes: the hand's ways, joint positions at the nodes (B, K, a), their derivatives by the hand's motion
    there (B, K, a, m), and how far each is from what the arm can do, by reach, by its way, by its joints (B,); 0: not
    at all."""

    way: HandWay
    nodes: np.ndarray
    slopes: np.ndarray
    reach: np.ndarray
    on_way: np.ndarray
    limits: np.ndarray


class HandSpace:
    """Strikes in m coordinates of the hand: its position and, if strikes prescribe it, its orientation.

    A strike is a vector `[x_i, x_f, D]`, (2 m + 1,): coordinates at the start and at the end, and the duration. The arm
    takes the posture with the given hand pose that is nearest to the home posture, `posture` (a,) [rad or m] or by
    default `home_posture`, to which the orientation is relative. With `led` the joints follow the hand's path exactly
    (position control).
    """

    def __init__(
        self,
        arm: AnyArm,
        *,
        posture: Sequence[float] | None = None,
        orientation: bool = False,
        led: bool = False,
    ) -> None:
        self.arm, self.led = arm, led
        self._last: tuple[bytes, _Found] | None = None
        home = np.zeros(arm.n) if posture is None else np.array(numbers("posture", tuple(posture), arm.n))
        check_turns("posture", home, arm)
        m = HandKinematics(arm, home, orientation=orientation).size
        if m > arm.n:
            what = "position and orientation" if orientation else "position"
            raise InputError("hand space", f"an arm of {arm.n} joints", f"{m} joints or more, for the hand's {what}")
        home = home_posture(arm, orientation=orientation) if posture is None else home
        self.kinematics = HandKinematics(arm, home, orientation=orientation)
        if np.linalg.svd(self.kinematics.jacobian(home), compute_uv=False)[-1] < 1e-3:
            given = tuple(np.round(home, 4).tolist())
            raise InputError(
                "posture", given, "a posture in which the hand can move in all directions, not a singular one"
            )

    @property
    def kind(self) -> str:
        """`hand` for positions only, or `pose` with orientation."""
        return "pose" if self.kinematics.orientation else "hand"

    @property
    def size(self) -> int:
        """Number of the hand's coordinates."""
        return self.kinematics.size

    @property
    def names(self) -> tuple[str, ...]:
        """Names of a strike's coordinates: `x_i`, `y_i`, ..., `D`; for rotations `turn_x_i`, ..., in the plane
        `turn_i`.
        """
        d = self.arm.dimension
        turns = ["turn"] if d == 2 else [f"turn_{axis}" for axis in "xyz"]
        coordinates = ["x", "y", "z"][:d] + (turns if self.kinematics.orientation else [])
        return (*(f"{c}_i" for c in coordinates), *(f"{c}_f" for c in coordinates), "D")

    @property
    def width(self) -> int:
        """Length of a strike vector, 2 m + 1."""
        return 2 * self.size + 1

    @property
    def layout(self) -> dict[str, int]:
        """Name and size of every block of the result of `numbers`."""
        orientation = self.kinematics.orientation
        return hand_layout(self.arm.n, self.arm.dimension, orientation=orientation, led=self.led)

    @property
    def bounds(self) -> StrikeBounds:
        """Bounds in which strikes are searched: around the hand's pose in the home posture, as far as the arm takes the
        hand with ease."""
        return self._bounds

    @cached_property
    def _bounds(self) -> StrikeBounds:
        """Bounds in which strikes are searched: from the hand of the home posture as far along each axis as the arm
        takes it with ease, either way; turns of `TURNED`; D as in joint space, from 0.2 s where no joint has a limit of
        speed."""
        d, home = self.arm.dimension, self.kinematics.coordinates(self.kinematics.posture)
        ways = np.vstack([-np.eye(self.size)[:d], np.eye(self.size)[:d]])
        distances = np.arange(1, _SAMPLES + 1) / _SAMPLES * 2 * self.arm.length
        found = self.kinematics.solve(home + distances[:, None, None] * ways)
        ease, at_home = (np.linalg.svd(self.kinematics.jacobian(q), compute_uv=False)[..., -1]
                         for q in (found.q, self.kinematics.posture))  # fmt: skip
        reached = np.isfinite(found.missed) & (self._beyond_limits(found.q) <= 0) & (ease > _EASY * at_home)
        steps = np.where(reached.all(axis=0), _SAMPLES, reached.argmin(axis=0))  # the last that is reached
        before, ahead = np.split(steps / _SAMPLES * 2 * self.arm.length, 2)
        turns = np.full(self.size - d, TURNED)
        low, high = home - np.r_[before, turns], home + np.r_[ahead, turns]
        limited = any(np.isfinite(limits.velocity) for limits in self.arm.joint_limits)
        return StrikeBounds((*low, *low, _D[0] if limited else _FAST), (*high, *high, _D[1]))

    def strike(self, vector: Sequence[float] | np.ndarray) -> HandStrike:
        """Return the strike of a vector `[x_i, x_f, D]`, (2 m + 1,)."""
        return HandStrike.from_vector(vector)

    def path(self, vector: np.ndarray) -> HandPath:
        """Return the path of the arm's joints for a strike (2 m + 1,); one that the arm cannot do is refused."""
        found = self._solved(vector[None])
        self._refuse(found, vector[None])
        return HandPath(self.strike(vector), found.nodes[0], HandWay(self.kinematics, self._ends(vector)))

    def numbers(self, vectors: np.ndarray) -> np.ndarray:
        """Return the parameters of strikes (B, 2 m + 1) for simulators, (B, P), in the order of `layout`."""
        found, B, (m, d) = self._solved(vectors), len(vectors), (self.size, self.arm.dimension)
        self._refuse(found, vectors)
        if self.led:
            return np.hstack([found.nodes[:, 0], self._coefficients(found.nodes), vectors[:, -1:]])
        blocks = [found.nodes[:, 0], vectors[:, :d], vectors[:, m : m + d]]
        if found.way.start.rotation is not None:
            blocks += [found.way.start.rotation.reshape(B, 9), found.way.turns]
        return np.hstack([*blocks, vectors[:, -1:]])

    def slopes(self, vectors: np.ndarray) -> np.ndarray:
        """Return the derivatives of `numbers` by the coordinates of strikes (B, 2 m + 1), (B, P, 2 m + 1)."""
        found, (B, width), (m, d) = self._solved(vectors), vectors.shape, (self.size, self.arm.dimension)
        by_vector = np.zeros((B, DEGREE + 1, self.arm.n, width))
        by_vector[..., : 2 * m] = found.slopes @ found.way.slopes(NODES)
        blocks, identity = [by_vector[:, 0]], np.broadcast_to(np.eye(width), (B, width, width))
        if self.led:
            flat = by_vector.transpose(0, 3, 1, 2).reshape(B * width, DEGREE + 1, self.arm.n)
            blocks.append(self._coefficients(flat).reshape(B, width, -1).transpose(0, 2, 1))
        else:
            blocks += [identity[:, :d], identity[:, m : m + d]]
        if not self.led and m > d:
            turned = np.zeros((B, 12, width))
            of_orientation = np.r_[d:m, m + d : 2 * m]
            turned[:, :9, of_orientation] = found.way.start_slopes().reshape(B, 9, -1)
            turned[:, 9:, of_orientation] = found.way.turn_slopes()[1]
            blocks.append(turned)
        return np.concatenate([*blocks, identity[:, -1:]], axis=1)

    def beyond(self, vectors: np.ndarray) -> np.ndarray:
        """Return how far strikes (B, 2 m + 1) are from feasible, (B,), dimensionless; 0 for feasible strikes."""
        found = self._solved(vectors)
        return found.reach + found.on_way + found.limits

    def check_turns(self, name: str, vectors: Any) -> None:
        """Refuse strikes (2 m + 1,) or (B, 2 m + 1) that rotate the hand by more than two turns, as values in degrees
        would.
        """
        rows = np.reshape(vectors, (-1, self.width))[:, :-1]
        refuse_far(name, rows, [x.startswith("turn") for x in self.names[:-1]], self.names)

    def _coefficients(self, nodes: np.ndarray) -> np.ndarray:
        """Coefficients of powers of 2 s - 1, s the share of the path, of values at the nodes (B, K, a): (B, K a)."""
        return (TO_POWERS @ TO_SERIES @ nodes).reshape(len(nodes), -1)

    def _solved(self, vectors: np.ndarray) -> _Found:
        """Solve for the joints' paths; those of the vectors that were asked for last are kept."""
        key, last = vectors.tobytes(), self._last  # other threads may ask the same space for other vectors
        if last is None or last[0] != key:
            last = self._last = key, self._solve(vectors)
        return last[1]

    def _ends(self, vectors: np.ndarray) -> np.ndarray:
        """The hand's coordinates at the start and the end of strikes (..., 2 m + 1), (..., 2, m)."""
        return vectors[..., :-1].reshape(*vectors.shape[:-1], 2, self.size)

    def _solve(self, vectors: np.ndarray) -> _Found:
        ends = self._ends(vectors)
        found, way = self.kinematics.solve(ends), HandWay(self.kinematics, ends)
        q_i, q_f = found.q[:, :1], found.q[:, 1:]
        share = NODES[1:-1]
        inner = self.kinematics.settle(way.at(share), q_i + share[:, None] * (q_f - q_i))
        nodes = np.concatenate([q_i, inner.q, q_f], axis=1)
        slopes = np.concatenate([found.slopes[:, :1], inner.slopes, found.slopes[:, 1:]], axis=1)
        home = self.kinematics.coordinates(self.kinematics.posture)
        away = np.abs(ends - home).max(axis=2) / self.arm.length
        reach = np.where(np.isfinite(found.missed), 0.0, 1 + away).max(axis=1)
        between = self.kinematics.motion(_AT_BETWEEN @ nodes)
        off = np.abs(self.kinematics.left(between, way.at(_BETWEEN))).max(axis=(1, 2))
        lost = ~(np.isfinite(inner.missed).all(axis=1) & (off <= EXACT))
        on_way = np.where(lost & (reach == 0), 1 + np.minimum(off, 1.0), 0.0)
        limits = np.where(reach + on_way == 0, np.maximum(self._beyond_limits(nodes).max(axis=1), 0.0), 0.0)
        assert nodes.shape == (len(vectors), DEGREE + 1, self.arm.n)
        return _Found(way, nodes, slopes, reach, on_way, limits)

    def _beyond_limits(self, q: np.ndarray) -> np.ndarray:
        """How far postures (..., a) are beyond the joints' limits, in parts of half their ranges (...)."""
        return self._per_joint(q).max(axis=-1)

    def _refuse(self, found: _Found, vectors: np.ndarray) -> None:
        """Refuse the first strike that the arm cannot make."""
        refused = np.flatnonzero(found.reach + found.on_way + found.limits > 0)
        if not len(refused):
            return
        i = int(refused[0])
        given = ", ".join(f"{x:.4g}" for x in vectors[i])
        if found.reach[i] > 0:
            rule = "a start and an end that the hand reaches on straight lines from the home posture"
        elif found.on_way[i] > 0:
            rule = "a straight path of the hand within its reach, without singular postures"
        else:
            worst = np.unravel_index(self._per_joint(found.nodes[i]).argmax(), found.nodes[i].shape)
            joint, q = self.arm.joints[worst[1]], found.nodes[i][worst]
            rule = f"a path of the hand within the joints' limits; {joint} would be at {q:.2f}"
        raise InputError("strike of the hand", f"({given})", rule)

    def _per_joint(self, q: np.ndarray) -> np.ndarray:
        """The same of each joint, (..., a); -inf where it has no limits."""
        low, high = np.array([limits.position for limits in self.arm.joint_limits]).T
        half = np.where(np.isfinite(high - low), (high - low) / 2, 1.0)
        return np.maximum(low - q, q - high) / half


StrikeSpace: TypeAlias = JointSpace | HandSpace
"""What describes strikes: the joints, or the hand."""


def numbers_of(space: StrikeSpace) -> str:
    """Return a description of a strike's coordinates, such as `5 numbers, q_si q_ei q_sf q_ef D`."""
    return f"{space.width} numbers, {' '.join(space.names)}"


@lru_cache(maxsize=32)
def home_posture(arm: AnyArm, *, orientation: bool = False) -> np.ndarray:
    """Return the default home posture of an arm in hand space [rad or m], (a,).

    Candidates have joints at the middle of the arm's default bounds, or one or two steps to either side: 45 degrees
    each, or a fifth of the joint's range if that is less. The best has the largest product of the smallest singular
    value of the Jacobian (with the hand's rotation if `orientation`) and the hand's forward distance; of several, the
    one nearest to the middle is taken.
    """
    try:
        box = default_bounds(arm)
    except InputError:
        rule = f"{arm.n} joint angles, as this arm has no default bounds"
        raise InputError(
            "home posture", "none", rule, "give one: HandControl(posture) in Python, --home on the command line"
        ) from None
    low, high = (np.reshape(side[:-1], (2, arm.n)) for side in (box.lower, box.upper))  # of q_i and q_f
    low, high = low.min(axis=0), high.max(axis=0)
    middle, step = (low + high) / 2, np.minimum(_QUARTER, (high - low) / 5)
    kinematics, best, chosen = HandKinematics(arm, middle, orientation=orientation), (-1.0, 0.0), middle
    every = np.array(list(itertools.product((0, 1, -1, 2, -2), repeat=arm.n)))
    for steps in np.array_split(every, 1 + len(every) // 4096):
        at = middle + steps * step
        worst = np.linalg.svd(kinematics.jacobian(at), compute_uv=False)[:, -1]
        good = np.round(worst * kinematics.motion(at).position[:, 0], 9)
        near = -(steps**2).sum(axis=1)
        i = np.lexsort((near, good))[-1]
        if (found := (float(good[i]), float(near[i]))) > best:
            best, chosen = found, middle + steps[i] * step
    return chosen
