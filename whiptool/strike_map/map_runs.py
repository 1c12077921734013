"""Maps of run folders: what a run of `whiptool map build` builds, and its map when it is finished."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any

from whiptool.errors import InputError, expect
from whiptool.goals.arrival_rule import GoalRegion, named_rule, named_zone, usual_region
from whiptool.goals.target import HIT_RADIUS
from whiptool.goals.zone import RADIUS
from whiptool.impedance.controller_files import controller_from_table
from whiptool.limits.all_limits import named_limits
from whiptool.models import Model
from whiptool.models.files import model_from_table
from whiptool.models.strike import T_STAY
from whiptool.rollout.compiled import CompiledRollout
from whiptool.runs import config_of
from whiptool.strike_map.answers import Answers
from whiptool.strike_map.building import Building, MapPlan
from whiptool.strike_map.map_files import load_gate, load_parts, shipped_map
from whiptool.strike_map.strike_map import StrikeMap
from whiptool.strike_map.striker import Striker
from whiptool.strike_map.turning import bounds_all_around

_ZONE = {"target": None, "zone_radius": RADIUS, "sector": None, "region": None}  # where none is named


def building_of(config: Mapping[str, Any]) -> Building:
    """Return the building of a run of `whiptool map build`, from its configuration, not begun.

    Raises:
        InputError: The region that the options name is out of the model's reach, or of another dimension.
    """
    options, model = config["options"], model_from_table(config["model"])
    controller = controller_from_table(config["controller"])
    controller.check_fits(model.arm)
    accuracy = {"tolerance": options.get("tolerance"), "timestep": options.get("timestep")}
    striker = Striker(
        CompiledRollout(model, controller, **accuracy),
        bounds=bounds_all_around(model.arm),
        limits=named_limits(options, model, prescribed=controller.prescribed),
        t_stay=options.get("t_stay", T_STAY),
    )
    lengths = (options[name] for name in ("random_strikes", "room", "rounds", "goals", "gate_strikes"))
    return Building(striker, _region_of(options, model), MapPlan(*lengths), seed=options["seed"])


def _region_of(options: Mapping[str, Any], model: Model) -> GoalRegion:
    """Return the region of goals that options name, or the usual one."""
    rule, hit_radius = named_rule(options), options.get("hit_radius", HIT_RADIUS)
    if any(options.get(name, usual) != usual for name, usual in _ZONE.items()):
        return GoalRegion(named_zone(options, model), rule, hit_radius)
    usual = usual_region(model, hit_radius)
    rule.check_dimension(model)
    return usual if rule.only_points else replace(usual, rule=rule)


def load_map(run_folder: str | Path) -> StrikeMap:
    """Return a strike map.

    Args:
        run_folder: Run folder of `python -m whiptool.map build`, or, if there is no such folder, the name of a preset
            whose map comes with the package.

    Raises:
        InputError: No preset has this name, the folder is of another command, or its map is not complete.
    """
    expect(str, PathLike, run_folder=run_folder)
    folder = Path(run_folder)
    if not folder.exists() and folder.name == str(run_folder):
        return shipped_map(str(run_folder))
    building = building_of(config_of(folder, "map"))
    parts, gate = load_parts(folder, building.plan.parts), load_gate(folder)
    if len(parts) < building.plan.parts or (gate is None and building.plan.gate_strikes > 0):
        rule = f"a finished map; continue with whiptool map build --resume {folder}"
        raise InputError("run_folder", str(folder), rule)
    return StrikeMap(building.striker, building.region, Answers.joined(parts), gate)
