"""Unknown ropes that no chain of ours is: Cosserat rods in PyElastica, as a port of an adaptation.

Such a rope shares no formula with what is fitted: it stretches, shears and twists, its air drags, and a knot hangs at
its end.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from whiptool import CompiledRollout, Controller, Model, Strike, Target, WhipProfile
from whiptool.adaptation.materials import stock_of_material
from whiptool.adaptation.ports import TipPort
from whiptool.adaptation.twins import Twin
from whiptool.errors import WhiptoolError
from whiptool.models.trajectory import Approach, closest_on_curve
from whiptool.rollout.cosserat import CosseratWhip, TipPaths, hand_path

ROPE = "rope"
ELEMENTS = 24
WAVES, RADIUS = 200.0, 0.016  # [m/s], [m]: of its stretching waves, and of its sections' inertia
KNOT = (0.001, 0.004)  # [kg]
TAPER = 0.15  # largest share of its thickness that a rope loses to its end
CLOCK = 0.004  # [s] that the camera's clock is off by, at most
NOISE = 0.005  # [m], as of every twin's camera
FINE = 1000.0  # [1/s] of a tip's path


def drawn_profile(seed: int, material: str) -> WhipProfile:
    """Return the rope of a material that a seed draws."""
    rng = np.random.default_rng([17, seed])
    numbers = stock_of_material(material).draw(rng)
    thin = 1 - rng.uniform(0, TAPER)
    return WhipProfile(
        length=numbers["length"],
        linear_density=numbers["linear_density"],
        bending_stiffness=numbers["bending_stiffness"],
        bending_damping=numbers["bending_damping"],
        density_taper=thin**2,
        stiffness_taper=thin**4,
        damping_taper=thin**4,
        drag=numbers["drag"],
        tip_mass=float(rng.uniform(*KNOT)),
    )


def drawn_rope(seed: int, material: str, model: Model, controller: Controller) -> Twin:
    """Return what a seed draws as a twin; its model has the rope's length, but moves as a chain."""
    whip = drawn_profile(seed, material).lump(ELEMENTS, joints="rod")
    clock = float(np.random.default_rng([18, seed]).uniform(-CLOCK, CLOCK))
    return Twin(ROPE, seed, replace(model, whip=whip), controller, 0.0, clock, NOISE)


class RodPort(TipPort):
    """A rope as a Cosserat rod, on an arm that follows its commands exactly, whatever hangs on it.

    Args:
        rope: See `drawn_rope`.
        material: Its material.
        model: The arm.
        target: Target.
        t_stay: The strike is watched so long after the movement ended [s].
    """

    def __init__(self, rope: Twin, material: str, model: Model, target: Target, *, t_stay: float) -> None:
        super().__init__(rope, target, t_stay=t_stay)
        self.profile, self.model = drawn_profile(rope.seed, material), model
        self._swung: tuple[Strike, TipPaths | None] | None = None

    def swing(self, strike: Strike) -> TipPaths | None:
        """Return how the rod moves in a strike; None: it left all bounds."""
        if self._swung is None or self._swung[0] != strike:
            arm = CompiledRollout(self.model, self.twin.controller, timestep=1e-3)
            hand = hand_path(self.model, arm.trajectory(strike, t_stay=self.t_stay))
            rod = CosseratWhip(
                self.profile, elements=ELEMENTS, wave_speed=WAVES, radius=RADIUS, gravity=self.model.gravity
            )
            try:
                self._swung = strike, rod.swing([hand], rate=FINE)
            except WhiptoolError:
                self._swung = strike, None
        return self._swung[1]

    def passes(self, strike: Strike) -> Approach:
        """Return how its tip passes the target in a strike."""
        swung, place = self.swing(strike), np.array(self.target)
        nothing = np.zeros((1, self.model.arm.n))
        if swung is None:
            lost = np.full((1, 3), np.nan)
            return Approach(np.array([np.inf]), np.zeros(1), lost, lost, nothing, nothing, np.array([True]))
        curve = swung.curve(0)
        when = closest_on_curve(curve, place, samples=len(swung.t))
        miss = np.array([np.linalg.norm(curve(when) - place)])
        tip, velocity = curve(when)[None], curve(when, 1)[None]
        return Approach(miss, np.array([when]), velocity, tip, nothing, nothing, np.array([False]))

    def path(self, strike: Strike) -> tuple[np.ndarray, np.ndarray]:
        """Return times and its tip's path."""
        swung = self.swing(strike)
        assert swung is not None
        return swung.t, swung.tip[0]
