"""The closed loop of strike, controller, arm and whip as one CasADi step, and its second-order integrator."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np

from whiptool.dynamics.chain import (
    Chain,
    forward_dynamics,
    inverse_dynamics,
    passive_torque,
    potential_energy,
    ride_on_end,
    tip_state,
)
from whiptool.impedance.controller import Controller
from whiptool.impedance.law import LAWS
from whiptool.models.parameters import ArmParameters, Model

_OPTIONAL = ("rest_angle", "dry_friction", "drag", "cubic_stiffness")  # per node, generated only where used
GAMMA = 1 - 1 / math.sqrt(2)  # of the Rosenbrock method: L-stable


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
        start = 0
        for name, size in self.layout.items():
            if name == block:
                return slice(start, start + size)
            start += size
        raise KeyError(block)

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


def _friction_gain(chain: Chain, v: ca.SX) -> ca.SX:
    """Slope of the joints' damping and smoothed friction against their speed [N m s/rad], (n, 1)."""
    smooth = chain.friction_velocity**2
    square = v**2 + smooth
    # not square**1.5: a power is taken lane by lane, and would cost more than all else in a step
    return ca.SX(chain.damping) + ca.SX(chain.dry_friction) * smooth / (square * ca.sqrt(square))


class ClosedLoop:
    """Symbolic closed loop of one structure.

    `step(x, t, h, p, tau)` advances the state x = [q, v] by one step of h seconds and also returns, at its start, tip
    position and velocity and the arm's torques; `control(x, t, p)` gives the torques to hold. `tau` is empty in a
    continuous loop.
    """

    def __init__(self, structure: Structure) -> None:
        self.structure = structure
        self.parameters = {name: ca.SX.sym(name, size) for name, size in structure.layout.items()}
        self.p = ca.vertcat(*self.parameters.values())
        self.chain = self._chain()

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

    def _torque_and_gain(self, t: ca.SX, q: ca.SX, v: ca.SX, held: ca.SX) -> tuple[ca.SX, ca.SX | None]:
        """The arm's torques (a, 1), and how they brake the arm's speed, `-d tau / d v` (a, a)."""
        a = self.structure.n_arm
        if self.structure.held:
            return held, None
        qa, va = ca.SX.sym("qa", a), ca.SX.sym("va", a)
        tau = self.torque(t, qa, va)
        return tuple(ca.substitute([tau, -ca.jacobian(tau, va)], [qa, va], [q[:a], v[:a]]))  # type: ignore[return-value]

    @cached_property
    def step(self) -> ca.Function:
        """One step of the two-stage Rosenbrock-W method of order 2 (ROS2).

        Verwer, Spee, Blom, Hundsdorfer (1999), SIAM J. Sci. Comput. 20(4), 1456-1480:
        `(1 - gamma h A) k1 = f(y)`, `(1 - gamma h A) k2 = f(y + h k1) - 2 k1`, `y+ = y + 3/2 h k1 + 1/2 h k2`,
        of order 2 for any A. Here A knows only `-M^-1 G`, G the joints' damping and the controller's
        velocity gain, so a stage is one articulated-body pass with `gamma h G` added to the mass matrix. With
        `w = k2 + 2 k1` the second stage reads `(M + gamma h G) w = F + 2 gamma h G k1`.
        """
        S, n, a = self.structure, self.structure.n, self.structure.n_arm
        x, t, h = ca.SX.sym("x", 2 * n), ca.SX.sym("t"), ca.SX.sym("h")
        held = ca.SX.sym("tau", a if S.held else 0)
        q, v = x[:n], x[n:]

        def stage(t: ca.SX, q: ca.SX, v: ca.SX, before: ca.SX | None) -> tuple[ca.SX, ca.SX]:
            tau, gain = self._torque_and_gain(t, q, v, held)
            joints = GAMMA * h * _friction_gain(self.chain, v)
            loop = None if gain is None else GAMMA * h * gain
            torque = passive_torque(self.chain, q, v)
            torque[:a] += tau
            if before is not None:
                torque += 2 * joints * before
                if loop is not None:
                    torque[:a] += 2 * loop @ before[:a]
            return forward_dynamics(self.chain, q, v, torque, armature=joints, coupling=loop), tau

        k1, tau = stage(t, q, v, None)
        w, _ = stage(t + h, q + h * v, v + h * k1, k1)
        x_next = ca.vertcat(q + h * v + h**2 / 2 * k1, v + h / 2 * (k1 + w))
        tip = ca.vertcat(*tip_state(self.chain, q, v))
        return ca.Function(
            "step",
            [x, t, h, self.p, held],
            [x_next, tip, tau],
            ["x", "t", "h", "p", "tau_held"],
            ["x_next", "tip", "tau"],
            {"cse": True},
        )

    @cached_property
    def control(self) -> ca.Function:
        """The controller alone: torques (n_arm, 1) at state x and time t."""
        n, a = self.structure.n, self.structure.n_arm
        x, t = ca.SX.sym("x", 2 * n), ca.SX.sym("t")
        tau = self.torque(t, x[:a], x[n : n + a])
        return ca.Function("control", [x, t, self.p], [tau], ["x", "t", "p"], ["tau"], {"cse": True})

    @cached_property
    def step_forward(self) -> ca.Function:
        """`step` with its derivative along one direction (dx, dt, dh, dp, dtau); CasADi's forward mode."""
        return _with_forward(self.step, ["x_next", "tip"])

    @cached_property
    def control_forward(self) -> ca.Function:
        """`control` with its derivative along one direction (dx, dt, dp)."""
        return _with_forward(self.control, ["tau"])

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


def _with_forward(function: ca.Function, differentiated: list[str]) -> ca.Function:
    """All outputs of a function, then the derivatives of some along one direction of all inputs."""
    inputs = [ca.SX.sym(function.name_in(i), function.size_in(i)) for i in range(function.n_in())]
    direction = [ca.SX.sym("d", *x.shape) for x in inputs]
    outputs = function.call(inputs)
    chosen = [outputs[function.index_out(name)] for name in differentiated]
    slopes = ca.forward(chosen, inputs, [direction])[0]
    return ca.Function(function.name(), [*inputs, *direction], [*outputs, *slopes], {"cse": True})


@lru_cache(maxsize=32)
def closed_loop(structure: Structure) -> ClosedLoop:
    """The closed loop of a structure, derived once per process."""
    return ClosedLoop(structure)
