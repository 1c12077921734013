"""The closed loop of strike, controller, arm and whip: a system that the arm's controller drives."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np

from whiptool.dynamics import articulated
from whiptool.dynamics.articulated import Acceleration, Carried, JointFrame, Moving
from whiptool.dynamics.chain import Chain, inverse_dynamics, potential_energy, ride_on_end
from whiptool.dynamics.columns import Columns
from whiptool.dynamics.integrator import GAMMA
from whiptool.dynamics.system import Hand, Instant, Reaction, System
from whiptool.impedance.controller import Controller
from whiptool.impedance.law import LAWS
from whiptool.models.parameters import ArmParameters, Model

_OPTIONAL = ("rest_angle", "dry_friction", "drag", "cubic_stiffness")  # per node, generated only where used
_LINK = {  # quantities of a link: what they are called in a whip
    "length": "l", "mass": "m", "stiffness": "k", "damping": "b", "rest_angle": "rest_angle",
    "dry_friction": "dry_friction", "drag": "drag", "cubic_stiffness": "cubic_stiffness", "drag_ratio": "drag_ratio",
    "friction_velocity": "friction_velocity",
}  # fmt: skip


@dataclass(frozen=True)
class Structure:
    """What of a model and controller decides which terms are generated; everything else is a parameter."""

    n_arm: int
    n_whip: int
    law: str
    optional: tuple[str, ...] = ()  # of _OPTIONAL, drag_ratio, hinge_mass
    feedforward: bool = False
    limited: bool = False
    held: bool = False  # the torque is held for a control period
    compensated: bool = False  # gravity compensation has masses of its own

    @classmethod
    def of(cls, model: Model, controller: Controller, *, free: Sequence[str] = ()) -> Structure:
        """The smallest structure that holds this model and controller, and the terms of parameters named in `free`."""
        named = {re.sub(r"^whip\.|\[\d+\]$", "", name) for name in free}
        named |= {"dry_friction"} if "friction_velocity" in named else set()
        named |= {"drag"} if "drag_ratio" in named else set()
        used = tuple(name for name in _OPTIONAL if model.whip.per_node(name).any() or name in named)
        if "drag" in used and (model.whip.drag_ratio != 1 or "drag_ratio" in named):
            used += ("drag_ratio",)
        used += ("hinge_mass",) if model.whip.hinge_mass or "hinge_mass" in named else ()
        return cls(
            n_arm=model.arm.n,
            n_whip=model.whip.N,
            law=controller.law.kind,
            optional=used,
            feedforward=controller.feedforward,
            limited=controller.torque_limit is not None,
            held=controller.control_period is not None,
            compensated=controller.compensated is not None,
        )

    @property
    def n(self) -> int:
        """Number of joints, those of the arm and of the whip."""
        return self.n_arm + self.n_whip

    @property
    def layout(self) -> dict[str, int]:
        """Name and size of every block of the parameter vector, in order."""
        a, N = self.n_arm, self.n_whip
        blocks = {"q_i": a, "q_f": a, "D": 1}
        blocks |= {f"arm.{name}": a for name in ArmParameters.QUANTITIES}
        blocks |= {f"whip.{name}": N for name in ("l", "m", "k", "b")}
        for name in self.optional:
            blocks[f"whip.{name}"] = 1 if name in ("drag_ratio", "hinge_mass") else N
        if "dry_friction" in self.optional:
            blocks["whip.friction_velocity"] = 1
        blocks["gravity"] = 1
        blocks |= {f"law.{name}": size for name, size in LAWS[self.law].sizes(a).items()}
        if self.limited:
            blocks["torque_limit"] = 1
        if self.compensated:
            blocks["compensated"] = a + 1
        return blocks

    @property
    def n_parameters(self) -> int:
        """Length of the parameter vector."""
        return sum(self.layout.values())

    def columns(self, block: str) -> slice:
        """Where a block of `layout` stands in the parameter vector."""
        return Columns(self.layout)[block]

    def pack(self, model: Model, controller: Controller, strikes: np.ndarray) -> np.ndarray:
        """Parameter vectors of many strikes of one model and controller.

        Args:
            model, controller: Of this structure.
            strikes: Strike vectors, shape (B, 2 n_arm + 1).

        Returns:
            Shape (B, n_parameters).
        """
        values: dict[str, Any] = {f"law.{k}": v for k, v in controller.law.parameters().items()}
        values |= {f"arm.{name}": model.arm.per_link(name) for name in ArmParameters.QUANTITIES}
        values |= {f"whip.{name}": model.whip.per_node(name) for name in ("l", "m", "k", "b", *_OPTIONAL)}
        values |= {
            f"whip.{name}": getattr(model.whip, name) for name in ("drag_ratio", "hinge_mass", "friction_velocity")
        }
        values |= {
            "gravity": model.gravity,
            "torque_limit": controller.torque_limit,
            "compensated": controller.compensated,
        }
        fixed = [np.ravel(values[name]) for name in self.layout if name not in ("q_i", "q_f", "D")]
        same = np.concatenate(fixed)
        return np.hstack([strikes, np.broadcast_to(same, (len(strikes), len(same)))])


class ClosedLoop(System):
    """Strike, controller, arm and whip of one structure: the arm's controller drives the whip.

    The input is the held torque (a, 1), or empty in a continuous loop.
    """

    def __init__(self, structure: Structure) -> None:
        self.structure = structure
        self.n_drive, self.n_links = structure.n_arm, structure.n_whip
        self.held = structure.held
        self.n_inputs = structure.n_arm if structure.held else 0
        self.parameters = {name: ca.SX.sym(name, size) for name, size in structure.layout.items()}
        self.p = ca.vertcat(*self.parameters.values())
        self.chain = self._chain()
        self.link_columns = {
            quantity: (structure.columns(f"whip.{name}").start, int(structure.layout[f"whip.{name}"] > 1))
            for quantity, name in _LINK.items()
            if f"whip.{name}" in structure.layout
        }

    def _chain(self) -> Chain:
        P, a, N = self.parameters, self.structure.n_arm, self.structure.n_whip
        mass, com, inertia = P["arm.mass"], P["arm.com"], P["arm.inertia"]
        if "whip.hinge_mass" in P:
            last = a - 1
            carried = ride_on_end(mass[last], com[last], inertia[last], P["arm.length"][last], P["whip.hinge_mass"])
            mass, com, inertia = (
                ca.vertcat(*ca.vertsplit(old)[:last], new)
                for old, new in zip((mass, com, inertia), carried, strict=True)
            )
        whip = {name: P.get(f"whip.{name}", ca.SX.zeros(N)) for name in _OPTIONAL}
        none = ca.SX.zeros(a)
        return Chain(
            length=ca.vertcat(P["arm.length"], P["whip.l"]),
            mass=ca.vertcat(mass, P["whip.m"]),
            com=ca.vertcat(com, P["whip.l"]),
            inertia=ca.vertcat(inertia, ca.SX.zeros(N)),
            stiffness=ca.vertcat(none, P["whip.k"]),
            damping=ca.vertcat(P["arm.friction"], P["whip.b"]),
            rest_angle=ca.vertcat(none, whip["rest_angle"]),
            dry_friction=ca.vertcat(none, whip["dry_friction"]),
            drag=ca.vertcat(none, whip["drag"]),
            cubic_stiffness=ca.vertcat(none, whip["cubic_stiffness"]),
            drag_ratio=P.get("whip.drag_ratio", 1.0),
            friction_velocity=P.get("whip.friction_velocity", 1.0),
            gravity=P["gravity"],
        )

    def _arm(self, *, mass: ca.SX, load: ca.SX | float, gravity: ca.SX | float) -> Chain:
        """The bare arm, of links of this `mass`; a point mass `load` at its hand as a last link of length zero."""
        P, zeros = self.parameters, ca.SX.zeros(self.structure.n_arm + 1)
        at_hand = ca.SX(0)
        return Chain(
            length=ca.vertcat(P["arm.length"], at_hand),
            mass=ca.vertcat(mass, load),
            com=ca.vertcat(P["arm.com"], at_hand),
            inertia=ca.vertcat(P["arm.inertia"], 0),
            stiffness=zeros,
            damping=zeros,
            rest_angle=zeros,
            dry_friction=zeros,
            drag=zeros,
            cubic_stiffness=zeros,
            gravity=gravity,
        )

    def reference(self, t: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Desired positions, velocities and accelerations (n_arm, 1) at time t (Eq. 1); at rest before 0, after D."""
        P = self.parameters
        s = ca.fmax(ca.fmin(t / P["D"], 1), 0)
        span = P["q_f"] - P["q_i"]
        position = P["q_i"] + span * (10 * s**3 - 15 * s**4 + 6 * s**5)  # Eq. 1
        velocity = span * (30 * s**2 - 60 * s**3 + 30 * s**4) / P["D"]
        acceleration = span * (60 * s - 180 * s**2 + 120 * s**3) / P["D"] ** 2
        return position, velocity, acceleration

    def torque(self, t: ca.SX, q: ca.SX, v: ca.SX) -> ca.SX:
        """The controller's torques (n_arm, 1) for the arm's `q` and `v` (n_arm, 1); Eq. 2."""
        q_d, v_d, a_d = self.reference(t)
        law = {name.removeprefix("law."): x for name, x in self.parameters.items() if name.startswith("law.")}
        tau = LAWS[self.structure.law].expression(law, q_d - q, v_d - v)
        P, a = self.parameters, self.structure.n_arm
        masses = P.get("compensated")
        if masses is None:
            masses = ca.vertcat(P["arm.mass"], ca.sum1(P["whip.m"]) + P.get("whip.hinge_mass", 0))
        loaded = self._arm(mass=masses[:a], load=masses[a], gravity=P["gravity"])
        tau += ca.gradient(potential_energy(loaded, ca.vertcat(q, 0)), q)  # Eq. 3
        if self.structure.feedforward:
            along = (ca.vertcat(x, 0) for x in (q_d, v_d, a_d))
            bare = self._arm(mass=P["arm.mass"], load=0, gravity=0)
            tau += inverse_dynamics(bare, *along)[:a] + P["arm.friction"] * v_d
        if self.structure.limited:
            limit = self.parameters["torque_limit"]
            tau = ca.fmin(ca.fmax(tau, -limit), limit)
        return tau

    def _torque_and_gain(self, now: Instant) -> tuple[ca.SX, ca.SX | None]:
        """The arm's torques (a, 1), and how they brake the arm's speed, `-d tau / d v` (a, a)."""
        a = self.structure.n_arm
        if self.structure.held:
            return now.u, None
        qa, va = ca.SX.sym("qa", a), ca.SX.sym("va", a)
        tau = self.torque(now.t, qa, va)
        return tuple(ca.substitute([tau, -ca.jacobian(tau, va)], [qa, va], [now.q, now.v]))  # type: ignore[return-value]

    def hand(self, q: ca.SX, v: ca.SX, u: ca.SX) -> Hand:
        """Return where the arm's hand is, and its links' ends."""
        frame, ends, angles, moving = JointFrame(), [], [], []
        for link, q_i, v_i in zip(self.chain.links, ca.vertsplit(q), ca.vertsplit(v), strict=False):
            frame, moves = articulated.outward(frame, q_i, v_i, link)
            ends.append(ca.horzcat(frame.x, frame.y))
            angles.append(frame.angle)
            moving.append(moves)
        return Hand(frame, ca.vertcat(*ends), ca.vertcat(*angles), moving)

    def react(self, now: Instant, before: ca.SX | None, moving: list[Moving], carried: Carried) -> Reaction:
        """Return how the controlled arm moves under what it carries; its joints are solved for together."""
        a, gravity = self.n_drive, self.parameters["gravity"]
        tau, gain = self._torque_and_gain(now)
        friction = self.parameters["arm.friction"]
        braked = GAMMA * now.h * friction
        loop = ca.SX.zeros(a, a) if gain is None else GAMMA * now.h * gain
        torque = tau - friction * now.v
        if before is not None:
            torque += 2 * braked * before + 2 * loop @ before
        carried_by = []
        for i in reversed(range(a)):
            carried = articulated.inward(carried, moving[i], self.chain.links[i])
            carried_by.append(carried)
        carried_by.reverse()
        joints = ca.vertsplit(torque), ca.vertsplit(braked)
        qdd = articulated.joint_together(carried_by, moving, *joints, loop, gravity)
        acceleration = Acceleration(ca.SX(0), gravity, ca.SX(0))
        for i in range(a):
            acceleration = articulated.accelerate(acceleration, qdd[i], moving[i])
        return Reaction(ca.vertcat(*qdd), acceleration, tau)

    @cached_property
    def control(self) -> ca.Function:
        """The controller alone: torques (n_arm, 1) at state x and time t, to hold where they are held."""
        n, a = self.structure.n, self.structure.n_arm
        x, t = ca.SX.sym("x", 2 * n), ca.SX.sym("t")
        tau = self.torque(t, x[:a], x[n : n + a])
        return ca.Function("control", [x, t, self.p], [tau], ["x", "t", "p"], ["tau"], {"cse": True})

    @cached_property
    def whip_balance(self) -> ca.Function:
        """Balance of the resting whip at q (n,): gradient (N,) and Hessian (N, N) of the potential energy with respect
        to the whip's joints, and the gradient's change (N,) along dq (arm joints only) and dp."""
        q, dq, dp = ca.SX.sym("q", self.structure.n), ca.SX.sym("dq", self.structure.n), ca.SX.sym("dp", self.p.numel())
        a = self.structure.n_arm
        hessian, gradient = ca.hessian(potential_energy(self.chain, q), q)
        change = ca.jtimes(gradient, q, dq) + ca.jtimes(gradient, self.p, dp)
        outputs = [gradient[a:], hessian[a:, a:], change[a:]]
        return ca.Function("whip_balance", [q, self.p, dq, dp], outputs, {"cse": True})


@lru_cache(maxsize=32)
def closed_loop(structure: Structure) -> ClosedLoop:
    """The closed loop of a structure, derived once per process."""
    return ClosedLoop(structure)
