"""Files of a strike map: its answers, part by part as they were made, and its gate; arrays only."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np

from whiptool.given_files import read_arrays
from whiptool.strike_map.answers import Answers
from whiptool.strike_map.gate import HIDDEN, Gate
from whiptool.whole_files import write_npz

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
    """Return the file of a part."""
    return folder / f"answers-{number:03d}.npz"


def save_part(folder: Path, number: int, answers: Answers) -> None:
    """Write the answers of a part."""
    write_npz(part_file(folder, number), {f.name: getattr(answers, f.name) for f in fields(Answers)})


def load_parts(folder: Path, count: int) -> list[Answers]:
    """Return the answers of the parts that are there, in order, up to the first of `count` that is not.

    Raises:
        InputError: A file has another format.
    """
    parts: list[Answers] = []
    while len(parts) < count and part_file(folder, len(parts)).exists():
        arrays = read_arrays(part_file(folder, len(parts)), "strike map", _SHAPES)
        parts.append(Answers(**{name: arrays[name] for name in _SHAPES}))
    return parts


def save_gate(folder: Path, gate: Gate) -> None:
    """Write a gate."""
    write_npz(folder / GATE, _gate_arrays(gate))


def load_gate(folder: Path) -> Gate | None:
    """Return the gate, or None where there is no file.

    Raises:
        InputError: The file has another format.
    """
    if not (folder / GATE).exists():
        return None
    return _gate_of(read_arrays(folder / GATE, "strike map", _GATE_SHAPES))


def save_packed(path: Path, answers: Answers, gate: Gate) -> None:
    """Write a whole map as one small file: answers in single precision, their derivatives in half."""
    kept = {f.name: getattr(answers, f.name) for f in fields(Answers)}
    packed = {name: x.astype(np.float16 if name.endswith("slopes") else np.float32) for name, x in kept.items()}
    write_npz(path, packed | _gate_arrays(gate))


def load_packed(path: Path) -> tuple[Answers, Gate]:
    """Return the map that `save_packed` wrote.

    Raises:
        InputError: The file has another format.
    """
    arrays = read_arrays(path, "strike map", _SHAPES | _GATE_SHAPES)
    return Answers(**{name: arrays[name].astype(float) for name in _SHAPES}), _gate_of(arrays)


def _gate_arrays(gate: Gate) -> dict[str, np.ndarray]:
    arrays = {"mean": gate.mean, "scale": gate.scale}
    for i, (weight, bias) in enumerate(zip(gate.weights, gate.biases, strict=True)):
        arrays |= {f"layers.weights.{i}": weight[None], f"layers.biases.{i}": bias[None, None]}
    return arrays


def _gate_of(arrays: dict[str, np.ndarray]) -> Gate:
    layers = range(len(HIDDEN) + 1)
    weights = tuple(arrays[f"layers.weights.{i}"][0] for i in layers)
    return Gate(weights, tuple(arrays[f"layers.biases.{i}"][0, 0] for i in layers), arrays["mean"], arrays["scale"])
