"""The whip of the task: a leather bullwhip of 1.6 m with ten markers, and the cascade of their speeds in a throw."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from papers.human.throw_path import MeanHand, ThrowPath, thrown
from whiptool import WhipProfile
from whiptool.dynamics.swing import SwingStructure
from whiptool.models.profile import lump
from whiptool.rollout.batch import Batch
from whiptool.rollout.engine import find_engine, wanted_rung

# [m] between neighbouring markers from the tip: medians of their places in all throws
SPACES = (0.066, 0.194, 0.197, 0.205, 0.194, 0.195, 0.197, 0.207, 0.160)
LENGTH = sum(SPACES)
PLACES = LENGTH - np.cumsum([0.0, *SPACES])  # [m] from the thong's beginning, tip first
# Leather of 20 mm at the handle. Where the handle's motion is given, only ratios to this matter, and it is held
DENSITY = 0.3  # [kg/m]
DRAG = 0.008  # [N s^2/m^3]: half the density of air times a drag coefficient of 1.1 times 12 mm
NODES = 20
TIMESTEP = 5e-4  # [s]
_STRIDE = 2
_GRAVITY = 9.81


@dataclass(frozen=True)
class Bullwhip:
    """A round thong of one material whose diameter runs geometrically: density, stiffness and damping follow from it.

    Args:
        stiffness: EI at the handle [N m^2]; it goes with the fourth power of the diameter.
        taper: Diameter at the tip over that at the handle; mass per length goes with its square.
        damping_time: Damping time of the material: bending damping over stiffness [s].
    """

    stiffness: float
    taper: float
    damping_time: float

    @property
    def profile(self) -> WhipProfile:
        """Return the whip's profile."""
        return WhipProfile(
            length=LENGTH,
            linear_density=DENSITY,
            bending_stiffness=self.stiffness,
            bending_damping=self.stiffness * self.damping_time,
            density_taper=self.taper**2,
            stiffness_taper=self.taper**4,
            damping_taper=self.taper**4,
            drag=DRAG,
        )


@dataclass(frozen=True, eq=False)
class Cascade:
    """What the markers of one throw did, tip first; M markers.

    Args:
        speeds: From onset to closest approach [m/s], (T, M).
        peaks: Their largest [m/s], (M,).
        times: When, as a part of the time from onset to closest approach, (M,).
        shape: Places when the hand is fastest, from the thong's beginning [m], (M, 2).
        way: Of the tip at the end, from where the thong's beginning was when the hand was fastest [m], (2,).
    """

    speeds: np.ndarray
    peaks: np.ndarray
    times: np.ndarray
    shape: np.ndarray
    way: np.ndarray


def cascades(
    hand: MeanHand, paths: Sequence[ThrowPath], whips: Sequence[Bullwhip], *, nodes: int = NODES
) -> list[Cascade | None]:
    """Return the cascade of each path with its whip; None where the simulation of the whip diverged.

    The whip hangs at rest at first, and is clamped to the handle.
    """
    structure = SwingStructure.of(n=nodes, moving=True, point_masses=True, used=("stiffness", "drag"))
    handles = [thrown(hand, path, TIMESTEP) for path in paths]
    rows, count = len(handles[0].inputs), len(handles)
    batch = Batch(
        p=np.array([_packed(structure, whip) for whip in whips]),
        x0=np.zeros((count, 2 * nodes)),
        target=np.zeros((count, 2)),
        h=np.full(count, TIMESTEP),
        h_last=np.full(count, TIMESTEP),
        steps=np.full(count, rows - 2),
        hold=1,
        u=np.concatenate([handle.inputs for handle in handles]),
        u_row=rows * np.arange(count),
        columns=np.arange(2 * nodes),
        stride=_STRIDE,
    )
    for which in (0, 1):  # the thong hangs and does not turn, wherever the handle points and however it turns
        batch.x0[:, which * nodes] = [-handle.inputs[0, which] for handle in handles]
    paths_of_nodes, _ = find_engine(structure, forward=False, rung=wanted_rung())(batch).observed()
    found = []
    for handle, nodes_at in zip(handles, paths_of_nodes, strict=True):
        if not np.isfinite(nodes_at).all():
            found.append(None)
            continue
        relative = _markers(nodes_at.reshape(len(nodes_at), nodes, 2))
        inputs, place = handle.inputs[:-1:_STRIDE][: len(relative)], handle.place[:-1:_STRIDE][: len(relative)]
        velocity = np.gradient(relative, _STRIDE * TIMESTEP, axis=0) + inputs[:, None, 3:5]
        onset, peak, end = (min(i // _STRIDE, len(relative) - 1) for i in (handle.onset, handle.peak, handle.end))
        speeds = np.linalg.norm(velocity[onset : end + 1], axis=2)
        peaks, times = _largest(speeds)
        way = relative[end, 0] + place[end] - place[peak]
        found.append(Cascade(speeds, peaks, times, relative[peak], way))
    return found


def _packed(structure: SwingStructure, whip: Bullwhip) -> np.ndarray:
    blocks = lump(whip.profile.numbers, structure.n, clamped=True)
    lumped = {name: np.ravel(column) for name, column in blocks.items()}
    return structure.pack(
        {
            "length": lumped["l"],
            "mass": lumped["m"],
            "damping": lumped["b"],
            "stiffness": lumped["k"],
            "drag": lumped["drag"],
            "gravity": _GRAVITY,
        }
    )


def _markers(nodes: np.ndarray) -> np.ndarray:
    """Return where the markers are, (T, M, 2), on straight links between nodes (T, N, 2)."""
    count = nodes.shape[1]
    nodes = np.concatenate([np.zeros((len(nodes), 1, 2)), nodes], axis=1)
    at = np.clip(PLACES / LENGTH * count, 0, count)
    link = np.minimum(at.astype(int), count - 1)
    part = (at - link)[None, :, None]
    return nodes[:, link] * (1 - part) + nodes[:, link + 1] * part


def _largest(speeds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the largest value of each column and where it is, from 0 to 1, by a parabola through three samples."""
    count, width = speeds.shape
    i, each = speeds.argmax(axis=0), np.arange(width)
    middle = np.clip(i, 1, count - 2)
    a, b, c = (speeds[middle + k, each] for k in (-1, 0, 1))
    bend = a - 2 * b + c
    shift = np.where(bend < 0, (a - c) / np.where(bend == 0, 1, 2 * bend), 0.0)
    inside = (i == middle) & (np.abs(shift) <= 1)
    shift = np.where(inside, shift, 0.0)
    peaks = np.where(inside, b - (a - c) * shift / 4, speeds[i, each])
    return peaks, (i + shift) / (count - 1)
