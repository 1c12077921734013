"""Inverse dynamics of an arm and whip in space by recursive Newton-Euler, one link at a time, and its derivatives.

The derivatives of a chain of N links follow from those of one link, by the chain rule from link to link: no expression
is longer than a link.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from whiptool.dynamics.closed_loop import ClosedLoop
from whiptool.dynamics.records import Stored
from whiptool.dynamics.rods import torque_of


class Reached(NamedTuple):
    """Frame in which a link begins, and its accelerations, with gravity included as an acceleration of the base."""

    frame: Any
    angular: ca.SX  # angular acceleration of the frame [rad/s^2], (3, 1)
    linear: ca.SX  # linear acceleration of its origin [m/s^2], (3, 1)


class Pull(NamedTuple):
    """Contribution of a link to its joint."""

    r: ca.SX  # lever from the joint to the link's end [m], (3, 1)
    axes: ca.SX  # axes of the joint's hinges, (3, K)
    passive: ca.SX  # passive torques of the joint, as `System.move_link` returns them
    force: ca.SX  # force on the link's mass [N], (3, 1)
    moment: ca.SX  # moment on the link's inertia [N m], (3, 1)


class Felt(NamedTuple):
    """Load on the previous link: moment [N m] and force [N], (3, 1) each, and `twist` as from `System.twist`."""

    moment: ca.SX
    force: ca.SX
    twist: ca.SX


def at_hand(loop: ClosedLoop, q: ca.SX, v: ca.SX, qdd: ca.SX) -> Reached:
    """Return the frame in which the whip begins and its acceleration, for positions q [rad or m], speeds v [per s] and
    accelerations qdd [per s^2] of the arm's joints, (a, 1) each.
    """
    a = loop.n_drive
    motion = loop.arm.motion(q, v, loop.parameters["gravity"], [])
    moves = motion.drift + ca.mtimes(motion.jacobian, qdd)
    return Reached(loop.hand(q, v, ca.SX.zeros(loop.n_inputs), ca.SX.zeros(a)).frame, moves[:3], moves[3:])


def outward(loop: ClosedLoop, at: Reached, q: ca.SX, v: ca.SX, qdd: ca.SX, w: ca.SX) -> tuple[Reached, Pull]:
    """Return the frame at the far end of a link, with its accelerations, and what the link adds to its joint's load,
    for its coordinates q, their speeds v and accelerations qdd, (K, 1), and its parameters w, see `System.link`.
    """
    link = loop.link(w)[0]
    frame, moving, passive, _ = loop.move_link(at.frame, q, v, w, ca.SX(0), None)
    angular, linear = at.angular, at.linear
    if loop.hinges:
        angular = angular + moving.turning + ca.mtimes(moving.axes, qdd)
        linear = linear + ca.cross(angular, moving.r) + moving.centripetal
    else:
        linear = linear + link.length * qdd
    force = link.mass * linear - moving.drag
    axes = moving.axes if loop.hinges else ca.SX(3, 0)
    return Reached(frame, angular, linear), Pull(moving.r, axes, passive, force, link.inertia * angular)


def at_tip(loop: ClosedLoop, frame: Any) -> Felt:
    """Return the load on the last link at the tip: zero, except for the twist of rods."""
    return Felt(ca.SX.zeros(3), ca.SX.zeros(3), loop.twist(frame))


def inward(loop: ClosedLoop, felt: Felt, pull: Pull) -> tuple[Felt, ca.SX]:
    """Return the load on the previous link, and the torque that this joint needs in addition to its passive torques.

    The latter is a torque per hinge (K, 1) [N m], or for a rod the moment on it in the world's axes (3, 1) [N m].
    """
    force = felt.force + pull.force
    levered = pull.moment + ca.cross(pull.r, force)
    if loop.hinges:
        moment = felt.moment + levered
        return Felt(moment, force, felt.twist), ca.mtimes(pull.axes.T, moment) - pull.passive
    own, twist = torque_of(pull.passive, felt.twist)  # what is before a rod feels its joint's torque alone
    return Felt(own, force, twist), felt.moment + levered - own


def of_arm(loop: ClosedLoop, q: ca.SX, v: ca.SX, qdd: ca.SX, felt: Felt) -> ca.SX:
    """Return the torques (a, 1) [N m] of the arm's joints under the load `felt` at the hand, with viscous friction."""
    gravity = loop.parameters["gravity"]
    jacobian = loop.arm.motion(q, v, gravity, []).jacobian
    own = loop.arm.inverse(q, v, qdd, gravity) + loop.friction * v
    return own + ca.mtimes(jacobian.T, ca.vertcat(felt.moment, felt.force))


# ---------------------------------------------------------------------------------------------------------------------
# Derivatives

Near = Callable[[ca.SX, ca.SX, ca.SX, ca.SX], tuple[ca.SX, ca.SX, ca.SX, ca.SX]]


class _Step(NamedTuple):
    """A step along a chain: from a state (S, 1) and what comes to it (U, 1) to the next state and an output (Y, 1);
    and its derivatives, (S + Y, S + U)."""

    value: ca.Function
    slopes: ca.Function

    @classmethod
    def of(cls, state: ca.SX, come: ca.SX, fixed: ca.SX, following: ca.SX, output: ca.SX) -> _Step:
        """Of expressions; `fixed` are numbers that nothing is differentiated by."""
        inputs = [state, come, fixed]
        slopes = ca.jacobian(ca.vertcat(following, output), ca.vertcat(state, come))
        return cls(
            ca.Function("step", inputs, [ca.densify(following), ca.densify(output)], {"cse": True}),
            ca.Function("slopes", inputs, [ca.densify(slopes)], {"cse": True}),
        )

    def along(self, start: np.ndarray, come: np.ndarray, fixed: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return the state after N steps (S,), each one's output (N, Y) and its derivatives (N, S + Y, S + U)."""
        N = len(come)
        states, output = (x.full() for x in self.value.mapaccum(N)(start, come.T, fixed.T))
        before = np.column_stack([start, states[:, :-1]])
        slopes = self.slopes.map(N)(before, come.T, fixed.T).full()
        return states[:, -1], output.T, slopes.reshape(len(slopes), N, -1).transpose(1, 0, 2)


def slopes(
    loop: ClosedLoop, p: np.ndarray, start: np.ndarray, rate: np.ndarray, near: Near, fixed: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the derivatives of all torques by accelerations, speeds and positions, (n, n) each, for a model in space.

    Each of the N links has two coordinates, and two torques that do work on the rotations by these coordinates; the
    `start` and `rate` of these follow those of the arm's a joints, (a + 2 N,). Accelerations are zero. From a link's
    coordinates, their first and second derivatives (2, 1) and its constants, a row of `fixed` (N, F), `near` returns
    the link's joint coordinates and their derivatives (K, 1), and the Jacobian of its rotation (K, 2).
    """
    a, N = loop.n_drive, loop.n_links
    states = (start, rate, np.zeros_like(start))
    at_arm, at_links = np.hstack([x[:a] for x in states]), np.hstack([x[a:].reshape(N, 2) for x in states])
    numbers = np.array([[p[first + i * by] for first, by in loop.link_columns.values()] for i in range(N)])

    hand, out, tip, back, base = _functions(loop, near, fixed.shape[1])
    begins, by_arm = (x.full() for x in hand(at_arm, p))
    ends, pulls, outward_slopes = out.along(begins[:, 0], at_links, np.hstack([numbers, fixed]))
    felt, by_tip = (x.full() for x in tip(ends))
    felt, _, inward_slopes = back.along(felt[:, 0], pulls[::-1], np.zeros((N, 0)))
    by_base = base(at_arm, felt, p).full()

    moved = np.zeros((len(begins), 3 * a + 6 * N))  # by all of the arm's numbers, then by each link's
    moved[:, : 3 * a] = by_arm
    pulled = np.empty((N, pulls.shape[1], moved.shape[1]))
    for i, by in enumerate(outward_slopes):
        both = by[:, : len(moved)] @ moved
        both[:, 3 * a + 6 * i : 3 * a + 6 * (i + 1)] += by[:, len(moved) :]
        moved, pulled[i] = np.split(both, [len(moved)])
    torques, moved = np.empty((a + 2 * N, moved.shape[1])), by_tip @ moved
    for i, by in zip(reversed(range(N)), inward_slopes, strict=True):
        moved, torques[a + 2 * i : a + 2 * (i + 1)] = np.split(by @ np.vstack([moved, pulled[i]]), [len(moved)])
    torques[:a] = by_base[:, 3 * a :] @ moved
    torques[:a, : 3 * a] += by_base[:, : 3 * a]
    of_links = 3 * a + np.arange(6 * N).reshape(N, 3, 2)
    K, C, M = (torques[:, np.r_[k * a : (k + 1) * a, of_links[:, k].ravel()]] for k in range(3))
    return M, C, K


def _functions(
    loop: ClosedLoop, near: Near, n_fixed: int
) -> tuple[ca.Function, _Step, ca.Function, _Step, ca.Function]:
    """Return the hand's state and its derivatives, of the arm's numbers; the steps from link to link; what is felt at
    the tip and its derivatives, of the state there; the steps back; and the arm's torques' derivatives."""
    arm, accelerations = ca.SX.sym("arm", 3 * loop.n_drive), ca.SX.sym("accelerations", 6)
    u, w, f = ca.SX.sym("u", 6), ca.SX.sym("w", len(loop.link_columns)), ca.SX.sym("f", n_fixed)
    q, v, qdd, turns = near(*_thirds(u), f)
    hand = at_hand(loop, *_thirds(arm))

    def follow(frame: Any) -> tuple[Reached, Pull]:
        return outward(loop, Reached(frame, accelerations[:3], accelerations[3:]), q, v, qdd, w)

    frame = Stored.along(hand.frame, "frame", lambda record: follow(record)[0].frame)
    begin, (end, pull) = ca.vertcat(frame.symbols, accelerations), follow(frame.record)
    state, at_end = (ca.vertcat(frame.column(x.frame), x.angular, x.linear) for x in (hand, end))
    tip = at_tip(loop, frame.record)
    felt, pulled = (tuple(ca.SX.sym("x", *x.shape) for x in parts) for parts in (tip, (*pull, turns)))
    *of_link, turned = pulled
    before, torque = inward(loop, Felt(*felt), Pull(*of_link))
    out = _Step.of(begin, u, ca.vertcat(w, f), at_end, _flat(*pull, turns))
    back = _Step.of(_flat(*felt), _flat(*pulled), ca.SX(0, 1), _flat(*before), ca.mtimes(turned.T, torque))
    on_arm = of_arm(loop, *_thirds(arm), Felt(*felt))
    by_arm, by_tip = ca.jacobian(state, arm), ca.jacobian(_flat(*tip), begin)
    by_base = ca.jacobian(on_arm, ca.vertcat(arm, _flat(*felt)))
    return (
        ca.Function("hand", [arm, loop.p], [state, by_arm], {"cse": True}),
        out,
        ca.Function("tip", [begin], [_flat(*tip), by_tip]),
        back,
        ca.Function("base", [arm, _flat(*felt), loop.p], [by_base], {"cse": True}),
    )


def _thirds(x: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    n = x.numel() // 3
    return x[:n], x[n : 2 * n], x[2 * n :]


def _flat(*parts: ca.SX) -> ca.SX:
    """All numbers of matrices, one column after the other."""
    return ca.vertcat(*(ca.vec(ca.densify(ca.SX(x))) for x in parts))
