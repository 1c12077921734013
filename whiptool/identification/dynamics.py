"""The two systems that a recording can be predicted with: the commanded strike, and a chain on a moving base.

Both are functions of one shape, so that one engine rolls them out: `advance(x, t, h, p, u)` gives the state a step
later, `observe(x, p, u)` the chain's link ends and absolute angles, `hold(x, t, p)` the torque to hold, if one is held.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from whiptool.dynamics.chain import Base, Chain, forward_dynamics, link_ends, passive_torque
from whiptool.dynamics.closed_loop import Structure, closed_loop

GAMMA = 1 - 1 / math.sqrt(2)  # of the Rosenbrock method: L-stable
BASE = 7  # numbers that describe the base at one instant, in the order of `Base`
_OPTIONAL = ("stiffness", "rest_angle", "dry_friction", "drag", "cubic_stiffness", "drag_ratio")


def _observation(chain: Chain, q: ca.SX, angle: ca.SX | float) -> ca.SX:
    """Link ends from the base (x, y of each link in turn) and the links' absolute angles, (3 n, 1)."""
    turned = ca.SX(q)
    turned[0] += angle
    return ca.vertcat(ca.vec(link_ends(chain, turned).T), ca.cumsum(turned))


class CommandedStrike:
    """Strike, controller, arm and whip: the closed loop of `whiptool.models`, seen at every link."""

    def __init__(self, structure: Structure) -> None:
        self._loop = closed_loop(structure)
        self.n, self.n_parameters = structure.n, structure.n_parameters
        self.held = structure.held
        self.n_inputs = structure.n_arm if structure.held else 0

    @cached_property
    def advance(self) -> ca.Function:
        """`x_next(x, t, h, p, u)`, u the held torque or empty."""
        step = self._loop.step
        inputs = [ca.SX.sym(step.name_in(i), step.size_in(i)) for i in range(step.n_in())]
        return ca.Function("advance", inputs, [step(*inputs)[0]], {"cse": True})

    @cached_property
    def observe(self) -> ca.Function:
        """Function `y(x, p, u)`: what is observed of a state."""
        x, u = ca.SX.sym("x", 2 * self.n), ca.SX.sym("u", self.n_inputs)
        return ca.Function("observe", [x, self._loop.p, u], [_observation(self._loop.chain, x[: self.n], 0.0)])

    @cached_property
    def hold(self) -> ca.Function | None:
        """Function `u(x, t, p)`: what is held between two samples; None where nothing is."""
        if not self.held:
            return None
        control = self._loop.control
        inputs = [ca.SX.sym(control.name_in(i), control.size_in(i)) for i in range(control.n_in())]
        return ca.Function("hold", inputs, [control(*inputs)], {"cse": True})


@dataclass(frozen=True)
class SwingStructure:
    """What decides which terms of a swinging chain are generated.

    Args:
        n: Links.
        moving: The base moves; its motion is the input.
        point_masses: Every link is a point mass at its far end: com is the length, and there is no inertia.
        optional: Which of `_OPTIONAL` there are.
    """

    n: int
    moving: bool
    point_masses: bool
    optional: tuple[str, ...] = ()

    @property
    def layout(self) -> dict[str, int]:
        """Name and size of every block of the parameter vector, in order."""
        blocks = ["length", "mass", *(() if self.point_masses else ("com", "inertia")), "damping", *self.optional]
        sizes = dict.fromkeys(blocks, self.n)
        if "dry_friction" in self.optional:
            sizes["friction_velocity"] = 1
        if "drag_ratio" in self.optional:
            sizes["drag_ratio"] = 1
        return sizes | {"gravity": 1}

    @property
    def n_parameters(self) -> int:
        """Length of the parameter vector."""
        return sum(self.layout.values())

    @classmethod
    def of(cls, *, n: int, moving: bool, point_masses: bool, used: Sequence[str]) -> SwingStructure:
        """With the terms of these quantities."""
        return cls(n, moving, point_masses, tuple(name for name in _OPTIONAL if name in used))

    def pack(self, values: Mapping[str, np.ndarray | float]) -> np.ndarray:
        """The parameter vector (n_parameters,) of quantities by name, each (n,) or one number."""
        return np.concatenate(
            [np.ravel(np.broadcast_to(np.asarray(values[name], float), size)) for name, size in self.layout.items()]
        )


class Swing:
    """A chain that hangs from a base whose motion is given, or from a fixed one.

    The input is the base at the step's start and end, `(angle, omega, alpha, vx, vy, ax, ay)` each; empty if the base
    is fixed. The integrator is that of the closed loop (Rosenbrock-W, second order); its approximate Jacobian knows
    the joints' damping.
    """

    held = False
    hold = None

    def __init__(self, structure: SwingStructure) -> None:
        self.structure = structure
        self.n, self.n_parameters = structure.n, structure.n_parameters
        self.n_inputs = 2 * BASE if structure.moving else 0
        P = {name: ca.SX.sym(name, size) for name, size in structure.layout.items()}
        self.p = ca.vertcat(*P.values())
        zeros = ca.SX.zeros(self.n)
        self.chain = Chain(
            length=P["length"],
            mass=P["mass"],
            com=P["length"] if structure.point_masses else P["com"],
            inertia=zeros if structure.point_masses else P["inertia"],
            stiffness=P.get("stiffness", zeros),
            damping=P["damping"],
            rest_angle=P.get("rest_angle", zeros),
            dry_friction=P.get("dry_friction", zeros),
            drag=P.get("drag", zeros),
            cubic_stiffness=P.get("cubic_stiffness", zeros),
            drag_ratio=P.get("drag_ratio", 1.0),
            friction_velocity=P.get("friction_velocity", 1.0),
            gravity=P["gravity"],
        )

    @cached_property
    def advance(self) -> ca.Function:
        """`x_next(x, t, h, p, u)`; Verwer et al. (1999), as `ClosedLoop.step`."""
        n, chain = self.n, self.chain
        x, t, h, u = ca.SX.sym("x", 2 * n), ca.SX.sym("t"), ca.SX.sym("h"), ca.SX.sym("u", self.n_inputs)
        q, v = x[:n], x[n:]
        start, end = (Base(*ca.vertsplit(part)) for part in (u[:BASE], u[BASE:])) if self.n_inputs else (None, None)

        def stage(q: ca.SX, v: ca.SX, base: Base | None, before: ca.SX | None) -> ca.SX:
            smooth = ca.SX(chain.friction_velocity) ** 2
            square = v**2 + smooth
            # not square**1.5, see `whiptool.dynamics.closed_loop`
            slope = ca.SX(chain.damping) + ca.SX(chain.dry_friction) * smooth / (square * ca.sqrt(square))
            braked = GAMMA * h * slope
            torque = passive_torque(chain, q, v)
            if before is not None:
                torque += 2 * braked * before
            return forward_dynamics(chain, q, v, torque, armature=braked, base=base)

        k1 = stage(q, v, start, None)
        w = stage(q + h * v, v + h * k1, end, k1)
        x_next = ca.vertcat(q + h * v + h**2 / 2 * k1, v + h / 2 * (k1 + w))
        return ca.Function("advance", [x, t, h, self.p, u], [x_next], {"cse": True})

    @cached_property
    def observe(self) -> ca.Function:
        """`y(x, p, u)`; link ends are counted from the base."""
        x, u = ca.SX.sym("x", 2 * self.n), ca.SX.sym("u", self.n_inputs)
        angle = u[0] if self.n_inputs else 0.0
        return ca.Function("observe", [x, self.p, u], [_observation(self.chain, x[: self.n], angle)], {"cse": True})


Dynamics = CommandedStrike | Swing  # `n` joints, states of length 2 n; `hold` is None unless a torque is `held`


@lru_cache(maxsize=32)
def dynamics(structure: Structure | SwingStructure) -> Dynamics:
    """The system of a structure, derived once per process."""
    return CommandedStrike(structure) if isinstance(structure, Structure) else Swing(structure)
