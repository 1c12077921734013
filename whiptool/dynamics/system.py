"""A whip behind what drives it: functions of one link, of the drive, and the integrator's step composed of them.

A compiled engine loops over links with the functions of `System.functions`, so that the generated code does not grow
with the number of links. `System.step` composes the same expressions into one function, for the interpreter and for
whoever wants to look at them.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property
from typing import ClassVar, NamedTuple

import casadi as ca

from whiptool.dynamics import articulated
from whiptool.dynamics.articulated import Acceleration, Carried, Joint, JointFrame, Moving
from whiptool.dynamics.chain import Chain, passive_torque
from whiptool.dynamics.integrator import GAMMA, advanced, damping_gain, predicted


class Hand(NamedTuple):
    """Where the whip begins; far ends (a, 2) [m], absolute angles (a, 1) and movement of the drive's links."""

    frame: JointFrame
    ends: ca.SX
    angles: ca.SX
    moving: list[Moving]


class Instant(NamedTuple):
    """Time `t` and step `h` [s], the drive's joints `q`, `v` (a, 1), and the input `u` (n_inputs, 1)."""

    t: ca.SX
    h: ca.SX
    q: ca.SX
    v: ca.SX
    u: ca.SX


class Reaction(NamedTuple):
    """Accelerations of the drive's joints (a, 1), of the hand, and the drive's torques (a, 1) [N m]."""

    qdd: ca.SX
    acceleration: Acceleration
    torque: ca.SX


class System(ABC):
    """A chain of links behind a drive, of which the drive's joints come first.

    Attributes:
        n_drive, n_links: Joints of the drive and of the whip.
        n_inputs: Numbers that drive it from outside at each instant: a held torque, or a base's motion.
        held: The input is a torque that `control` gives and that is held.
        p: Parameters, (P, 1).
        link_columns: Where the whip's quantities stand in p: (first, stride from link to link) by quantity.
    """

    LINK_QUANTITIES: ClassVar = (
        "length", "mass", "com", "inertia", "stiffness", "damping", "rest_angle", "dry_friction", "drag",
        "cubic_stiffness", "drag_ratio", "friction_velocity",
    )  # fmt: skip

    n_drive: int
    n_links: int
    n_inputs: int
    held: bool
    p: ca.SX
    link_columns: dict[str, tuple[int, int]]

    @abstractmethod
    def hand(self, q: ca.SX, v: ca.SX, u: ca.SX) -> Hand:
        """Return where the whip begins, for the drive's joints (a, 1) and the input."""

    @abstractmethod
    def react(self, now: Instant, before: ca.SX | None, moving: list[Moving], carried: Carried) -> Reaction:
        """Return how the drive moves under what it carries.

        Args:
            now: Time, step, the drive's state and input of this stage.
            before: Accelerations of the first stage (a, 1), in the second.
            moving: How its links move, as `hand` says.
            carried: What the hand carries.
        """

    @property
    def n(self) -> int:
        """Number of all joints."""
        return self.n_drive + self.n_links

    @property
    def n_parameters(self) -> int:
        """Length of the parameter vector."""
        return self.p.numel()

    def link(self, w: ca.SX) -> Chain:
        """Return one link as a chain, of its numbers in the order of `link_columns`."""
        of = dict(zip(self.link_columns, ca.vertsplit(w), strict=True))
        zero = ca.SX(0)
        quantities = {name: of.get(name, zero) for name in self.LINK_QUANTITIES}
        quantities["com"] = of.get("com", of["length"])
        quantities["drag_ratio"] = of.get("drag_ratio", ca.SX(1))
        quantities["friction_velocity"] = of.get("friction_velocity", ca.SX(1))
        return Chain(**quantities, gravity=0.0)

    # -----------------------------------------------------------------------------------------------------------------
    # One link

    def move_link(
        self, frame: JointFrame, q: ca.SX, v: ca.SX, w: ca.SX, h: ca.SX, before: ca.SX | None
    ) -> tuple[JointFrame, Moving, ca.SX, ca.SX]:
        """Return the frame at a link's end, how it moves, its joint's torque and armature in this stage."""
        chain = self.link(w)
        end, moving = articulated.outward(frame, q, v, chain.links[0])
        armature = GAMMA * h * damping_gain(chain, v)
        torque = passive_torque(chain, q, v)
        if before is not None:
            torque += 2 * armature * before
        return end, moving, torque, armature

    def carry_link(
        self, carried: Carried, moving: Moving, w: ca.SX, torque: ca.SX, armature: ca.SX
    ) -> tuple[Carried, Joint]:
        """Return what the link before carries of this one, and what the joint keeps."""
        carried = articulated.inward(carried, moving, self.link(w).links[0])
        joint = articulated.joint(carried, torque, armature)
        return articulated.share(carried, joint, armature), joint

    # -----------------------------------------------------------------------------------------------------------------
    # Composed

    def _stage(
        self, x: tuple[ca.SX, ca.SX], t: ca.SX, h: ca.SX, u: ca.SX, before: ca.SX | None
    ) -> tuple[ca.SX, Reaction, Hand, list[JointFrame]]:
        """Accelerations (n, 1) of one stage, the drive's reaction, the hand, and the links' ends."""
        a, N = self.n_drive, self.n_links
        q, v = x
        numbers = [ca.vertcat(*(self.p[first + i * by] for first, by in self.link_columns.values())) for i in range(N)]
        hand = self.hand(q[:a], v[:a], u)
        frame, frames, moving, torques, armatures = hand.frame, [], [], [], []
        for i, w in enumerate(numbers):
            k1 = None if before is None else before[a + i]
            frame, moves, torque, armature = self.move_link(frame, q[a + i], v[a + i], w, h, k1)
            frames.append(frame)
            moving.append(moves)
            torques.append(torque)
            armatures.append(armature)
        carried, joints = Carried(), []
        for i in reversed(range(N)):
            carried, joint = self.carry_link(carried, moving[i], numbers[i], torques[i], armatures[i])
            joints.append(joint)
        joints.reverse()
        k1 = None if before is None else before[:a]
        reaction = self.react(Instant(t, h, q[:a], v[:a], u), k1, hand.moving, carried)
        at, accelerations = reaction.acceleration, [reaction.qdd]
        for i in range(N):
            qdd = articulated.joint_acceleration(at, joints[i])
            at = articulated.accelerate(at, qdd, moving[i])
            accelerations.append(qdd)
        return ca.vertcat(*accelerations), reaction, hand, frames

    @cached_property
    def step(self) -> ca.Function:
        """One step: `step(x, t, h, p, u, u_end)`, the inputs those at the step's start and end.

        Besides the next state it returns, at the step's start, the tip's position and velocity, the drive's torques,
        and what `observed` lists.
        """
        n = self.n
        x, t, h = ca.SX.sym("x", 2 * n), ca.SX.sym("t"), ca.SX.sym("h")
        u, u_end = ca.SX.sym("u", self.n_inputs), ca.SX.sym("u_end", self.n_inputs)
        q, v = x[:n], x[n:]
        k1, reaction, hand, frames = self._stage((q, v), t, h, u, None)
        w, *_ = self._stage(predicted(q, v, k1, h), t + h, h, u_end, k1)
        outputs = [ca.vertcat(*advanced(q, v, k1, w, h)), tip_of(frames[-1]), reaction.torque, observed(hand, frames)]
        names = ["x", "t", "h", "p", "u", "u_end"], ["x_next", "tip", "tau", "observed"]
        return ca.Function("step", [x, t, h, self.p, u, u_end], outputs, *names, {"cse": True})

    @cached_property
    def step_forward(self) -> ca.Function:
        """`step` with its derivative along one direction of all inputs; CasADi's forward mode."""
        return along(self.step)

    @cached_property
    def control(self) -> ca.Function:
        """`u(x, t, p)`: the torque to hold, (a, 1).

        Raises:
            NotImplementedError: Nothing is held.
        """
        raise NotImplementedError

    @cached_property
    def control_forward(self) -> ca.Function:
        """`control` with its derivative along one direction of all inputs."""
        return along(self.control)

    # -----------------------------------------------------------------------------------------------------------------
    # For a loop over links

    @cached_property
    def functions(self) -> dict[str, ca.Function]:
        """What a compiled engine is made of, by name; each takes and gives columns."""
        a, W = self.n_drive, len(self.link_columns)
        q, v, h, before, w = (*(ca.SX.sym(name) for name in ("q", "v", "h", "before")), ca.SX.sym("w", W))
        frame, carried, joint, at = (
            ca.SX.sym(kind.__name__, len(kind._fields)) for kind in (JointFrame, Carried, Joint, Acceleration)
        )
        qa, va, u = ca.SX.sym("qa", a), ca.SX.sym("va", a), ca.SX.sym("u", self.n_inputs)
        before_a = ca.SX.sym("before_a", a)
        t, torque, armature, k1, k2 = (ca.SX.sym(name) for name in ("t", "torque", "armature", "k1", "k2"))

        def parts(kind: type, column: ca.SX):
            return kind(*ca.vertsplit(column))

        hand = self.hand(qa, va, u)
        arm_moves, arm_moving, arm_kept = _stored(hand.moving)
        end, moves, *first_torque = self.move_link(parts(JointFrame, frame), q, v, w, h, None)
        again = self.move_link(parts(JointFrame, frame), q, v, w, h, before)[2:]
        turns = end[:2] if self.link(w).links[0].drag.is_zero() else end[:4]  # all that the second stage needs of it
        moves, moving, (kept,) = _stored([moves])
        carries, keeps = self.carry_link(parts(Carried, carried), kept, w, torque, armature)
        qdd = articulated.joint_acceleration(parts(Acceleration, at), parts(Joint, joint))
        ahead = articulated.accelerate(parts(Acceleration, at), qdd, kept)
        reaction = self.react(Instant(t, h, qa, va, u), before_a, arm_kept, parts(Carried, carried))
        table = {
            "hand": ([qa, va, self.p, u], [ca.vertcat(*hand.frame), ca.vec(hand.ends.T), hand.angles, arm_moves]),
            "outward": ([frame, q, v, w, h], [ca.vertcat(*end), moves, *first_torque]),
            "outward_again": ([frame, q, v, w, h, before], [ca.vertcat(*turns), moves, *again]),
            "inward": ([carried, moving, w, torque, armature], [ca.vertcat(*carries), ca.vertcat(*keeps)]),
            "react": (
                [t, h, qa, va, self.p, u, before_a, arm_moving, carried],
                [reaction.qdd, ca.vertcat(*reaction.acceleration), reaction.torque],
            ),
            "accelerate": ([at, joint, moving], [ca.vertcat(*ahead), qdd]),
            "predict": ([q, v, k1, h], [*predicted(q, v, k1, h)]),
            "advance": ([q, v, k1, k2, h], [*advanced(q, v, k1, k2, h)]),
        }
        found = {name: ca.Function(name, *sides, {"cse": True}) for name, sides in table.items()}
        return found | {"control": self.control} if self.held else found


def _stored(moving: list[Moving]) -> tuple[ca.SX, ca.SX, list[Moving]]:
    """Return what of moving links differs from zero and from each other, symbols for it, and the links of symbols."""
    different: list[ca.SX] = []
    places: list[int | None] = []
    for value in (ca.SX(x) for link in moving for x in link):
        same = [i for i, x in enumerate(different) if ca.is_equal(x, value)]
        if not same and not value.is_zero():
            same = [len(different)]
            different.append(value)
        places.append(same[0] if same else None)
    symbols = ca.SX.sym("moving", len(different))
    values = [ca.SX(0) if i is None else symbols[i] for i in places]
    width = len(Moving._fields)
    return ca.vertcat(*different), symbols, [Moving(*values[i : i + width]) for i in range(0, len(values), width)]


def tip_of(frame: JointFrame) -> ca.SX:
    """Return the tip's position and velocity (4, 1): x, y, vx, vy."""
    return ca.vertcat(frame.x, frame.y, frame.vx, frame.vy)


def observed(hand: Hand, frames: list[JointFrame]) -> ca.SX:
    """Return all links' far ends (x, y of each in turn) and their absolute angles, (3 n, 1)."""
    places = [ca.vec(hand.ends.T), *(ca.vertcat(frame.x, frame.y) for frame in frames)]
    return ca.vertcat(*places, hand.angles, *(frame.angle for frame in frames))


def along(function: ca.Function) -> ca.Function:
    """Return a function with, behind its outputs, their derivatives along one direction of all its inputs."""
    inputs = [ca.SX.sym(function.name_in(i), function.size_in(i)) for i in range(function.n_in())]
    direction = [ca.SX.sym("d", *x.shape) for x in inputs]
    outputs = function.call(inputs)
    slopes = ca.forward(outputs, inputs, [direction])[0]
    return ca.Function(function.name(), [*inputs, *direction], [*outputs, *slopes], {"cse": True})
