"""The identified plant: a model, its controller and optionally its profile, with all parameters by name."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import tomli_w

from whiptool.dynamics.structure import LUMPED, lumping, profile_slopes
from whiptool.errors import InputError, expect
from whiptool.given_files import build_from, read_toml
from whiptool.impedance.controller import Controller
from whiptool.models.numbers import number
from whiptool.models.parameters import ArmLink, ArmParameters, Model
from whiptool.models.profile import WhipProfile
from whiptool.models.whip import WhipParameters
from whiptool.whole_files import write_whole

EACH = ("dry_friction", "drag", "zero")  # numbers per link in addition to those of a link itself
SHARED = ("gravity", "friction_velocity")  # numbers of the whole arm


@dataclass(frozen=True)
class BareArm:
    """Rigid links in a row that swing freely, the first on a fixed pivot: a model for a `Plant`, in place of arm and
    whip.

    Args:
        arm: The links; `friction` is viscous, of a link's own joint.
        dry_friction: Dry friction of each joint at high speed [N m], one per link; empty: none.
        friction_velocity: Joint speed around which dry friction changes its sign smoothly [rad/s].
        drag: Quadratic air drag at each link's end [N s^2/m^2], one per link; empty: none.
        gravity: Gravity [m/s^2].
        name: A label only.
        zero: What each link's encoder reads while the link hangs straight down [rad], one per link; empty: 0.

    Raises:
        InputError: A value is not allowed.
    """

    arm: ArmParameters
    dry_friction: tuple[float, ...] = ()
    friction_velocity: float = 0.1
    drag: tuple[float, ...] = ()
    gravity: float = 9.81
    name: str = dataclasses.field(default="pendulum", compare=False)
    zero: tuple[float, ...] = ()

    dimension: ClassVar = 1  # of its readings, which are angles

    def __post_init__(self) -> None:
        for name in EACH:
            values = tuple(getattr(self, name)) or (0.0,) * self.arm.n
            if len(values) != self.arm.n:
                raise InputError(name, values, f"{self.arm.n} numbers, one per link")
            low = -math.inf if name == "zero" else 0.0
            object.__setattr__(self, name, tuple(number(f"{name}[{i}]", x, low=low) for i, x in enumerate(values)))
        for name in SHARED:
            strict = name == "friction_velocity"
            object.__setattr__(self, name, number(name, getattr(self, name), low=0, strict=strict))

    def parameters(self) -> dict[str, float]:
        """Return all parameters by name: `link.mass[0]`, `link.dry_friction[1]`, `link.drag[0]`, `gravity`, ..."""
        named = self.arm.parameters() | {f"{name}[{i}]": x for name in EACH for i, x in enumerate(getattr(self, name))}
        return {f"link.{name}": x for name, x in named.items()} | {name: getattr(self, name) for name in SHARED}

    def with_parameters(self, changes: Mapping[str, float]) -> BareArm:
        """Return a copy with some of `parameters()` changed."""
        known = {name.removeprefix("link."): x for name, x in (self.parameters() | dict(changes)).items()}
        arm = self.arm.with_parameters({name: known[name] for name in self.arm.parameters()})
        each = {name: tuple(known[f"{name}[{i}]"] for i in range(self.arm.n)) for name in EACH}
        return dataclasses.replace(self, arm=arm, **each, **{name: known[name] for name in SHARED})

    def quantities(self) -> dict[str, np.ndarray]:
        """Return the parameters as arrays (one value per link, or one) by their names in `whiptool.dynamics.swing`."""
        blocks = {name: self.arm.per_link(name) for name in self.arm.QUANTITIES}
        blocks["damping"] = blocks.pop("friction")
        return blocks | {name: np.atleast_1d(getattr(self, name)) for name in (*EACH, *SHARED)}


def read_bare_arm(path: Path | str) -> BareArm:
    """Read an arm without a whip from its TOML file."""
    table = read_toml(Path(path))
    links = table.get("links")
    for key in table:
        if key not in ("links", *SHARED):
            raise InputError(f"{path}: {key}", table[key], "one of the keys links, " + ", ".join(SHARED))
    if not isinstance(links, list) or not links or not all(isinstance(link, Mapping) for link in links):
        raise InputError(f"{path}: links", links, "one table [[links]] per link, or more")
    numbers: dict[str, Any] = {key: tuple(link.pop(key, 0.0) for link in links) for key in EACH}
    arm = ArmParameters(tuple(build_from(ArmLink, link, f"{path}: links[{i}].") for i, link in enumerate(links)))
    try:
        return BareArm(arm, **numbers, **{key: table[key] for key in SHARED if key in table})
    except InputError as error:
        raise error.within(f"{path}: ") from None


def write_bare_arm(model: BareArm, path: Path | str) -> None:
    """Write an arm without a whip as a TOML file that `read_bare_arm` reads back the same."""
    links = [
        {key: getattr(link, key) for key in model.arm.QUANTITIES} | {key: getattr(model, key)[i] for key in EACH}
        for i, link in enumerate(model.arm.links)
    ]
    write_whole(Path(path), tomli_w.dumps({**{key: getattr(model, key) for key in SHARED}, "links": links}))


_BESIDE_PROFILE = ("dry_friction", "friction_velocity", "drag_ratio", "cubic_stiffness")  # of the whip, not its profile
# the hinge's numbers over those of a joint between two links, where half a link bends at the hinge
_CLAMPED = {"k": 2.0, "b": 2.0, "cubic_stiffness": 8.0, "rest_angle": 0.5, "dry_friction": 1.0}
_OF_WHIP = (*LUMPED, *_BESIDE_PROFILE, "node_inertia", "rest_angle_x")

Quantities = dict[str, np.ndarray]  # numbers of the chain by block, as the generated code takes them


@dataclass(frozen=True)
class Plant:
    """A model and a controller whose parameters can be fitted; the whip has values per node or a profile.

    Args:
        model: Whip, arm, gravity; or an arm without a whip, a `BareArm`.
        controller: Controller of the arm; needed if the command drives the whip.
        profile: The whip's profile, from which the nodes of the model's whip are then computed; its dry friction is
            kept.
        clamp: Direction of a clamp that holds the whip, 0 for straight down [rad]; the first joint then has the bending
            stiffness of the clamped half link, see `held`. None: the hinge of the model.

    The parameters are called `whip.k` (or `whip.k[3]`), `arm.mass[0]`, `gravity`, `law.a`, and, with a profile,
    `profile.length` and so on instead of the whip's.
    """

    model: Model | Any  # a BareArm, where the whip is left out
    controller: Controller | None = None
    profile: WhipProfile | None = None
    clamp: float | None = None

    def __post_init__(self) -> None:
        expect(Model, BareArm, model=self.model)
        expect(Controller, type(None), controller=self.controller)
        expect(WhipProfile, type(None), profile=self.profile)
        if isinstance(self.model, BareArm) and (self.controller or self.profile or self.clamp is not None):
            raise InputError("model", "an arm without a whip", "a Model, with a controller, a profile or a clamp")
        if self.model.dimension == 3 and self.clamp is not None:
            raise InputError("clamp", self.clamp, "None for a model in space, since only planar whips are clamped")
        if self.profile is not None:
            whip = self._lumped(self.profile, self.model.whip.N)
            object.__setattr__(self, "model", dataclasses.replace(self.model, whip=whip))

    def _lumped(self, profile: WhipProfile, N: int) -> WhipParameters:
        """Return the profile's whip with N nodes, and what of the model's whip no profile says."""
        whip = self.model.whip
        kept = {name: getattr(whip, name) for name in _BESIDE_PROFILE}
        kept["node_inertia"] = whip.per_node("node_inertia").sum() / N
        kept["rest_angle_x"] = whip.per_node("rest_angle_x").sum() / max(N - 1, 1)  # the free hinge has none
        return dataclasses.replace(profile.lump(N, joints=whip.joints), **kept)

    @property
    def held(self) -> Model:
        """The model with the whip held by the clamp: the hinge at the hand gets the bending parameters of half a link.

        Compliance, rest angle and losses of the hinge are half those of a joint between two links. Values that are
        given per node are kept, as they include the hinge. Without a clamp the model is unchanged.
        """
        if self.clamp is None:
            return self.model
        whip = self.model.whip
        numbers: dict[str, Any] = {
            name: (factor * value, *(value,) * (whip.N - 1))
            for name, factor in _CLAMPED.items()
            if not isinstance(value := getattr(whip, name), tuple)
        }
        if self.profile is not None:
            blocks = lumping(whip.N, clamped=True)[0](np.array([*self.profile.numbers.values()]))
            lumped = dict(zip(LUMPED, (block.full().ravel() for block in blocks), strict=True))
            numbers |= {name: tuple(lumped[name].tolist()) for name in ("k", "b", "rest_angle")}
        return dataclasses.replace(self.model, whip=dataclasses.replace(whip, **numbers))

    def values(self) -> dict[str, float]:
        """Return all parameters that can be fitted in SI units, by name: `whip.k`, `arm.mass[0]`, `law.a`, ..."""
        named = self.model.parameters()
        if self.profile is not None:
            named = {k: v for k, v in named.items() if not k.startswith("whip.") or _quantity(k) in _BESIDE_PROFILE}
            of_profile = self.profile.numbers
            if self.model.dimension == 3:
                del of_profile["rest_curvature"]
            named |= {f"profile.{name}": value for name, value in of_profile.items()}
        named |= {} if self.clamp is None else {"clamp": self.clamp}
        return named | ({} if self.controller is None else self.controller.parameters())

    def changed(self, changes: Mapping[str, float]) -> Plant:
        """Return a copy with some of `values()` changed.

        Raises:
            InputError: A name is unknown, or a value is not allowed.
        """
        known = self.values()
        for name in changes:
            if name not in known:
                raise InputError("parameter", name, "one of " + ", ".join(known))
        groups: dict[str, dict[str, float]] = {"profile": {}, "law": {}, "model": {}}
        for name, value in changes.items():
            if name == "clamp":
                continue
            group = name.split(".")[0].split("[")[0]
            groups["law" if group in ("law", "torque_limit") else group if group == "profile" else "model"][name] = (
                value
            )
        profile, controller = self.profile, self.controller
        if groups["profile"]:
            assert profile is not None
            profile = profile.changed({k.split(".")[1]: v for k, v in groups["profile"].items()})
        if groups["law"]:
            assert controller is not None
            controller = _with_law(controller, groups["law"])
        model = self.model.with_parameters(groups["model"]) if groups["model"] else self.model
        return Plant(model, controller, profile, changes.get("clamp", self.clamp))

    def with_nodes(self, N: int) -> Plant:
        """Return the plant with another number N of nodes.

        The nodes of a profile are computed again. Otherwise total length, mass and bending of the whip are kept: `l`,
        `m` and `drag` scale with 1/N, `k` and `b` with N, `cubic_stiffness` with N^3.

        Raises:
            InputError: The whip has values per node and no profile.
        """
        whip = self.model.whip
        if self.profile is not None:
            whip = self._lumped(self.profile, N)
        else:
            numbers = {name: getattr(whip, name) for name in _OF_WHIP}
            per_node = [name for name, value in numbers.items() if isinstance(value, tuple)]
            if per_node:
                raise InputError(f"whip.{per_node[0]}", "a value per node", "one number for all", "or give a profile")
            finer = N / whip.N
            powers = {"l": -1, "m": -1, "k": 1, "b": 1, "rest_angle": -1, "drag": -1, "cubic_stiffness": 3}
            powers |= {"node_inertia": -1, "rest_angle_x": -1}
            scaled = {name: numbers[name] * finer**power for name, power in powers.items()}
            whip = dataclasses.replace(whip, N=N, **scaled)
        return Plant(dataclasses.replace(self.model, whip=whip), self.controller, self.profile, self.clamp)

    def quantities(self) -> Quantities:
        """Return the parameters of arm, whip, gravity and control law as arrays by name, such as `whip.k`, (N,)."""
        if isinstance(self.model, BareArm):
            return self.model.quantities()
        model, blocks = self.held, {}
        blocks |= {f"arm.{name}": numbers for name, numbers in model.arm.numbers().items()}
        for name in _OF_WHIP:
            single = name in ("hinge_mass", "friction_velocity", "drag_ratio")
            blocks[f"whip.{name}"] = np.array([getattr(model.whip, name)]) if single else model.whip.per_node(name)
        blocks["gravity"] = np.array([model.gravity])
        if self.clamp is not None:
            blocks["clamp"] = np.array([self.clamp])
        if self.controller is not None:
            blocks |= {f"law.{name}": np.ravel(x) for name, x in self.controller.law.parameters().items()}
            if self.controller.torque_limit is not None:
                blocks["torque_limit"] = np.ravel(self.controller.torque_limit)
        return blocks


def _quantity(name: str) -> str:
    """Return the quantity in a parameter's name: `k` of `whip.k[3]`."""
    return name.split(".")[-1].split("[")[0]


def _with_law(controller: Controller, changes: Mapping[str, float]) -> Controller:
    fields: dict = {}
    law = {name: np.array(x, float) for name, x in controller.law.parameters().items()}
    for name, value in changes.items():
        index = int(name[name.index("[") + 1 : -1]) if "[" in name else 0
        if _quantity(name) == "torque_limit":
            limits = np.ravel(fields.get("torque_limit", controller.torque_limit))
            limits[index] = value
            fields["torque_limit"] = limits if "[" in name else value
            continue
        law[_quantity(name)][index] = value
    return dataclasses.replace(controller, law=controller.law.changed(law), **fields)


def slopes(plant: Plant, names: Sequence[str]) -> list[Quantities]:
    """Return the derivatives of the arrays of `plant.quantities()` by each named parameter, one dict per parameter.

    The arrays are linear in the parameters of model and control law, so that any difference is the derivative;
    derivatives by a profile's parameters are computed with CasADi.
    """
    base, known = plant.quantities(), plant.values()
    profile = plant.profile
    by_profile = {} if profile is None else profile_slopes(profile, base["whip.m"].size, plant.clamp is not None)
    found = []
    for name in names:
        if name not in known:
            raise InputError("parameter", name, "one of " + ", ".join(known))
        if name in by_profile:
            found.append({block: np.zeros_like(x) for block, x in base.items()} | by_profile[name])
            continue
        for step in (1.0, -1.0, known[name], -known[name] / 2):  # the first that its bounds allow
            with suppress(InputError):
                moved = plant.changed({name: known[name] + step}).quantities()
                found.append({block: np.round((moved[block] - x) / step, 12) for block, x in base.items()})
                break
        else:
            raise InputError("parameter", f"{name} = {known[name]:g}", "a value that can be changed", "leave it fixed")
    return found
