"""The outcome of one strike, as lines of text and as tables for JSON."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from whiptool.goals.target import missed_words
from whiptool.models.strike import sliding_names


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
    return f"{value:+.4f} m" if name[0] in "xyz" or name in slides else _degrees(value)


def _degrees(radians: float) -> str:
    """Return an angle as text: in rad, with degrees in parentheses."""
    return f"{radians:+.4f} rad ({math.degrees(radians):+.1f} deg)"


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
