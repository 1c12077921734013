"""Models: whip, profile, arm, motors and strikes as data, published presets, and files."""

from __future__ import annotations

from typing import TYPE_CHECKING

from whiptool.lazy_names import imported_when_used

_HOMES = {
    "ArmLink": "parameters",
    "ArmParameters": "parameters",
    "Model": "parameters",
    "WhipParameters": "parameters",
    "JointLimits": "spatial_arm",
    "SpatialArm": "spatial_arm",
    "SpatialLink": "spatial_arm",
    "in_space": "parameters",
    "WhipProfile": "profile",
    "Strike": "strike",
    "StrikeBounds": "strike",
    "Trajectory": "trajectory",
    "default_bounds": "strike",
    "PRESETS": "presets",
    "preset": "presets",
    "load_model": "files",
    "read_model": "files",
    "write_model": "files",
}
__all__ = list(_HOMES)

if TYPE_CHECKING:
    from whiptool.models.files import load_model, read_model, write_model
    from whiptool.models.parameters import ArmLink, ArmParameters, Model, in_space
    from whiptool.models.presets import PRESETS, preset
    from whiptool.models.profile import WhipProfile
    from whiptool.models.spatial_arm import JointLimits, SpatialArm, SpatialLink
    from whiptool.models.strike import Strike, StrikeBounds, default_bounds
    from whiptool.models.trajectory import Trajectory
    from whiptool.models.whip import WhipParameters

__getattr__, __dir__ = imported_when_used(__name__, _HOMES)  # presets and files are read where used
