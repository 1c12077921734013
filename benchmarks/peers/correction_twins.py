"""Truths of other code for `benchmarks/correction.py`, in the plane: a chain of capsules in MuJoCo, and Cosserat rods.

Only swings disturb them. The chain of capsules has another controller and another arm (`foreign_whip.py` of the tests'
helpers). The rods of PyElastica, which share no formula with our whip, hang on the hand of our arm.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from whiptool.correction import Begun, LinearStrike, Paths, Submovements
from whiptool.correction.disturbances import moved, swing_directions
from whiptool.correction.rolled import INTERVAL
from whiptool.models import WhipProfile
from whiptool.models.trajectory import closest_on_segments
from whiptool.rollout.cosserat import CosseratWhip, hand_path

ELEMENTS, WAVES, RADIUS = 12, 200.0, 0.032  # of a rod, with speed [m/s] and radius [m]
AFTER = 0.1  # [s]


def swung_states(linear: LinearStrike, swing: float, count: int, rng: np.random.Generator) -> np.ndarray:
    """States of whips that swing when the strike begins, (count, 2 n)."""
    model = linear.simulator.model
    swings = swing_directions(model, linear.strike)
    by = swing * rng.normal(size=(count, len(swings))) @ swings
    return moved(model, np.repeat(linear.states[:1], count, axis=0), by)


def tilts(linear: LinearStrike, states: np.ndarray, parts: int) -> np.ndarray:
    """Absolute angles of equal parts of whips, or their changes, and their rates, (B, 2, parts)."""
    model, N = linear.simulator.model, linear.simulator.model.whip.N
    both = states.reshape(len(states), 2, -1).cumsum(axis=2)[..., model.arm.n :]
    places, nodes = (np.arange(parts) + 0.5) / parts, (np.arange(N) + 0.5) / N
    return np.array([[np.interp(places, nodes, x) for x in pair] for pair in both])


def instants(linear: LinearStrike) -> int:
    """Instants of paths until some time after the planned hit; what comes later is not simulated."""
    return min(round((linear.hit_at + AFTER) / INTERVAL), linear.planned.tip.shape[1])


def seen(linear: LinearStrike, tips: np.ndarray, arms: np.ndarray) -> Paths:
    """Paths of tips (B, S, 2) and arms (B, S, 2, 2) [m], which stay where they end."""
    miss = [float(closest_on_segments(x, linear.target).distance) for x in tips]
    more = linear.planned.tip.shape[1] - tips.shape[1]
    tips, arms = (np.pad(x, [(0, 0), (0, more), *[(0, 0)] * (x.ndim - 2)], mode="edge") for x in (tips, arms))
    return Paths(tips, arms, np.array(miss))


class Capsules:
    """The true course by capsules in MuJoCo, whose arm, controller and whip are other code; swings only."""

    def __init__(self, linear: LinearStrike, swing: float, count: int, rng: np.random.Generator) -> None:
        sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "helpers"))
        from foreign_whip import STEP, ForeignPort, ForeignWhip

        model, self.linear, self.step = linear.simulator.model, linear, STEP
        whip, stiffness = model.whip, float(model.whip.per_node("k")[1])
        radius = 0.007
        density = whip.mass / whip.length / (np.pi * radius**2)
        loss = float(whip.per_node("b")[1]) / stiffness
        masses = tuple(link.mass for link in model.arm.links)
        bending = stiffness * float(whip.per_node("l")[1])
        numbers = {"length": whip.length, "thick": radius, "thin": radius, "density": density, "stiffness": bending}
        own = ForeignWhip(**numbers, loss=loss, friction=0.0, first=1e-6, masses=masses, gain=1.0, late=0.0)
        self.port = ForeignPort(own, tuple(linear.target))
        swung = tilts(linear, swung_states(linear, swing, count, rng) - linear.states[0], 40)
        self.changes = [[np.diff(x, prepend=0.0) for x in both] for both in swung]

    def __call__(self, added: Submovements) -> Paths:
        import mujoco

        found, strike = [], self.linear.strike
        for i, (dq, dv) in enumerate(self.changes):
            parts = list(zip(added.since[i], added.lasts[i], added.by[i], strict=True))
            wanted = SimpleNamespace(q_i=strike.q_i, q_f=strike.q_f, D=strike.D, added=parts)
            rest = self.port._rest(strike).copy()
            data = mujoco.MjData(self.port._mj)
            data.qpos[:], data.qvel[2:] = rest, dv
            data.qpos[2:] += dq
            tip, elbow, hand = [], [], []
            every = round(INTERVAL / self.step)
            for k in range(every * (instants(self.linear) - 1) + 1):
                if k % every == 0:
                    mujoco.mj_kinematics(self.port._mj, data)
                    tip.append(data.site_xpos[self.port._tip, ::2].copy())
                    elbow.append(data.xpos[2, ::2].copy())
                    hand.append(data.xpos[3, ::2].copy())
                self.port._step(data, wanted, k * self.step)
            found.append((np.array(tip), np.stack([elbow, hand], axis=1)))
        tips, arms = (np.stack(x) for x in zip(*found, strict=True))
        return seen(self.linear, tips, arms)


class Rods:
    """The true course by Cosserat rods in PyElastica, on the hand as our arm moves it with our whip."""

    def __init__(self, linear: LinearStrike, swing: float, count: int, rng: np.random.Generator) -> None:
        self.linear, self.x0 = linear, swung_states(linear, swing, count, rng)
        whip = linear.simulator.model.whip
        link = float(whip.per_node("l")[1])
        profile = WhipProfile(
            length=whip.length,
            linear_density=whip.mass / whip.length,
            bending_stiffness=float(whip.per_node("k")[1]) * link,
            bending_damping=float(whip.per_node("b")[1]) * link,
        )
        self.whip = CosseratWhip(
            profile, elements=ELEMENTS, wave_speed=WAVES, radius=RADIUS, gravity=linear.simulator.model.gravity
        )

    def __call__(self, added: Submovements) -> Paths:
        simulator, target = self.linear.simulator, self.linear.target
        begun = Begun(self.linear.strike, self.x0, added, self.linear.lasts)
        arm = simulator.paths(begun, target).arm
        tips = []
        for i, tilt in enumerate(tilts(self.linear, self.x0, ELEMENTS)):
            one = Submovements(*(x[i : i + 1] for x in (added.since, added.lasts, added.by)))
            path = simulator.trajectory(replace(begun, x0=self.x0[i : i + 1], added=one))
            tips.append(self._swung(hand_path(simulator.model, path), tilt))
        return seen(self.linear, np.array(tips), arm[:, : instants(self.linear)])

    def _swung(self, hand: object, tilt: np.ndarray) -> np.ndarray:
        """The tip's path, (S, 2), of a rod whose elements begin with such angles and rates (2, ELEMENTS)."""
        elastica, parts, whip = self.whip._elastica, self.whip._parts, self.whip
        every, count = int(np.ceil(INTERVAL / whip.timestep)), instants(self.linear)
        h, bench = INTERVAL / every, parts.Bench()
        rod, halves = whip.add_hanging(bench, hand(0.0), h), np.arange(2 * every * (count - 1) + 1) * h / 2
        swing(rod, tilt)
        path = {"places": hand(halves), "velocities": hand(halves, 1), "half": h / 2}
        bench.constrain(rod).using(parts.MovedHand, **path)
        bench.finalize()
        stepper, time, tip = elastica.PositionVerlet(), np.float64(0.0), []
        for k in range(count):
            for _ in range(every if k else 0):
                time = stepper.step(bench, time, h)
            tip.append(rod.position_collection[::2, -1].copy())
        return np.array(tip)


def swing(rod: object, tilt: np.ndarray) -> None:
    """Tilt the elements of a rod that hangs at rest by angles towards +x and let them turn, (2, elements)."""
    lengths, (angle, rate) = -np.diff(rod.position_collection[2]), tilt
    sin, cos, zero = np.sin(angle), np.cos(angle), 0 * angle
    for nodes, steps in (
        (rod.position_collection, (sin, zero, -cos)),
        (rod.velocity_collection, (rate * cos, zero, rate * sin)),
    ):
        nodes[:, 1:] = nodes[:, :1] + np.cumsum(lengths * np.array(steps), axis=1)
    turn = np.array([[cos, zero, -sin], [zero, zero + 1, zero], [sin, zero, cos]])  # by -angle about y
    rod.director_collection[:] = np.einsum("ije,kje->kie", turn, rod.director_collection)
    rod.omega_collection[:] = np.einsum("kie,ie->ke", rod.director_collection, np.array([zero, -rate, zero]))
