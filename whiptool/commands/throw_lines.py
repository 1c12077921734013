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

NEVER_DOWN = "the thing never comes down through the opening's plane"
NOT_RELEASED = "the thing is not released, because the strike ends before the release time"


def throw_table(throws: ThrowRollout, strike: AnyStrike, outcome: Outcome, t_stay: float) -> dict[str, Any]:
    """Return release and landing of a throw as a table for JSON."""
    box = throws.box
    released, landing = (False, None) if outcome.lost else throws.landing(strike, t_stay=t_stay)
    place = None if landing is None else landing.place
    return {
        "from": throws.place,
        "thing_mass": throws.thing.mass,
        "thing_drag": throws.thing.drag,
        "release_time": float(throws.release_times(strike, t_stay=t_stay)[0]) if released else None,
        "release_noise": throws.release_noise,
        "landing_time": None if landing is None else outcome.time,
        "landing_distance": None if place is None else math.hypot(*place[0]),
        "landing_velocity": None if landing is None else list(outcome.tip_velocity),
        "entry_angle": None if landing is None else box.entry_angle(outcome.tip_velocity),
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
    over = f" with releases {2e3 * noise:g} ms early or late" if noise else ""
    counted = f"counted as {outcome.miss_distance:.4f} m{over}, at most {box.hit_radius:.3f} m for all of it to enter"
    begin = f"  box            ({where}) m, {said}: "
    if table["release_time"] is None:
        joints = others[len(others) - len(outcome.max_joint_speed) :]
        return [f"{begin}{NOT_RELEASED}", *joints]
    release = f"  release        from the {throws.place} at {table['release_time']:.4f} s"
    if table["landing_time"] is None:
        joints = others[len(others) - len(outcome.max_joint_speed) :]
        return [f"{begin}{NEVER_DOWN}; {counted}", release, *joints]
    return [
        f"{begin}the thing lands {table['landing_distance']:.4f} m from the centre at "
        f"{math.degrees(table['entry_angle']):.0f} degrees from the opening's normal; {counted}",
        f"{release}, lands at {outcome.time:.4f} s",
        f"  landing speed  {outcome.tip_speed:.1f} m/s",
        *others[2:],
    ]


def never_landed(table: dict[str, Any], found: dict[str, Any]) -> dict[str, Any]:
    """Return what JSON has in place of the arrival in an `outcome_table` if the thing never lands."""
    if table["landing_time"] is not None:
        return {}
    arrival, missed = found["arrival"], found["missed_by"]
    return {
        "tip_speed": None,
        "arrival": arrival and arrival | {"angle": None, "speed": None},
        "missed_by": missed and missed | {"direction": None, "speed": None},
    }


def replay_doubt(seen: ThrowReplay, agreement: float) -> str | None:
    """Return, in words, why a replay in MuJoCo does not confirm a throw; None if it does."""
    if seen.confirmed:
        return None
    step = f"in MuJoCo at {1e3 * seen.timestep:.2g} ms"
    if seen.diverged:
        return f"the simulation diverges {step}"
    if seen.offset is None:
        return f"{NEVER_DOWN} {step}"
    if seen.difference is None:
        return f"the thing comes down through the opening's plane only {step}"
    rule = f"more than {1e3 * agreement:g} mm"
    return f"the thing lands {1e3 * seen.difference:.1f} mm away {step}, {rule}; try a smaller --tolerance"


def replay_table(seen: ThrowReplay, throws: ThrowRollout) -> dict[str, Any]:
    """Return a throw's replay in MuJoCo as a table for JSON, with the keys of that of a strike.

    `difference` is the distance between the landing points, `miss_distance` what counts of the landing point in MuJoCo
    at the nominal release [m].
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
