"""Impedance control with constant stiffness and damping (Eqs. 2, 22)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import casadi as ca
import numpy as np

from whiptool.errors import InputError
from whiptool.impedance.law import register

Matrix = tuple[tuple[float, ...], ...]


def _matrix(name: str, value: object) -> Matrix:
    try:
        array = np.asarray(value, float)
    except (TypeError, ValueError):  # rows of different lengths, words
        raise InputError(name, value, "a square matrix of finite numbers") from None
    if array.ndim != 2 or array.shape[0] != array.shape[1] or not np.isfinite(array).all():
        raise InputError(name, value, "a square matrix of finite numbers")
    return tuple(tuple(float(x) for x in row) for row in array)


@register
@dataclass(frozen=True)
class ConstantImpedance:
    """`tau = K e + B de`, with the paper's matrices (Eq. 22, from Nah et al. 2020) by default.

    Args:
        K: Stiffness [N m/rad], (n, n).
        B: Damping [N m s/rad], (n, n).
    """

    K: Matrix = ((29.5, 14.3), (14.3, 39.3))
    B: Matrix = ((2.95, 1.43), (1.43, 3.93))

    kind: ClassVar[str] = "constant"

    def __post_init__(self) -> None:
        object.__setattr__(self, "K", _matrix("K", self.K))
        object.__setattr__(self, "B", _matrix("B", self.B))
        if len(self.K) != len(self.B):
            raise InputError("B", self.B, f"{len(self.K)} rows, as many as K")

    def gains(self, e: np.ndarray, de: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """K and B for tracking errors `e` [rad] and `de` [rad/s] of shape (..., n): each (..., n, n)."""
        shape = (*np.shape(e), np.shape(e)[-1])
        K, B = self._arrays
        return np.broadcast_to(K, shape), np.broadcast_to(B, shape)

    @cached_property
    def _arrays(self) -> tuple[np.ndarray, np.ndarray]:
        return np.array(self.K), np.array(self.B)

    @staticmethod
    def sizes(n: int) -> dict[str, int]:
        """Names and lengths of `parameters()` for an arm of n joints."""
        return {"K": n * n, "B": n * n}

    def changed(self, numbers: Mapping[str, np.ndarray]) -> ConstantImpedance:
        """The same law with other numbers, as `parameters` gives them."""
        n = len(self.K)
        return ConstantImpedance(*(np.reshape(numbers[name], (n, n)) for name in ("K", "B")))  # type: ignore[arg-type]

    def parameters(self) -> dict[str, np.ndarray]:
        """The law's numbers by name, flat; what `expression` takes."""
        return {"K": np.ravel(self.K), "B": np.ravel(self.B)}

    @staticmethod
    def expression(p: dict[str, ca.SX], e: ca.SX, de: ca.SX) -> ca.SX:
        """Torque (n, 1) as a CasADi expression of symbolic `parameters()` and errors."""
        n = e.numel()
        K, B = (ca.reshape(p[name], n, n).T for name in ("K", "B"))  # parameters are row by row
        return K @ e + B @ de
