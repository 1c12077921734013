"""Groups of options, of which every command is composed: it has those groups whose options it uses, and no others."""

from whiptool.options.base import (
    MANY_TARGETS,
    JsonOptions,
    OptionGroup,
    OutputOptions,
    ResumableOptions,
    SeedOptions,
    check_place,
    flag,
    flags,
    refuse_idle,
    whole,
)
from whiptool.options.budget import (
    METHODS,
    WITH_DERIVATIVES,
    WITHOUT_DERIVATIVES,
    Learner,
    Methods,
    Observation,
    SearchOptions,
    TrainingOptions,
    learned_with,
    spell_methods,
)
from whiptool.options.controller import ControllerOptions, LawOptions, Preset, SimulatedControllerOptions
from whiptool.options.criteria import CriteriaOptions, CriterionName
from whiptool.options.limits import LimitOptions
from whiptool.options.region import RegionOptions
from whiptool.options.scene import LONGEST_STAY, MODELS, GoalOptions, ModelOptions, TargetOptions, ZoneOptions
from whiptool.options.simulator import Integrator, Simulator, SimulatorOptions, StepOptions
from whiptool.options.space import Space, SpaceOptions
from whiptool.options.trajectory import TrajectoryOptions
from whiptool.options.whip import WhipOptions
from whiptool.options.zone_goals import ZoneGoalOptions

__all__ = [
    "LONGEST_STAY",
    "MANY_TARGETS",
    "METHODS",
    "MODELS",
    "WITHOUT_DERIVATIVES",
    "WITH_DERIVATIVES",
    "ControllerOptions",
    "CriteriaOptions",
    "CriterionName",
    "GoalOptions",
    "Integrator",
    "JsonOptions",
    "LawOptions",
    "Learner",
    "LimitOptions",
    "Methods",
    "ModelOptions",
    "Observation",
    "OptionGroup",
    "OutputOptions",
    "Preset",
    "RegionOptions",
    "ResumableOptions",
    "SearchOptions",
    "SeedOptions",
    "SimulatedControllerOptions",
    "Simulator",
    "SimulatorOptions",
    "Space",
    "SpaceOptions",
    "StepOptions",
    "TargetOptions",
    "TrainingOptions",
    "TrajectoryOptions",
    "WhipOptions",
    "ZoneGoalOptions",
    "ZoneOptions",
    "check_place",
    "flag",
    "flags",
    "learned_with",
    "refuse_idle",
    "spell_methods",
    "whole",
]
