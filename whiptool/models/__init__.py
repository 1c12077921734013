"""Models of whip and arm, and the two ways to roll a strike out."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

_HOMES = {
    "ArmLink": "parameters",
    "ArmParameters": "parameters",
    "Model": "parameters",
    "WhipParameters": "parameters",
    "WhipProfile": "profile",
    "PRESETS": "presets",
    "preset": "presets",
    "find_model": "files",
    "read_model": "files",
    "write_model": "files",
    "Trajectory": "trajectory",
    "CompiledRollout": "compiled",
    "ReferenceRollout": "reference",
    "Arm": "arm",
    "Chain": "chain",
    "chain_of": "chain",
    "hanging_modes": "modes",
    "linearise": "modes",
}
__all__ = list(_HOMES)

if TYPE_CHECKING:
    from whiptool.models.arm import Arm
    from whiptool.models.chain import Chain, chain_of
    from whiptool.models.compiled import CompiledRollout
    from whiptool.models.files import find_model, read_model, write_model
    from whiptool.models.modes import hanging_modes, linearise
    from whiptool.models.parameters import ArmLink, ArmParameters, Model, WhipParameters
    from whiptool.models.presets import PRESETS, preset
    from whiptool.models.profile import WhipProfile
    from whiptool.models.reference import ReferenceRollout
    from whiptool.models.trajectory import Trajectory


def __getattr__(name: str) -> object:  # MuJoCo, Pinocchio and CasADi are imported where used
    if name in _HOMES:
        return getattr(import_module(f"whiptool.models.{_HOMES[name]}"), name)
    raise AttributeError(f"module 'whiptool.models' has no attribute {name!r}")
