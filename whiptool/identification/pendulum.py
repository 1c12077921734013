"""A planar pendulum of any number of links that swings freely, and recordings of its angles."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.identification.plant import Quantities
from whiptool.models.parameters import ArmLink, number

_EACH = ("dry_friction", "drag")  # per link, in addition to what a link itself holds
_SHORT = 0.015  # [s] through which an angle is a parabola
_LINK = ("mass", "length", "com", "inertia", "friction")


@dataclass(frozen=True)
class Pendulum:
    """Rigid links in a row, the first on a fixed pivot.

    Args:
        links: The links in order; `friction` is viscous, of a link's own joint.
        dry_friction: Dry friction of each joint at high speed [N m], one per link; empty: none.
        friction_velocity: Joint speed around which dry friction turns over smoothly [rad/s].
        drag: Quadratic air drag at each link's end [N s^2/m^2], one per link; empty: none.
        gravity: Gravity [m/s^2].

    Raises:
        InputError: A value breaks its rule.
    """

    links: tuple[ArmLink, ...]
    dry_friction: tuple[float, ...] = ()
    friction_velocity: float = 0.1
    drag: tuple[float, ...] = ()
    gravity: float = 9.81

    def __post_init__(self) -> None:
        links = tuple(self.links)
        if not links or not all(isinstance(link, ArmLink) for link in links):
            raise InputError("links", self.links, "one or more ArmLink")
        object.__setattr__(self, "links", links)
        for name in _EACH:
            values = tuple(getattr(self, name)) or (0.0,) * len(links)
            if len(values) != len(links):
                raise InputError(name, values, f"{len(links)} numbers, one per link")
            object.__setattr__(self, name, tuple(number(f"{name}[{i}]", x, low=0) for i, x in enumerate(values)))
        velocity = number("friction_velocity", self.friction_velocity, low=0, strict=True)
        object.__setattr__(self, "friction_velocity", velocity)
        object.__setattr__(self, "gravity", number("gravity", self.gravity, low=0))

    @property
    def n(self) -> int:
        """Number of links of the pendulum."""
        return len(self.links)

    def values(self) -> dict[str, float]:
        """Every number by name: `link.mass[0]`, `link.dry_friction[1]`, `link.drag[0]`, `gravity`."""
        named = {f"link.{name}[{i}]": getattr(link, name) for i, link in enumerate(self.links) for name in _LINK}
        named |= {f"link.{name}[{i}]": x for name in _EACH for i, x in enumerate(getattr(self, name))}
        return named | {"friction_velocity": self.friction_velocity, "gravity": self.gravity}

    def changed(self, changes: Mapping[str, float]) -> Pendulum:
        """A copy with some of `values()` changed.

        Raises:
            InputError: A name is unknown, or a value is not allowed.
        """
        known = self.values()
        for name in changes:
            if name not in known:
                raise InputError("parameter", name, "one of " + ", ".join(known))
        all_of = known | dict(changes)
        links = tuple(ArmLink(**{name: all_of[f"link.{name}[{i}]"] for name in _LINK}) for i in range(self.n))
        each = {name: tuple(all_of[f"link.{name}[{i}]"] for i in range(self.n)) for name in _EACH}
        return dataclasses.replace(
            self,
            links=links,
            friction_velocity=all_of["friction_velocity"],
            gravity=all_of["gravity"],
            **each,
        )

    def quantities(self) -> Quantities:
        """Blocks of numbers, as a swing takes them."""
        blocks = {name: np.array([getattr(link, name) for link in self.links]) for name in _LINK}
        blocks["damping"] = blocks.pop("friction")
        blocks |= {name: np.array(getattr(self, name)) for name in _EACH}
        return blocks | {name: np.array([getattr(self, name)]) for name in ("friction_velocity", "gravity")}


@dataclass(frozen=True, eq=False)
class AngleRecording:
    """A free swing, as encoders saw it.

    Args:
        t: Times [s], (T,), increasing.
        angles: Absolute angle of each link, 0 hanging straight down [rad], (T, n); NaN where missing.
        start: Angles and their rates at t[0] as measured, (2, n) [rad, rad/s]; a first guess, and where predictions
            begin.
        sigma: Standard error of the angles [rad].
        source: File of the recording.

    Raises:
        InputError: Shapes do not fit, times do not increase, or nothing was seen.
    """

    t: np.ndarray
    angles: np.ndarray
    start: np.ndarray
    sigma: float = 1e-3
    source: str = ""

    def __post_init__(self) -> None:
        for name in ("t", "angles", "start"):
            object.__setattr__(self, name, np.array(getattr(self, name), float))
        if self.t.ndim != 1 or len(self.t) < 2 or not (np.diff(self.t) > 0).all():
            raise InputError("t", f"{self.t.shape} times", "two or more finite times in increasing order")
        if self.angles.ndim != 2 or len(self.angles) != len(self.t) or not np.isfinite(self.angles).any():
            raise InputError("angles", self.angles.shape, f"({len(self.t)}, links), not all of them missing")
        if self.start.shape != (2, self.angles.shape[1]) or not np.isfinite(self.start).all():
            raise InputError("start", self.start.shape, f"finite angles and rates, (2, {self.angles.shape[1]})")
        object.__setattr__(self, "sigma", number("sigma", self.sigma, low=0, strict=True))

    def cut(self, length: float) -> list[AngleRecording]:
        """Pieces of `length` seconds, each beginning where a parabola through its first samples says.

        A long swing of several links forgets its start; pieces do not, and a fit that begins with them converges.
        """
        count = max(1, round((self.t[-1] - self.t[0]) / length))
        ends = np.linspace(0, len(self.t), count + 1).astype(int)
        pieces: list[AngleRecording] = []
        for first, last in itertools.pairwise(ends):
            t, angles = self.t[first:last], self.angles[first:last]
            piece = dataclasses.replace(self, t=t, angles=angles)
            pieces.append(piece if first == 0 else dataclasses.replace(piece, start=piece.parabola))
        return pieces

    @property
    def parabola(self) -> np.ndarray:
        """Angles and rates at the first sample, by a parabola through the first samples, (2, n) [rad, rad/s]."""
        t = self.t - self.t[0]
        few = slice(0, min(len(t), max(4, int(np.searchsorted(t, _SHORT)))))
        return np.polynomial.polynomial.polyfit(t[few], self.angles[few], 2)[:2]

    @property
    def provenance(self) -> dict[str, Any]:
        """Where it came from and what it holds, as plain data for a report."""
        seen = np.isfinite(self.angles).sum(axis=0)
        return {
            "source": self.source,
            "frames": len(self.t),
            "span": [float(self.t[0]), float(self.t[-1])],
            "markers": {f"link{i + 1}": int(n) for i, n in enumerate(seen)},
        }
