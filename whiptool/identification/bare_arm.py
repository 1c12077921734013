"""An arm without a whip and without motors, such as a pendulum of several links, and its TOML file.

The file holds one table `[[links]]` per link with `mass`, `length`, and perhaps `com`, `inertia`, `friction` (viscous),
`dry_friction`, `drag`; in addition `gravity` and `friction_velocity`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import tomli_w

from whiptool.errors import InputError
from whiptool.given_files import read_toml
from whiptool.models.numbers import number
from whiptool.models.parameters import ArmLink, ArmParameters
from whiptool.whole_files import write_whole

EACH = ("dry_friction", "drag")  # numbers per link in addition to those of a link itself
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

    Raises:
        InputError: A value breaks its rule.
    """

    arm: ArmParameters
    dry_friction: tuple[float, ...] = ()
    friction_velocity: float = 0.1
    drag: tuple[float, ...] = ()
    gravity: float = 9.81
    name: str = dataclasses.field(default="pendulum", compare=False)

    dimension: ClassVar = 1  # of its readings, which are angles

    def __post_init__(self) -> None:
        for name in EACH:
            values = tuple(getattr(self, name)) or (0.0,) * self.arm.n
            if len(values) != self.arm.n:
                raise InputError(name, values, f"{self.arm.n} numbers, one per link")
            object.__setattr__(self, name, tuple(number(f"{name}[{i}]", x, low=0) for i, x in enumerate(values)))
        for name in SHARED:
            strict = name == "friction_velocity"
            object.__setattr__(self, name, number(name, getattr(self, name), low=0, strict=strict))

    def parameters(self) -> dict[str, float]:
        """Return all parameters by name: `link.mass[0]`, `link.dry_friction[1]`, `link.drag[0]`, `gravity`, ..."""
        named = self.arm.parameters() | {f"{name}[{i}]": x for name in EACH for i, x in enumerate(getattr(self, name))}
        return {f"link.{name}": x for name, x in named.items()} | {name: getattr(self, name) for name in SHARED}

    def with_parameters(self, changes: Mapping[str, float]) -> BareArm:
        """A copy with some of `parameters()` changed."""
        known = {name.removeprefix("link."): x for name, x in (self.parameters() | dict(changes)).items()}
        arm = self.arm.with_parameters({name: known[name] for name in self.arm.parameters()})
        each = {name: tuple(known[f"{name}[{i}]"] for i in range(self.arm.n)) for name in EACH}
        return dataclasses.replace(self, arm=arm, **each, **{name: known[name] for name in SHARED})

    def quantities(self) -> dict[str, np.ndarray]:
        """Return the parameters as blocks for `whiptool.dynamics.swing`, by name."""
        blocks = {name: self.arm.per_link(name) for name in self.arm.QUANTITIES}
        blocks["damping"] = blocks.pop("friction")
        return blocks | {name: np.atleast_1d(getattr(self, name)) for name in (*EACH, *SHARED)}


def read_bare_arm(path: Path | str) -> BareArm:
    """An arm without a whip from its TOML file.

    Raises:
        InputError: The file cannot be read, a key is unknown or missing, or a value is not allowed.
    """
    table = read_toml(Path(path))
    links, of_link = table.get("links"), (*ArmParameters.QUANTITIES, *EACH)
    for key in table:
        if key not in ("links", *SHARED):
            raise InputError(f"{path}: {key}", table[key], "one of the keys links, " + ", ".join(SHARED))
    if not isinstance(links, list) or not links or not all(isinstance(link, Mapping) for link in links):
        raise InputError(f"{path}: links", links, "one table [[links]] per link, or more")
    for i, link in enumerate(links):
        for key in link:
            if key not in of_link:
                raise InputError(f"{path}: links[{i}].{key}", link[key], "one of " + ", ".join(of_link))
        for key in ("mass", "length"):
            if key not in link:
                raise InputError(f"{path}: links[{i}].{key}", None, "a number > 0", "it is missing")
    try:
        made = tuple(ArmLink(**{key: x for key, x in link.items() if key not in EACH}) for link in links)
        numbers: dict[str, Any] = {key: tuple(link.get(key, 0.0) for link in links) for key in EACH}
        return BareArm(ArmParameters(made), **numbers, **{key: table[key] for key in SHARED if key in table})
    except InputError as error:
        raise error.within(f"{path}: ") from None


def write_bare_arm(model: BareArm, path: Path | str) -> None:
    """Write an arm without a whip as a TOML file that `read_bare_arm` reads back the same."""
    links = [
        {key: getattr(link, key) for key in model.arm.QUANTITIES} | {key: getattr(model, key)[i] for key in EACH}
        for i, link in enumerate(model.arm.links)
    ]
    write_whole(Path(path), tomli_w.dumps({**{key: getattr(model, key) for key in SHARED}, "links": links}))
