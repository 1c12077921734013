"""whiptool: model whips, and search for strikes. The public names; each is imported when first used."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

__version__ = "0.1.0"

_HOMES = {
    "ConstantImpedance": "whiptool.impedance",
    "Controller": "whiptool.impedance",
    "OIAC": "whiptool.impedance",
    "oiac_preset": "whiptool.impedance",
    "ArmLink": "whiptool.models",
    "ArmParameters": "whiptool.models",
    "CompiledRollout": "whiptool.models",
    "Model": "whiptool.models",
    "ReferenceRollout": "whiptool.models",
    "Trajectory": "whiptool.models",
    "WhipParameters": "whiptool.models",
    "WhipProfile": "whiptool.models",
    "find_model": "whiptool.models",
    "preset": "whiptool.models",
    "Objective": "whiptool.objective",
    "Outcome": "whiptool.objective",
    "Target": "whiptool.objective",
    "search": "whiptool.optimizers",
    "Strike": "whiptool.strike",
    "StrikeBounds": "whiptool.strike",
}
__all__ = ["__version__", *_HOMES]

if TYPE_CHECKING:
    from whiptool.impedance import OIAC, ConstantImpedance, Controller, oiac_preset
    from whiptool.models import (
        ArmLink,
        ArmParameters,
        CompiledRollout,
        Model,
        ReferenceRollout,
        Trajectory,
        WhipParameters,
        WhipProfile,
        find_model,
        preset,
    )
    from whiptool.objective import Objective, Outcome, Target
    from whiptool.optimizers import search
    from whiptool.strike import Strike, StrikeBounds


def __getattr__(name: str) -> object:
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'whiptool' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
