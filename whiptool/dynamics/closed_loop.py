"""The closed loop of strike, controller, arm and whip as CasADi functions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property, lru_cache
from typing import NamedTuple

import casadi as ca

from whiptool.dynamics.articulated import SpatialAcceleration, SpatialCarried, SpatialFrame
from whiptool.dynamics.chain import PLANAR_AXIS
from whiptool.dynamics.integrator import GAMMA
from whiptool.dynamics.rods import RodFrame, bend
from whiptool.dynamics.serial_arm import ArmMotion, ArmPosture, Body, LedMotion, SerialArm, solve
from whiptool.dynamics.structure import Structure
from whiptool.dynamics.system import Hand, Instant, Reaction, System
from whiptool.impedance.controller import SINGULAR
from whiptool.impedance.laws import LAWS
from whiptool.models.whip import KINDS

_NONE = 1e-12  # [rad]; a smaller turn is taken as zero
_FLAT = 1e-15  # keeps what is left of half a turn finite


def turned_by(vector: ca.SX, share: ca.SX) -> ca.SX:
    """Return the rotation matrix by `share` times a rotation vector (3, 1) [rad], smooth also at zero (Rodrigues)."""
    angle = ca.sqrt(ca.sumsqr(vector) + _NONE**2)
    K = ca.skew(vector)
    first, half = ca.sin(share * angle) / angle, ca.sin(share * angle / 2) / angle
    return ca.SX.eye(3) + first * K + 2 * half**2 * ca.mtimes(K, K)


def rotation_left(wanted: ca.SX, present: ca.SX) -> ca.SX:
    """Return the rotation `wanted @ present.T` from one orientation (3, 3) to another, as its unit axis in the world
    frame times 2 sin(angle / 2), (3, 1).

    It is computed from the antisymmetric part, which contains sin(angle), and the trace, 1 + 2 cos(angle).
    """
    R = ca.mtimes(wanted, present.T)
    sine = ca.vertcat(R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]) / 2
    return 2 * sine / ca.sqrt(1 + ca.trace(R) + _FLAT)


def _minimum_jerk(t: ca.SX, since: ca.SX | float, lasts: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return the share of a movement (Eq. 1) at time t [s] that begins at `since` and lasts so long, with two
    derivatives."""
    s = ca.fmax(ca.fmin((t - since) / lasts, 1), 0)
    share = s**3 * (10 - 15 * s + 6 * s**2)
    return share, 30 * s**2 * (1 - s) ** 2 / lasts, 60 * s * (1 - s) * (1 - 2 * s) / lasts**2


_UNTURNED = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
_LINK = {  # quantities of a link: what they are called in a whip
    "length": "l", "mass": "m", "stiffness": "k", "damping": "b", "rest_angle": "rest_angle",
    "rest_angle_x": "rest_angle_x",
    "dry_friction": "dry_friction", "drag": "drag", "cubic_stiffness": "cubic_stiffness", "drag_ratio": "drag_ratio",
    "friction_velocity": "friction_velocity", "inertia": "node_inertia",
}  # fmt: skip
_TURNS = {2: [[0, -1, 0]], 3: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}  # of the orientation's coordinates: their axes


class HandNow(NamedTuple):
    """Current motion of the hand."""

    place: ca.SX  # position [m], (3, 1)
    turned: ca.SX  # rotation matrix, column by column (9, 1); empty if the control law does not need it
    jacobian: ca.SX  # angular and linear velocity of the hand per unit of the joints' speeds, angular first, (6, a)


class ClosedLoop(System):
    """Equations of motion of arm and whip, with a controller that makes the arm follow a strike, for one `Structure`.

    The input is the torque that a sampled controller holds (a, 1), or the accelerations of prescribed joints (a, 1), or
    empty if the controller is continuous.
    """

    def __init__(self, structure: Structure) -> None:
        self.structure = structure
        self.n_drive, self.n_links = structure.n_arm, structure.n_whip
        self.held, self.prescribed = structure.held, structure.prescribed
        self.explicit = structure.explicit
        assert self.prescribed or not self.explicit
        self.n_inputs = structure.n_arm if self.held or self.prescribed else 0
        self.dimension = structure.dimension
        self.hinges = KINDS[structure.joints].hinges
        self.parameters = {name: ca.SX.sym(name, size) for name, size in structure.layout.items()}
        self.p = ca.vertcat(*self.parameters.values())
        self.link_columns = {
            quantity: (structure.columns(f"whip.{name}").start, int(structure.layout[f"whip.{name}"] > 1))
            for quantity, name in _LINK.items()
            if f"whip.{name}" in structure.layout
        }
        self.bare_arm = self._planar_arm() if structure.arm is None else self._spatial_arm()
        at_hand = [self._at_hand(self.parameters["whip.hinge_mass"])] if "hinge_mass" in structure.optional else []
        self.arm = replace(self.bare_arm, bodies=[*self.bare_arm.bodies, *at_hand])

    # -----------------------------------------------------------------------------------------------------------------
    # The arm

    def _planar_arm(self) -> SerialArm:
        """Links along -z whose axes are all that of the plane."""
        P, a = self.parameters, self.structure.n_arm
        zero = ca.SX(0)
        ends = [ca.vertcat(0, 0, -length) for length in ca.vertsplit(P["arm.length"])]
        bodies = []
        for i in range(a):
            inertia = ca.diagcat(zero, P["arm.inertia"][i], zero)
            bodies.append(Body(i, P["arm.mass"][i], ca.vertcat(0, 0, -P["arm.com"][i]), ca.densify(inertia)))
        return SerialArm(
            kinds=("revolute",) * a,
            axes=(PLANAR_AXIS,) * a,
            positions=[ca.SX.zeros(3), *ends[:-1]],
            rotations=(_UNTURNED,) * a,
            hand_position=ends[-1],
            hand_rotation=_UNTURNED,
            armatures=ca.SX.zeros(a),
            bodies=bodies,
        )

    @cached_property
    def _arm_numbers(self) -> dict[str, ca.SX]:
        """The numbers of the arm's links by quantity; what is structurally zero is the number 0."""
        of = {name.removeprefix("arm."): x for name, x in self.parameters.items() if name.startswith("arm.")}
        if self.structure.arm is None:
            return of
        for name, present in self.structure.arm.present:
            given, of[name] = of[name], ca.SX.zeros(of[name].numel())
            for i in present:
                of[name][i] = given[i]
        return of

    @property
    def friction(self) -> ca.SX:
        """Viscous friction of the arm's joints [N m s/rad], (a, 1)."""
        return self._arm_numbers["friction"]

    def _spatial_arm(self) -> SerialArm:
        """The arm in space; of its numbers only those that are not structurally zero."""
        shape, a, of, bodies = self.structure.arm, self.structure.n_arm, self._arm_numbers, []
        assert shape is not None
        for i in range(a):
            xx, yy, zz, xy, xz, yz = ca.vertsplit(of["inertia"][6 * i : 6 * i + 6])
            inertia = ca.vertcat(ca.horzcat(xx, xy, xz), ca.horzcat(xy, yy, yz), ca.horzcat(xz, yz, zz))
            bodies.append(Body(i, of["mass"][i], of["com"][3 * i : 3 * i + 3], inertia))
        return SerialArm(
            kinds=shape.kinds,
            axes=shape.axes,
            positions=[of["position"][3 * i : 3 * i + 3] for i in range(a)],
            rotations=shape.rotations,
            hand_position=of["hand_position"],
            hand_rotation=shape.hand_rotation,
            armatures=of["armature"],
            bodies=bodies,
        )

    def _at_hand(self, mass: ca.SX) -> Body:
        """A point mass at the hand."""
        return Body(self.structure.n_arm - 1, mass, self.bare_arm.hand_position, ca.SX.zeros(3, 3))

    @cached_property
    def _compensated(self) -> tuple[list[Body], ca.SX]:
        """Bodies whose weight the controller holds, and the mass that it takes to be at the hand."""
        P, bodies = self.parameters, self.bare_arm.bodies
        if not self.structure.compensated:
            return bodies, ca.sum1(P["whip.m"]) + P.get("whip.hinge_mass", 0)
        *masses, load = ca.vertsplit(P["compensated"])
        return [body._replace(mass=masses[body.link]) for body in bodies], load

    # -----------------------------------------------------------------------------------------------------------------
    # The controller

    def reference(self, t: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Return the desired positions [rad or m], velocities [per s] and accelerations [per s^2] of the joints at time
        t [s] (Eq. 1), (n_arm, 1) each; at rest before 0 and after D.

        Submovements, which have the same form, are added to the strike (Henis and Flash 1995); time 0 is `elapsed` [s]
        after the strike began."""
        P = self.parameters
        if "by" in P:
            t = t + P["elapsed"]
            shares = [ca.horzcat(*_minimum_jerk(t, 0.0, P["D"])), *self._submovements(t)]  # (1, 3) each
            spans = ca.horzcat(P["q_f"] - P["q_i"], ca.reshape(P["by"], self.structure.n_arm, len(shares) - 1))
            moved = ca.mtimes(spans, ca.vertcat(*shares))
            return P["q_i"] + moved[:, 0], moved[:, 1], moved[:, 2]
        s = ca.fmax(ca.fmin(t / P["D"], 1), 0)
        if "path" in P:
            return self._along_path(s)
        span = P["q_f"] - P["q_i"]
        position = P["q_i"] + span * (10 * s**3 - 15 * s**4 + 6 * s**5)  # Eq. 1
        velocity = span * (30 * s**2 - 60 * s**3 + 30 * s**4) / P["D"]
        acceleration = span * (60 * s - 180 * s**2 + 120 * s**3) / P["D"] ** 2
        return position, velocity, acceleration

    def _submovements(self, t: ca.SX) -> list[ca.SX]:
        """Share of each added movement at time t [s] after the strike began, and its first two derivatives, (1, 3)."""
        times = zip(*(ca.vertsplit(self.parameters[name]) for name in ("since", "lasts")), strict=True)
        return [ca.horzcat(*_minimum_jerk(t, since, lasts)) for since, lasts in times]

    def _along_path(self, s: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Positions, velocities and accelerations (n_arm, 1) of joints that hold the hand on its path, at the share s
        of D; polynomials of the share of the path, by Horner's scheme."""
        P, a = self.parameters, self.structure.n_arm
        ease = s**3 * (10 - 15 * s + 6 * s**2)  # Eq. 1
        speed = 30 * s**2 * (1 - s) ** 2 / P["D"]
        growth = 60 * s * (1 - s) * (1 - 2 * s) / P["D"] ** 2
        x, q, once, half_twice = 2 * ease - 1, ca.SX.zeros(a), ca.SX.zeros(a), ca.SX.zeros(a)
        for coefficient in reversed(ca.vertsplit(P["path"], a)):
            half_twice, once, q = half_twice * x + once, once * x + q, q * x + coefficient
        return q, 2 * once * speed, 8 * half_twice * speed**2 + 2 * once * growth

    def torque(self, t: ca.SX, q: ca.SX, v: ca.SX, weight: ca.SX, hand: HandNow | None = None) -> ca.SX:
        """The controller's torques (n_arm, 1) at time t [s] and the arm's q and v (Eq. 2); `weight` are those that hold
        the arm's weight there (n_arm, 1) (Eq. 3), and `hand` is for a control law in the hand's coordinates.
        """
        law = {name.removeprefix("law."): x for name, x in self.parameters.items() if name.startswith("law.")}
        expression, P = LAWS[self.structure.law].expression, self.parameters
        if hand is not None:
            tau = self._hand_torque(t, v, hand, lambda e, de: expression(law, e, de)) + weight
        else:
            q_d, v_d, a_d = self.reference(t)
            tau = expression(law, q_d - q, v_d - v) + weight
            if self.structure.feedforward:
                tau += self.bare_arm.inverse(q_d, v_d, a_d, 0.0) + self.friction * v_d
        if self.structure.limits:
            limit = P["torque_limit"]
            tau = ca.fmin(ca.fmax(tau, -limit), limit)
        return tau

    def _hand_torque(self, t: ca.SX, v: ca.SX, hand: HandNow, force: Callable[[ca.SX, ca.SX], ca.SX]) -> ca.SX:
        """Torques (n_arm, 1) of a law of the hand's errors, and of what brakes joints that do not move the hand."""
        P, seen, m = self.parameters, list(self.coordinates), self.structure.hand
        s = ca.fmax(ca.fmin(t / P["D"], 1), 0)
        ease = 10 * s**3 - 15 * s**4 + 6 * s**5  # Eq. 1
        speed = (30 * s**2 - 60 * s**3 + 30 * s**4) / P["D"]
        span = P["x_f"] - P["x_i"]
        e, v_d, J = P["x_i"] + span * ease - hand.place[seen], span * speed, hand.jacobian[3:, :][seen, :]
        if "turns" in P:
            about = ca.SX(ca.DM(_TURNS[self.dimension]))
            wanted = ca.mtimes(turned_by(P["turns"], ease), ca.reshape(P["R_i"], 3, 3).T)
            e = ca.vertcat(e, ca.mtimes(about, rotation_left(wanted, ca.reshape(hand.turned, 3, 3))))
            v_d = ca.vertcat(v_d, ca.mtimes(about, P["turns"]) * speed)
            J = ca.vertcat(J, ca.mtimes(about, hand.jacobian[:3, :]))
        tau = ca.mtimes(J.T, force(e, v_d - ca.mtimes(J, v)))
        moved = solve(ca.mtimes(J, J.T) + SINGULAR**2 * ca.SX.eye(m), ca.mtimes(J, v))
        assert tau.numel() == self.structure.n_arm
        return tau - P["null_damping"] * (v - ca.mtimes(J.T, moved))

    def _torque_and_gain(self, now: Instant, weight: ca.SX, hand: HandNow | None) -> tuple[ca.SX, ca.SX | None]:
        """The arm's torques (a, 1), and how they brake the arm's speed, `-d tau / d v` (a, a)."""
        a = self.structure.n_arm
        if self.structure.held:
            return now.u, None
        va, held = ca.SX.sym("va", a), ca.SX.sym("weight", a)
        tau = self.torque(now.t, now.q, va, held, hand)
        tau, gain = ca.substitute([tau, -ca.jacobian(tau, va)], [va, held], [now.v, weight])
        return tau, gain

    def _hand_of(self, posture: ArmPosture) -> HandNow:
        """Where the hand is in a posture, as far as the law is one of it."""
        oriented = self.structure.hand > self.dimension
        turned = ca.vec(posture.hand_turned.matrix) if oriented else ca.SX(0, 1)
        return HandNow(posture.hand, turned, posture.jacobian)

    # -----------------------------------------------------------------------------------------------------------------
    # What drives the whip

    def hand(self, q: ca.SX, v: ca.SX, u: ca.SX, before: ca.SX, share: ca.SX | None = None) -> Hand:
        """Return the frame in which the whip begins, the far ends of the arm's links, and the arm's motion, from the
        arguments of `System.hand`; the drive is the arm.
        """
        arm, posture, gravity = self.arm, self.arm.posture(q), self.parameters["gravity"]
        share = ca.SX(1) if share is None else share
        if self.prescribed:
            motion = arm.led(q, v, u, gravity)
            drift = motion.acceleration - ca.mtimes(motion.jacobian, u)
            first = share * drift + ca.mtimes(motion.jacobian, before)
            first = ca.SX.zeros(6) if self.explicit else first
        else:
            motion = arm.motion(q, v, gravity, [] if self.held else self._compensated[0])
            if self.structure.hand and not self.held:
                at = self._hand_of(posture)
                motion = motion._replace(place=at.place, turned=at.turned)
            first = share * motion.drift + ca.mtimes(motion.jacobian, before)
        moves = ca.mtimes(motion.jacobian, v)
        turned = posture.hand_turned if len(self.hinges) == 1 else posture.hand_turned.settled
        frame = SpatialFrame(turned, moves[:3], moves[3:], posture.hand)
        if not self.hinges:
            frame = RodFrame.at_hand(frame, first[:3])
        ends = ca.horzcat(*posture.places[1:], posture.hand).T
        return Hand(frame, ends, ca.vertcat(*(turned.angle for turned in posture.turned)), motion)

    def react(
        self, now: Instant, before: ca.SX | None, motion: ArmMotion | LedMotion, carried: SpatialCarried
    ) -> Reaction:
        """Return the accelerations of the controlled arm's joints and of its hand under the load of the whip.

        One linear system gives all of them. The arguments are those of `System.react`.
        """
        if isinstance(motion, LedMotion):
            return self._led(now, motion, carried)
        a, P = self.n_drive, self.parameters
        weight = motion.weight + motion.jacobian[5, :].T * (self._compensated[1] * P["gravity"])
        hand = HandNow(motion.place, motion.turned, motion.jacobian) if self.structure.hand else None
        tau, gain = self._torque_and_gain(now, weight, hand)
        friction = self.friction
        braked = GAMMA * now.h * friction
        loop = ca.SX.zeros(a, a) if gain is None else GAMMA * now.h * gain
        torque = tau - friction * now.v
        if before is not None:
            torque += 2 * braked * before + 2 * loop @ before
        inertia = ca.vertcat(ca.horzcat(carried.J, carried.H), ca.horzcat(carried.H.T, carried.M))
        whip = ca.mtimes(inertia, motion.jacobian)
        H = motion.inertia + ca.mtimes(motion.jacobian.T, whip) + loop + ca.diag(braked)
        load = ca.mtimes(motion.jacobian.T, ca.vertcat(carried.moment, carried.force)) + ca.mtimes(whip.T, motion.drift)
        qdd = solve(H, torque - motion.bias - load)
        moves = motion.drift + ca.mtimes(motion.jacobian, qdd)
        return Reaction(qdd, SpatialAcceleration(moves[:3], moves[3:]), tau)

    def _led(self, now: Instant, motion: LedMotion, carried: SpatialCarried) -> Reaction:
        """Return the accelerations that are given, and the torques that they need under what the hand carries."""
        angular, linear = motion.acceleration[:3], motion.acceleration[3:]
        moment = ca.mtimes(carried.J, angular) + ca.mtimes(carried.H, linear) + carried.moment
        force = ca.mtimes(carried.H.T, angular) + ca.mtimes(carried.M, linear) + carried.force
        load = ca.mtimes(motion.jacobian.T, ca.vertcat(moment, force))
        torque = motion.torque + self.friction * now.v + load
        return Reaction(now.u, SpatialAcceleration(angular, linear), torque)

    def lead(self, t: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Return the reference positions, speeds and accelerations of the arm's joints at time t [s], (a, 1) each."""
        return self.reference(t)

    @cached_property
    def control(self) -> ca.Function:
        """The controller as a function: torques (n_arm, 1) [N m] at state x (2 n,) and time t [s], as a sampled loop
        holds them.
        """
        n, a = self.n, self.structure.n_arm
        x, t = ca.SX.sym("x", 2 * n), ca.SX.sym("t")
        bodies, load = self._compensated
        weights = [*bodies, self._at_hand(load)]
        posture = self.arm.posture(x[:a])
        weight = self.arm.weight(posture, weights, self.parameters["gravity"])
        hand = self._hand_of(posture) if self.structure.hand else None
        tau = self.torque(t, x[:a], x[n : n + a], weight, hand)
        return ca.Function("control", [x, t, self.p], [tau], ["x", "t", "p"], ["tau"], {"cse": True})

    # -----------------------------------------------------------------------------------------------------------------
    # The whip at rest

    @cached_property
    def whip_balance(self) -> ca.Function:
        """Function `whip_balance(q, p, dq, dp)`: static balance of a whip at rest at q (n,), with parameters p (P,).

        It returns the gradient of the potential energy by the whip's own joints (n - a,), which is zero in equilibrium,
        and the change of that gradient along dq (n,) and dp (P,). The gradient by a rod's rotation is three torques.
        """
        q, slope = self._whip_slopes
        dq, dp = ca.SX.sym("dq", self.n), ca.SX.sym("dp", self.p.numel())
        change = ca.jtimes(slope, q, dq) + ca.jtimes(slope, self.p, dp)
        return ca.Function("whip_balance", [q, self.p, dq, dp], [slope, change], {"cse": True})

    @cached_property
    def whip_hessian(self) -> ca.Function:
        """Function `whip_hessian(q, p)`: the gradient as in `whip_balance`, and its derivatives by the whip's joints (n
        - a, n - a).
        """
        q, slope = self._whip_slopes
        hessian = ca.densify(ca.jacobian(slope, q)[:, self.n_drive :])
        # without "cse", which saves a tenth of the instructions and takes half a minute at 100 nodes
        return ca.Function("whip_hessian", [q, self.p], [slope, hessian])

    @property
    def _whip_slopes(self) -> tuple[ca.SX, ca.SX]:
        """The joints q (n,) and the slopes of the resting whip's potential energy by its own joints (n - a,)."""
        a, K = self.n_drive, self.link_size
        q, gravity = ca.SX.sym("q", self.n), self.parameters["gravity"]
        still, none = ca.SX.zeros(K), ca.SX.zeros(a)
        frame = self.hand(q[:a], none, ca.SX.zeros(self.n_inputs), none).frame
        links = []
        for i in range(self.n_links):
            w = ca.vertcat(*(self.p[first + i * by] for first, by in self.link_columns.values()))
            frame, moving, springs, _ = self.move_link(frame, q[a + K * i : a + K * (i + 1)], still, w, ca.SX(0), None)
            links.append((moving, self.link(w)[0].mass * gravity, springs))
        slopes, weight, moment, beyond = list[ca.SX](), ca.SX(0), ca.SX.zeros(3), ca.SX.zeros(3)
        for moving, own_weight, springs in reversed(links):
            weight = weight + own_weight
            turned = ca.cross(moving.r, ca.vertcat(0, 0, weight))
            moment = moment + turned
            if self.hinges:
                slopes.append(ca.mtimes(moving.axes.T, moment) - springs)
                continue
            own = springs[:3, 0]  # nothing turns
            slopes.append(turned - own + beyond)
            beyond = own
        return q, ca.vertcat(*reversed(slopes))

    # -----------------------------------------------------------------------------------------------------------------
    # Energy

    @cached_property
    def energies(self) -> ca.Function:
        """Function `energies(q, v, p)`: kinetic energy, and potential energy of gravity and springs [J], with
        height counted from the base.
        """
        a, K = self.n_drive, self.link_size
        q, v = ca.SX.sym("q", self.n), ca.SX.sym("v", self.n)
        at, gravity = self.arm.posture(q[:a]), self.parameters["gravity"]
        frame = self.hand(q[:a], v[:a], ca.SX.zeros(self.n_inputs), ca.SX.zeros(a)).frame
        T, V = self.arm.kinetic(q[:a], v[:a]), self.arm.potential(at, gravity)
        for i in range(self.n_links):
            w = ca.vertcat(*(self.p[first + i * by] for first, by in self.link_columns.values()))
            own, (link, joint) = slice(a + K * i, a + K * (i + 1)), self.link(w)
            end = self.move_link(frame, q[own], v[own], w, ca.SX(0), None)[0]
            T += (link.mass * ca.sumsqr(end.velocity) + link.inertia * ca.sumsqr(end.speed)) / 2
            V += link.mass * gravity * end.place[2]
            if isinstance(frame, RodFrame):
                V += bend(joint, frame.direction, q[own])[1]
            else:
                bent = q[own] - joint.rest_angle
                V += ca.sum1(joint.stiffness * bent**2 / 2 + joint.cubic_stiffness * bent**4 / 4)
            frame = end
        return ca.Function("energies", [q, v, self.p], [T, V], {"cse": True})


@lru_cache(maxsize=32)
def closed_loop(structure: Structure) -> ClosedLoop:
    """Return the closed loop of a structure, derived once per process."""
    return ClosedLoop(structure)
