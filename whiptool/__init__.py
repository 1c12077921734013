"""whiptool: models of whips, and searches for strikes. Its public names are imported when first used."""

from __future__ import annotations

from typing import TYPE_CHECKING

from whiptool.lazy_names import doors_aside, imported_when_used, register_with_gymnasium
from whiptool.stop_signals import end_by_signals_while_importing

end_by_signals_while_importing()

_HOMES = {
    "__version__": "version",
    "ArmLink": "models",
    "ArmParameters": "models",
    "Model": "models",
    "MotorLimits": "limits.arm_limits",
    "Strike": "models",
    "StrikeBounds": "models",
    "WhipParameters": "models",
    "WhipProfile": "models",
    "default_bounds": "models",
    "limits_preset": "limits.arm_limits",
    "load_model": "models",
    "preset": "models",
    "presets": "models.presets",
    "read_model": "models",
    "write_model": "models",
    "ConstantImpedance": "impedance",
    "Controller": "impedance",
    "OIAC": "impedance",
    "default_controller": "impedance",
    "impedance_cost": "impedance",
    "oiac_preset": "impedance",
    "CompiledRollout": "rollout",
    "ReferenceRollout": "rollout",
    "Trajectory": "models",
    "Objective": "objective",
    "Outcome": "objective",
    "Target": "goals.target",
    "Disc": "goals.zone",
    "METHODS": "optimizers",
    "search": "optimizers",
    "animate": "viz.animation",
    "plot_distance": "viz.plots",
    "plot_strike": "viz.plots_strike",
    "plot_tip_speed": "viz.plots",
    "plot_torque": "viz.plots",
    "plot_tracking": "viz.plots",
    "StrikeRecording": "recording",
    "read_recording": "recording",
    "Fit": "identification",
    "Plant": "identification",
    "fit": "identification.fit",
    "similarity": "identification.similarity",
    "Adaptation": "adaptation",
    "TipPort": "adaptation",
    "default_prior": "adaptation",
    "draw_twin": "adaptation",
    "load_map": "strike_map.building",
    "load_policy": "rl.trained",
    "train": "rl.trained",
    "compare": "comparison.plan",
    "correct": "correction",
    "WhipEnv": "rl.environment",
    "citations": "runs",
}
__all__ = list(_HOMES)

if TYPE_CHECKING:
    from whiptool.adaptation import Adaptation, TipPort, default_prior, draw_twin
    from whiptool.comparison.plan import compare
    from whiptool.correction import correct
    from whiptool.goals.target import Target
    from whiptool.goals.zone import Disc
    from whiptool.identification import Fit, Plant
    from whiptool.identification.fit import fit
    from whiptool.identification.similarity import similarity
    from whiptool.impedance import OIAC, ConstantImpedance, Controller, default_controller, impedance_cost, oiac_preset
    from whiptool.limits.arm_limits import MotorLimits, limits_preset
    from whiptool.models import (
        ArmLink,
        ArmParameters,
        Model,
        Strike,
        StrikeBounds,
        Trajectory,
        WhipParameters,
        WhipProfile,
        default_bounds,
        load_model,
        preset,
        read_model,
        write_model,
    )
    from whiptool.models.presets import presets
    from whiptool.objective import Objective, Outcome
    from whiptool.optimizers import METHODS, search
    from whiptool.recording import StrikeRecording, read_recording
    from whiptool.rl.environment import WhipEnv
    from whiptool.rl.trained import load_policy, train
    from whiptool.rollout import CompiledRollout, ReferenceRollout
    from whiptool.runs import citations
    from whiptool.strike_map.building import load_map
    from whiptool.version import __version__
    from whiptool.viz.animation import animate
    from whiptool.viz.plots import plot_distance, plot_tip_speed, plot_torque, plot_tracking
    from whiptool.viz.plots_strike import plot_strike

__getattr__, __dir__ = imported_when_used(__name__, _HOMES)
doors_aside(__name__, _HOMES)
register_with_gymnasium()
