"""Simulated whips with random parameters that are unknown to the planner.

The parameters are drawn from a stock (`whiptool.adaptation.materials`); the family determines how far the structure
deviates from the model that is fitted.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from whiptool.adaptation.materials import Stock, stock_of_model, uniform_whip
from whiptool.errors import expect
from whiptool.extras import Registry
from whiptool.impedance import OIAC, Controller
from whiptool.models.numbers import whole
from whiptool.models.parameters import AnyArm, Model
from whiptool.models.whip import WhipParameters

NODES = 36  # of a strange whip
_SMOOTH = 3  # waves along a strange whip
BEND = 0.3 / 0.072  # curvature [1/m] that nine strikes in ten at the published whip stay below


@dataclass(frozen=True)
class Twin:
    """A simulated arm, whip and camera whose parameters differ from those of the model that plans."""

    family: str  # of unknown whips, see `draw_twin`
    seed: int  # with which the twin was drawn
    model: Model  # the true arm and whip
    controller: Controller  # as it really acts on the arm
    latency: float  # round-trip delay of the servos' bus [s]
    clock_offset: float  # delay of the camera's clock [s]
    noise: float  # standard deviation of a measured tip position without simulated images [m]

    def __repr__(self) -> str:
        whip = self.model.whip
        of = f"whip of {whip.length:.2f} m and {whip.mass:.3f} kg, {whip.N} nodes"
        return f"Twin({self.family}, seed {self.seed}: {of})"


def draw_twin(family: str, seed: int, model: Model, controller: Controller, stock: Stock | None = None) -> Twin:
    """Draw an unknown whip: length, density, stiffness, damping, drag and friction from a material, its structure by
    family.

    `kin`: a uniform whip, with the model's drag and friction if `stock` is None, and slight friction in the arm.
    `strange`: 36 nodes; the tip is 10 to 30 % thinner than the root, mass scales with the square of the thickness and
    bending stiffness with its fourth power, with smooth random deviations; a bead; one soft joint; rest curvature;
    springs that stiffen with the bending angle, by up to 30 % where a strike bends most; less drag along the whip than
    across; friction that differs from joint to joint; arm mass, controller gain and arm friction differ from the
    model's; the camera's clock is off by up to 8 ms. `stranger`: as `strange`, with every deviation doubled. In space
    the arm is a robot that follows its commands: arm and gain are the model's, and rods have no rest curvature.

    Args:
        family: One of `FAMILIES`.
        seed: A whole number >= 0; with the same seed `strange` and `stranger` deviate in the same directions, and have
            the same parameters from the stock.
        model, controller: The nominal model and its controller; the twin has the model's arm.
        stock: Distribution of the whip's material parameters; None: centred on those of the model.

    Raises:
        InputError: The family or seed is not allowed, or there is no stock and the model has values per node.
    """
    expect(Model, model=model)
    expect(Controller, controller=controller)
    kind, seed = FAMILIES.find(family), whole("seed", seed, low=0)
    own = None if stock is not None else model.whip
    stock = stock or stock_of_model(model)
    rng = np.random.default_rng([kind.stream, seed])
    latency, noise = float(rng.uniform(0.0005, 0.0015)), 0.005
    true, acting, offset = kind.draw(stock.draw(rng), rng, model, controller)
    if own is not None and kind.like_model:
        whip = dataclasses.replace(true.whip, drag=own.drag, dry_friction=own.dry_friction)
        true = dataclasses.replace(true, whip=whip)
    family = FAMILIES.name(family)
    true = dataclasses.replace(true, name=f"{family}-{seed}")
    return Twin(family, int(seed), true, acting, latency, offset, noise)


Drawn = tuple[
    Model, Controller, float
]  # the true model, the controller as it acts, the delay of the camera's clock [s]


@dataclass(frozen=True)
class Family:
    """A family of simulated unknown whips, see `draw_twin`.

    Args:
        stream: Whole number with which random numbers are seeded, next to the seed: families with the same number
            deviate in the same directions.
        draw: Function that draws a whip from the parameters of a stock, a generator, and the nominal model and
            controller.
        like_model: Whether whips have the drag and the friction of the nominal model if no stock is given.
    """

    stream: int
    draw: Callable[[Mapping[str, float], np.random.Generator, Model, Controller], Drawn]
    like_model: bool = False


def _kin(numbers: Mapping[str, float], rng: np.random.Generator, model: Model, controller: Controller) -> Drawn:
    friction = rng.uniform(0.0, 0.01, model.arm.n)
    arm = model.arm if model.dimension == 3 else _with_friction(model, friction)
    return Model(uniform_whip(numbers, model.whip), arm, model.gravity), controller, 0.0


def _strange(
    numbers: Mapping[str, float], rng: np.random.Generator, model: Model, controller: Controller, *, size: float = 1.0
) -> Drawn:
    strange = _strange_whip(numbers, rng, size)
    if model.dimension == 3:  # there the arm is a robot's, which follows its command exactly
        strange = _joined_in_space(strange, model.whip)
        offset = float(size * rng.uniform(-0.008, 0.008))
        return Model(strange, model.arm, model.gravity), controller, offset
    factors = np.exp(size * rng.uniform(-0.08, 0.08, model.arm.n)).tolist()
    heavier = {f"arm.{x}[{i}]": f for x in ("mass", "inertia") for i, f in enumerate(factors)}
    named = model.parameters()
    arm = _with_friction(
        model.with_parameters({name: named[name] * f for name, f in heavier.items()}),
        size * rng.uniform(0.0, 0.01, model.arm.n),
    )
    gain = float(np.exp(size * rng.uniform(-0.08, 0.08)))
    offset = float(size * rng.uniform(-0.008, 0.008))
    return Model(strange, arm, model.gravity), _with_gain(controller, gain), offset


FAMILIES: Registry[Family] = Registry(
    "families",
    Family,
    {
        "kin": Family(0, _kin, like_model=True),
        "strange": Family(1, _strange),
        "stranger": Family(1, partial(_strange, size=2.0)),
    },
    what="family",
)


def _strange_whip(numbers: Mapping[str, float], rng: np.random.Generator, size: float) -> WhipParameters:
    """36 nodes with the numbers of a stock at the handle; `size` 1 is strange."""
    x = (np.arange(NODES) + 0.5) / NODES  # place along the whip
    thickness = 1 - size * rng.uniform(0.1, 0.3) * x
    l = numbers["length"] / NODES
    m = numbers["linear_density"] * l * thickness**2 * _waves(x, rng, 0.12 * size)
    k = numbers["bending_stiffness"] / l * thickness**4 * _waves(x, rng, 0.12 * size)
    b = numbers["bending_damping"] / l * thickness**4 * _waves(x, rng, 0.12 * size)
    m[rng.integers(NODES // 4, NODES - 2)] += size * rng.uniform(0.001, 0.004)  # the bead
    k[rng.integers(2, NODES - 4)] *= 0.4**size  # the soft joint
    rest = np.full(NODES, size * rng.uniform(-0.2, 0.2) * l)
    friction = numbers["dry_friction"] * np.exp(size * rng.uniform(-0.5, 0.5, NODES))
    for joint in (k, b, rest, friction):
        joint[0] = 0.0  # the free hinge
    stiffening = size * rng.uniform(0.0, 0.3)
    return WhipParameters(
        N=NODES,
        l=float(l),
        m=tuple(m.tolist()),
        k=tuple(k.tolist()),
        b=tuple(b.tolist()),
        rest_angle=tuple(rest.tolist()),
        dry_friction=tuple(friction.tolist()),
        cubic_stiffness=tuple((stiffening * k / (BEND * l) ** 2).tolist()),
        drag=tuple((numbers["drag"] * l * thickness).tolist()),
        drag_ratio=float(1 - size * rng.uniform(0.2, 0.475)),
    )


def _joined_in_space(whip: WhipParameters, like: WhipParameters) -> WhipParameters:
    """A whip joined as another one in space; rods do not twist with the hand: their bend would have no direction."""
    rest = 0.0 if like.joints == "rod" else whip.rest_angle
    inertia = float(like.per_node("node_inertia").mean())
    return dataclasses.replace(whip, joints=like.joints, rest_angle=rest, node_inertia=inertia)


def _waves(x: np.ndarray, rng: np.random.Generator, size: float) -> np.ndarray:
    """A smooth positive factor along the whip, its logarithm of this standard deviation."""
    log = np.zeros_like(x)
    for i in range(1, _SMOOTH + 1):
        log += rng.normal() * np.cos(i * np.pi * x + rng.uniform(0, 2 * np.pi))
    return np.exp(size * log * np.sqrt(2 / _SMOOTH))


def _with_friction(model: Model, friction: np.ndarray) -> AnyArm:
    """The model's arm, with more friction in its joints."""
    named = model.parameters()
    added = {f"arm.friction[{i}]": x for i, x in enumerate(friction.tolist())}
    return model.with_parameters({name: named[name] + x for name, x in added.items()}).arm


def _with_gain(controller: Controller, gain: float) -> Controller:
    """The same law, its torque multiplied."""
    law = controller.law
    if isinstance(law, OIAC):
        return dataclasses.replace(controller, law=dataclasses.replace(law, a=law.a / gain))
    scaled = {name: gain * x if name in ("K", "B") else x for name, x in law.parameters().items()}
    return dataclasses.replace(controller, law=law.changed(scaled))
