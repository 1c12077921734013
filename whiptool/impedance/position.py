"""Position control: a robot whose joints are where the strike's reference wants them, whatever that takes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import casadi as ca
import numpy as np

from whiptool.impedance.law import register


@register
@dataclass(frozen=True)
class PositionControl:
    """Joints exactly on the reference (Eq. 1), as stiff industrial robots follow it.

    The motion is prescribed, and there are no tracking errors. The torques are those that this motion needs under the
    load of the whip, by inverse dynamics, so that torque limits can be checked. K and B are zero.
    """

    kind: ClassVar[str] = "position"
    uncertain: ClassVar[tuple[str, ...]] = ()

    def gains(self, e: np.ndarray, de: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Zeros for errors `e` and `de` of shape (..., n): each (..., n, n)."""
        zeros = np.zeros((*np.shape(e), np.shape(e)[-1]))
        return zeros, zeros.copy()

    @staticmethod
    def sizes(n: int) -> dict[str, int]:
        """Return an empty dict: the law has no parameters."""
        return {}

    def parameters(self) -> dict[str, np.ndarray]:
        """Return an empty dict: the law has no parameters."""
        return {}

    def changed(self, numbers: Mapping[str, np.ndarray]) -> PositionControl:
        """Return the same law: it has no parameters to change."""
        return self

    @staticmethod
    def expression(p: dict[str, ca.SX], e: ca.SX, de: ca.SX) -> ca.SX:
        """Return zeros (n, 1): no torque depends on the errors."""
        return ca.SX.zeros(e.numel())
