"""The outcome of a strike as bars: what they say is what the trajectory does, and names are shown as text."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest

import whiptool as wt
from whiptool.live_page.outcome_bars import Bar, bars_html, millimetres, outcome_bars
from whiptool.live_page.session import Session

BAD = "<img src=x onerror=alert(1)>&'\""


@pytest.fixture(scope="module")
def planar():
    return Session(wt.preset("lemon2024"), target=wt.Target((1.2, 0.1), direction=(0.5, 1.0), cone=0.2, speed=3.0))


@pytest.fixture(scope="module")
def robot():
    return Session(wt.preset("ur5e"))


def test_bars_of_a_target_with_direction_and_speed(planar):
    shown = planar.shown()
    bars = {bar.label: bar for bar in outcome_bars(shown, planar.striker.limits)}
    velocity, unit = shown.near.velocity[0], np.array([0.5, 1.0]) / np.hypot(0.5, 1.0)
    angle = np.degrees(np.arccos(velocity @ unit / np.linalg.norm(velocity)))
    assert bars["direction"].text == f"{angle:.1f}° of 11.5° allowed"
    assert bars["tip speed"].text == f"{velocity @ unit:.1f} m/s along the direction, at least 3 m/s"
    assert bars["miss distance"].share == pytest.approx(float(shown.near.distance[0]) / 0.06)
    assert all(bars[name].good for name in ("miss distance", "direction", "tip speed"))
    torque = np.abs(shown.trajectory.tau).max()
    assert bars["largest torque"].text.startswith(f"{torque:.3g} N m")


def test_a_miss_says_what_is_missed(planar):
    session = Session(wt.preset("lemon2024"))
    session.turn_whip("length", 0.4)
    shown = session.shown()
    bar = outcome_bars(shown, session.striker.limits)[0]
    assert not shown.hit
    assert bar.good is False
    assert bar.share > 1
    assert 'data-hit="false"' in bars_html(shown, [bar])
    assert "✗ Miss" in bars_html(shown, [bar])


def test_a_target_beyond_the_reach_is_named():
    model, strike = wt.preset("lemon2024"), (-1.36, 0.47, 1.73, 1.41, 0.95)
    reach = sum(link.length for link in model.arm.links) + 0.864
    said = f"beyond the arm&#x27;s and whip&#x27;s reach of {reach:.3g} m"
    for x, far in ((reach + 0.061, True), (reach + 0.059, False)):  # of a hit radius of 0.06 m
        shown = Session(model, target=wt.Target((x, 0.0)), strike=strike).shown()
        assert (said in bars_html(shown, [])) == far


def test_an_older_outcome_has_no_verdict(planar):
    shown = planar.shown()
    assert "✓ Hit" in bars_html(shown, [])
    page = bars_html(shown, [], computing=True)
    assert "Computing" in page
    assert "Hit" not in page


def test_bars_of_limits_are_shares_of_the_arms_limits(robot):
    shown = robot.shown()
    bars = {bar.label: bar for bar in outcome_bars(shown, robot.striker.limits)}
    joints, path = shown.model.arm.joint_limits, shown.trajectory
    speeds = np.abs(path.v[:, :6]).max(axis=0) / [joint.velocity for joint in joints]
    torques = np.abs(path.tau).max(axis=0) / [joint.torque for joint in joints]
    assert bars["joint speeds"].share == pytest.approx(speeds.max(), rel=1e-6)
    assert bars["joint torques"].share == pytest.approx(torques.max(), rel=1e-6)
    assert bars["clearance"].good
    assert "largest torque" not in bars


def test_names_are_shown_as_text(robot):
    shown = dataclasses.replace(robot.shown(), beyond=BAD, hit=False, source=BAD)
    page = bars_html(shown, [*outcome_bars(shown, robot.striker.limits), Bar(BAD, BAD, 1.0)])
    assert set(re.findall(r"<(\w+)", page)) == {"div", "span"}
    assert page.count("&lt;img src=x onerror") == 5


@pytest.mark.parametrize(("length", "text"), [(2e-6, "below 0.01 mm"), (0.0123, "12.3 mm"), (3.571, "3.57 m")])
def test_lengths_are_in_units_that_need_no_exponent(length, text):
    assert millimetres(length) == text
