"""Whips of rods: a node is a unit vector, with equal bending in all directions and without twist.

Rod i points along `d_i` from one node to the next and carries a point mass at its end. A joint's spring exerts the
torque

    -(k + 2 c w) w'(u) d_{i-1} x d_i,    u = 1 - d_{i-1} . d_i,    w(u) = u + u^2 / 6 + 2 u^3 / 45,

on it, and the opposite torque on rod i - 1. `w` is half the square of the bend's angle theta, expanded at the straight
whip to the third order in u: the energy k w + c w^2 is that of an angular spring, k theta^2 / 2 + c theta^4 / 4, to a
relative theta^6; the term in k is 0.7 % below at 75 degrees and 5 % at 110. There is neither sine nor cosine.

A damper acts on the rotation W_i - W_{i-1} of a rod relative to the previous rod. Rods do not twist against each other,
so that (W_i - W_{i-1}) . (d_i + d_{i-1}) = 0, and spin about their axes without inertia, all together: the spin sigma
of the whip minimises the power of the dampers. The joint before the first rod is a ball joint, and a joint that folds
lets twist slip. A joint's torque is linear in sigma, which is known at the tip, and in the torque that it gets along
its rod, where this has no inertia: docs/derivations.md, "Damping of rods".

A rod's joint has two free directions, so that the algorithm is that of `articulated`, and the load on the arm has the
same form as with hinges. The integrator's damping acts on the difference of the accelerations of neighbours.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from whiptool.dynamics.articulated import (
    Link,
    SpatialAcceleration,
    SpatialCarried,
    SpatialFrame,
    SpatialMoving,
    drag_force,
    scalars,
    symmetric,
    upper,
)
from whiptool.dynamics.chain import Chain
from whiptool.dynamics.integrator import GAMMA
from whiptool.models.whip import WhipParameters

SWIVEL = 1e-9  # [N m s/rad]: damping of the first rod's spin past the hand; without it a straight whip's is 0 / 0
FOLD = 0.2  # 1 + cosine of a bend near which a joint begins to let twist slip: 143 degrees


class RodFrame(NamedTuple):
    """Frame in which a rod begins, at the end of the previous rod or at the hand; vectors are (3, 1).

    `sums` (2, 1) are those of b d . e [N m] and b e . e [N m s] over the joints from the hand to here: b is the
    damping, d the rotation rate of a joint, and e the change of d per unit of the first rod's spin.
    """

    direction: ca.SX  # unit vector along the previous rod
    speed: ca.SX  # its angular velocity [rad/s] for a first rod that spins as the hand does
    before: ca.SX  # in a step's second stage, its angular acceleration in the first, without its spin [rad/s^2]
    sums: ca.SX
    spun: ca.SX  # spin of the previous rod per unit of the first rod's spin, (1, 1)
    twists: ca.SX  # 1 if the previous body transmits twist (a rod), 0 if not (the hand), (1, 1)
    velocity: ca.SX  # velocity of the previous rod's end [m/s]
    place: ca.SX  # position of the previous rod's end [m]

    VELOCITY = 13  # where it begins among the entries
    PLACE = 16

    def entries(self) -> list[ca.SX]:
        """All entries as scalars; velocity and position last."""
        return [x for part in self for x in scalars(part)]

    def with_entries(self, entries: Sequence[ca.SX]) -> RodFrame:
        """Return the frame with these entries."""
        at = (0, 3, 6, 9, 11, 12, 13, 16, 19)
        return RodFrame(*(ca.vertcat(*entries[i:j]) for i, j in pairwise(at)))

    @classmethod
    def at_hand(cls, hand: SpatialFrame, before: ca.SX) -> RodFrame:
        """Return the frame at the hand, whose -z is the whip's axis; `before` is the hand's angular acceleration in
        the first stage (3, 1).
        """
        direction, sums = -hand.turned.matrix[:, 2], ca.vertcat(ca.SX(0), SWIVEL)
        return cls(direction, hand.speed, before, sums, ca.SX(1), ca.SX(0), hand.velocity, hand.place)

    @property
    def twist(self) -> ca.SX:
        """Twist at the tip (2, 1): spin of the first rod relative to the hand [rad/s], and torque along the last rod,
        which is 0.
        """
        return ca.vertcat(-self.sums[0] / self.sums[1], 0)


class RodJoint(NamedTuple):
    """Coefficients of a rod for `accelerate`: its angular acceleration is `free - across a + with_last alpha`.

    a is the acceleration of its joint and alpha the angular acceleration of the previous rod, (3, 1) each; `free` is
    (3, 1), `across` (3, 3) and `with_last` symmetric (3, 3).
    """

    free: ca.SX
    across: ca.SX
    with_last: ca.SX

    def entries(self) -> list[ca.SX]:
        """Return 18 scalars: `free`, `across` column by column, and the upper triangle of `with_last`."""
        return [*scalars(self.free), *scalars(self.across), *upper(self.with_last)]

    def with_entries(self, entries: Sequence[ca.SX]) -> RodJoint:
        """Return the rod's coefficients with these entries."""
        across = ca.reshape(ca.vertcat(*entries[3:12]), 3, 3)
        return RodJoint(ca.vertcat(*entries[:3]), across, symmetric(entries[12:]))


def outward(frame: RodFrame, d: ca.SX, rate: ca.SX, link: Link, before: ca.SX | None) -> tuple[RodFrame, SpatialMoving]:
    """Return the frame at a rod's end and the rod's motion, for its direction d and the rate of d, (3, 1) each. `sums`
    and `spun` are still those of the previous rod.

    In the second stage of a step `before` is the acceleration of d in the first (3, 1), else None. The columns of the
    motion's `axes` are d and the part of its acceleration that keeps it a unit vector.
    """
    r, past = link.length * d, ca.cross(d, rate) - frame.speed
    past = past - ca.dot(past, d) * d  # the rod before, across d
    speed = frame.speed + past - (_hold(frame, d) * ca.dot(past, frame.direction)) * d
    bound = -ca.sumsqr(rate) * d
    velocity = frame.velocity + link.length * rate
    last = ca.SX.zeros(3) if before is None else ca.cross(d, before)
    end = RodFrame(d, speed, last, frame.sums, frame.spun, ca.SX(1), velocity, frame.place + r)
    centripetal = link.length * bound
    none = ca.SX.zeros(3)
    drag = drag_force(link, velocity, d)
    return end, SpatialMoving(r, centripetal, r, centripetal, none, none, drag, ca.horzcat(d, bound))


def half_square(u: Any) -> tuple[Any, Any]:
    """Return half the square of a bending angle, `w(u)` with `u = 1 - cos(angle)`, and dw/du."""
    return u * (1 + u * (1 / 6 + 2 / 45 * u)), 1 + u * (1 / 3 + 2 / 15 * u)


def bend(joint: Chain, before: ca.SX, d: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return the torque of a joint's spring on the rod after the joint (3, 1) [N m], and the spring's energy [J]; the
    rod before it gets the opposite torque. `before` and `d` are unit vectors along these two rods, (3, 1).
    """
    u = 1 - ca.dot(before, d)
    w, slope = half_square(u)
    k, cubic = ca.SX(joint.stiffness), ca.SX(joint.cubic_stiffness)
    return -((k + 2 * cubic * w) * slope) * ca.cross(before, d), (k + cubic * w) * w


def _hold(frame: RodFrame, d: ca.SX) -> ca.SX:
    """Return how a joint turns against its rod's direction per turn along that of the rod before, (1, 1): so that it
    does not twist, `1 / y`, y = 1 + the cosine of the bend; it lets go where it folds, and behind the hand."""
    y = 1 + ca.dot(frame.direction, d)
    return frame.twists * y**3 / (y**4 + FOLD**4)


def torques_and_gain(
    joint: Chain, frame: RodFrame, end: RodFrame, h: ca.SX, *, again: bool
) -> tuple[RodFrame, ca.SX, ca.SX]:
    """Return the frame at a rod's end with its joint included, the joint's torques, and the inertia that the integrator
    adds for the joint's damping [kg m^2], in this stage.

    `again` is true in the second stage of a step. The torques are (4, 3): rows are the torque on the rod and its
    component along the previous rod; columns are the constant part, the part per spin of the first rod, and the part
    per torque along this rod.
    """
    last, d, spring = frame.direction, end.direction, bend(joint, frame.direction, end.direction)[0]
    hold, cosine = _hold(frame, d), ca.dot(frame.direction, d)
    along = d + hold * (last - cosine * d)  # how a torque along the rod reaches the one before
    spun = frame.spun * (1 - frame.twists + frame.twists * ca.dot(along, last))
    turning, per_spin = end.speed - frame.speed, frame.twists * (spun * d - frame.spun * last)
    viscous, dry, smooth = (ca.SX(x) for x in (joint.damping, joint.dry_friction, joint.friction_velocity))
    damping = viscous + dry / ca.sqrt(ca.sumsqr(turning) + smooth**2)
    gain = GAMMA * h * damping  # friction changes by this across the slip, and by less along it
    sums = frame.sums + damping * ca.vertcat(ca.dot(turning, per_spin), ca.sumsqr(per_spin))
    couples = [-damping * turning, -damping * per_spin]
    columns = [*(couple - ca.dot(d, couple) * along for couple in couples), along]
    torques = ca.horzcat(*(ca.vertcat(x, ca.dot(last, x)) for x in columns))
    torques[:3, 0] += spring
    if again:
        torques[:3, 0] += 2 * gain * (end.before - frame.before)
    return end._replace(sums=sums, spun=spun), torques, gain


def torque_of(torques: ca.SX, twist: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return a joint's torque on its rod (3, 1) [N m], and the twist for the previous joint, from the torques (4, 3) of
    `torques_and_gain` and the twist (2, 1): spin of the first rod [rad/s] and torque along this rod [N m].
    """
    found = ca.mtimes(torques, ca.vertcat(1, twist))
    return found[:3], ca.vertcat(twist[0], found[3])


def give_way(carried: SpatialCarried, d: ca.SX, torque: ca.SX, gain: ca.SX) -> tuple[SpatialCarried, RodJoint]:
    """Return the inertia and load on the previous rod through the free joint of a rod with direction d (3, 1) (one step
    of the articulated-body algorithm), and the joint's coefficients for `accelerate`; its torque is from `torque_of`,
    its gain from `torques_and_gain`.
    """
    inverse = _inverse_across(carried.J, gain, d)
    across = ca.mtimes(inverse, carried.H)
    free = ca.mtimes(inverse, torque - carried.moment)
    with_last = symmetric(upper(gain * inverse))
    one = ca.densify(ca.SX.eye(3))
    J = gain * (one - with_last)
    M = symmetric([x - y for x, y in zip(upper(carried.M), upper(ca.mtimes(carried.H.T, across)), strict=True)])
    force = carried.force + ca.mtimes(carried.H.T, free)
    return (
        SpatialCarried(J, gain * across, M, torque - gain * free, force),
        RodJoint(free, across, with_last),
    )


def _inverse_across(J: ca.SX, gain: ca.SX, d: ca.SX) -> ca.SX:
    """Return the inverse of `J + gain` in the plane across d, as a matrix (3, 3) that has no part along d.

    In a plane `K^-1 = (tr K - K) / det K`, by Cayley and Hamilton.
    """
    along = ca.mtimes(J, d)
    less = along - (ca.dot(d, along) / 2) * d
    one = ca.densify(ca.SX.eye(3))
    P = one - ca.mtimes(d, d.T)
    K = J - ca.mtimes(d, less.T) - ca.mtimes(less, d.T) + gain * P
    minors = [K[i, i] * K[j, j] - K[i, j] ** 2 for i, j in ((0, 1), (0, 2), (1, 2))]
    negative = ca.SX(-1) / (minors[0] + minors[1] + minors[2])  # one division: see `articulated.give_way`
    return symmetric([(k - ca.trace(K) * p) * negative for k, p in zip(upper(K), upper(P), strict=True)])


def accelerate(at: SpatialAcceleration, joint: RodJoint, moving: SpatialMoving) -> tuple[ca.SX, SpatialAcceleration]:
    """Return the second derivative of a rod's unit direction (3, 1) [1/s^2], and the acceleration at its far end."""
    angular = joint.free - ca.mtimes(joint.across, at.linear) + ca.mtimes(joint.with_last, at.angular)
    d, bound = moving.axes[:, 0], moving.axes[:, 1]
    linear = at.linear + ca.cross(angular, moving.r) + moving.centripetal
    return ca.cross(angular, d) + bound, SpatialAcceleration(angular, linear)


def unit(d: ca.SX, rate: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return a direction normalised to a unit vector, and its rate with the component along it removed, (3, 1) each."""
    d = -d * (ca.SX(-1) / ca.sqrt(ca.sumsqr(d)))
    return d, rate - ca.dot(d, rate) * d


class RodDamping(NamedTuple):
    """Damping and friction at the N joints of a whip of rods.

    The sum of both joints' torques on a rod has no component along it.
    """

    torques: np.ndarray  # torque of each joint on its rod, the opposite acts on the previous rod [N m], (..., N, 3)
    power: np.ndarray  # power that each joint dissipates [W], (..., N)


def rod_damping(whip: WhipParameters, directions: np.ndarray, turns: np.ndarray) -> RodDamping:
    """Return damping and friction at the joints of N rotating rods, by unit vectors along the hand's -z and the rods
    and the angular velocities of hand and rods [rad/s], (..., N + 1, 3) each; the component along a rod is ignored.
    """
    before, d = directions[..., :-1, :], directions[..., 1:, :]
    hand, turned = turns[..., :1, :], turns[..., 1:, :]
    across = turned - _dot(turned, d)[..., None] * d
    cosine = _dot(before, d)
    once = 1 + cosine
    cube = once * once * once
    hold = cube / (cube * once + FOLD**4)
    hold[..., 0] = 0
    passed = cosine + hold * (1 - cosine * cosine)  # of a spin, or of a torque along the rod, from joint to joint
    passed[..., 0] = 1
    gained = (1 - hold * cosine) * _dot(np.concatenate([hand, across[..., :-1, :]], axis=-2), d)
    spins = _along(gained - hold * _dot(across, before), passed)
    moved = np.concatenate([hand, across + spins[..., None] * d], axis=-2)
    slip = moved[..., 1:, :] - moved[..., :-1, :]
    spun = np.cumprod(passed, axis=-1)
    per_spin = spun[..., None] * (d - before / passed[..., None])
    per_spin[..., 0, :] = 0
    root = np.sqrt(_dot(slip, slip) + whip.friction_velocity**2)
    damping = whip.per_node("b") + whip.per_node("dry_friction") / root
    resistance = SWIVEL + (damping * _dot(per_spin, per_spin)).sum(axis=-1, keepdims=True)
    spin = -(damping * _dot(slip, per_spin)).sum(axis=-1, keepdims=True) / resistance  # of the first rod, (..., 1)
    slip += spin[..., None] * per_spin
    power = damping * _dot(slip, slip)
    power[..., :1] += SWIVEL * spin**2

    couples = -damping[..., None] * slip
    along = _dot(couples, d)
    own = _dot(couples, before) - passed * along
    beyond = np.zeros_like(own)  # what the next joint does, along each rod
    beyond[..., :-1] = _along(own[..., :0:-1], passed[..., :0:-1])[..., ::-1]
    twisted = d + hold[..., None] * (before - cosine[..., None] * d)
    return RodDamping(couples + (beyond - along)[..., None] * twisted, power)


def _along(gained: np.ndarray, passed: np.ndarray) -> np.ndarray:
    """Return what there is after each of N joints (..., N): what it passes on of what was there, and gains."""
    if gained.ndim == 1:  # of one instant, as at each step in MuJoCo: numbers are ten times faster than arrays of one
        there = 0.0
        return np.array(
            [there := share * there + gain for gain, share in zip(gained.tolist(), passed.tolist(), strict=True)]
        )
    found = np.empty_like(gained)
    one = np.zeros_like(gained[..., 0])
    for i in range(gained.shape[-1]):
        one = passed[..., i] * one + gained[..., i]
        found[..., i] = one
    return found


_dot = np.vecdot  # inner products (...) of vectors (..., 3)
