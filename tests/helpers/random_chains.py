"""Random chains, their numbers and symbols, and accelerations by three engines."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cache

import casadi as ca
import mujoco
import numpy as np
import pinocchio as pin
from hypothesis import settings
from hypothesis import strategies as st
from lagrangian import link_ends, tip_state

from whiptool.dynamics.chain import (
    Chain,
    bias_forces,
    forward_dynamics,
    kinetic_energy,
    mass_matrix,
    passive_torque,
    potential_energy,
)
from whiptool.impedance.arm import pinocchio_chain

VECTORS = [f.name for f in fields(Chain)][:10]
SCALARS = ("drag_ratio", "friction_velocity", "gravity")
POINT_INERTIA = 1e-9  # [kg m^2] of point masses wherever MuJoCo takes part; it refuses zero
EPS = np.finfo(float).eps
Key = tuple[int, str, bool, bool]  # links, pattern of point masses, drag, inertia of point masses


def pinocchio_of(chain: Chain) -> pin.Model:
    """The same links in Pinocchio."""
    return pinocchio_chain(chain.length, chain.mass, chain.com, chain.inertia, chain.gravity)


@dataclass(frozen=True)
class Case:
    """What hypothesis chooses: the chain's structure, and the seed of its numbers.

    `points` is the pattern of point masses on massless links among the rods: all rods, all points, two rods then
    points (arm and whip), or taking turns.
    """

    n: int
    points: str
    drag: bool
    friction: bool
    moving: bool
    seed: int

    @property
    def key(self) -> Key:
        """What decides the generated code; point masses without any inertia."""
        return self.n, self.points, self.drag, False

    @property
    def heavy_key(self) -> Key:
        """The same, with an inertia for the point masses too."""
        return self.n, self.points, self.drag, True


def is_point(pattern: str, i: int) -> bool:
    return {"none": False, "all": True, "whip": i >= 2, "turns": i % 2 == 1}[pattern]


def cases(sizes: st.SearchStrategy[int], points=("none", "all", "whip", "turns")) -> st.SearchStrategy[Case]:
    return st.builds(
        Case,
        n=sizes,
        points=st.sampled_from(points),
        drag=st.booleans(),
        friction=st.booleans(),
        moving=st.sampled_from([True, True, True, False]),
        seed=st.integers(0, 2**32 - 1),
    )


def examples(number: int):
    return settings(max_examples=number, deadline=None, derandomize=True, database=None)


@dataclass(frozen=True)
class Numbers:
    """A chain of numbers and a state of it."""

    chain: Chain
    q: np.ndarray
    v: np.ndarray
    tau: np.ndarray

    @property
    def p(self) -> np.ndarray:
        c = self.chain
        return np.concatenate([*(getattr(c, name) for name in VECTORS), [getattr(c, name) for name in SCALARS]])


def numbers(case: Case, point_inertia: float = 0.0) -> Numbers:
    """Random chain and state.

    Uniform: length 0.05..0.4 m; mass 0.01..0.5 kg; rods' centre of mass at 0.2..0.8 of the length, their radius of
    gyration 0.1..0.4 of it; stiffness 0..1 N m/rad; rest angle -0.5..0.5 rad; damping 0..0.1 N m s/rad; dry friction
    0..0.05 N m at 0.05..1 rad/s; drag 0..0.02 N s^2/m^2, along the link 0..1.5 of that; cubic stiffness 0..0.3
    N m/rad^3; gravity 0..15 m/s^2; q -pi..pi rad; v -5..5 rad/s or 0; torque -1..1 N m.
    """
    rng, n = np.random.default_rng(case.seed), case.n
    points = np.array([is_point(case.points, i) for i in range(n)])
    length, mass = rng.uniform(0.05, 0.4, n), rng.uniform(0.01, 0.5, n)
    chain = Chain(
        length=length,
        mass=mass,
        com=length * np.where(points, 1, rng.uniform(0.2, 0.8, n)),
        inertia=np.where(points, point_inertia, mass * (length * rng.uniform(0.1, 0.4, n)) ** 2),
        stiffness=rng.uniform(0, 1, n),
        rest_angle=rng.uniform(-0.5, 0.5, n),
        damping=rng.uniform(0, 0.1, n),
        dry_friction=rng.uniform(0, 0.05, n) * case.friction,
        drag=rng.uniform(0, 0.02, n) * case.drag,
        cubic_stiffness=rng.uniform(0, 0.3, n),
        drag_ratio=rng.uniform(0, 1.5),
        friction_velocity=rng.uniform(0.05, 1),
        gravity=rng.uniform(0, 15),
    )
    q, v, tau = rng.uniform(-np.pi, np.pi, n), rng.uniform(-5, 5, n), rng.uniform(-1, 1, n)
    return Numbers(chain, q, v * case.moving, tau)


@dataclass(frozen=True)
class Symbols:
    chain: Chain
    p: ca.SX
    q: ca.SX
    v: ca.SX
    tau: ca.SX

    def function(self, *outputs: ca.SX, extra: tuple[ca.SX, ...] = (), cse: bool = False) -> ca.Function:
        return ca.Function("f", [self.p, self.q, self.v, self.tau, *extra], outputs, {"cse": cse})


@cache
def symbols(key: Key) -> Symbols:
    """A symbolic chain whose point masses, missing drag and missing inertia are known to the code that derives."""
    n, points, drag, point_inertia = key
    s = {name: ca.SX.sym(name, n) for name in VECTORS}
    scalars = {name: ca.SX.sym(name) for name in SCALARS}
    p = ca.vertcat(*s.values(), *scalars.values())
    for i in range(n):
        if is_point(points, i):
            s["com"][i] = s["length"][i]
            s["inertia"][i] = s["inertia"][i] if point_inertia else 0
    if not drag:
        s["drag"] = ca.SX.zeros(n)
    chain = Chain(**s, **scalars)
    return Symbols(chain, p, ca.SX.sym("q", n), ca.SX.sym("v", n), ca.SX.sym("tau", n))


@cache
def acceleration(key: Key) -> ca.Function:
    s = symbols(key)
    return s.function(forward_dynamics(s.chain, s.q, s.v, s.tau + passive_torque(s.chain, s.q, s.v)))


def evaluate(function: ca.Function, x: Numbers, *extra) -> list[np.ndarray]:
    """The function's outputs, columns as (n,)."""
    outputs = [np.array(y) for y in function.call([x.p, x.q, x.v, x.tau, *extra])]
    return [y[:, 0] if y.shape[1] == 1 else y for y in outputs]


def end_positions(length: np.ndarray, q: np.ndarray) -> np.ndarray:
    theta = np.cumsum(q)
    return np.cumsum(np.stack([length * np.sin(theta), -length * np.cos(theta)], axis=1), axis=0)  # (n, 2)


def end_jacobians(length: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Jacobians of the links' ends (n, 2, n) by the complex step."""
    columns = [end_positions(length, q + 1e-30j * unit).imag / 1e-30 for unit in np.eye(len(q))]
    return np.stack(columns, axis=2)


def drag_torque(x: Numbers) -> np.ndarray:
    J = end_jacobians(x.chain.length, x.q)
    u = J @ x.v  # (n, 2)
    links = np.diff(end_positions(x.chain.length, x.q), axis=0, prepend=0.0) / x.chain.length[:, None]
    along = (u * links).sum(axis=1, keepdims=True) * links
    braked = (u - along) + x.chain.drag_ratio * along
    force = -x.chain.drag[:, None] * np.linalg.norm(u, axis=1, keepdims=True) * braked
    return np.einsum("ikj,ik->j", J, force)


def friction_torque(x: Numbers) -> np.ndarray:
    return -x.chain.dry_friction * x.v / np.hypot(x.v, x.chain.friction_velocity)


def spring_torque(x: Numbers) -> np.ndarray:
    bent = x.q - x.chain.rest_angle
    return -x.chain.stiffness * bent - x.chain.cubic_stiffness * bent**3


def mujoco_chain(chain: Chain) -> mujoco.MjModel:
    opening = "".join(
        f'<body pos="0 0 {-chain.length[i - 1] if i else 0!r}">'
        f'<inertial pos="0 0 {-chain.com[i]!r}" mass="{chain.mass[i]!r}"'
        f' diaginertia="{chain.inertia[i]!r} {chain.inertia[i]!r} {chain.inertia[i]!r}"/>'
        f'<joint type="hinge" axis="0 -1 0" stiffness="{chain.stiffness[i]!r} 0 {chain.cubic_stiffness[i]!r}"'
        f' springref="{chain.rest_angle[i]!r}" damping="{chain.damping[i]!r}"/>'
        for i in range(chain.n)
    )
    xml = f"""<mujoco><compiler angle="radian"/><option gravity="0 0 {-chain.gravity!r}"/>
    <worldbody>{opening}{"</body>" * chain.n}</worldbody></mujoco>"""
    return mujoco.MjModel.from_xml_string(xml.replace("np.float64(", "").replace(")", ""))


def accelerations(case: Case) -> tuple[np.ndarray, dict[str, np.ndarray], float]:
    """Ours, the engines', and the mass matrix's condition number."""
    x = numbers(case, POINT_INERTIA)
    ours = evaluate(acceleration(case.heavy_key), x)[0]
    applied = x.tau + friction_torque(x) + drag_torque(x)
    mj = mujoco_chain(x.chain)
    data = mujoco.MjData(mj)
    data.qpos[:], data.qvel[:], data.qfrc_applied[:] = x.q, x.v, applied
    mujoco.mj_forward(mj, data)
    model = pinocchio_of(x.chain)
    passive = spring_torque(x) - x.chain.damping * x.v
    by_pinocchio = pin.aba(model, model.createData(), x.q, x.v, applied + passive)
    M = np.empty((case.n, case.n))
    mujoco.mj_fullM(mj, data, M)
    return ours, {"MuJoCo": data.qacc.copy(), "Pinocchio": by_pinocchio}, np.linalg.cond(M)


def worst(a: np.ndarray, b: np.ndarray) -> float:
    """Largest difference, relative to the largest entry."""
    return float(np.abs(a - b).max() / np.abs(b).max())


def tolerance(condition: float) -> float:
    """Relative error that rounding leaves to engines that factorise the mass matrix: `eps cond(M)`; over a thousand
    chains of up to 30 links the largest was 0.4 of that. Ten times it is allowed."""
    return 10 * EPS * condition


@cache
def terms(key: Key) -> ca.Function:
    """Mass matrix, bias, kinetic and potential energy, the latter's gradient, ends, tip."""
    s = symbols(key)
    V = potential_energy(s.chain, s.q)
    return s.function(
        mass_matrix(s.chain, s.q),
        bias_forces(s.chain, s.q, s.v),
        kinetic_energy(s.chain, s.q, s.v),
        V,
        ca.gradient(V, s.q),
        link_ends(s.chain, s.q),
        *tip_state(s.chain, s.q, s.v),
    )
