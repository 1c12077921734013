"""Check of the accuracy of equal steps by a second simulation with small errors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from whiptool.impedance.controller import Controller
from whiptool.models.parameters import Model
from whiptool.models.strike import AnyStrike, StrikeBounds
from whiptool.models.trajectory import Trajectory
from whiptool.rollout.compiled import CompiledRollout
from whiptool.rollout.interface import Rollout
from whiptool.rollout.reference import ReferenceRollout
from whiptool.rollout.trust import beyond_trust

MISS, PEAK = 3e-4, 0.05  # [m]; of the larger of two peaks: by which finer steps may differ
SAMPLE = 64  # random strikes
SMALL_PEAK = 0.1  # [N m], [rad/s]; peaks below are compared as if they were this large


def refine(
    rollout: Rollout,
    strike: AnyStrike,
    path: Trajectory,
    *,
    t_stay: float,
    target: np.ndarray,
) -> str | None:
    """Return a sentence on a possibly inaccurate integration of a strike; None if it is accurate.

    A strike with equal steps is simulated again with small errors and compared; otherwise it is checked whether the
    tolerance was met.

    Args:
        rollout: The simulator of the strike.
        strike, t_stay: The simulated strike, and the time after it that was simulated [s].
        path: Trajectory of the strike.
        target: Target of the miss distance [m].
    """
    if rollout.tolerance is not None:
        near = rollout.approach(strike, target, t_stay=t_stay)
        unmet = not near.diverged[0] and near.integration_error is not None and np.isinf(near.integration_error[0])
        what = f"the miss distance is not known to {1e3 * rollout.tolerance:g} mm, however small the steps are"
        return f"{what}: it depends too strongly on the strike" if unmet else None
    assert isinstance(rollout, CompiledRollout | ReferenceRollout)
    model, controller = rollout.model, rollout.controller
    again = CompiledRollout(model, controller).trajectory(strike, t_stay=t_stay)
    if path.diverged or again.diverged:
        said = ("the strike diverges",) if again.diverged else ("the strike does not diverge",)
        return _too_coarse(said) if path.diverged != again.diverged else None
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
    return _too_coarse(differences) if differences else None


def doubts(rollout: Rollout, strike: AnyStrike, path: Trajectory, *, t_stay: float, target: np.ndarray) -> str | None:
    """Return why the result of a strike may not be trusted, as a sentence; None if nothing speaks against it.

    Its integration may be inaccurate (`refine`), or it is beyond the range of its model (`beyond_trust`).

    Args:
        rollout, strike, path, t_stay, target: As in `refine`.
    """
    found = refine(rollout, strike, path, t_stay=t_stay, target=target), beyond_trust(rollout.model, path)
    return "; ".join(one for one in found if one is not None) or None


def _too_coarse(said: Sequence[str]) -> str:
    cure = "take a smaller --timestep, or with the compiled simulator none"
    return f"the step is too coarse: at steps of small errors {'; '.join(said)}; {cure}"


def share_too_coarse(
    model: Model, controller: Controller, bounds: StrikeBounds, *, timestep: float, t_stay: float, target: np.ndarray
) -> float:
    """Return the fraction of random strikes whose miss distance with a time step is wrong by more than 0.3 mm.

    Args:
        model, controller, t_stay, target: As in `refine`.
        bounds: Bounds of the strikes.
        timestep: Time step to judge [s].
    """
    strikes = bounds.sample(np.random.default_rng(0), SAMPLE)
    rollouts = [CompiledRollout(model, controller, timestep=h) for h in (timestep, None)]
    coarse, fine = (rollout.approach(strikes, target, t_stay=t_stay) for rollout in rollouts)
    same = (coarse.diverged & fine.diverged) | (np.abs(coarse.distance - fine.distance) <= MISS)
    return float(np.mean(~same))
