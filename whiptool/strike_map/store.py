"""Files of a strike map: its answers, part by part as they were made, and its gate; arrays only."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

from whiptool.extras import optional
from whiptool.given_files import parsing, read_arrays
from whiptool.strike_map.answers import Answers
from whiptool.strike_map.gate import HIDDEN, Gate
from whiptool.whole_files import write_npz

GATE = "gate.npz"
# of a part's file
_SHAPES = {"strikes": "Km", "tips": "Kd", "velocities": "Kd", "tip_slopes": "Kds", "velocity_slopes": "Kds"}


def part_file(folder: Path, number: int) -> Path:
    """Return the file of a part."""
    return folder / f"answers-{number:03d}.npz"


def save_part(folder: Path, number: int, answers: Answers) -> None:
    """Write the answers of a part."""
    write_npz(part_file(folder, number), {f.name: getattr(answers, f.name) for f in fields(Answers)})


def load_parts(folder: Path, count: int) -> list[Answers]:
    """Return the answers of the parts that are there, in order, up to the first of `count` that is not.

    Raises:
        InputError: A file is none of these.
    """
    parts: list[Answers] = []
    while len(parts) < count and part_file(folder, len(parts)).exists():
        arrays = read_arrays(part_file(folder, len(parts)), "strike map", _SHAPES)
        parts.append(Answers(**{name: arrays[name] for name in _SHAPES}))
    return parts


def save_gate(folder: Path, gate: Gate) -> None:
    """Write a gate."""
    weights = {f"layers.{name}": x.numpy() for name, x in gate.layers.state_dict().items()}
    write_npz(folder / GATE, {"mean": gate.mean, "scale": gate.scale, **weights})


def load_gate(folder: Path) -> Gate | None:
    """Return the gate, or None where there is no file.

    Raises:
        InputError: The file is none of these.
    """
    if not (folder / GATE).exists():
        return None
    torch = optional("torch", "the gate of a strike map")
    from whiptool.rl.networks import Layers

    arrays = read_arrays(folder / GATE, "strike map", {"mean": "f", "scale": "f"})
    with parsing(folder / GATE, "NPZ"):  # PyTorch refuses weights of other names and shapes
        layers = Layers([len(arrays["mean"]), *HIDDEN, 1], torch.Generator())
        weights = {name.removeprefix("layers."): x for name, x in arrays.items() if name.startswith("layers.")}
        layers.load_state_dict({name: torch.as_tensor(x) for name, x in weights.items()})
        return Gate(layers, arrays["mean"], arrays["scale"])
