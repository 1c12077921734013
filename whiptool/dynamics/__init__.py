"""Equations of motion in CasADi, in the plane and in space: closed loop and integrator, posture, modes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from whiptool.lazy_names import imported_when_used

_HOMES = {
    "Chain": "chain",
    "chain_of": "chain",
    "hanging_modes": "modes",
    "linearise": "modes",
    "start_posture": "posture",
}
__all__ = list(_HOMES)

if TYPE_CHECKING:
    from whiptool.dynamics.chain import Chain, chain_of
    from whiptool.dynamics.modes import hanging_modes, linearise
    from whiptool.dynamics.posture import start_posture

__getattr__, __dir__ = imported_when_used(__name__, _HOMES)  # CasADi is imported where used
