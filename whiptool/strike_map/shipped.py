"""Maps that come with the package: of presets, as `python -m whiptool.map build --model NAME` builds them."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from whiptool.errors import InputError
from whiptool.models import Model
from whiptool.models.presets import PRESETS
from whiptool.rollout.compiled import CompiledRollout
from whiptool.strike_map.goal_region import usual_region
from whiptool.strike_map.store import load_packed
from whiptool.strike_map.strike_map import StrikeMap
from whiptool.strike_map.striker import Striker
from whiptool.strike_map.turning import bounds_all_around
from whiptool.words import as_named

FOLDER = Path(__file__).parent / "shipped"


def shipped_names() -> list[str]:
    """Return the names of the presets that have a map."""
    return sorted(path.stem for path in FOLDER.glob("*.npz"))


@cache
def shipped_map(name: str) -> StrikeMap:
    """Return the map of a preset, for its own controller, limits and `usual_region`.

    Raises:
        InputError: No map has that name; the message lists the maps.
    """
    name = as_named(name, shipped_names())
    if name not in shipped_names():
        raise InputError("map", name, ", ".join(shipped_names()), "or the run folder of whiptool map build")
    model = PRESETS[name]
    striker = Striker(CompiledRollout(model), bounds=bounds_all_around(model.arm))
    return StrikeMap(striker, usual_region(model), *load_packed(FOLDER / f"{name}.npz"))


def map_of(model: Model) -> StrikeMap:
    """Return the map that comes with the package for a model.

    Raises:
        InputError: The model has no map.
    """
    for name in shipped_names():
        if PRESETS[name] == model:
            return shipped_map(name)
    raise InputError("model", model.name, f"one that has a map: {', '.join(shipped_names())}, unchanged")
