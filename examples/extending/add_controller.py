"""A new impedance law: constant impedance that hardens with the position error."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import casadi as ca
import numpy as np

import whiptool as wt
from whiptool.impedance import register

EQ22 = wt.ConstantImpedance()


@register
@dataclass(frozen=True)
class HardeningImpedance:
    """`tau = (1 + c |e|^2) (K e + B de)`.

    Args:
        c: How fast it hardens [1/rad^2].
        K, B: Stiffness [N m/rad] and damping [N m s/rad] at small errors, (n, n).
    """

    c: float = 100.0
    K: tuple[tuple[float, ...], ...] = EQ22.K
    B: tuple[tuple[float, ...], ...] = EQ22.B

    kind: ClassVar[str] = "hardening"
    uncertain: ClassVar[tuple[str, ...]] = ("c",)

    def gains(self, e: np.ndarray, de: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """K and B for errors `e` [rad] and `de` [rad/s], (..., n): each (..., n, n)."""
        scale = (1 + self.c * np.vecdot(e, e))[..., None, None]
        return scale * np.array(self.K), scale * np.array(self.B)

    @staticmethod
    def expression(p: dict[str, ca.SX], e: ca.SX, de: ca.SX) -> ca.SX:
        """The same as a CasADi expression."""
        return (1 + p["c"] * ca.sumsqr(e)) * wt.ConstantImpedance.expression(p, e, de)

    @staticmethod
    def sizes(n: int) -> dict[str, int]:
        """Lengths of `parameters()` for an arm of n joints."""
        return {"c": 1, "K": n * n, "B": n * n}

    def parameters(self) -> dict[str, np.ndarray]:
        """The law's numbers by name."""
        return {"c": np.array([self.c]), "K": np.ravel(self.K), "B": np.ravel(self.B)}

    def changed(self, numbers: Mapping[str, np.ndarray]) -> HardeningImpedance:
        """The same law with other numbers."""
        K, B = (tuple(map(tuple, np.reshape(numbers[name], np.shape(self.K)))) for name in ("K", "B"))
        return HardeningImpedance(float(numbers["c"][0]), K, B)


def largest_errors(path: wt.Trajectory) -> np.ndarray:
    """Largest position errors of shoulder and elbow [rad], (2,)."""
    return np.abs(path.q_d - path.q[:, :2]).max(axis=0)


if __name__ == "__main__":
    strike, model = wt.Strike(q_i=(-1.36, 0.47), q_f=(1.73, 1.41), D=0.95), wt.preset("lemon2024")
    errors = {}
    for law in (wt.ConstantImpedance(), HardeningImpedance(0.0), HardeningImpedance()):
        controller = wt.Controller(law)
        reference = wt.ReferenceRollout(model, controller).trajectory(strike, t_stay=0.3)
        compiled = wt.CompiledRollout(model, controller).trajectory(strike, t_stay=0.3)
        assert np.abs(reference.tip[-1] - compiled.tip[-1]).max() < 1e-4  # two simulators, one law
        errors[law] = largest_errors(compiled)
        print(law.kind, "largest errors [rad]", errors[law].round(4))
    constant, soft, hard = errors.values()
    assert np.allclose(soft, constant, rtol=1e-6)  # c = 0 is the constant law
    assert (hard < constant).all()
