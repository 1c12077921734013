"""Unknown ropes on a robot in space: how their tips move, and what motion capture sees of them.

Three families are chains of ours (`whiptool.adaptation.twins`); `rope` is a Cosserat rod in PyElastica, which shares no
formula with what is fitted: it stretches, shears and twists, its air drags, and a knot hangs at its end.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.util import find_spec

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from papers.aim.robot import CONTROLLER, MODEL
from whiptool import CompiledRollout, Model, Strike, StrikeRecording, Target, Trajectory, WhipProfile, draw_twin
from whiptool.adaptation.materials import stock_of_material
from whiptool.adaptation.twins import FAMILIES
from whiptool.errors import InputError, WhiptoolError
from whiptool.models.closest import closest_on_curve
from whiptool.models.strike import T_STAY
from whiptool.rollout.cosserat import CosseratWhip, TipPaths, hand_path

ROPE = "rope"
IN_SPACE = (*FAMILIES, ROPE)
ELEMENTS = 24  # of a Cosserat rod
WAVES, RADIUS = 200.0, 0.016  # [m/s], [m]: of its stretching waves, and of its sections' inertia
KNOT = (0.001, 0.004)  # [kg]
TAPER = 0.15  # largest share of its thickness that a rope loses to its end
CLOCK = 0.004  # [s] that the cameras' clock is off by, at most
FINE = 1000.0  # [1/s] of a tip's path


@dataclass(frozen=True)
class Capture:
    """Motion capture of the tip.

    Args:
        fps: Frames per second [1/s].
        noise: Standard error of a place [m].
    """

    fps: float = 100.0
    noise: float = 0.002


CAPTURE = Capture()


@dataclass(frozen=True)
class Passed:
    """How a strike passed its target.

    Args:
        miss: [m]; None: the simulation was given up.
        angle: Between the tip's velocity and the direction [rad]; None likewise.
        hit: By point, direction and speed.
    """

    miss: float | None
    angle: float | None
    hit: bool


@dataclass(frozen=True)
class Swing:
    """A rope's tip in one strike, with time from the command's start (T,) [s], (T, 3) [m] and [m/s]."""

    t: np.ndarray
    tip: np.ndarray
    velocity: np.ndarray

    def passed(self, target: Target) -> Passed:
        """Return how it passed a target."""
        goal = target.goals
        path = CubicHermiteSpline(self.t, self.tip, self.velocity)
        when = closest_on_curve(path, goal.positions[0], samples=len(self.t))
        miss, velocity = float(np.linalg.norm(path(when) - goal.positions[0])), path(when, 1)[None]
        hit = bool(goal.hit(np.array([miss]), velocity)[0])
        return Passed(miss, None if goal.directions is None else float(goal.angle(velocity)[0]), hit)


@dataclass(frozen=True)
class UnknownRope:
    """A rope of a family, drawn by seed.

    Args:
        family: One of `IN_SPACE`.
        seed: A whole number.
        material: Material of `whiptool.adaptation.materials`.
    """

    family: str
    seed: int
    material: str

    def __post_init__(self) -> None:
        if self.family not in IN_SPACE:
            raise InputError("family", self.family, ", ".join(IN_SPACE))

    @cached_property
    def profile(self) -> WhipProfile:
        """Of a Cosserat rod."""
        rng = np.random.default_rng([17, self.seed])
        numbers = stock_of_material(self.material).draw(rng)
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

    @property
    def length(self) -> float:
        """[m]"""
        return self.profile.length if self.family == ROPE else self._twin.model.whip.length

    @property
    def reach(self) -> float:
        """Of arm and rope [m]."""
        return MODEL.reach - MODEL.whip.length + self.length

    @cached_property
    def _twin(self):
        return draw_twin(self.family, self.seed, MODEL, CONTROLLER, stock_of_material(self.material))

    @property
    def clock(self) -> float:
        """How late the cameras' clock is [s]."""
        if self.family != ROPE:
            return self._twin.clock_offset
        return float(np.random.default_rng([18, self.seed]).uniform(-CLOCK, CLOCK))

    def swing(self, strike: Strike, *, t_stay: float = T_STAY) -> Swing | None:
        """Return how the tip moves in a strike; None: the simulation was given up."""
        if self.family == ROPE:
            try:
                swung, _ = self._cosserat(strike, t_stay)
            except WhiptoolError:  # it left all bounds
                return None
            return Swing(swung.t, swung.tip[0], swung.velocity[0])
        t, paths, _ = self._chain.tip_path(strike.vector[None], t_stay=t_stay, rate=FINE)
        whole = np.isfinite(paths[0]).all(axis=1)
        if t[whole][-1] < strike.D + t_stay - 2 / FINE:
            return None
        return Swing(t[whole], paths[0, whole], np.gradient(paths[0, whole], t[whole], axis=0))

    def played(self, strike: Strike, *, t_stay: float = T_STAY) -> tuple[Model, Trajectory]:
        """Return arm and rope as a model and a trajectory of it, for pictures; a Cosserat rod as one of rods."""
        if self.family != ROPE:
            return self._twin.model, self._chain.trajectory(strike, t_stay=t_stay)
        swung, arm = self._cosserat(strike, t_stay)
        assert swung.nodes is not None
        steps = np.diff(swung.nodes[0], axis=1)
        directions = steps / np.linalg.norm(steps, axis=2, keepdims=True)
        rows = np.minimum(np.searchsorted(arm.t, swung.t - 0.5 / FINE), len(arm.t) - 1)  # both take steps of 1 ms
        of_arm = {name: getattr(arm, name)[rows] for name in ("q_d", "v_d", "tau", "K", "B")}
        q = np.hstack([arm.q[rows, : MODEL.arm.n], directions.reshape(len(rows), -1)])
        of_rope = {"q": q, "v": np.gradient(q, swung.t, axis=0), "tip": swung.tip[0]}
        path = Trajectory(t=swung.t, tip_velocity=swung.velocity[0], **of_rope, **of_arm)
        return replace(MODEL, whip=self.profile.lump(ELEMENTS, joints="rod")), path

    @property
    def _chain(self) -> CompiledRollout:
        return CompiledRollout(self._twin.model, CONTROLLER)

    def _cosserat(self, strike: Strike, t_stay: float) -> tuple[TipPaths, Trajectory]:
        """The rod in a strike, and the arm: it follows its commands exactly, whatever hangs on it."""
        arm = CompiledRollout(MODEL, CONTROLLER, timestep=1e-3).trajectory(strike, t_stay=t_stay)
        rod = CosseratWhip(self.profile, elements=ELEMENTS, wave_speed=WAVES, radius=RADIUS, gravity=MODEL.gravity)
        return rod.swing([hand_path(MODEL, arm)], rate=FINE), arm

    def recorded(
        self, swing: Swing, strike: Strike, number: int, capture: Capture = CAPTURE, *, t_stay: float = T_STAY
    ) -> StrikeRecording:
        """Return what motion capture has of a swing; the same number has the same noise."""
        rng = np.random.default_rng([IN_SPACE.index(self.family), self.seed, number])
        t = np.arange(int(swing.t[-1] * capture.fps) + 1) / capture.fps
        points = np.stack([np.interp(t, swing.t, x) for x in swing.tip.T], axis=1)
        points += capture.noise * rng.standard_normal(points.shape)
        source = f"{self.family}-{self.seed}, strike {number}"
        sigma = np.array(capture.noise)
        return StrikeRecording(
            t + self.clock, points[:, None], ("tip",), sigma=sigma, strike=strike, t_stay=t_stay, source=source
        )


def families(asked: Sequence[str] = IN_SPACE) -> tuple[str, ...]:
    """Return the families that can be simulated here: `rope` needs PyElastica."""
    return tuple(x for x in asked if x != ROPE or find_spec("elastica") is not None)
