"""Chains of nodes that hang from a fixed point and begin with a fold, on the engine that simulates strikes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from whiptool import WhipProfile
from whiptool.dynamics.structure import row_columns
from whiptool.dynamics.swing import SwingStructure
from whiptool.models.profile import lump
from whiptool.rollout.batch import Batch
from whiptool.rollout.engine import find_engine, wanted_rung

Lumped = dict[str, np.ndarray]


def lumped(profile: WhipProfile, nodes: int, *, thinning: float = 1.0) -> Lumped:
    """Return the nodes of a profile by quantity, (N,) each; drag goes with the thickness, whose ratio of tip to handle
    is `thinning`."""
    found = {name: np.ravel(column) for name, column in lump(profile.numbers, nodes).items()}
    return found | {"drag": found["drag"] * thinning ** (np.arange(1, nodes + 1) / nodes)}


@dataclass(frozen=True, eq=False)
class Motion:
    """Motion of a chain in the plane; angles are those of links from straight down.

    Args:
        whip: Its nodes.
        gravity: [m/s^2].
        t: Times [s], (T,).
        angles, rates: Of the links [rad, rad/s], (T, N).
    """

    whip: Lumped
    gravity: float
    t: np.ndarray
    angles: np.ndarray
    rates: np.ndarray

    @cached_property
    def places(self) -> np.ndarray:
        """Places of the nodes [m], (T, N, 2)."""
        across = np.stack([np.sin(self.angles), -np.cos(self.angles)], axis=-1)
        return np.cumsum(self.whip["l"][:, None] * across, axis=1)

    @cached_property
    def velocities(self) -> np.ndarray:
        """Velocities of the nodes [m/s], (T, N, 2)."""
        along = np.stack([np.cos(self.angles), np.sin(self.angles)], axis=-1)
        return np.cumsum((self.whip["l"] * self.rates)[..., None] * along, axis=1)

    @property
    def tip_speed(self) -> np.ndarray:
        """Speed of the tip [m/s], (T,)."""
        return np.linalg.norm(self.velocities[:, -1], axis=1)

    @property
    def energy(self) -> np.ndarray:
        """Kinetic energy and that in gravity [J], (T,)."""
        kinetic = (self.velocities**2).sum(axis=2) / 2
        return (kinetic + self.gravity * self.places[..., 1]) @ self.whip["m"]

    @property
    def bends(self) -> np.ndarray:
        """The sharpest angle between neighbouring links at any time [rad], (T,)."""
        return np.abs(np.diff(self.angles, axis=1)).max(axis=1)

    @property
    def momentum(self) -> np.ndarray:
        """Momentum downwards [kg m/s], (T,)."""
        return -self.velocities[..., 1] @ self.whip["m"]

    @property
    def pull(self) -> np.ndarray:
        """Force with which the chain pulls at its support downwards [N], (T,)."""
        return self.whip["m"].sum() * self.gravity - np.gradient(self.momentum, self.t)


def folded(whip: Lumped, place: float, radius: float, speed: float) -> tuple[np.ndarray, np.ndarray]:
    """Return angles and rates (N,) of a chain that hangs down to a half circle and goes up from there, its upward part
    moving down with a speed.

    Args:
        whip: Its nodes.
        place: Middle of the half circle, along the chain [m].
        radius: Of the half circle [m]; at least a link's length is taken, so that three links are in it.
        speed: Of the part beyond it [m/s].
    """
    middles = np.cumsum(whip["l"]) - whip["l"] / 2
    radius = max(radius, float(whip["l"].max()))
    along = (middles - place) / (np.pi * radius) + 0.5
    within = (along > 0) & (along < 1)
    return np.pi * np.clip(along, 0, 1), np.where(within, -speed / 2 / radius, 0.0)


def moved(whip: Lumped, begin: tuple[np.ndarray, np.ndarray], *, until: float, step: float, gravity: float) -> Motion:
    """Return the motion from angles and rates of the links at first, until some time [s], in equal steps [s].

    It ends before the instant from which it diverges.
    """
    nodes = len(whip["l"])
    structure = SwingStructure.of(n=nodes, moving=False, point_masses=True, used=("stiffness", "drag"))
    named = {"length": "l", "mass": "m", "damping": "b", "stiffness": "k", "drag": "drag"}
    p = structure.pack({name: whip[column] for name, column in named.items()} | {"gravity": gravity})
    x0 = np.concatenate([np.diff(x, prepend=0.0) for x in begin])
    each = np.array([step])
    steps = np.array([round(until / step)])
    batch = Batch(p[None], x0[None], np.zeros((1, 2)), each, each, steps, hold=1, with_rows=True)
    rolled = find_engine(structure, forward=False, rung=wanted_rung())(batch)
    assert rolled.rows is not None
    x = rolled.rows[:, row_columns(nodes, 0, 2)["x"]]
    good = np.isfinite(x).all(axis=1)
    count = len(x) if good.all() else int(good.argmin())
    both = [np.cumsum(part[:count], axis=1) for part in (x[:, :nodes], x[:, nodes:])]
    return Motion(whip, gravity, rolled.rows[:count, 0], *both)
