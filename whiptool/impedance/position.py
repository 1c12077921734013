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

    The motion is prescribed: no error is left that a torque could follow. The torques are those which that motion
    needs under the whip's pull, by inverse dynamics, so that limits of torque can still be judged. There are
    no springs and dampers: K and B are zero.
    """

    kind: ClassVar[str] = "position"
    uncertain: ClassVar[tuple[str, ...]] = ()

    def gains(self, e: np.ndarray, de: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Zeros for errors `e` and `de` of shape (..., n): each (..., n, n)."""
        zeros = np.zeros((*np.shape(e), np.shape(e)[-1]))
        return zeros, zeros.copy()

    @staticmethod
    def sizes(n: int) -> dict[str, int]:
        """Return no names: it has no numbers."""
        return {}

    def parameters(self) -> dict[str, np.ndarray]:
        """Return no numbers."""
        return {}

    def changed(self, numbers: Mapping[str, np.ndarray]) -> PositionControl:
        """Return the same law: it has no numbers to change."""
        return self

    @staticmethod
    def expression(p: dict[str, ca.SX], e: ca.SX, de: ca.SX) -> ca.SX:
        """Return zeros (n, 1): no torque follows an error."""
        return ca.SX.zeros(e.numel())
