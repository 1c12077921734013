"""Maps in folders: built part by part, gone on with after a kill, and opened again."""

from __future__ import annotations

import sys
from pathlib import Path

from whiptool.errors import InputError
from whiptool.progress import Progress
from whiptool.strike_map.answers import Answers
from whiptool.strike_map.building import Building
from whiptool.strike_map.goal_region import GoalRegion
from whiptool.strike_map.store import load_gate, load_parts, save_gate, save_part
from whiptool.strike_map.strike_map import StrikeMap
from whiptool.strike_map.striker import Striker

_MANY = 10_000  # parts


def built(building: Building, folder: Path) -> StrikeMap:
    """Return the map of a building; what of it is not in the folder yet is made, each part written when it is."""
    plan = building.plan
    parts = load_parts(folder, plan.parts)
    with Progress(total=plan.parts, initial=len(parts), unit=" parts", desc="map", file=sys.stderr, leave=False) as bar:
        while len(parts) < plan.parts:
            parts.append(building.part(parts))
            save_part(folder, len(parts) - 1, parts[-1])
            bar.set_postfix_str(f"{sum(map(len, parts))} answers", refresh=False)
            bar.update()
    answers, gate = Answers.joined(parts), load_gate(folder)
    if gate is None and plan.gate_strikes > 0:
        gate = building.gate(answers, progress=True)
        save_gate(folder, gate)
    return StrikeMap(building.striker, building.region, answers, gate)


def opened(striker: Striker, region: GoalRegion, folder: Path) -> StrikeMap:
    """Return the map that a folder holds.

    Raises:
        InputError: It holds none, or one of its files is damaged.
    """
    parts = load_parts(folder, _MANY)
    if not parts:
        raise InputError("strike map", str(folder), "a folder with answers, that every worker sees")
    return StrikeMap(striker, region, Answers.joined(parts), load_gate(folder))
