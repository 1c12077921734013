"""Published models: those of the paper, a human arm, and robots with a rope, whose arms are files in `published`."""

from __future__ import annotations

import dataclasses
import math
import tomllib
from importlib.resources import files
from typing import Any, Literal

from whiptool.errors import expect
from whiptool.extras import Registry
from whiptool.models.capsules import Capsule
from whiptool.models.mount import with_stick
from whiptool.models.parameters import ArmLink, ArmParameters, Model
from whiptool.models.profile import WhipProfile
from whiptool.models.spatial_arm import JointLimits, SpatialArm, SpatialLink
from whiptool.models.whip import WhipParameters

# A rope on a stick, for robots: "Point It, Strike It" (2026), rope of 1 m, radius 6.35 mm, 700 kg/m^3, E = 2e5 Pa;
# stick of 0.65 m. Not published, and chosen here: the rope's damping, by a retardation time of 0.1 s; the stick's mass,
# that of 16 mm of beech, 700 kg/m^3; that air does not brake the rope.
_RADIUS, _DENSITY, _YOUNG, _RETARDATION = 6.35e-3, 700.0, 2e5, 0.1
STICK = {"length": 0.65, "mass": 0.09}


def rope(N: int = 20, *, joints: Literal["rod", "universal"] = "rod") -> WhipParameters:
    """Return the rope of the robot presets as N rods, which bend equally in all directions.

    With universal joints instead, each node has the moment of inertia of a cord about its axis, m r^2 / 2.
    """
    stiffness = _YOUNG * math.pi * _RADIUS**4 / 4  # EI of a round section
    density = _DENSITY * math.pi * _RADIUS**2
    profile = WhipProfile(
        length=1.0,
        linear_density=density,
        bending_stiffness=stiffness,
        bending_damping=_RETARDATION * stiffness,
    )
    inertia = density / N * _RADIUS**2 / 2 if joints == "universal" else 0.0
    return profile.lump(N, joints=joints, node_inertia=inertia)


def _published(name: str) -> SpatialArm:
    """Return an arm of the folder `published`, whose files are tables as `[arm]` of a model file is one."""
    table = tomllib.loads(files("whiptool.models").joinpath("published", f"{name}.toml").read_text())
    links = (_link(**link) for link in table.pop("links"))
    return SpatialArm(tuple(links), **table | {"base": tuple(Capsule(**x) for x in table.pop("base", ()))})


def _link(capsules: tuple[dict, ...] = (), limits: dict | None = None, **numbers: Any) -> SpatialLink:
    return SpatialLink(**numbers, capsules=tuple(Capsule(**x) for x in capsules), limits=JointLimits(**limits or {}))


UR5E_ARM, PANDA_ARM, FR3_ARM = (_published(name) for name in ("ur5e", "panda", "fr3"))  # without a tool
UR5E = Model(name="ur5e", arm=with_stick(UR5E_ARM, **STICK), whip=rope())
PANDA = Model(name="panda", arm=with_stick(PANDA_ARM, **STICK), whip=rope())
FR3 = Model(name="fr3", arm=with_stick(FR3_ARM, **STICK), whip=rope())
NAH2023 = Model(
    name="nah2023",
    arm=_published("person"),
    # nodes are spheres of radius 0.02 m: 2/5 m r^2
    whip=WhipParameters(
        N=25, l=0.072, m=0.012, k=0.242, b=0.092, joints="universal", node_inertia=0.4 * 0.012 * 0.02**2
    ),
)


# Wang et al. 2024, Tables 2 and 3. Table 3 gives no inertias: uniform rods.
_LEMON = Model(
    name="lemon2024",
    whip=WhipParameters(N=12, l=0.072, m=0.012, k=0.242, b=0.092),
    arm=ArmParameters((ArmLink(mass=0.25, length=0.31), ArmLink(mass=0.274, length=0.34))),
)
# Nah et al. 2020 (BioRob, 685-691): a human arm with three generic whips and one fitted to an experiment.
_NAH_ARM = ArmParameters(
    (
        ArmLink(mass=1.595, length=0.294, com=0.129, inertia=0.011937),
        ArmLink(mass=0.869, length=0.291, com=0.112, inertia=0.004855),
    )
)


def _nah(name: str, whip: WhipParameters) -> Model:
    return Model(name=name, whip=whip, arm=_NAH_ARM)


PRESETS: Registry[Model] = Registry(
    "presets",
    Model,
    {
        model.name: model
        for model in (
            _LEMON,
            *(_nah(f"nah2020-n{N}", WhipParameters(N=N, l=0.1, m=0.1, k=0.05, b=0.005)) for N in (10, 15, 20)),
            _nah("nah2020-fitted", WhipParameters(N=25, l=0.072, m=0.012, k=0.242, b=0.092)),
            NAH2023,
            UR5E,
            PANDA,
            FR3,
        )
    },
    what="model preset",
)


def presets() -> list[str]:
    """Return the names of the published models, including those of installed packages; see `preset`."""
    PRESETS.add_installed()
    return list(PRESETS)


def preset(name: str) -> Model:
    """Return the published model called `name`, in capital or small letters.

    Raises:
        InputError: No preset has that name; the message lists the presets.
    """
    expect(str, name=name)
    return dataclasses.replace(PRESETS.find(name))
