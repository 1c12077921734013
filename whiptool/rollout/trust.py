"""How far a simulated whip may be trusted: bounds of the models, as data, and which of them a strike is beyond.

Where each bound comes from is computed by `python -m whiptool.reproduce crack`, see `docs/how-to/crack.md`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from whiptool.models.kinematics import chain_motion
from whiptool.models.parameters import Model
from whiptool.models.trajectory import Trajectory

SOUND = 340.0  # [m/s], speed of sound in air


@dataclass(frozen=True)
class TrustBound:
    """A quantity up to which a model of the whip may be trusted.

    Args:
        models: Which models it bounds, for people.
        quantity: What is bounded, for people.
        limit: Largest value.
        unit: Unit of the value; empty for a ratio.
        beyond: What is wrong beyond it.
    """

    models: str
    quantity: str
    limit: float
    unit: str
    beyond: str


MACH = TrustBound(
    "all whips with drag or without",
    "tip speed over the speed of sound",
    0.3,
    "",
    "air is compressed, and drag is larger than a constant coefficient has it",
)
BEND = TrustBound(
    "chains of nodes: hinge, universal, rod",
    "angle between two neighbouring links until the tip is fastest",
    60.0,
    "degrees",
    "a half turn has fewer than three links, and the tip's largest speed depends on the number of nodes",
)
ROD_BEND = TrustBound(
    "chains of rods with bending stiffness",
    "angle between two neighbouring rods",
    60.0,
    "degrees",
    "the bending torque of rods is more than 1 % below that of a linear spring",
)
STRETCH = TrustBound(
    "Cosserat rods",
    "tip speed over `wave_speed`, the speed of stretching waves",
    0.1,
    "",
    "the rod stretches by more than some 1 %, the square of this ratio",
)
TRUST = (MACH, BEND, ROD_BEND, STRETCH)


def trust_table() -> list[list[str]]:
    """Return the bounds as rows of text, the header first."""
    rows = [[x.models, x.quantity, f"{x.limit:g} {x.unit}".strip(), x.beyond] for x in TRUST]
    return [["model", "quantity", "trusted up to", "beyond it"], *rows]


def joint_bends(model: Model, trajectory: Trajectory) -> np.ndarray:
    """Return the angles between neighbouring links of the whip over time [rad], (T, N - 1)."""
    links = np.diff(chain_motion(model, trajectory.q, trajectory.v)[0][:, model.arm.n :], axis=1)
    links /= np.linalg.norm(links, axis=2, keepdims=True)
    return np.arccos(np.clip(np.vecdot(links[:, 1:], links[:, :-1]), -1, 1))


def beyond_trust(model: Model, trajectory: Trajectory) -> str | None:
    """Return a sentence on the bounds of the chain of nodes that a strike is beyond until its tip is fastest; None if
    it keeps them, or diverged.

    Args:
        model, trajectory: Trajectory of the strike, and the model with which it was simulated.
    """
    if trajectory.diverged:
        return None
    fastest = int(trajectory.tip_speed.argmax())
    speed = float(trajectory.tip_speed[fastest])
    said = []
    if speed > MACH.limit * SOUND:
        said.append(
            f"the tip moves at {speed:.0f} m/s, Mach {speed / SOUND:.2f}: beyond Mach {MACH.limit:g} {MACH.beyond}"
        )
    if model.whip.N > 1:
        sharpest = float(np.degrees(joint_bends(model, trajectory)[: fastest + 1].max()))
        if sharpest > BEND.limit:
            said.append(
                f"neighbouring links of the whip bend by {sharpest:.0f} degrees: beyond {BEND.limit:g} {BEND.beyond}; "
                "take more nodes"
            )
    return "; ".join(said) or None
