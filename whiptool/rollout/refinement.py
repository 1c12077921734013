"""Whether a strike's step was fine enough: the same strike once more, compiled, at a finer one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from whiptool.dynamics.modes import steady_timestep
from whiptool.impedance.controller import Controller
from whiptool.models.joint_space import AnyStrike
from whiptool.models.parameters import Model
from whiptool.models.strike import StrikeBounds
from whiptool.rollout.compiled import TIMESTEP, CompiledRollout
from whiptool.rollout.trajectory import Trajectory

FINEST = 1e-5  # [s]; nothing here needs less
MISS, PEAK = 3e-4, 0.05  # [m]; of the larger of two peaks: by which a finer step may differ
SAMPLE = 64  # random strikes
SMALL_PEAK = 0.1  # [N m], [rad/s]; peaks below are compared as if they were this large


@dataclass(frozen=True)
class Refined:
    """A strike at a finer step, beside the one that was asked for.

    Args:
        timestep: The finer one [s].
        differences: What it gives otherwise, in words; empty: nothing that matters.
    """

    timestep: float
    differences: tuple[str, ...]

    @property
    def warning(self) -> str | None:
        """In one sentence, for people; None: the step was fine enough."""
        if not self.differences:
            return None
        said = "; ".join(self.differences)
        return f"the step is too coarse: at {1e3 * self.timestep:.3g} ms {said}; take a smaller --timestep"


def _finer(model: Model, controller: Controller, timestep: float) -> float:
    """Half a step [s], or half the usual one if that is less."""
    usual = steady_timestep(model, TIMESTEP, prescribed=controller.prescribed)
    return max(min(timestep, usual) / 2, FINEST)


def refine(
    model: Model,
    controller: Controller,
    strike: AnyStrike,
    path: Trajectory,
    *,
    timestep: float,
    t_stay: float,
    target: np.ndarray,
) -> Refined:
    """Play a strike again at half its step, or half the usual one if that is less.

    Args:
        model, controller, strike, t_stay: Of the strike.
        path: What it came to, in either simulator.
        timestep: Its step [s].
        target: Where the miss distance is measured from [m].
    """
    finer = _finer(model, controller, timestep)
    again = CompiledRollout(model, controller, timestep=finer).trajectory(strike, t_stay=t_stay)
    if path.diverged or again.diverged:
        said = ("the strike diverges",) if again.diverged else ("the strike does not diverge",)
        return Refined(finer, said if path.diverged != again.diverged else ())
    then, now = path.approach(target), again.approach(target)
    differences = []
    if abs(then.distance[0] - now.distance[0]) > MISS:
        differences.append(f"the miss distance is {now.distance[0]:.4f} m, not {then.distance[0]:.4f}")
    slides = model.arm.slides
    for name, what, turning, sliding in (
        ("max_torque", "torque", "N m", "N"),
        ("max_joint_speed", "speed", "rad/s", "m/s"),
    ):
        for joint, a, b in zip(model.arm.joints, getattr(then, name)[0], getattr(now, name)[0], strict=True):
            if abs(a - b) > PEAK * max(a, b, SMALL_PEAK):
                unit = sliding if joint in slides else turning
                differences.append(f"the {joint}'s largest {what} is {b:.2f} {unit}, not {a:.2f}")
    return Refined(finer, tuple(differences))


def share_too_coarse(
    model: Model, controller: Controller, bounds: StrikeBounds, *, timestep: float, t_stay: float, target: np.ndarray
) -> tuple[float, float]:
    """The share of random strikes whose miss a finer step changes by more than 0.3 mm, and that step [s].

    Args:
        model, controller, t_stay, target: As in `refine`.
        bounds: Of the strikes.
        timestep: To be judged [s].
    """
    strikes = bounds.sample(np.random.default_rng(0), SAMPLE)
    finer = _finer(model, controller, timestep)
    rollouts = [CompiledRollout(model, controller, timestep=h) for h in (timestep, finer)]
    coarse, fine = (rollout.approach(strikes, target, t_stay=t_stay) for rollout in rollouts)
    same = (coarse.diverged & fine.diverged) | (np.abs(coarse.distance - fine.distance) <= MISS)
    return float(np.mean(~same)), finer
