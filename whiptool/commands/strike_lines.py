"""The outcome of one strike and its usage of the limits, as lines of text and as tables for JSON."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from whiptool.goals.target import missed_words
from whiptool.models.spatial_arm import SpatialArm
from whiptool.models.strike import sliding_names

if TYPE_CHECKING:
    from whiptool.limits.all_limits import AllLimits
    from whiptool.models import Strike
    from whiptool.models.parameters import AnyArm
    from whiptool.models.trajectory import Trajectory


def outcome_table(outcome, target) -> dict[str, Any]:
    """Return the outcome of a strike at a target as a table for JSON."""
    return {
        "target": list(target.position),
        "hit_radius": target.hit_radius,
        "miss_distance": outcome.known_miss,
        "hit": outcome.hit,
        "missed_by": missed_by(outcome, target),
        "hit_time": outcome.hit_time,
        "tip_speed": None if outcome.diverged else finite(outcome.tip_speed),
        "arrival": arrival_table(outcome, target),
    }


def finite(value: float | None) -> float | None:
    """Return a number for JSON: None if it is not finite."""
    return value if value is not None and math.isfinite(value) else None


def strike_lines(strike: dict[str, float], arm, bounds=None) -> list[str]:
    """Return lines of text on a strike's coordinates, with the bounds of the search if given."""
    slides = sliding_names(arm)
    lines = []
    limits = list(bounds) if bounds is not None else [None] * len(strike)
    width = max(14, *map(len, strike))
    for (name, value), limit in zip(strike.items(), limits, strict=True):
        text = _number_text(name, value, slides)
        within = "" if limit is None else f"   within {limit[0]:+.4f} .. {limit[1]:+.4f}"
        lines.append(f"  {name:{width}s} {text:27s}{within}")
    return lines


def _number_text(name: str, value: float, slides: Sequence[str]) -> str:
    """One of a strike's numbers for people: angles, or lengths where a joint slides or the hand is."""
    if name == "D":
        return f"{value:.4f} s"
    if name[0] in "xyz" or name in slides:
        return f"{value:+.4f} m"
    return f"{value:+.4f} rad ({math.degrees(value):+.1f} deg)"


def _joint_lines(outcome, arm) -> list[str]:
    """The lines that tell people how fast joints were, and with how much torque or force."""
    width, lines = max(14, *map(len, arm.joints)), []
    for joint, speed, torque in zip(arm.joints, outcome.max_joint_speed, outcome.max_torque, strict=True):
        fast, strong, what = ("m/s", "N", "force") if joint in arm.slides else ("rad/s", "N m", "torque")
        said = f"{torque:.1f} {strong}" if not arm.weightless else f"{what} not known"
        lines.append(f"  {joint:{width}s} at most {speed:.1f} {fast}, {said}")
    return lines


def missed_by(outcome, target) -> dict[str, float | None] | None:
    """Return, for JSON, by how much a strike misses point [m], direction [rad] and speed [m/s]; None for each
    requirement that is met.

    The result is None if the strike hits, or has no closest approach.
    """
    if outcome.hit or outcome.lost:
        return None
    missed = target.missed_by(outcome.miss_distance, outcome.tip_velocity)
    return {"point": None, "direction": None, "speed": None} | missed


def outcome_lines(outcome, target, arm) -> list[str]:
    """Return lines of text on the outcome of a strike."""
    if outcome.diverged:
        cure = "move less far or in more time, or take a smaller --timestep"
        return [f"  outcome        the simulation diverged: the joint speeds grew without bound; {cure}"]
    where = ", ".join(f"{x:.3f}" for x in target.position)
    said = "hit" if outcome.hit else "missed"
    if not outcome.hit and outcome.arrival is not None:
        said = f"missed {missed_words(target.missed_by(outcome.miss_distance, outcome.tip_velocity))}"
    return [
        f"  target         ({where}) m, {said}: closest {outcome.miss_distance:.4f} m at {outcome.time:.3f} s, "
        f"hit radius {target.hit_radius:.3f} m",
        f"  tip speed      {outcome.tip_speed:.1f} m/s",
        *_arrival_lines(outcome, target),
        *_joint_lines(outcome, arm),
    ]


def arrival_table(outcome, target) -> dict | None:
    """Return, for JSON, arrival angle [rad] and speed [m/s] of the tip and those that the target requires; None if it
    requires none.
    """
    if target.goals.only_points:
        return None
    return {
        "angle": None if outcome.arrival is None else outcome.arrival.angle,
        "speed": None if outcome.arrival is None else outcome.arrival.speed,
        "direction": None if target.direction is None else list(target.direction),
        "sight": None if target.sight is None else list(target.sight),
        "cone": None if target.direction is None else target.cone,
        "least_speed": target.speed,
    }


def _arrival_lines(outcome, target) -> list[str]:
    """The line that tells people how the tip arrived, if the target asks for more than a point."""
    came = outcome.arrival
    if came is None:
        return []
    said = []
    if came.angle is not None:
        said.append(f"{math.degrees(came.angle):.2f} degrees (at most {math.degrees(target.cone):g})")
    if target.speed is not None or came.angle is not None:
        along = "along it" if came.angle is not None else "fast"
        least = "" if target.speed is None else f" (at least {target.speed:g})"
        said.append(f"{came.speed:.1f} m/s {along}{least}")
    lead = "from its direction " if came.angle is not None else ""
    return [f"  arrival        {lead}{', '.join(said)}"]


def limits_table(limits: AllLimits, trajectory: Trajectory, strike: Strike, arm: AnyArm) -> dict:
    """Return how much of the limits a strike uses, as a table for JSON; it is empty if there are no limits.

    Each kind of limit has a key: `joint_usage`, `motor_usage` and `speed_usage` are fractions of it, `clearance` is the
    smallest distance [m] and `nearest` the two that it is between. `unlimited` names the joints that have no limit
    of speed, torque or position. `point_speeds` are the largest speeds of elbow, flange and hand of an arm in space
    [m/s]. `beyond` describes the limit that is exceeded most, None: all are kept; `overlap` is whether
    this is that two shapes are inside each other. Numbers of a diverged strike are None.
    """
    from whiptool.limits.arm_limits import ArmLimits, unlimited
    from whiptool.limits.clearance import Clearance

    if not limits:
        return {}
    table: dict[str, Any] = {}
    for each in limits.members:
        if isinstance(each, Clearance):
            nearest = None if trajectory.diverged else each.nearest(trajectory)[0]
            table["clearance"] = None if nearest is None else nearest.clearance
            table["nearest"] = None if nearest is None else list(nearest.names)
            continue
        if isinstance(each, ArmLimits):
            table["unlimited"] = unlimited(each.joints, arm.joints)
        used = each.violation(trajectory) + 1
        if each.command is not None and each.command in limits.commands:  # not of a strike of the hand
            used = max(used, 1 + float(each.command.violation(strike.vector[None])[0]))
        table[f"{each.judges}_usage"] = used if math.isfinite(used) else None
    if isinstance(arm, SpatialArm) and not trajectory.diverged:
        from whiptool.limits.point_speeds import point_speeds

        names = [name for name in ("elbow", "flange", "hand") if name in arm.points]
        fastest = point_speeds(arm, names, trajectory.q[:, : arm.n], trajectory.v[:, : arm.n]).max(axis=0)
        table["point_speeds"] = dict(zip(names, fastest.tolist(), strict=True))
    found = None if trajectory.diverged else limits.worst(trajectory, arm.joints, strike)
    return table | {"beyond": None if found is None else str(found), "overlap": found is not None and found.overlap}


def limit_lines(limits: AllLimits, table: dict) -> list[str]:
    """Return the content of `limits_table` as lines of text."""
    lines = []
    for each in limits.members:
        if table.get(f"{each.judges}_usage") is not None:
            lines.append(f"  {each.judges + 's':14s} {_used(table[f'{each.judges}_usage'], each.words)}")
        elif table.get(each.judges) is not None:
            nearest = f"nearest are {' and '.join(table['nearest'])}"
            lines.append(f"  {each.judges:14s} {1e3 * table[each.judges]:.0f} mm at least; {each.words}; {nearest}")
    if table.get("point_speeds"):
        fastest = ", ".join(f"{name} {speed:.2f}" for name, speed in table["point_speeds"].items())
        lines.append(f"  point speeds   at most {fastest} m/s")
    return lines + ([f"  beyond         {with_cure(table['beyond'], table['overlap'])}"] if table.get("beyond") else [])


def _used(share: float, limits: str) -> str:
    """Return which share of limits a strike uses, for people; what just keeps them uses 99 %."""
    if share <= 1:
        return f"within {limits}: at most {math.floor(100 * share)} % used"
    return f"beyond {limits}: {math.ceil(100 * share)} % used"


def with_cure(words: str | None, overlap: bool) -> str | None:
    """Return the text on the limit that a strike exceeds; if two shapes collide, with the settings that allow them to
    touch.

    Args:
        words: The limit; None: all are kept.
        overlap: Whether two shapes are inside each other, as `Excess` has it.
    """
    if words is None or not overlap:
        return words
    return f"{words}; if they never meet: arm.never_touch in a model file, or --ignore-collisions"
