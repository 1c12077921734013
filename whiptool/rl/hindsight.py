"""Hindsight (Andrychowicz et al. 2017): the tip passes many points in a strike and would have hit a target at each.

Relabelled transitions are exact: for targets without direction and speed the miss distance follows from the tip's path,
and otherwise the strikes are simulated at their new goals.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from whiptool.goals.arrival_rule import ArrivalRule
from whiptool.goals.goals import Goals, arrival_angles
from whiptool.goals.zone import Zone, directions
from whiptool.models.trajectory import closest_on_segments
from whiptool.rl.task import StrikeTask

RATE = 500.0  # [1/s] of the paths: within a millimetre of the tip, save that they may end 2 ms before the strike
NEAR = (0.0, 0.5, 2.0)  # offsets of new goals from the path, in hit radii and in cones: hits, edges, near misses


def nearest(paths: np.ndarray, targets: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the miss distance of each path from its target, with position and sample of the closest approach.

    Args:
        paths: Paths of B tips, S samples in d dimensions, (B, S, d) [m]; NaN after a strike's end.
        targets: Positions of the targets, (B, d) [m].

    Returns:
        Distances (B,) [m], infinite for paths with fewer than two samples; nearest points (B, d) [m]; index of the
        sample before each nearest point (B,).
    """
    nearest = closest_on_segments(paths, targets)
    lanes, i = np.arange(len(paths)), nearest.segment
    start, end = paths[lanes, i], paths[lanes, i + 1]
    return nearest.distance, start + nearest.share[:, None] * (end - start), i


def new_targets(
    paths: np.ndarray, zone: Zone, hit_radius: float, uniform: np.ndarray, *, wanted: np.ndarray | None = None
) -> np.ndarray:
    """Return for each path a target in the zone: on the path or near it, or anywhere if the path does not pass the
    zone.

    Args:
        paths: Paths of tips, (B, S, d) [m].
        zone: Zone of the targets.
        hit_radius: Hit radius [m].
        uniform: Uniform random numbers, (B, 2 d + 2).
        wanted: Whether each sample is preferred as a target, (B, S); ignored for a path on which no preferred sample is
            in the zone. None: no preference.

    Returns:
        Targets, (B, d) [m].
    """
    return _passed(paths, zone, hit_radius, uniform, wanted)[0]


def _passed(
    paths: np.ndarray, zone: Zone, hit_radius: float, uniform: np.ndarray, wanted: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """As `new_targets`, and the sample that each target is on or near, (B,); -1 where it is anywhere."""
    of_zone, of_path = np.split(uniform, [zone.dimension + 1], axis=1)
    anywhere = zone.place(of_zone)
    inside = zone.contains(paths)
    if wanted is not None:
        inside = np.where((inside & wanted).any(axis=1, keepdims=True), inside & wanted, inside)
    count = inside.sum(axis=1)
    number = (of_path[:, 0] * count).astype(int) + 1  # of the sample, among those inside
    sample = (np.cumsum(inside, axis=1) >= number[:, None]).argmax(axis=1)
    offset = np.array(NEAR)[(of_path[:, 1] * len(NEAR)).astype(int)] * hit_radius
    near = paths[np.arange(len(paths)), sample] + offset[:, None] * directions(of_path[:, 2:])
    taken = (count > 0) & zone.contains(near)
    return np.where(taken[:, None], near, anywhere), np.where(taken, sample, -1)


def uniforms(zone: Zone, rule: ArrivalRule) -> int:
    """Return the number of uniform random numbers that `new_goals` needs for each path."""
    return 2 * zone.dimension + 2 + 3 * rule.drawn


def new_goals(paths: np.ndarray, zone: Zone, rule: ArrivalRule, hit_radius: float, uniform: np.ndarray) -> Goals:
    """Return for each path a goal: a target as in `new_targets`, and a direction close to the tip's there.

    Samples at which the tip moves as `rule` can require are preferred. If `rule` draws directions, the new direction is
    that of the tip's motion, or deviates from it by half a cone or two cones to either side, within the rule's range of
    angles.

    Args:
        paths: Paths of tips sampled at `RATE`, (B, S, d) [m].
        zone, rule, hit_radius: Zone of the targets, required arrival and hit radius.
        uniform: Uniform random numbers, (B, `uniforms(zone, rule)`).
    """
    if rule.only_points:
        return rule.goals(new_targets(paths, zone, hit_radius, uniform), hit_radius, uniform[:, :0])
    of_place, of_angle = np.split(uniform, [2 * zone.dimension + 2], axis=1)
    velocities = np.full(paths.shape, np.nan)
    velocities[:, :-1] = np.diff(paths, axis=1) * RATE
    places, sample = _passed(paths, zone, hit_radius, of_place, _as_asked(paths, velocities, zone, rule))
    if not rule.drawn:
        return rule.goals_at(places, hit_radius)
    goals = rule.goals(places, hit_radius, of_angle[:, :1])
    velocity = velocities[np.arange(len(paths)), sample]
    known = np.flatnonzero((sample >= 0) & np.isfinite(velocity).all(axis=1))
    offset = np.array(NEAR)[(of_angle[known, 1] * len(NEAR)).astype(int)] * rule.cone
    near = arrival_angles(places[known], velocity[known]) + np.where(of_angle[known, 2] < 0.5, offset, -offset)
    return goals.with_rows(known, rule.goals_at(places[known], hit_radius, rule.within(near)))


def _as_asked(paths: np.ndarray, velocities: np.ndarray, zone: Zone, rule: ArrivalRule) -> np.ndarray:
    """Whether each sample lies in the zone, and its velocity is one that a target there may ask for, (B, S)."""
    found = zone.contains(paths) & np.isfinite(velocities).all(axis=2)
    places, velocity = paths[found], velocities[found]
    angles = rule.within(arrival_angles(places, velocity)) if rule.drawn else None
    found[found] = rule.goals_at(places, 1.0, angles).arrives(velocity)  # whatever the hit radius is
    return found


class Relabelled(NamedTuple):
    """Results of strikes with respect to other goals.

    Args:
        tip, velocity: Position [m] and velocity [m/s] of the tip at the closest approach, (B, d) each.
        cost: Cost [m], see `Goals.cost`, (B,).
        hit: Whether the strike hits, (B,).
        known: Whether the result is valid, (B,); False for strikes whose paths have fewer than two samples or, if they
            were simulated again, that diverged or were refused.
    """

    tip: np.ndarray
    velocity: np.ndarray
    cost: np.ndarray
    hit: np.ndarray
    known: np.ndarray


def judged_by_path(paths: np.ndarray, goals: Goals) -> Relabelled:
    """Return the results of strikes, from their tip paths (B, S, d) [m] sampled at `RATE`, at goals without direction
    and speed.
    """
    distance, tip, i = nearest(paths, goals.positions)
    lanes = np.arange(len(paths))
    velocity = (paths[lanes, i + 1] - paths[lanes, i]) * RATE
    return Relabelled(tip, velocity, distance, goals.hit(distance, velocity), np.isfinite(distance))


def judged_by_rollout(task: StrikeTask, strikes: np.ndarray, goals: Goals) -> Relabelled:
    """Simulate strikes (B, n_act) and return their results at goals."""
    judged = task.judge(strikes, goals)
    return Relabelled(judged.approach.tip, judged.approach.velocity, judged.cost, judged.hit, ~judged.lost)
