"""Passage of balls through openings, against distances between dense points of path and rim."""

from __future__ import annotations

import numpy as np
import pytest

from whiptool.throws.flight import HIGHEST, land
from whiptool.throws.passage import FLATTEST, LEAST_ROOM, Opening, overlap, passage

G = 9.81
TILTED = np.array([0.3, -0.2, 0.9]) / np.linalg.norm([0.3, -0.2, 0.9])


def at(normal: np.ndarray, room: float, ball: float) -> Opening:
    """Return an opening that stands at the origin."""
    return Opening(np.zeros((1, len(normal))), normal, np.zeros(len(normal)), room, ball)


def crossings(d: int, normal: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return offsets (N, d) in the opening's plane, velocities (N, d) into the box, radii of ball and opening (N,)."""
    rng = np.random.default_rng(d)
    radius = rng.uniform(0.03, 0.3, count)
    ball = radius * rng.uniform(0.02, 0.8, count)
    offset = rng.normal(size=(count, d))
    offset -= (offset @ normal)[:, None] * normal
    offset *= (rng.uniform(0, 1.1, count) * radius / np.linalg.norm(offset, axis=1))[:, None]
    side = rng.normal(size=(count, d))
    side -= (side @ normal)[:, None] * normal
    side /= np.linalg.norm(side, axis=1)[:, None]
    angle, speed = rng.uniform(0, 1.4, count), rng.uniform(1.5, 12, count)
    velocity = speed[:, None] * (np.sin(angle)[:, None] * side - np.cos(angle)[:, None] * normal)
    return offset, velocity, ball, radius


def clearance(offset, velocity, normal, ball: float, radius: float) -> float:
    """Smallest distance of a parabola's points to those of the rim [m], while the ball is near the plane."""
    d, down = len(offset), np.r_[np.zeros(len(offset) - 1), -G]
    first = np.linalg.svd(normal[None])[2][1:]  # a basis of the opening's plane
    turns = np.linspace(0, 2 * np.pi, 361) if d == 3 else np.array([0.0, np.pi])
    rim = radius * (np.cos(turns)[:, None] * first[0] + (np.sin(turns)[:, None] * first[-1] if d == 3 else 0))
    t = np.linspace(-0.4, 0.4, 20_001)[:, None]
    path = offset + velocity * t + down * t**2 / 2
    height = path @ normal
    middle, near = len(t) // 2, np.abs(height) <= ball
    begin = middle - np.argmin(near[middle::-1]) + 1  # the samples about the crossing at which the plane cuts the ball
    end = middle + np.argmin(near[middle:])
    path = path[begin:end]
    return min(float(np.linalg.norm(path - q, axis=1).min()) for q in rim)


@pytest.mark.parametrize(("d", "normal"), [(2, np.array([0.0, 1.0])), (3, np.array([0.0, 0.0, 1.0])), (3, TILTED)])
def test_balls_count_as_passing_if_their_path_stays_a_radius_from_the_rim(d, normal):
    down, entered, checked = np.r_[np.zeros(d - 1), -G], 0, 0
    for offset, velocity, ball, radius in zip(*crossings(d, normal, 30 if d == 3 else 200), strict=True):
        room, steep = radius - ball, -velocity @ normal / np.linalg.norm(velocity)
        if steep < max(np.cos(FLATTEST), ball / (ball + (1 - LEAST_ROOM) * room)) + 0.02:
            continue  # flatter than is allowed
        counted = passage(offset[None], velocity[None], at(normal, room, ball), down, np.ones(1))[0]
        margin = clearance(offset, velocity, normal, ball, radius) - ball
        inside = np.linalg.norm(offset) < radius
        if abs(margin) > 2e-4:
            checked += 1
            entered += inside and margin > 0
            assert (np.linalg.norm(counted) <= room) == (inside and margin > 0)
    assert 5 < entered < checked - 5


@pytest.mark.parametrize(("d", "normal"), [(2, np.array([0.0, 1.0])), (3, np.array([0.0, 0.0, 1.0])), (3, TILTED)])
def test_balls_that_rise_through_the_plane_stay_outside_if_their_path_stays_a_radius_from_the_rim(d, normal):
    down, outside, checked = np.r_[np.zeros(d - 1), -G], 0, 0
    for offset, velocity, ball, radius in zip(*crossings(d, normal, 60 if d == 3 else 200), strict=True):
        offset, velocity = 2.5 * offset, velocity - 2 * (velocity @ normal) * normal
        along, pull = velocity @ normal, down @ normal
        if along**2 < -2.1 * pull * ball:
            continue  # not all of the ball rises above the plane
        opening = at(normal, radius - ball, ball)
        within = overlap(offset[None], velocity[None], opening, down, np.ones(1))[0]
        margin = clearance(offset, velocity, normal, ball, radius) - ball
        beyond = np.linalg.norm(offset) > radius
        if abs(margin) > 2e-4:
            checked += 1
            outside += beyond and margin > 0
            assert (within[0] <= 0) == (beyond and margin > 0)
    assert 5 < outside < checked - 5


@pytest.mark.parametrize("ball", [0.0, 0.02])
def test_a_thing_that_is_released_under_the_opening_has_to_rise_beside_it(ball):
    opening = at(np.array([0.0, 1.0]), 0.1 - ball, ball)
    rise, t = np.sqrt(2 * G * 0.6), np.sqrt(2 * 0.3 / G) + np.sqrt(2 * 0.6 / G)  # 0.3 m over the plane, then down to it
    for x, allowed in ((-0.05, False), (-0.11, ball == 0), (-0.2, True)):  # where it rises through the plane
        fraction = (np.sqrt(2 * G * 0.6) - np.sqrt(2 * G * 0.3)) / G / t  # of the way to the landing
        begin = x * 1 / (1 - fraction)
        state = np.array([[begin, -0.3, -begin / t, rise]])  # it comes down in the middle
        found = land(state, opening, gravity=G, drag=0.0)
        assert found.place is not None
        assert found.place[0] == pytest.approx([0, 0], abs=1e-9)
        assert (np.linalg.norm(found.offset[0]) <= opening.radius) == allowed


def test_an_entry_along_the_normal_and_that_of_a_point_count_with_their_offset():
    normal, down, since = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -G]), np.ones(1)
    offset = np.array([[0.03, -0.04, 0.0]])
    for velocity, ball in (([0.0, 0.0, -3.0], 0.02), ([4.0, 0.0, -3.0], 0.0)):
        counted = passage(offset, np.array([velocity]), at(normal, 0.08, ball), down, since)[0]
        assert counted == pytest.approx(offset, abs=1e-12)


def test_an_entry_at_87_degrees_does_not_count_and_a_steeper_one_counts_less():
    normal, down, since = np.array([0.0, 1.0]), np.array([0.0, -G]), np.ones(1)
    misses = []
    for angle in np.radians([87.0, 80.0, 76.0, 74.0, 50.0]):
        velocity = 5 * np.array([[np.sin(angle), -np.cos(angle)]])
        counted = passage(np.zeros((1, 2)), velocity, at(normal, 0.08, 0.02), down, since)[0]
        misses.append(float(np.linalg.norm(counted)))
    assert misses == sorted(misses, reverse=True)
    assert misses[2] > 0.08 > misses[3]


STATES = {
    "aslant": [0.3, 0.2, 0.1, 4.0, 0.7, 2.0],
    "flat": [0.3, 0.2, 0.4, 7.0, 0.4, 0.3],
    "too flat": [0.4, 0.2, -0.2, 12.0, 0.2, 0.6],
    "too high": [1.2, 0.2, 0.1, 0.5, 0.1, 11.5],
    "up through the opening": [1.55, 0.35, -0.6, 0.3, 0.2, 5.0],
    "up beside its rim": [1.47, 0.35, -0.6, 0.5, 0.2, 5.0],
    "released while it rises through the plane": [1.68, 0.38, -0.31, 0.3, 0.2, 3.0],
}


@pytest.mark.parametrize("name", STATES)
@pytest.mark.parametrize("drag", [0.0, 0.0177])
def test_slopes_of_balls_are_those_of_differences(name, drag):
    state = np.array(STATES[name])
    opening = Opening(np.array([[1.7, 0.4, -0.3]]), np.array([0.0, 0.0, 1.0]), np.array([0.2, 0.1, 0.0]), 0.08, 0.02)
    found = land(state[None], opening, gravity=G, drag=drag, slopes=True)
    for k in range(7 if drag else 6):
        by = 1e-6 * np.eye(7)[k]
        ahead, behind = (land((state + x[:-1])[None], opening, gravity=G, drag=drag + x[-1]) for x in (by, -by))
        expected = (ahead.offset - behind.offset)[0] / 2e-6
        assert found.slopes[0, :3, k] == pytest.approx(expected, rel=2e-5, abs=2e-5)


def test_a_thing_that_rises_above_the_ceiling_is_not_in_the_box():
    opening = Opening(np.array([[1.0, 0.0]]), np.array([0.0, 1.0]), np.zeros(2), 0.08)
    for rise, allowed in ((HIGHEST - 0.1, True), (HIGHEST + 0.1, False)):
        speed = np.sqrt(2 * G * rise)
        found = land(np.array([[1.0, 0.5, 0.0, speed]]), opening, gravity=G, drag=0.0)
        assert (np.linalg.norm(found.offset[0]) <= 0.08) == allowed
