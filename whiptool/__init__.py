"""whiptool: model whips, and search for strikes. The public names; each is imported when first used."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from whiptool.version import __version__

_HOMES = {
    "ArmLink": "whiptool.models",
    "ArmParameters": "whiptool.models",
    "Model": "whiptool.models",
    "MotorLimits": "whiptool.models",
    "PRESETS": "whiptool.models",
    "Strike": "whiptool.models",
    "StrikeBounds": "whiptool.models",
    "WhipParameters": "whiptool.models",
    "WhipProfile": "whiptool.models",
    "default_bounds": "whiptool.models",
    "find_model": "whiptool.models",
    "limits_preset": "whiptool.models",
    "preset": "whiptool.models",
    "read_model": "whiptool.models",
    "write_model": "whiptool.models",
    "ConstantImpedance": "whiptool.impedance",
    "Controller": "whiptool.impedance",
    "OIAC": "whiptool.impedance",
    "impedance_cost": "whiptool.impedance",
    "oiac_preset": "whiptool.impedance",
    "CompiledRollout": "whiptool.rollout",
    "ReferenceRollout": "whiptool.rollout",
    "Trajectory": "whiptool.rollout",
    "Objective": "whiptool.objective",
    "Outcome": "whiptool.objective",
    "Target": "whiptool.objective",
    "Disc": "whiptool.zone",
    "METHODS": "whiptool.optimizers",
    "search": "whiptool.optimizers",
    "plot_distance": "whiptool.viz.plots",
    "plot_strike": "whiptool.viz.plots",
    "StrikeRecording": "whiptool.recording",
    "read_recording": "whiptool.recording",
    "Fit": "whiptool.identification",
    "Plant": "whiptool.identification",
    "fit": "whiptool.identification.fit",
    "Adaptation": "whiptool.adaptation",
    "TipPort": "whiptool.adaptation",
    "default_prior": "whiptool.adaptation",
    "draw_twin": "whiptool.adaptation",
}
__all__ = ["__version__", *_HOMES]

if TYPE_CHECKING:
    from whiptool.adaptation import Adaptation, TipPort, default_prior, draw_twin
    from whiptool.identification import Fit, Plant
    from whiptool.identification.fit import fit
    from whiptool.impedance import OIAC, ConstantImpedance, Controller, impedance_cost, oiac_preset
    from whiptool.models import (
        PRESETS,
        ArmLink,
        ArmParameters,
        Model,
        MotorLimits,
        Strike,
        StrikeBounds,
        WhipParameters,
        WhipProfile,
        default_bounds,
        find_model,
        limits_preset,
        preset,
        read_model,
        write_model,
    )
    from whiptool.objective import Objective, Outcome, Target
    from whiptool.optimizers import METHODS, search
    from whiptool.recording import StrikeRecording, read_recording
    from whiptool.rollout import CompiledRollout, ReferenceRollout, Trajectory
    from whiptool.viz.plots import plot_distance, plot_strike
    from whiptool.zone import Disc


def __getattr__(name: str) -> object:
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'whiptool' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
