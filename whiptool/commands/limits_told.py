"""What a strike uses of its limits, for programs and for people."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from whiptool.limits import AllLimits
    from whiptool.models import Strike
    from whiptool.rollout.trajectory import Trajectory


def limits_table(limits: AllLimits, trajectory: Trajectory, strike: Strike, joints: Sequence[str]) -> dict:
    """Return for JSON what a strike uses: `joint_usage` or `motor_usage`, `clearance` [m], and `beyond`, in words.

    Empty where there are no limits.
    """
    from whiptool.models.clearance import Clearance

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
    """Return the lines that tell people the same."""
    lines = []
    for each in limits.members:
        if table.get(f"{each.judges}_usage") is not None:
            used = table[f"{each.judges}_usage"]
            lines.append(f"  {each.judges + 's':14s} {used:.0%} of {each.words} at the worst instant")
        elif table.get(each.judges) is not None:
            lines.append(f"  {each.judges:14s} {1e3 * table[each.judges]:.0f} mm at least; {each.words}")
    return lines + ([f"  beyond         {with_cure(table['beyond'])}"] if table.get("beyond") else [])


def with_cure(words: str | None) -> str | None:
    """Return what a strike is beyond, and which options let shapes touch, where two of them do."""
    if words is None or " mm inside " not in words:
        return words
    return f"{words}; if they never meet: arm.never_touch in a model file, or --ignore-collisions"
