"""Simulation of strikes (rollouts): the compiled engine, and the reference in MuJoCo."""

from __future__ import annotations

from typing import TYPE_CHECKING

from whiptool.lazy_names import imported_when_used

_HOMES = {
    "CompiledRollout": "compiled",
    "ReferenceRollout": "reference",
    "energies": "energy",
}
__all__ = list(_HOMES)

if TYPE_CHECKING:
    from whiptool.rollout.compiled import CompiledRollout
    from whiptool.rollout.energy import energies
    from whiptool.rollout.reference import ReferenceRollout

__getattr__, __dir__ = imported_when_used(__name__, _HOMES)  # CasADi and MuJoCo are imported where used
