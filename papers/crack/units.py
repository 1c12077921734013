"""The work units: a folded chain that falls, a loop that runs along a whip, and a robot's fastest strike."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from papers.crack.chains import Lumped, Motion, folded, lumped, moved
from papers.crack.closed_forms import loop_time
from whiptool import CompiledRollout, Controller, Objective, Target, WhipProfile, default_bounds, preset, search
from whiptool.comparison.units import Unit
from whiptool.goals.criteria import find_criterion
from whiptool.impedance import PositionControl
from whiptool.limits.arm_limits import ArmLimits
from whiptool.models.kinematics import joint_points
from whiptool.models.parameters import Model
from whiptool.models.profile import resized
from whiptool.rollout.trust import beyond_trust, joint_bends

GRAVITY = 9.81
_LIMP = 1e-9  # [N m^2]: a profile has some stiffness
_SHOWN = 80  # instants that a picture or film has
_GAINED = 1.1  # energy over that at first from which on an integration is not looked at


@dataclass(frozen=True, kw_only=True)
class FoldedUnit(Unit):
    """A uniform chain of 1 m and 1 kg, folded in the middle, one end of which is let go, a work unit.

    Args:
        nodes: Number of nodes.
        radius: Of the fold [m].
    """

    nodes: int
    radius: float = 0.02

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Let it fall, and return how long it took, how fast the tip was at each depth, and the pull at the support."""
        profile = WhipProfile(length=1.0, linear_density=1.0, bending_stiffness=_LIMP, bending_damping=0.0)
        whip = lumped(profile, self.nodes)
        seen = moved(whip, folded(whip, 0.5, self.radius, 0.0), until=0.5, step=4e-3 / self.nodes, gravity=GRAVITY)
        depth = seen.places[0, -1, 1] - seen.places[:, -1, 1]
        lowest = int((seen.velocities[1:, -1, 1] > 0).argmax())  # before the tip goes up for the first time
        fastest = int(seen.tip_speed[: lowest + 1].argmax())
        way = slice(0, fastest)
        depths = np.linspace(0.05, 0.9, 18)
        return {
            "time": float(seen.t[lowest]),
            "fall": float(depth[lowest]),
            "depths": depths.tolist(),
            "times": np.interp(depths, depth[way], seen.t[way]).tolist(),
            "speeds": np.interp(depths, depth[way], seen.tip_speed[way]).tolist(),
            "peak": float(seen.tip_speed[fastest]),
            "pull": float(seen.pull.max() / GRAVITY),
            "energy": float(np.abs(seen.energy[way] / seen.energy[0] - 1).max()),
        }


@dataclass(frozen=True, kw_only=True)
class LoopUnit(Unit):
    """A loop that runs along a whip whose handle rests, from a half circle of 6 cm on, a work unit.

    Args:
        nodes: Number of nodes.
        taper: Thickness at the tip over that at the handle.
        start: Where the loop begins, as a fraction of the length.
        stiffness: Bending stiffness at the handle [N m^2].
        damping_time: Bending damping over stiffness [s].
        drag: Drag per length at the handle [N s^2/m^3].
        speed: Of the part of the tip at first [m/s].
        length: Of the whip [m].
        density: Mass per length at the handle [kg/m].
    """

    nodes: int = 80
    taper: float = 0.3
    start: float = 0.3
    stiffness: float = _LIMP
    damping_time: float = 0.0
    drag: float = 0.0
    speed: float = 10.0
    length: float = 1.6
    density: float = 0.3

    @property
    def whip(self) -> Lumped:
        """Return its nodes."""
        profile = WhipProfile(
            length=self.length,
            linear_density=self.density,
            bending_stiffness=self.stiffness,
            bending_damping=self.stiffness * self.damping_time,
            density_taper=self.taper**2,
            stiffness_taper=self.taper**4,
            damping_taper=self.taper**4,
            drag=self.drag,
        )
        return lumped(profile, self.nodes, thinning=self.taper)

    @cached_property
    def first(self) -> Motion:
        """Return the first instant of its motion. A half circle of few links moves its tip at about `speed` only."""
        whip = self.whip
        angles, rates = folded(whip, self.start * self.length, 0.06, self.speed)
        return Motion(whip, 0.0, np.zeros(1), angles[None], rates[None])

    @property
    def most(self) -> float:
        """Return the tip's speed over that at first if the last node had all the energy, that of the fold included."""
        fastest = np.sqrt(2 * self.first.energy[0] / self.first.whip["m"][-1])
        return float(fastest / self.first.tip_speed[0])

    def over_first(self, ratio: float) -> float:
        """Return a speed over the tip's at first, from one over `speed`."""
        return float(ratio * self.speed / self.first.tip_speed[0])

    def motion(self) -> Motion:
        """Return its motion until the loop of an ideal string is past the tip, as far as energy is kept."""
        whip, until = self.whip, 1.3 * loop_time(1.0, self.start, self.taper, self.length, self.speed)
        step = 8e-4 / self.nodes * 10 / self.speed
        seen = moved(whip, (self.first.angles[0], self.first.rates[0]), until=until, step=step, gravity=0.0)
        gained = seen.energy > _GAINED * seen.energy[0]
        end = int(gained.argmax()) if gained.any() else len(gained)
        return Motion(whip, 0.0, seen.t[:end], seen.angles[:end], seen.rates[:end])

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Let it run, and return the tip's largest speed over `speed`, the sharpest bend until then [rad], and, when
        an ideal loop is halfway to the tip, its speed over `speed` and the momentum left."""
        seen = self.motion()
        fastest = int(seen.tip_speed.argmax())
        half = loop_time((1 + self.start) / 2, self.start, self.taper, self.length, self.speed)
        middle = min(int(np.searchsorted(seen.t, half)), len(seen.t) - 1)
        shown = np.linspace(0, fastest, _SHOWN).astype(int)
        momentum = seen.momentum
        return {
            "peak": float(seen.tip_speed[fastest] / self.speed),
            "bend": float(seen.bends[: fastest + 1].max()),
            "energy": float(seen.energy[fastest] / seen.energy[0]),
            "half_speed": float(seen.tip_speed[middle] / self.speed),
            "half_momentum": float(momentum[middle] / momentum[0]),
            "t": seen.t[shown].tolist(),
            "tip_speed": seen.tip_speed[shown].tolist(),
        }


@dataclass(frozen=True, kw_only=True)
class FastestUnit(Unit):
    """The strike with the fastest tip that a search finds within an arm's limits, a work unit.

    Args:
        name: Preset of arm and whip.
        taper: Thickness of its whip at the tip over that at the handle; None: the preset's whip.
        trials: Strikes at most.
    """

    name: str
    taper: float | None = None
    trials: int = 600

    @property
    def model(self) -> Model:
        """Return arm and whip."""
        model = preset(self.name)
        return model if self.taper is None else replace(model, whip=resized(model.whip, taper=self.taper))

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Search, and return the tip's largest speed [m/s], the sharpest bend until then [rad], and the strike."""
        model = self.model
        planar = model.dimension == 2
        rollout = CompiledRollout(model, Controller() if planar else Controller(PositionControl()), threads=threads)
        bounds, far = default_bounds(model.arm), 0.85 * model.reach
        target = Target((far, 0.1) if planar else (far, 0.0, 0.3), 0.4)
        limits = None if planar else ArmLimits.of(model.arm, prescribed=True)
        judged = [find_criterion("speed", bounds)]
        objective = Objective(rollout, target, bounds=bounds, max_trials=self.trials, limits=limits, criteria=judged)
        found = search(objective, "cmaes", seed=0).uninterrupted()
        assert found.strike is not None
        path = rollout.trajectory(found.strike)
        fastest = int(path.tip_speed.argmax())
        hand = np.linalg.norm(np.gradient(joint_points(model, path.q)[:, model.arm.n], path.t, axis=0), axis=1)
        return {
            "tip_speed": float(path.tip_speed[fastest]),
            "hand_speed": float(hand.max()),
            "bend": float(joint_bends(model, path)[: fastest + 1].max()),
            "kept": bool(found.hit) and path.diverged is False,
            "beyond": beyond_trust(model, path),
            "strike": found.strike.vector.tolist(),
        }
