"""The outcome of a throw as lines of text and as a table for JSON."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from whiptool.models.strike import AnyStrike
    from whiptool.objective import Outcome
    from whiptool.throws.mujoco_throw import ThrowReplay
    from whiptool.throws.rollout import ThrowRollout


def throw_table(throws: ThrowRollout, strike: AnyStrike, outcome: Outcome, t_stay: float) -> dict[str, Any]:
    """Return release and landing of a throw as a table for JSON."""
    lost = outcome.lost
    box = throws.box
    return {
        "from": throws.place,
        "thing_mass": throws.thing.mass,
        "thing_drag": throws.thing.drag,
        "release_time": None if lost else float(throws.release_times(strike, t_stay=t_stay)[0]),
        "release_noise": throws.release_noise,
        "landing_time": None if lost else outcome.time,
        "landing_velocity": None if lost else list(outcome.tip_velocity),
        "entry_angle": None if lost else box.entry_angle(outcome.tip_velocity),
        "normal": list(box.normal or ()),
        "box_velocity": box.drift.tolist(),
        "most_speed": box.most_speed,
    }


def throw_lines(table: dict[str, Any], outcome: Outcome, throws: ThrowRollout, others: Sequence[str]) -> list[str]:
    """Return lines of text on a throw.

    Args:
        table, outcome, throws: From `throw_table`, and its arguments.
        others: Lines on the outcome as that of a strike; those on arrival and joints are kept.
    """
    if outcome.lost:
        return list(others)
    box, noise = throws.box, throws.release_noise
    where = ", ".join(f"{x:.3f}" for x in box.position)
    said = "hit" if outcome.hit else "missed"
    over = f", with releases {2e3 * noise:g} ms early or late" if noise else ""
    return [
        f"  box            ({where}) m, {said}: lands {outcome.miss_distance:.4f} m from the centre, with the room "
        f"that its slant takes{over}; at most {box.hit_radius:.3f} m",
        f"  release        from the {throws.place} at {table['release_time']:.4f} s, lands at {outcome.time:.4f} s",
        f"  landing speed  {outcome.tip_speed:.1f} m/s, {math.degrees(table['entry_angle']):.0f} degrees from the "
        "opening's normal",
        *others[2:],
    ]


def replay_table(seen: ThrowReplay, throws: ThrowRollout) -> dict[str, Any]:
    """Return a throw's replay in MuJoCo as a table for JSON, with the keys of that of a strike.

    `difference` is the distance between the landing points, `miss_distance` the nominal miss in MuJoCo [m].
    """
    if seen.offset is None or seen.velocity is None:
        return dict.fromkeys(("miss_distance", "difference", "angle", "speed"))
    goals, velocity = throws.box.goals, seen.velocity[None]
    return {
        "miss_distance": seen.miss,
        "difference": seen.difference,
        "angle": None if goals.directions is None else float(goals.angle(velocity)[0]),
        "speed": None if goals.only_points else float(goals.arrival_speed(velocity)[0]),
    }
