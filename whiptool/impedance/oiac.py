"""Online Impedance Adaptation Control (Eqs. 2, 4, 8-10)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import casadi as ca
import numpy as np

from whiptool.errors import InputError, expect
from whiptool.impedance.law import register
from whiptool.models.arrays import NoArray
from whiptool.models.parameters import number
from whiptool.words import as_named


@register
@dataclass(frozen=True)
class OIAC(NoArray, instead="its parameters()"):
    """Online impedance adaptation control: stiffness and damping that grow with the tracking error.

    `eps = e + beta de` (Eq. 8), `F = eps / gamma`, `K = F e^T`, `B = F de^T` (Eq. 9),
    `gamma = a / (1 + C |eps|^2)` (Eq. 10), `tau = K e + B de` (Eq. 2). Both matrices have rank one, and the torque
    is `eps (|e|^2 + |de|^2)(1 + C |eps|^2) / a`: cubic in the error, and zero where the error is.

    Args:
        a: Adaptation scale; smaller is stiffer.
        beta: Weight of the velocity error [s].
        C: Growth of the gain with the error.
    """

    a: float = 0.2
    beta: float = 0.6
    C: float = 5.0

    kind: ClassVar[str] = "oiac"
    uncertain: ClassVar[tuple[str, ...]] = ("a",)

    def __post_init__(self) -> None:
        object.__setattr__(self, "a", number("a", self.a, low=0, strict=True))
        object.__setattr__(self, "beta", number("beta", self.beta, low=0))
        object.__setattr__(self, "C", number("C", self.C, low=0))

    def gains(self, e: np.ndarray, de: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """K [N m/rad] and B [N m s/rad] for errors `e` [rad], `de` [rad/s] of shape (..., n): each (..., n, n)."""
        epsilon = e + self.beta * de  # Eq. 8
        gamma = self.a / (1 + self.C * np.vecdot(epsilon, epsilon))  # Eq. 10
        F = (epsilon / gamma[..., None])[..., :, None]  # Eq. 9
        return F * e[..., None, :], F * de[..., None, :]

    @staticmethod
    def sizes(n: int) -> dict[str, int]:
        """Names and lengths of `parameters()`, whatever the arm."""
        return {"a": 1, "beta": 1, "C": 1}

    def changed(self, numbers: Mapping[str, np.ndarray]) -> OIAC:
        """Return the same law with other values of its `parameters`."""
        return OIAC(**{name: float(x[0]) for name, x in numbers.items()})

    def parameters(self) -> dict[str, np.ndarray]:
        """Return the law's parameters by name, (1,) each, as `expression` takes them."""
        return {"a": np.array([self.a]), "beta": np.array([self.beta]), "C": np.array([self.C])}

    @staticmethod
    def expression(p: dict[str, ca.SX], e: ca.SX, de: ca.SX) -> ca.SX:
        """Torque (n, 1) as a CasADi expression of symbolic `parameters()` and errors."""
        epsilon = e + p["beta"] * de  # Eq. 8
        return epsilon * ((ca.sumsqr(e) + ca.sumsqr(de)) * (1 + p["C"] * ca.sumsqr(epsilon)) / p["a"])  # Eqs. 2, 9, 10


# `printed` is the paper's a = 0.2; `table4` is fitted to the four error ratios of Table 4 by
# benchmarks/table4_sweep.py, over random strikes of the default bounds.
OIAC_PRESETS: dict[str, OIAC] = {"printed": OIAC(), "table4": OIAC(a=1.3e-4)}


def oiac_preset(name: str) -> OIAC:
    """The OIAC preset called `name`.

    Raises:
        InputError: No preset has that name; the message lists the presets.
    """
    expect(str, name=name)
    own = as_named(name, OIAC_PRESETS)
    if own not in OIAC_PRESETS:
        raise InputError("OIAC preset", name, ", ".join(OIAC_PRESETS))
    return OIAC_PRESETS[own]
