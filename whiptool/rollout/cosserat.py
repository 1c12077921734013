"""An independent reference for whips: the profile as a Cosserat rod in PyElastica, which shares no formula with the
chain of nodes.

The rod hangs on the hand by a ball joint, like the free first joint of a whip, and the path of the hand is given. The
rod has the properties of a `WhipProfile` before lumping: linear density, bending stiffness and damping at each
position, the tip's mass on the last node, a bead on the two nodes next to it. Properties that an inextensible beam
without sections lacks are chosen such that their effect is small:

- Extension and shear have the stiffness `linear_density wave_speed^2`, so that stretching waves run at `wave_speed`: a
  whip whose parts move with v stretches by the order of (v / wave_speed)^2.
- Sections turn with the inertia of a round rod of `radius`, `linear_density radius^2 / 4` per length, alike about all
  axes: waves shorter than some radii are slowed.

The largest stable step is `1 / (wave_speed sqrt(1 / element^2 + 1 / radius^2))`; a whip that must be truer costs more.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from whiptool.errors import InputError, WhiptoolError
from whiptool.extras import optional
from whiptool.models.kinematics import chain_motion, upright
from whiptool.models.numbers import number, whole
from whiptool.models.parameters import Model
from whiptool.models.profile import WhipProfile, shares
from whiptool.models.trajectory import Trajectory

_SHARE_OF_LIMIT = 0.9  # of the largest stable step


def hand_path(model: Model, trajectory: Trajectory) -> CubicHermiteSpline:
    """Return the hand's position over time (3,) [m] in a trajectory, as a smooth curve through its instants.

    It includes the whip's effect on the arm. For a planar model, the path is in x and z.
    """
    moving = chain_motion(model, trajectory.q, trajectory.v)
    place, velocity = (upright(x[:, model.arm.n]) for x in moving)
    return CubicHermiteSpline(trajectory.t, place, velocity)


class TipPaths(NamedTuple):
    """Motion of the tips of B rods.

    Args:
        t: Times [s], (T,).
        tip: Positions of the tips [m], (B, T, 3).
        velocity: Velocities of the tips [m/s], (B, T, 3).
        nodes: Positions of the nodes from the hand to the tip [m], (B, T, elements + 1, 3); None for extrapolated
            paths.
    """

    t: np.ndarray
    tip: np.ndarray
    velocity: np.ndarray
    nodes: np.ndarray | None = None

    def curve(self, i: int) -> CubicHermiteSpline:
        """Return the path of tip i [m] as a function of time [s], a cubic spline through positions and velocities."""
        return CubicHermiteSpline(self.t, self.tip[i], self.velocity[i])


class CosseratWhip:
    """A whip as a Cosserat rod.

    Args:
        profile: Profile of the whip, without rest curvature.
        elements: Number of elements of the rod, at least 3.
        wave_speed: Wave speed of stretching and shearing [m/s], which sets their stiffness.
        radius: Radius of the cross sections, for their inertia [m].
        gravity: Gravity [m/s^2].
        timestep: Timestep [s]; default: somewhat below the largest that is stable.
        spins: Whether sections can rotate about the rod's axis; False only to study the effect.

    Raises:
        InputError: A number is out of range, or the profile is curved at rest.
        WhiptoolError: PyElastica is missing.
    """

    def __init__(
        self,
        profile: WhipProfile,
        *,
        elements: int = 24,
        wave_speed: float = 400.0,
        radius: float = 0.016,
        gravity: float = 9.81,
        timestep: float | None = None,
        spins: bool = True,
    ) -> None:
        if profile.rest_curvature:
            raise InputError("rest_curvature", profile.rest_curvature, "0 for a whip that hangs straight down")
        self._elastica, self._parts = elastica()
        self.profile, self.elements = profile, whole("elements", elements, low=3)
        self.wave_speed = number("wave_speed", wave_speed, low=0, strict=True)
        self.radius = number("radius", radius, low=0, strict=True)
        self.gravity, self.spins = number("gravity", gravity), spins
        shortest = math.hypot(self.elements / profile.length, 1 / self.radius)  # [1/m]
        limit = 1 / (self.wave_speed * shortest)
        self.timestep = number("timestep", timestep or _SHARE_OF_LIMIT * limit, low=0, high=limit, strict=True)

    def swing(self, hands: Sequence[CubicHermiteSpline], *, rate: float = 1000.0) -> TipPaths:
        """Return the motion of tip and nodes while the hand follows a path, for B paths at once.

        Args:
            hands: B paths of the hand, positions (3,) [m] over time from 0. At first the whip hangs at rest; after the
                end of its path the hand does not move.
            rate: Sampling rate of the result [1/s].

        Raises:
            WhiptoolError: A rod diverged: the time step is too large.
        """
        end = max(float(hand.x[-1]) for hand in hands)
        per_sample = max(1, math.ceil(1 / (rate * self.timestep)))
        h = 1 / (rate * per_sample)
        samples = math.ceil(end * rate - 1e-9)
        halves = np.arange(2 * samples * per_sample + 1) * (h / 2)
        bench, rods = self._parts.Bench(), []
        for hand in hands:
            rods.append(self.add_hanging(bench, hand(0.0), h))
            times = np.minimum(halves, hand.x[-1])
            path = {"places": hand(times), "velocities": hand(times, 1), "half": h / 2}
            bench.constrain(rods[-1]).using(self._parts.MovedHand, **path)
        bench.finalize()
        nodes = np.empty((len(hands), samples + 1, self.elements + 1, 3))
        velocities = np.empty((len(hands), samples + 1, 3))
        stepper, time = self._elastica.PositionVerlet(), np.float64(0.0)
        for i in range(samples + 1):
            for _ in range(per_sample if i else 0):
                time = stepper.step(bench, time, h)
            for k, rod in enumerate(rods):
                nodes[k, i], velocities[k, i] = rod.position_collection.T, rod.velocity_collection[:, -1]
        if not np.isfinite(nodes).all():
            raise WhiptoolError(f"the Cosserat rod left all bounds at a step of {h:.3g} s: make it smaller")
        return TipPaths(np.arange(samples + 1) / rate, nodes[:, :, -1], velocities, nodes)

    def limit(
        self, hands: Sequence[CubicHermiteSpline], *, rate: float = 1000.0, elements: bool = True
    ) -> tuple[TipPaths, TipPaths]:
        """Return the tip's motion extrapolated to an infinitely fine and stiff rod, and, for comparison, the motion
        with this rod.

        The effects of elements, wave speed and sections are of second order; they are removed by Richardson
        extrapolation from this rod and one that is twice as coarse.

        Args:
            hands, rate: See `swing`.
            elements: Whether elements are made infinitely fine, too; otherwise there are as many as this rod has.

        Raises:
            InputError: The number of elements is odd and to be halved.
            WhiptoolError: See `swing`.
        """
        if elements and self.elements % 2:
            raise InputError("elements", self.elements, "an even number, to be halved")
        coarse = CosseratWhip(
            self.profile,
            elements=self.elements // 2 if elements else self.elements,
            wave_speed=self.wave_speed / 2,
            radius=2 * self.radius,
            gravity=self.gravity,
            spins=self.spins,
        )
        ours, other = self.swing(hands, rate=rate), coarse.swing(hands, rate=rate)
        tip, velocity = (4 * ours.tip - other.tip) / 3, (4 * ours.velocity - other.velocity) / 3
        return TipPaths(ours.t, tip, velocity), ours

    def add_hanging(self, bench: Any, place: np.ndarray, h: float) -> Any:
        """Add a rod to a PyElastica system and return the rod; it hangs at rest, with weight, damping and drag.

        Args:
            bench: The system, a `Bench` of `whiptool.rollout.cosserat_parts`.
            place: Position of the rod's upper end [m], (3,).
            h: Time step [s].
        """
        profile, n = self.profile, self.elements
        element = profile.length / n
        middles, inner = (np.arange(n) + 0.5) / n, np.arange(1, n) / n  # of the elements, and nodes between them
        density = profile.at("linear_density", middles)  # [kg/m]
        stiffness, damping = profile.at("bending_stiffness", inner), profile.at("bending_damping", inner)
        rod = self._elastica.CosseratRod.straight_rod(
            n,
            place,
            np.array([0.0, 0.0, -1.0]),
            np.array([0.0, 1.0, 0.0]),
            profile.length,
            self.radius,
            density / (math.pi * self.radius**2),
            youngs_modulus=1.0,  # stiffness is given below
        )
        inertia = density * element * self.radius**2 / 4
        unit = np.eye(3)[..., None]
        rod.mass_second_moment_of_inertia[:] = inertia * unit
        rod.inv_mass_second_moment_of_inertia[:] = unit / inertia
        rod.shear_matrix[:] = density * self.wave_speed**2 * unit
        rod.bend_matrix[:] = stiffness * unit
        if not self.spins:
            rod.bend_matrix[2, 2] = 0.0
        rod.mass[-1] += profile.tip_mass
        rod.mass[:] += profile.bead_mass * shares(profile.bead_place, n).ravel()
        below = np.cumsum(rod.mass[:0:-1])[::-1]  # what hangs on each element [kg]
        strain = self.gravity * below / (density * self.wave_speed**2)
        rod.position_collection[2, 1:] -= np.cumsum(strain * element)
        bench.append(rod)
        bench.add_forcing_to(rod).using(self._elastica.GravityForces, np.array([0.0, 0.0, -self.gravity]))
        if damping.any() or not self.spins:
            damper = self._parts.BendingDamper if self.spins else self._parts.UnspunDamper
            bench.dampen(rod).using(damper, damping=damping, inertia=inertia, timestep=h)
        if profile.drag:
            drag = profile.drag * element * np.r_[0.5, np.ones(n - 1), 0.5]
            bench.add_forcing_to(rod).using(self._parts.Drag, drag)
        return rod


def elastica() -> tuple[Any, Any]:
    """Return the module PyElastica and `whiptool.rollout.cosserat_parts`.

    Raises:
        InputError: PyElastica is not installed, or does not load.
    """
    return optional("elastica", "Cosserat rods"), optional("whiptool.rollout.cosserat_parts", "Cosserat rods")
