"""How recorded places and times stand to the model's: a camera, or motion capture, that is scaled, turned and moved,
with its own clock.

    measured = scale R position + shift
    stamped  = clock_rate time + delay

R is in the plane a turn by `rotation`, in space `R = Rz Ry Rx` of turns about the axes.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from whiptool.models.kinematics import rotation_about

PLACED = {
    2: ("scale", "rotation", "shift_x", "shift_y"),
    3: ("scale", "rotation_x", "rotation_y", "rotation_z", "shift_x", "shift_y", "shift_z"),
}  # by dimension
NUISANCE_IN = {1: (), **{d: ("delay", "clock_rate", *names) for d, names in PLACED.items()}}  # 1: angles of links
NUISANCE = ("delay", "clock_rate", *dict.fromkeys((*PLACED[2], *PLACED[3])))
NEUTRAL = {name: float(name in ("scale", "clock_rate")) for name in NUISANCE}


def placed(x: np.ndarray, given: Mapping[str, float]) -> np.ndarray:
    """Return positions x (..., d) in the frame of the measurement, for placement parameters `PLACED[d]`."""
    d = x.shape[-1]
    shift = [given[f"shift_{axis}"] for axis in "xyz"[:d]]
    return given["scale"] * x @ _turned(given, d)[0].T + shift


def carried(dx: np.ndarray, given: Mapping[str, float]) -> np.ndarray:
    """Return the change of measured positions for a change dx (..., d) of the true ones."""
    return given["scale"] * dx @ _turned(given, dx.shape[-1])[0].T


def by_placement(x: np.ndarray, given: Mapping[str, float]) -> dict[str, np.ndarray]:
    """Return the derivatives of measured positions x (K, d) by each of `PLACED[d]`, (K, d) each."""
    d = x.shape[-1]
    R, slopes = _turned(given, d)
    found = {"scale": x @ R.T}
    found |= {name: given["scale"] * x @ dR.T for name, dR in slopes.items()}
    return found | {f"shift_{axis}": np.broadcast_to(np.eye(d)[i], x.shape) for i, axis in enumerate("xyz"[:d])}


def _turned(given: Mapping[str, float], d: int) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Return R (d, d), and its derivative by each turn."""
    if d == 2:
        c, s = np.cos(given["rotation"]), np.sin(given["rotation"])
        return np.array([[c, -s], [s, c]]), {"rotation": np.array([[-s, -c], [c, -s]])}
    axes = np.eye(3).tolist()
    X, Y, Z = (rotation_about(axis, given[f"rotation_{name}"]) for axis, name in zip(axes, "xyz", strict=True))
    Kx, Ky, Kz = (np.cross(axis, -np.eye(3)) for axis in axes)
    return Z @ Y @ X, {"rotation_x": Z @ Y @ Kx @ X, "rotation_y": Z @ Ky @ Y @ X, "rotation_z": Kz @ Z @ Y @ X}
