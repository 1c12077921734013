"""whiptool: model whips, and search for strikes. The public names; each is imported when first used."""

from __future__ import annotations

from typing import TYPE_CHECKING

from whiptool.gymnasium_id import register_with_gymnasium
from whiptool.lazy_names import imported_when_used

_HOMES = {
    "__version__": "version",
    "ArmLink": "models",
    "ArmParameters": "models",
    "Model": "models",
    "MotorLimits": "models",
    "PRESETS": "models",
    "Strike": "models",
    "StrikeBounds": "models",
    "WhipParameters": "models",
    "WhipProfile": "models",
    "default_bounds": "models",
    "find_model": "models",
    "limits_preset": "models",
    "preset": "models",
    "read_model": "models",
    "write_model": "models",
    "ConstantImpedance": "impedance",
    "Controller": "impedance",
    "OIAC": "impedance",
    "impedance_cost": "impedance",
    "oiac_preset": "impedance",
    "CompiledRollout": "rollout",
    "ReferenceRollout": "rollout",
    "Trajectory": "rollout",
    "Objective": "objective",
    "Outcome": "objective",
    "Target": "target",
    "Disc": "zone",
    "METHODS": "optimizers",
    "search": "optimizers",
    "plot_distance": "viz.plots",
    "plot_strike": "viz.plots",
    "StrikeRecording": "recording",
    "read_recording": "recording",
    "Fit": "identification",
    "Plant": "identification",
    "fit": "identification.fit",
    "Adaptation": "adaptation",
    "TipPort": "adaptation",
    "default_prior": "adaptation",
    "draw_twin": "adaptation",
    "load_map": "commands.map",
    "load_policy": "commands.train",
}
__all__ = list(_HOMES)

if TYPE_CHECKING:
    from whiptool.adaptation import Adaptation, TipPort, default_prior, draw_twin
    from whiptool.commands.map import load_map
    from whiptool.commands.train import load_policy
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
    from whiptool.objective import Objective, Outcome
    from whiptool.optimizers import METHODS, search
    from whiptool.recording import StrikeRecording, read_recording
    from whiptool.rollout import CompiledRollout, ReferenceRollout, Trajectory
    from whiptool.target import Target
    from whiptool.version import __version__
    from whiptool.viz.plots import plot_distance, plot_strike
    from whiptool.zone import Disc

__getattr__, __dir__ = imported_when_used(__name__, _HOMES)
register_with_gymnasium()
