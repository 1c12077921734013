"""Files of strike maps: entries in parts, the ranking network (gate), and maps that come with the package."""

from __future__ import annotations

from dataclasses import fields
from functools import cache
from pathlib import Path

import numpy as np

from whiptool.errors import InputError
from whiptool.given_files import read_arrays
from whiptool.goals.arrival_rule import GoalRegion, usual_region
from whiptool.models import Model
from whiptool.models.parameters import AnyArm
from whiptool.models.presets import PRESETS
from whiptool.rollout.compiled import CompiledRollout
from whiptool.strike_map.answers import Answers, bounds_all_around
from whiptool.strike_map.strike_map import HIDDEN, Gate, StrikeMap
from whiptool.strike_map.striker import Striker
from whiptool.whole_files import write_npz
from whiptool.words import as_named

FOLDER = Path(__file__).parent / "shipped"  # of presets, as `python -m whiptool.map build --model NAME` builds them
_MANY = 10_000  # parts
GATE = "gate.npz"
# of a part's file
_SHAPES = {"strikes": "Km", "tips": "Kd", "velocities": "Kd", "tip_slopes": "Kds", "velocity_slopes": "Kds"}

_GATE_SHAPES = {  # one network (n) of two hidden layers (a, b)
    "mean": "f",
    "scale": "f",
    "layers.weights.0": "nfa",
    "layers.biases.0": "nna",
    "layers.weights.1": "nab",
    "layers.biases.1": "nnb",
    "layers.weights.2": "nbn",
    "layers.biases.2": "nnn",
}


def part_file(folder: Path, number: int) -> Path:
    """Return the path of the file that holds part `number` of a map's entries, `answers-NNN.npz`."""
    return folder / f"answers-{number:03d}.npz"


def save_part(folder: Path, number: int, answers: Answers) -> None:
    """Write part `number` of a map's entries to its file, see `part_file`."""
    write_npz(part_file(folder, number), {f.name: getattr(answers, f.name) for f in fields(Answers)})


def load_parts(folder: Path, count: int, *, first: int = 0) -> list[Answers]:
    """Return the entries of parts `first` to `count` - 1 in order, up to the first one that is missing."""
    parts: list[Answers] = []
    while (number := first + len(parts)) < count and part_file(folder, number).exists():
        arrays = read_arrays(part_file(folder, number), "strike map", _SHAPES)
        parts.append(Answers(**{name: arrays[name] for name in _SHAPES}))
    return parts


def save_gate(folder: Path, gate: Gate) -> None:
    """Write a map's ranking network (gate) as an NPZ file into its folder."""
    write_npz(folder / GATE, _gate_arrays(gate))


def load_gate(folder: Path) -> Gate | None:
    """Return the ranking network (gate), or None if there is no file."""
    if not (folder / GATE).exists():
        return None
    return _gate_of(read_arrays(folder / GATE, "strike map", _GATE_SHAPES))


def save_packed(path: Path, answers: Answers, gate: Gate) -> None:
    """Write a whole map as one small file: entries in single precision, their derivatives in half precision."""
    kept = {f.name: getattr(answers, f.name) for f in fields(Answers)}
    packed = {name: x.astype(np.float16 if name.endswith("slopes") else np.float32) for name, x in kept.items()}
    write_npz(path, packed | _gate_arrays(gate))


def load_packed(path: Path) -> tuple[Answers, Gate]:
    """Return entries and gate of a map that `save_packed` wrote."""
    arrays = read_arrays(path, "strike map", _SHAPES | _GATE_SHAPES)
    return Answers(**{name: arrays[name].astype(float) for name in _SHAPES}), _gate_of(arrays)


def opened(striker: Striker, region: GoalRegion, folder: Path) -> StrikeMap:
    """Return the map stored in a folder."""
    parts = load_parts(folder, _MANY)
    if not parts:
        raise InputError(
            "strike map", str(folder), "a folder that holds the files of a map and that every worker can read"
        )
    return StrikeMap(striker, region, Answers.joined(parts), load_gate(folder))


def shipped_names() -> list[str]:
    """Return the names of the presets that have a map."""
    return sorted(path.stem for path in FOLDER.glob("*.npz"))


@cache
def shipped_map(name: str) -> StrikeMap:
    """Return the map of a preset, for its default controller and limits and its `usual_region`."""
    name = as_named(name, shipped_names())
    if name not in shipped_names():
        raise InputError("map", name, ", ".join(shipped_names()), "or the run folder of whiptool map build")
    model = PRESETS[name]
    striker = Striker(CompiledRollout(model), bounds=bounds_all_around(model.arm))
    return StrikeMap(striker, usual_region(model), *load_packed(FOLDER / f"{name}.npz"))


def map_of(model: Model) -> StrikeMap:
    """Return the map that comes with the package for a model."""
    for name in shipped_names():
        if PRESETS[name] == model:
            return shipped_map(name)
    raise InputError("model", model.name, f"an unchanged preset that has a map: {', '.join(shipped_names())}")


def map_of_arm(arm: AnyArm) -> StrikeMap | None:
    """Return the map that comes with the package for an arm, whatever hangs on it; None for another arm."""
    names = [name for name in shipped_names() if PRESETS[name].arm == arm]
    return shipped_map(names[0]) if names else None


def _gate_arrays(gate: Gate) -> dict[str, np.ndarray]:
    arrays = {"mean": gate.mean, "scale": gate.scale}
    for i, (weight, bias) in enumerate(zip(gate.weights, gate.biases, strict=True)):
        arrays |= {f"layers.weights.{i}": weight[None], f"layers.biases.{i}": bias[None, None]}
    return arrays


def _gate_of(arrays: dict[str, np.ndarray]) -> Gate:
    layers = range(len(HIDDEN) + 1)
    weights = tuple(arrays[f"layers.weights.{i}"][0] for i in layers)
    return Gate(weights, tuple(arrays[f"layers.biases.{i}"][0, 0] for i in layers), arrays["mean"], arrays["scale"])
