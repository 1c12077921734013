"""Rollouts of strikes: the compiled engine, the reference in MuJoCo, and the trajectories that they return."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

_HOMES = {
    "CompiledRollout": "compiled",
    "ReferenceRollout": "reference",
    "Trajectory": "trajectory",
    "energies": "energy",
}
__all__ = list(_HOMES)

if TYPE_CHECKING:
    from whiptool.rollout.compiled import CompiledRollout
    from whiptool.rollout.energy import energies
    from whiptool.rollout.reference import ReferenceRollout
    from whiptool.rollout.trajectory import Trajectory


def __getattr__(name: str) -> object:  # CasADi and MuJoCo are imported where used
    if name in _HOMES:
        return getattr(import_module(f"whiptool.rollout.{_HOMES[name]}"), name)
    raise AttributeError(f"module 'whiptool.rollout' has no attribute {name!r}")
