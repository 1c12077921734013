"""Ranges of the properties of whips by material, from handbooks and data sheets, for priors and for simulated twins.

The table was written from the sources below before any prior was computed. `density` and `modulus` are effective: mass
per length over `pi d^2 / 4`, and bending stiffness EI over `pi d^4 / 64`. The fibres of a rope and the strands of a
plait slip when it bends, so that the modulus is far below that of the fibre. `relaxation` is bending damping over
bending stiffness: the loss factor over the angular frequency of bending, some 6 to 30 rad/s in a strike.

Sources:
    Lengths of whips that arms strike with: 0.6 to 1 m (Chi et al. 2022, Iterative Residual Policy), 1 m (a rope on a
        UR5e), 0.86 m (Wang et al. 2024, Table 2), 1.6 m (people, Krotov et al. 2022); no shorter than an arm of 0.65 m
        needs for targets at 1.25 m.
    Cotton: fibres 1520 to 1550 kg/m^3 (Morton and Hearle, Physical Properties of Textile Fibres, 2008), which fill 0.4
        to 0.55 of a soft rope; three-strand rope of natural fibre 730 to 930 (Cordage Institute CI 1308). A rope of
        12.7 mm in dynamic manipulation was fitted with 700 kg/m^3 and 0.2 MPa ("Point It, Strike It", 2026). With the
        bending length c (Peirce, J. Text. Inst. 21, 1930) and the weight per length w, EI = w c^3: c of 5 to 9 cm.
    Nylon: rope 700 to 770 kg/m^3 (2.23, 5.21 and 9.67 kg per 100 m at 6.35, 9.53 and 12.7 mm, makers' tables); bending
        length 8 to 18 cm; loss factor 0.05 to 0.3 (polyamide, and more where fibres rub; Ashby, Materials Selection in
        Mechanical Design, 2011).
    Leather: 810 to 1050 kg/m^3 and 100 to 500 MPa in tension as a sheet (Ashby 2011). Of n strands of a plait that
        slip and fill phi of the section remains phi^2 / n of the solid's EI: 3 to 8 % with 8 to 16 strands. The whip of
        Table 2 (Nah et al. 2020, fitted), 0.167 kg/m and 0.0174 N m^2, is leather of 15 mm with 7 MPa; its b / k, 0.38
        s, is the upper end of `relaxation`; a loss factor of 0.2 at 10 rad/s is the lower one. Diameters: Goriely and
        McMillen, Phys. Rev. Lett. 88, 244301 (2002); Krehl, Engemann and Schwenkel, Shock Waves 8 (1998).
    Silicone: 1100 to 1200 kg/m^3; 1.6 to 5.5 MPa, Shore A 40 to 70 by Gent's relation (Trans. Inst. Rubber Ind. 34,
        1958; makers give 2.1 to 4 MPa for tubing of Shore A 50 to 78); loss factor 0.05 to 0.2.
    Steel chain: short links of wire d, DIN 766: 0.07, 0.16 and 0.32 kg/m at 2, 3 and 4 mm, so 20,400 to 25,500 kg/m^3
        of the wire's section. A joint rotates freely except for the friction between links, mu T d / 2 (mu 0.15 to 0.3,
        tension T 0.5 to 2 N); the modulus is negligibly small.
    Polypropylene and manila: ropes of three strands, 2.68, 4.17 and 6.99 kg per 100 m of polypropylene and 4.32, 6.10
        and 11.2 of manila at 7.94, 9.53 and 12.7 mm (makers' tables). Their bending lengths were not found: moduli,
        relaxation and friction are those of nylon and, as both ropes feel stiffer, up to three times as large.
    Friction moments of the others: 5 to 20 % of EI at a curvature of 5 /m, the hysteresis of bent ropes; almost none
        for silicone.
    Air: drag per length `rho C_d d / 2` across; C_d = 1.0 to 1.3 for cylinders and ropes at Reynolds numbers of 10^3 to
        10^5 (Hoerner, Fluid-Dynamic Drag, 1965); a chain is 1 to 3.6 wires wide, 2.3 on average.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.models.numbers import THICKEST, metres
from whiptool.models.parameters import Model
from whiptool.models.profile import profile_from
from whiptool.models.whip import WhipParameters

LONGEST = 20.0  # [m] of a whip that an arm swings
Range = tuple[float, float]

AIR = 1.2  # [kg/m^3]
MEASURED = 0.02  # relative half range of a diameter or a length that was measured by hand
CAUSES = ("length", "diameter", "density", "modulus", "relaxation", "friction", "drag_coefficient")
NUMBERS = ("length", "linear_density", "bending_stiffness", "bending_damping", "drag", "dry_friction")
_POWERS = np.array([
    [1, 0, 0, 0, 0, 0, 0],
    [0, 2, 1, 0, 0, 0, 0],
    [0, 4, 0, 1, 0, 0, 0],
    [0, 4, 0, 1, 1, 0, 0],
    [0, 1, 0, 0, 0, 0, 1],
    [0, 0, 0, 0, 0, 1, 0],
])  # fmt: skip  # of each cause in each number


@dataclass(frozen=True)
class Material:
    """Ranges (least, largest) of the physical properties of whips of one material."""

    diameter: Range  # outer diameter, of a chain the diameter of its wire [m]
    density: Range  # mass per length over `pi d^2 / 4` [kg/m^3]
    modulus: Range  # bending stiffness over `pi d^4 / 64` [Pa]
    relaxation: Range  # bending damping over bending stiffness [s]
    friction: Range  # moment of dry friction [N m]
    drag_coefficient: Range = (1.0, 1.3)  # across the whip
    length: Range = (0.7, 1.1)  # [m]
    width: float = 1.0  # of the cross section across the air flow, in diameters

    @property
    def ranges(self) -> np.ndarray:
        """Logarithms of the lower and upper end of the range of each of the seven properties `CAUSES`, (7, 2)."""
        return np.log([getattr(self, name) for name in CAUSES])

    @property
    def factors(self) -> np.ndarray:
        """Values of the six parameters `NUMBERS` of a whip (see `Stock`) whose properties are all 1, (6,)."""
        return np.array([1.0, np.pi / 4, np.pi / 64, np.pi / 64, AIR * self.width / 2, 1.0])


MATERIALS: Mapping[str, Material] = MappingProxyType({
    "cotton": Material((0.008, 0.014), (600, 850), (1e5, 1e6), (0.015, 0.1), (2e-5, 2e-4)),
    "leather": Material((0.010, 0.015), (750, 950), (2e6, 15e6), (0.02, 0.4), (1e-4, 1e-3)),
    "nylon": Material((0.008, 0.012), (700, 770), (0.5e6, 5e6), (0.01, 0.06), (5e-5, 5e-4)),
    "silicone": Material((0.008, 0.014), (1100, 1200), (1.6e6, 5.5e6), (0.005, 0.02), (1e-6, 1e-5)),
    "steel-chain": Material((0.002, 0.003), (20_400, 25_500), (1e6, 1e7), (0.005, 0.02), (8e-5, 9e-4), width=2.3),
    "polypropylene": Material((0.008, 0.012), (540, 590), (0.5e6, 15e6), (0.01, 0.06), (5e-5, 1.5e-3)),
    "manila": Material((0.008, 0.012), (850, 885), (0.5e6, 15e6), (0.01, 0.06), (5e-5, 1.5e-3)),
})  # fmt: skip


USUAL = ("cotton", "leather", "nylon", "silicone", "steel-chain")  # of which a prior around one's own model is the mean


@dataclass(frozen=True, eq=False)  # arrays have no single truth value to compare by
class Stock:
    """Distribution of the whips of a material.

    The six parameters of a whip (`NUMBERS`: length, linear density, bending stiffness, bending damping, drag, dry
    friction) are constants times powers of its seven properties (`CAUSES`: length, diameter, density, modulus,
    relaxation, friction, drag coefficient). The properties are independent, with logarithms uniform over their ranges.
    """

    name: str  # of the material, or of the model
    centre: np.ndarray  # logarithms of the median whip's parameters in SI units, (6,)
    spread: np.ndarray  # their change if a property's logarithm goes from the middle to the top of its range, (6, 7)

    @property
    def numbers(self) -> dict[str, float]:
        """The six parameters `NUMBERS` of the median whip in SI units, by name."""
        return dict(zip(NUMBERS, np.exp(self.centre).tolist(), strict=True))

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of the logarithms of the six parameters, (6, 6)."""
        return self.spread @ self.spread.T / 3

    def draw(self, rng: np.random.Generator) -> dict[str, float]:
        """Return the six parameters `NUMBERS` of one random whip in SI units, by name."""
        log = self.centre + self.spread @ rng.uniform(-1, 1, len(CAUSES))
        return dict(zip(NUMBERS, np.exp(log).tolist(), strict=True))

    def owned(self, model: Model) -> Model:
        """Return the model with a uniform whip that has the median parameters, and with this material's name."""
        return dataclasses.replace(model, whip=uniform_whip(self.numbers, model.whip), name=self.name)


def uniform_whip(numbers: Mapping[str, float], like: WhipParameters) -> WhipParameters:
    """Return a uniform whip with the parameters `numbers` (see `NUMBERS`), and the number of nodes and the joints of
    `like`.
    """
    N = like.N
    l = numbers["length"] / N
    return WhipParameters(
        N=N,
        l=l,
        m=numbers["linear_density"] * l,
        k=numbers["bending_stiffness"] / l,
        b=numbers["bending_damping"] / l,
        drag=numbers["drag"] * l,
        dry_friction=numbers["dry_friction"],
        joints=like.joints,
        node_inertia=float(like.per_node("node_inertia").mean()),
    )


def stock_of_material(name: str, *, diameter: float | None = None, length: float | None = None) -> Stock:
    """Return the distribution of the whips of one of `MATERIALS`; a measured diameter or length [m] has a standard
    error of 2 %.
    """
    if name not in MATERIALS:
        raise InputError("material", name, ", ".join(MATERIALS))
    measured: dict[str, Any] = {}
    for measure, value, longest in (("diameter", diameter, THICKEST), ("length", length, LONGEST)):
        if value is not None:
            value = metres(measure, value, longest=longest)
            measured[measure] = (value * (1 - MEASURED), value * (1 + MEASURED))
    material = dataclasses.replace(MATERIALS[name], **measured)
    low, high = material.ranges.T
    centre = np.log(material.factors) + _POWERS @ ((low + high) / 2)
    return Stock(name, centre, _POWERS * (high - low) / 2)


def stock_of_model(model: Model) -> Stock:
    """Return a distribution of whips around a model, as wide as those of usual materials are on average (root mean
    square).

    Damping, drag or friction that is 0 in the model is replaced by the geometric mean over the materials.
    """
    stocks = [stock_of_material(name) for name in USUAL]
    spread = np.sqrt(np.mean([stock.spread**2 for stock in stocks], axis=0))
    usual = np.exp(np.mean([stock.centre for stock in stocks], axis=0))
    profile = profile_from(model.whip)
    own = [getattr(profile, name) for name in NUMBERS[:-1]] + [_friction(model)]
    return Stock(model.name, np.log([x or other for x, other in zip(own, usual, strict=True)]), spread)


def _friction(model: Model) -> float:
    friction = model.whip.dry_friction
    if isinstance(friction, tuple):
        raise InputError("whip.dry_friction", "a value per node", "one number for all")
    return friction
