"""Usage of the limits by a strike, as a table for JSON and as lines of text."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from whiptool.errors import InputError

if TYPE_CHECKING:
    import numpy as np

    from whiptool.impedance import Controller
    from whiptool.limits.all_limits import AllLimits
    from whiptool.models import Model, Strike
    from whiptool.models.strike import StrikeBounds
    from whiptool.models.trajectory import Trajectory


def limits_table(limits: AllLimits, trajectory: Trajectory, strike: Strike, joints: Sequence[str]) -> dict:
    """Return, for JSON, the usage of the limits by a strike, 1 being the limit (`joint_usage` or `motor_usage`), its
    `clearance` [m], and `beyond`: the limit that it exceeds most, as text, or None.

    The table is empty if there are no limits.
    """
    from whiptool.limits.clearance import Clearance

    if not limits:
        return {}
    table: dict[str, float | str | None] = {}
    for each in limits.members:
        if isinstance(each, Clearance):
            nearest = None if trajectory.diverged else each.nearest(trajectory)[0]
            table["clearance"] = None if nearest is None else nearest.clearance
            continue
        used = each.violation(trajectory) + 1
        if each.command is not None and each.command in limits.commands:  # not of a strike of the hand
            used = max(used, 1 + float(each.command.violation(strike.vector[None])[0]))
        table[f"{each.judges}_usage"] = used if math.isfinite(used) else None
    return table | {"beyond": None if trajectory.diverged else limits.explain(trajectory, joints, strike)}


def limit_lines(limits: AllLimits, table: dict) -> list[str]:
    """Return the content of `limits_table` as lines of text."""
    lines = []
    for each in limits.members:
        if table.get(f"{each.judges}_usage") is not None:
            lines.append(f"  {each.judges + 's':14s} {_used(table[f'{each.judges}_usage'], each.words)}")
        elif table.get(each.judges) is not None:
            lines.append(f"  {each.judges:14s} {1e3 * table[each.judges]:.0f} mm at least; {each.words}")
    return lines + ([f"  beyond         {with_cure(table['beyond'])}"] if table.get("beyond") else [])


def _used(share: float, limits: str) -> str:
    """Return which share of limits a strike uses, for people; what just keeps them uses 99 %."""
    if share <= 1:
        return f"within {limits}: at most {math.floor(100 * share)} % used"
    return f"beyond {limits}: {math.ceil(100 * share)} % used"


_POSTURES = 2000  # that are tried, and the straight arm
_SURELY = 0.02  # beyond the limits, in parts of them: a posture between those tried may ask for a little less


def refuse_unheld(model: Model, controller: Controller, limits: AllLimits, bounds: StrikeBounds) -> None:
    """Refuse bounds of strikes if the arm can hold none of the start postures, or none of the end postures, within the
    limits.

    Raises:
        InputError: Gravity alone needs more torque than the motors or joints give at every start posture within the
            bounds, or at every end posture.
    """
    if not limits or controller.prescribed or controller.hand is not None or model.arm.weightless:
        return
    a = model.arm.n
    for name, part in (("start", slice(a)), ("end", slice(a, 2 * a))):
        low, high = (x[part] for x in bounds.box)
        beyond, torques = _easiest_to_hold(model, controller, limits, low, high)
        if beyond > _SURELY:
            rule = f"within {' and '.join(each.words for each in limits.members)}"
            fix = f"{name} elsewhere (--lower, --upper), or take a lighter whip or arm, or stronger motors"
            raise InputError(f"{name} postures", f"all beyond the arm: the easiest needs {torques}", rule, fix)


def _easiest_to_hold(
    model: Model, controller: Controller, limits: AllLimits, low: np.ndarray, high: np.ndarray
) -> tuple[float, str]:
    """Return how far beyond the limits the posture of a box is that is easiest to hold, and its torques in words.

    Args:
        low, high: Corners of the box, (a,).
    """
    import numpy as np

    from whiptool.impedance.arm import Arm
    from whiptool.models.trajectory import Approach

    a, arm = model.arm.n, Arm(model)
    q = np.vstack([np.random.default_rng(0).uniform(low, high, (_POSTURES, a)), np.clip(np.zeros(a), low, high)])
    tau = np.abs(controller.clipped(np.array([arm.gravity_compensation(x, controller.compensated) for x in q])))
    still, nowhere = np.zeros_like(tau), np.zeros((len(q), model.dimension))
    at_rest = Approach(
        distance=still[:, 0],
        time=still[:, 0],
        velocity=nowhere,
        tip=nowhere,
        max_joint_speed=still,
        max_torque=tau,
        diverged=np.zeros(len(q), bool),
        positions=np.stack([q, q], axis=1),
    )
    beyond = np.max([each.violation_of_peaks(at_rest) for each in limits.members], axis=0)
    least = int(beyond.argmin())
    units = ["N" if joint in model.arm.slides else "N m" for joint in model.arm.joints]
    held = zip(model.arm.joints, tau[least], units, strict=True)
    torques = ", ".join(f"{joint} {torque:.2f} {unit}" for joint, torque, unit in held)
    return float(beyond[least]), torques


def with_cure(words: str | None) -> str | None:
    """Return the text on the limit that a strike exceeds; if two shapes collide, with the settings that allow them to
    touch.
    """
    if words is None or " mm inside " not in words:
        return words
    return f"{words}; if they never meet: arm.never_touch in a model file, or --ignore-collisions"
