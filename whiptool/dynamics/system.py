"""A whip on its drive (arm or moving base): functions of one link and of the drive, and the integrator's step.

A compiled engine loops over links with the functions of `System.functions`, so that the generated code does not grow
with the number of links. `System.step` composes the same expressions into one function, for the interpreter.

A planar system is the case of parallel axes; quantities that are zero or not used have no column in the compiled code.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import casadi as ca

from whiptool.dynamics import articulated, rods, taut_rods
from whiptool.dynamics.articulated import (
    Axis,
    Link,
    SpatialAcceleration,
    SpatialCarried,
    SpatialFrame,
    SpatialJoint,
    SpatialMoving,
)
from whiptool.dynamics.chain import Chain, passive_torque
from whiptool.dynamics.integrator import GAMMA, RUNGE_KUTTA, advanced, damping_gain, followed, predicted
from whiptool.dynamics.records import Record, Stored
from whiptool.dynamics.rods import RodFrame, RodJoint
from whiptool.dynamics.taut_rods import PointAcceleration, TautCarried, TautJoint

LinkFrame = SpatialFrame | RodFrame
Carried = SpatialCarried | TautCarried
LinkAcceleration = SpatialAcceleration | PointAcceleration


class Instant(NamedTuple):
    """Time and step [s], positions and speeds of the drive's joints (a, 1), and input (n_inputs, 1)."""

    t: ca.SX
    h: ca.SX
    q: ca.SX
    v: ca.SX
    u: ca.SX


class Hand(NamedTuple):
    """Frame in which the whip begins, and the state of the drive."""

    frame: LinkFrame  # frame at the hand
    ends: ca.SX  # far ends of the drive's links [m], (a, 3)
    angles: ca.SX  # in the plane, absolute angles of the drive's links [rad], (a, 1)
    motion: Record  # quantities that `System.react` needs of the drive


class Reaction(NamedTuple):
    """Accelerations of the drive's joints (a, 1), acceleration of the hand, and the drive's torques (a, 1) [N m]."""

    qdd: ca.SX
    acceleration: SpatialAcceleration
    torque: ca.SX


class _Columns(NamedTuple):
    """What of each record stands in columns."""

    frame: Stored[Any]
    motion: Stored[Any]
    moving: Stored[SpatialMoving]
    carried: Stored[Any]
    joint: Stored[Any]
    acceleration: Stored[Any]


class System(ABC):
    """A whip, a chain of links, on a drive (arm or moving base); the drive's joints are the first coordinates.

    The coordinates of a link that is a rod are those of a unit vector; it has no hinges.
    """

    LINK_QUANTITIES: ClassVar = (
        "length", "mass", "com", "inertia", "stiffness", "damping", "rest_angle", "dry_friction", "drag",
        "cubic_stiffness", "drag_ratio", "friction_velocity",
    )  # fmt: skip

    n_drive: int  # number of joints of the drive
    n_links: int  # number of links of the whip
    n_inputs: int  # size of the input: a held torque, or the motion of a base
    held: bool  # whether the input is a torque that `control` computes and that is held for a control period
    prescribed: bool = False  # whether the drive's joints follow `lead` exactly, whose accelerations are the input
    explicit: bool = False  # whether steps are classical Runge-Kutta steps; the drive's joints are then prescribed
    dimension: int = 2  # 2 in the plane, 3 in space
    hinges: tuple[Axis, ...] = ((0.0, -1.0, 0.0),)  # axes of a link's hinges, each in the frame after those before it
    p: ca.SX  # parameters, (P, 1)
    link_columns: dict[str, tuple[int, int]]  # columns of the whip's quantities in p: (first, stride between links)

    @abstractmethod
    def hand(self, q: ca.SX, v: ca.SX, u: ca.SX, before: ca.SX, share: ca.SX | None = None) -> Hand:
        """Return the frame in which the whip begins, for the drive's joints q, v (a, 1) and the input u (n_inputs, 1).

        In later stages of a step `before` is a weighted sum of the drive's joint accelerations in the previous stages
        (a, 1), and `share` is the sum of the weights; default: 1.
        """

    @abstractmethod
    def react(self, now: Instant, before: ca.SX | None, motion: Any, carried: SpatialCarried) -> Reaction:
        """Return the motion of the drive under the load of the whip, `carried`, with the `motion` of the result of
        `hand`; in the second stage of a step `before` is the accelerations of the first (a, 1), else None.
        """

    def lead(self, t: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Return prescribed positions, speeds and accelerations of the drive's joints, (a, 1) each, at time t [s]."""
        raise NotImplementedError

    @property
    def n(self) -> int:
        """Number of all coordinates: the drive's joints, and those of the links."""
        return self.n_drive + self.n_links * self.link_size

    @property
    def link_size(self) -> int:
        """Number of coordinates of a link: one for each hinge, or three components of a rod's direction."""
        return len(self.hinges) or 3

    @property
    def n_parameters(self) -> int:
        """Length of the parameter vector."""
        return self.p.numel()

    @property
    def coordinates(self) -> tuple[int, ...]:
        """Indices of the coordinates that a position has: x and z in the plane, which is vertical in space, else x, y
        and z.
        """
        return (0, 2) if self.dimension == 2 else (0, 1, 2)

    def link(self, w: ca.SX) -> tuple[Link, Chain]:
        """Return a link, and its joint as a chain of one link, from its parameters w in the order of `link_columns`."""
        of = dict(zip(self.link_columns, ca.vertsplit(w), strict=True))
        zero = ca.SX(0)
        quantities = {name: of.get(name, zero) for name in self.LINK_QUANTITIES}
        quantities["com"] = of.get("com", of["length"])
        quantities["drag_ratio"] = of.get("drag_ratio", ca.SX(1))
        quantities["friction_velocity"] = of.get("friction_velocity", ca.SX(1))
        if len(self.hinges) == 2:
            quantities["rest_angle"] = ca.vertcat(of.get("rest_angle_x", zero), quantities["rest_angle"])
        link = Link(*(quantities[name] for name in Link._fields))
        return link, Chain(**quantities, gravity=0.0)

    # -----------------------------------------------------------------------------------------------------------------
    # One link

    def move_link(
        self, frame: Any, q: ca.SX, v: ca.SX, w: ca.SX, h: ca.SX, before: ca.SX | None
    ) -> tuple[LinkFrame, SpatialMoving, ca.SX, ca.SX]:
        """Return, in a stage of a step, the frame at a link's end, the link's motion, its joint's torques, and the
        inertia that the integrator adds, for the link's coordinates q, their speeds v, its parameters w (see `link`)
        and the step h [s].

        With K hinges q, v and the last two results are (K, 1); for a rod q and v are (3, 1), and these are (4, 3), see
        `rods.torques_and_gain`, and (1, 1). In the second stage `before` is the accelerations of q in the first; else
        None.
        """
        link, joint = self.link(w)
        h = ca.SX(0) if self.explicit else h
        if not self.hinges:
            end, moving = rods.outward(frame, q, v, link, before)
            end, torques, gain = rods.torques_and_gain(joint, frame, end, h, again=before is not None)
            return end, moving, torques, gain
        end, moving = articulated.outward(frame, q, v, link, self.hinges)
        armature = GAMMA * h * damping_gain(joint, v)
        torque = passive_torque(joint, q, v)
        if before is not None:
            torque += 2 * armature * before
        return end, moving, torque, armature

    @property
    def taut(self) -> bool:
        """Whether links only transmit forces along themselves: rods in explicit steps."""
        return self.explicit and not self.hinges

    @property
    def _nothing(self) -> Carried:
        """What the tip carries."""
        return TautCarried() if self.taut else SpatialCarried()

    def _felt(self, carried: Any) -> SpatialCarried:
        """What is carried, as the drive feels it."""
        return carried.spatial if self.taut else carried

    def _begins(self, at: SpatialAcceleration) -> LinkAcceleration:
        """The hand's acceleration, as the first link needs it."""
        return PointAcceleration(at.linear) if self.taut else at

    def twist(self, tip: Any) -> ca.SX:
        """Return the twist (2, 1) of a whip of rods at its tip, from the tip's frame; (0, 1) for hinges."""
        return ca.SX.zeros(0) if self.hinges else tip.twist

    def carry_link(
        self, carried: Any, moving: SpatialMoving, w: ca.SX, torque: ca.SX, armature: ca.SX, twist: ca.SX
    ) -> tuple[Carried, SpatialJoint | RodJoint | TautJoint, ca.SX]:
        """Return the inertia and load on the previous link, the coefficients of this link's joint for
        `accelerate_link`, and the twist for the previous link.

        `carried` is what this link's far end carries; `moving`, `torque` and `armature` are from `move_link`, w are the
        link's parameters, see `link`. `twist` is what this method returned for the next link, or for the last link
        `twist`.
        """
        if not self.hinges:
            torque, twist = rods.torque_of(torque, twist)
        if self.taut:
            return *taut_rods.give_way(carried, moving, self.link(w)[0], torque), twist
        carried = articulated.inward(carried, moving, self.link(w)[0])
        if not self.hinges:
            return *rods.give_way(carried, moving.axes[:, 0], torque, armature), twist
        return *articulated.give_way(carried, moving.axes, torque, armature), twist

    def accelerate_link(self, at: Any, joint: Any, moving: SpatialMoving) -> tuple[ca.SX, LinkAcceleration]:
        """Return the accelerations of a link's coordinates (K, 1), and the acceleration at its far end."""
        if self.taut:
            return taut_rods.accelerate(at, joint, moving)
        return (articulated if self.hinges else rods).accelerate(at, joint, moving)

    def predict_link(self, q: ca.SX, v: ca.SX, k1: ca.SX, h: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return a link's coordinates and speeds (K, 1) at which the second stage is evaluated."""
        later = predicted(q, v, k1, h)
        return later if self.hinges else rods.unit(*later)

    def advance_link(self, q: ca.SX, v: ca.SX, k1: ca.SX, w: ca.SX, h: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return a link's coordinates and speeds (K, 1) after a step h [s]."""
        later = advanced(q, v, k1, w, h)
        return later if self.hinges else rods.unit(*later)

    def follow_link(self, q: ca.SX, v: ca.SX, speed: ca.SX, k: ca.SX, h: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return a link's coordinates and speeds (K, 1) after a time h [s], with constant `speed` and acceleration
        k."""
        later = followed(q, v, speed, k, h)
        return later if self.hinges else rods.unit(*later)

    def _all(self, of_link: Callable[..., tuple[ca.SX, ca.SX]], h: ca.SX, *columns: ca.SX) -> tuple[ca.SX, ca.SX]:
        """All links' coordinates and speeds (N K, 1), by a function of each link's columns (K, 1) and the step."""
        K = self.link_size
        each = [of_link(*(x[K * i : K * (i + 1)] for x in columns), h) for i in range(self.n_links)]
        return ca.vertcat(*(q for q, _ in each)), ca.vertcat(*(v for _, v in each))

    # -----------------------------------------------------------------------------------------------------------------
    # Composed

    def _stage(
        self, at: Instant, q: ca.SX, v: ca.SX, before: ca.SX | None
    ) -> tuple[ca.SX, Reaction, Hand, list[LinkFrame]]:
        """Accelerations (n, 1) of one stage for the whip's q and v, the drive's reaction, the hand, and the links'
        ends; in the second stage `before` is the accelerations of the first (n, 1).
        """
        a, N, K = self.n_drive, self.n_links, self.link_size
        numbers = [ca.vertcat(*(self.p[first + i * by] for first, by in self.link_columns.values())) for i in range(N)]
        hand = self.hand(at.q, at.v, at.u, ca.SX.zeros(a) if before is None else before[:a])
        frame, frames, links = hand.frame, [], []
        for i, w in enumerate(numbers):
            own = slice(K * i, K * (i + 1))
            k1 = None if before is None else before[a:][own]
            frame, *link = self.move_link(frame, q[own], v[own], w, at.h, k1)
            frames.append(frame)
            links.append(link)
        carried, joints, twist = self._nothing, [], self.twist(frame)
        for w, (moving, torque, armature) in zip(reversed(numbers), reversed(links), strict=True):
            carried, joint, twist = self.carry_link(carried, moving, w, torque, armature, twist)
            joints.append(joint)
        joints.reverse()
        reaction = self.react(at, None if before is None else before[:a], hand.motion, self._felt(carried))
        acceleration, accelerations = self._begins(reaction.acceleration), [reaction.qdd]
        for joint, (moving, *_) in zip(joints, links, strict=True):
            qdd, acceleration = self.accelerate_link(acceleration, joint, moving)
            accelerations.append(qdd)
        return ca.vertcat(*accelerations), reaction, hand, frames

    @cached_property
    def step(self) -> ca.Function:
        """One time step, `step(x, t, h, p, u, u_end)`: from the state x (2 n, 1), coordinates and then rates, at time t
        [s], over h [s], with parameters p, and inputs u at its start and u_end at its end; these a prescribed drive
        ignores.

        It returns the next state and, at the step's start, the tip's position and velocity, the drive's torques, and
        the observed quantities (`n_observed`).
        """
        n, a = self.n, self.n_drive
        x, t, h = ca.SX.sym("x", 2 * n), ca.SX.sym("t"), ca.SX.sym("h")
        u, u_end = ca.SX.sym("u", self.n_inputs), ca.SX.sym("u_end", self.n_inputs)
        q, v = x[:n], x[n:]
        now = self.lead(t)[2] if self.prescribed else u
        k1, reaction, hand, frames = self._stage(Instant(t, h, q[:a], v[:a], now), q[a:], v[a:], None)
        if self.explicit:
            following = self._runge_kutta(x, t, h, k1)
        else:
            following = self._rosenbrock(x, t, h, k1, u_end)
        tip = ca.vertcat(frames[-1].place[self._places], frames[-1].velocity[self._places])
        outputs = [following, tip, reaction.torque, self._observed(hand, frames)]
        names = ["x", "t", "h", "p", "u", "u_end"], ["x_next", "tip", "tau", "observed"]
        return ca.Function("step", [x, t, h, self.p, u, u_end], outputs, *names, {"cse": True})

    def _rosenbrock(self, x: ca.SX, t: ca.SX, h: ca.SX, k1: ca.SX, u_end: ca.SX) -> ca.SX:
        """The state (2 n, 1) a step later, of the first stage's accelerations (n, 1) and the input at its end."""
        a, q, v = self.n_drive, x[: self.n], x[self.n :]
        later_q, later_v = predicted(q[:a], v[:a], k1[:a], h)
        if self.prescribed:
            later_q, later_v, u_end = self.lead(t + h)
        links_q, links_v = self._all(self.predict_link, h, q[a:], v[a:], k1[a:])
        w, *_ = self._stage(Instant(t + h, h, later_q, later_v, u_end), links_q, links_v, k1)
        if not self.prescribed:
            later_q, later_v = advanced(q[:a], v[:a], k1[:a], w[:a], h)
        links_q, links_v = self._all(self.advance_link, h, q[a:], v[a:], k1[a:], w[a:])
        return ca.vertcat(later_q, links_q, later_v, links_v)

    def _runge_kutta(self, x: ca.SX, t: ca.SX, h: ca.SX, k1: ca.SX) -> ca.SX:
        """The state (2 n, 1) a step later, of the first stage's accelerations (n, 1)."""
        a, q, v = self.n_drive, x[: self.n], x[self.n :]
        k, speeds, (_, weight) = k1[a:], v[a:], RUNGE_KUTTA[0]
        mean_speed, mean_k = weight * speeds, weight * k
        for at, weight in RUNGE_KUTTA[1:]:
            led_q, led_v, u = self.lead(t + at * h)
            links_q, speeds = self._all(self.follow_link, at * h, q[a:], v[a:], speeds, k)
            k = self._stage(Instant(t + at * h, h, led_q, led_v, u), links_q, speeds, None)[0][a:]
            mean_speed, mean_k = mean_speed + weight * speeds, mean_k + weight * k
        led_q, led_v, _ = self.lead(t + h)
        links_q, links_v = self._all(self.follow_link, h, q[a:], v[a:], mean_speed, mean_k)
        return ca.vertcat(led_q, links_q, led_v, links_v)

    @cached_property
    def acceleration(self) -> ca.Function:
        """Function `acceleration(x, t, p, u)`: accelerations of all coordinates, (n, 1)."""
        n, a = self.n, self.n_drive
        x, t, u = ca.SX.sym("x", 2 * n), ca.SX.sym("t"), ca.SX.sym("u", self.n_inputs)
        q, v = x[:n], x[n:]
        found, *_ = self._stage(Instant(t, ca.SX(0), q[:a], v[:a], u), q[a:], v[a:], None)
        return ca.Function("acceleration", [x, t, self.p, u], [found], {"cse": True})

    @property
    def _places(self) -> list[int]:
        return list(self.coordinates)

    def _observed(self, hand: Hand, frames: list[Any]) -> ca.SX:
        """All links' far ends (coordinates of each in turn) and in the plane their absolute angles, (observed, 1)."""
        ends = [ca.vec(hand.ends[:, self._places].T), *(frame.place[self._places] for frame in frames)]
        angles = [hand.angles, *(frame.turned.angle for frame in frames)] if self.dimension == 2 else []
        return ca.vertcat(*ends, *angles)

    @property
    def n_observed(self) -> int:
        """Number of observed quantities: x, y and angle of each link in the plane, x, y, z in space."""
        return (self.n_drive + self.n_links) * 3  # x, y and angle, or x, y, z

    @cached_property
    def step_forward(self) -> ca.Function:
        """`step` with its derivative along one direction of all inputs; CasADi's forward mode."""
        return along(self.step)

    @cached_property
    def control(self) -> ca.Function:
        """Function `u(x, t, p)`: the torque to hold for a control period, (a, 1) [N m]."""
        raise NotImplementedError

    @cached_property
    def control_forward(self) -> ca.Function:
        """`control` with its derivative along one direction of all inputs."""
        return along(self.control)

    # -----------------------------------------------------------------------------------------------------------------
    # For a loop over links

    @cached_property
    def _symbols(self) -> dict[str, ca.SX]:
        """Inputs of the functions of one link and of the drive."""
        a, K = self.n_drive, self.link_size
        sizes = {"q": K, "v": K, "before": K, "armature": len(self.hinges) or 1, "twist": 0 if self.hinges else 2}
        sizes |= {"k1": K, "k2": K, "w": len(self.link_columns)}
        sizes |= {"qa": a, "va": a, "before_a": a, "u": self.n_inputs, "t": 1, "h": 1, "share": 1}
        torque = ca.SX.sym("torque", *((K, 1) if self.hinges else (4, 3)))
        return {name: ca.SX.sym(name, size) for name, size in sizes.items()} | {"torque": torque}

    @property
    def _armature(self) -> ca.SX:
        """What the integrator adds to the inertia of a link's joint; nothing in an explicit step."""
        given = self._symbols["armature"]
        return ca.SX.zeros(given.numel()) if self.explicit else given

    @cached_property
    def columns(self) -> _Columns:
        """The entries that the compiled code stores of each kind of record (see `Stored`), the same for all links."""
        s = self._symbols
        hand = self.hand(s["qa"], s["va"], s["u"], s["before_a"])

        def out(frame: Any) -> Any:
            return self.move_link(frame, s["q"], s["v"], s["w"], s["h"], None)[0]

        seen = [first + i for first in (hand.frame.VELOCITY, hand.frame.PLACE) for i in self.coordinates]
        seen += [SpatialFrame.ANGLE] if self.dimension == 2 else []
        frame = Stored.along(hand.frame, "frame", out, always=seen)
        motion = Stored.of(hand.motion, "motion")
        moving = Stored.of(self.move_link(frame.record, s["q"], s["v"], s["w"], s["h"], None)[1], "moving")

        def carry(carried: Any) -> tuple[Any, Any]:
            return self.carry_link(carried, moving.record, s["w"], s["torque"], self._armature, s["twist"])[:2]

        def uses(carried: Any) -> ca.SX:
            at = Instant(s["t"], s["h"], s["qa"], s["va"], s["u"])
            reaction = self.react(at, s["before_a"], motion.record, self._felt(carried))
            return ca.vertcat(*carry(carried)[1].entries(), reaction.qdd, *reaction.acceleration.entries())

        every = Stored.along(self._nothing, "carried", lambda x: carry(x)[0])
        carried = every.needed(self._nothing, "carried", uses, lambda x: carry(x)[0])
        joint = Stored.of(carry(carried.record)[1], "joint")
        at = Instant(s["t"], s["h"], s["qa"], s["va"], s["u"])
        start = self.react(at, s["before_a"], motion.record, self._felt(carried.record)).acceleration
        acceleration = Stored.along(
            self._begins(start), "acceleration", lambda x: self.accelerate_link(x, joint.record, moving.record)[1]
        )
        return _Columns(frame, motion, moving, carried, joint, acceleration)

    @cached_property
    def functions(self) -> dict[str, ca.Function]:
        """The functions of one link and of the drive that a compiled engine calls, by name; they take and return
        records as columns of their stored entries, see `columns`.
        """
        s, c = self._symbols, self.columns
        q, v, w, h, before = (s[name] for name in ("q", "v", "w", "h", "before"))
        hand = self.hand(s["qa"], s["va"], s["u"], s["before_a"], s["share"])
        end, moves, *first_torque = self.move_link(c.frame.record, q, v, w, h, None)
        end_again, _, *again = self.move_link(c.frame.record, q, v, w, h, before)
        # all that the second stage needs of a frame
        going_on = end.VELOCITY if self.link(w)[0].drag.is_zero() else end.PLACE
        turns = c.frame.column(end_again)[: len({i for i in c.frame.where[:going_on] if i is not None})]
        carries, keeps, twist = self.carry_link(
            c.carried.record, c.moving.record, w, s["torque"], self._armature, s["twist"]
        )
        qdd, ahead = self.accelerate_link(c.acceleration.record, c.joint.record, c.moving.record)
        at = Instant(s["t"], h, s["qa"], s["va"], s["u"])
        reaction = self.react(at, s["before_a"], c.motion.record, self._felt(c.carried.record))
        frame, moving, carried = c.frame.symbols, c.moving.symbols, c.carried.symbols
        k1, k2, x, y = (ca.SX.sym(name) for name in ("k1", "k2", "q", "v"))
        hand_ends = ca.vec(hand.ends[:, self._places].T)
        table = {
            "hand": (
                [s["qa"], s["va"], self.p, s["u"], s["before_a"], s["share"]],
                [c.frame.column(hand.frame), hand_ends, hand.angles, c.motion.column(hand.motion)],
            ),
            "outward": ([frame, q, v, w, h], [c.frame.column(end), c.moving.column(moves), *first_torque]),
            "outward_again": ([frame, q, v, w, h, before], [turns, c.moving.column(moves), *again]),
            "twist": ([frame], [self.twist(c.frame.record)]),
            "inward": (
                [carried, moving, w, s["torque"], s["armature"], s["twist"]],
                [c.carried.column(carries), c.joint.column(keeps), twist],
            ),
            "react": (
                [s["t"], h, s["qa"], s["va"], self.p, s["u"], s["before_a"], c.motion.symbols, carried],
                [reaction.qdd, c.acceleration.column(self._begins(reaction.acceleration)), reaction.torque],
            ),
            "accelerate": ([c.acceleration.symbols, c.joint.symbols, moving], [c.acceleration.column(ahead), qdd]),
            "predict": ([x, y, k1, h], [*predicted(x, y, k1, h)]),
            "advance": ([x, y, k1, k2, h], [*advanced(x, y, k1, k2, h)]),
            "predict_link": ([q, v, s["k1"], h], [*self.predict_link(q, v, s["k1"], h)]),
            "follow_link": ([q, v, s["k1"], s["k2"], h], [*self.follow_link(q, v, s["k1"], s["k2"], h)]),
            "advance_link": ([q, v, s["k1"], s["k2"], h], [*self.advance_link(q, v, s["k1"], s["k2"], h)]),
        }
        if self.prescribed:
            table["lead"] = [s["t"], self.p], [*self.lead(s["t"])]
        if self.explicit:
            for name in ("outward_again", "predict", "advance", "predict_link", "advance_link"):
                del table[name]
        found = {name: ca.Function(name, *sides, {"cse": True}) for name, sides in table.items()}
        return found | {"control": self.control} if self.held else found

    @property
    def frame_columns(self) -> dict[str, int]:
        """First column of a frame's position, velocity and, in the plane, angle, by name."""
        where, kind = self.columns.frame.where, self.columns.frame.record
        found = {"place": where[kind.PLACE], "velocity": where[kind.VELOCITY]}
        found["angle"] = where[SpatialFrame.ANGLE] if self.dimension == 2 else None
        return {name: 0 if i is None else i for name, i in found.items()}


def along(function: ca.Function) -> ca.Function:
    """Return a function whose outputs are followed by their derivatives along one direction of all its inputs."""
    inputs = [ca.SX.sym(function.name_in(i), function.size_in(i)) for i in range(function.n_in())]
    direction = [ca.SX.sym("d", *x.shape) for x in inputs]
    outputs = function.call(inputs)
    slopes = ca.forward(outputs, inputs, [direction])[0]
    return ca.Function(function.name(), [*inputs, *direction], [*outputs, *slopes], {"cse": True})
