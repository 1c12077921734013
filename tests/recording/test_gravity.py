"""Gravity tells axes and units: by whips that hang, markers that fall, and whips that swing."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest

from whiptool.recording.gravity import G, falling, gravity_findings, hanging, rests, swing_length
from whiptool.recording.strike_recording import StrikeRecording

FPS = 120.0
T = np.arange(0, 2.0, 1 / FPS)


def recording(points: np.ndarray, markers=("handle", "node3", "tip"), noise: float = 1e-3, **fields) -> StrikeRecording:
    rng = np.random.default_rng(0)
    return StrikeRecording(T[: len(points)], points + noise * rng.normal(size=points.shape), markers, noise, **fields)


def strike(up: np.ndarray, d: int = 3, *, lean: float = 0.0) -> np.ndarray:
    """A whip of 0.8 m that hangs for 0.4 s, then moves; `lean` [rad] from the vertical."""
    forward = np.roll(up, 1) / np.linalg.norm(up)
    down = -math.cos(lean) * up + math.sin(lean) * forward
    s = np.clip(T - 0.4, 0, None)
    hand = 0.5 * np.sin(3 * s)[:, None] * forward
    bent = 0.3 * np.sin(5 * s)[:, None] * forward
    return np.stack([hand, hand + 0.4 * down + 0.5 * bent, hand + 0.8 * down + bent], 1)[..., :d]


@pytest.mark.parametrize(("axis", "fix"), [
    ("z", ""), ("y", 'up = "y"'), ("x", 'axes = ["y", "z", "x"]'), ("-z", 'axes = ["x", "-y", "-z"]'),
    ("-y", 'axes = ["x", "z", "-y"]'),
])  # fmt: skip
def test_a_hanging_whip_says_which_axis_is_up(axis, fix):
    up = np.eye(3)["xyz".index(axis[-1])] * (-1 if axis[0] == "-" else 1)
    r = recording(strike(up))
    (rest,) = hanging(r)
    assert rest.axis[0] == axis
    assert rest.axis[1] < 3 * rest.error + 2e-3
    assert rest.length == pytest.approx(0.8, abs=2e-3)
    assert rest.span[1] == pytest.approx(0.4, abs=0.05)
    finding = next(f for f in gravity_findings(r) if f.topic == "up")
    assert fix in finding.fix
    assert finding.certainty == ("measured" if axis in ("y", "z") else "doubtful")


def test_the_axes_that_are_advised_are_right_handed_and_point_up():
    """What is advised turns the file's axes into the model's."""
    from whiptool.recording.gravity import _axes

    for up in ("x", "y", "z", "-x", "-y", "-z"):
        words = _axes(up, 3).split("[")[1].split("]")[0].replace('"', "").split(", ")
        rows = [(-1 if w[0] == "-" else 1) * np.eye(3)["xyz".index(w[-1])] for w in words]
        assert np.linalg.det(rows) == pytest.approx(1)
        assert words[2] == up


def test_a_whip_that_leans_is_doubtful():
    finding = next(f for f in gravity_findings(recording(strike(np.eye(3)[2], lean=0.3))) if f.topic == "up")
    assert finding.certainty == "doubtful"
    assert "17 deg off z" in finding.value


def test_a_plane_whose_y_points_down_is_seen():
    up = np.array([0.0, -1.0])
    points = strike(np.array([0.0, -1.0, 0.0]))[..., :2]
    finding = next(f for f in gravity_findings(recording(points)) if f.topic == "up")
    assert finding.certainty == "doubtful"
    assert 'axes = ["x", "-y"]' in finding.fix
    assert up @ finding.numbers["up"] == pytest.approx(1, abs=1e-3)


UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254}


@pytest.mark.parametrize("true", UNITS)
@pytest.mark.parametrize("stated", UNITS)
def test_a_marker_that_falls_says_the_unit(stated, true):
    """A file in the unit `true` that was read as if it were in `stated`."""
    scale = UNITS[stated] / UNITS[true]
    if scale > 30:  # the reader itself refuses what is so far away
        return
    t = T[:60]
    r = recording(scale * np.stack([0.1 * t, 0 * t, 0.4 - G / 2 * t**2], 1)[:, None], ("tip",), noise=1e-3 * scale)
    found = falling(r)
    assert found is not None
    assert found.size == pytest.approx(G * scale, rel=0.03)
    assert found.acceleration[2] < 0
    topics = {f.topic: f for f in gravity_findings(r, stated)}
    assert topics["units"].numbers["units"] == true
    assert topics["units"].certainty == ("measured" if stated == true else "doubtful")
    assert "z is up" in topics["up"].value


def test_a_strike_is_no_fall():
    """Neither a simulated swing nor a smooth strike is taken for one, at any phase."""
    for phase in np.linspace(0, 3, 7):
        angle = 1.2 * np.cos(math.sqrt(G / 0.8) * T + phase)
        swing = 0.8 * np.stack([np.sin(angle), 0 * angle, -np.cos(angle)], 1)[:, None]
        assert falling(recording(swing, ("tip",))) is None
    assert falling(recording(strike(np.eye(3)[2]))) is None


@pytest.mark.parametrize("length", [0.3, 0.8])
@pytest.mark.parametrize(("stated", "true"), [("m", "m"), ("m", "in"), ("mm", "cm"), ("mm", "m")])
def test_a_swing_says_the_unit(length, stated, true):
    """A point pendulum below a hand at rest, in the unit `true`, that was read as if it were in `stated`."""
    scale = UNITS[stated] / UNITS[true]
    if scale * length > 15:
        return
    t = np.arange(0, 4, 1 / 60)
    angle = 0.3 * np.cos(math.sqrt(G / length) * t)
    tip = scale * length * np.stack([np.sin(angle), 0 * angle, -np.cos(angle)], 1)
    r = StrikeRecording(t, np.stack([0 * tip, tip], 1), ("handle", "tip"), 1e-3 * scale)
    found = swing_length(r)
    assert found is not None
    pendulum, measured = found
    assert pendulum == pytest.approx(length, rel=0.05)
    assert measured == pytest.approx(scale * length, rel=0.01)
    units = {f.topic: f for f in gravity_findings(r, stated)}["units"]
    assert units.numbers["units"] == true


def test_markers_that_were_never_or_not_at_first_seen_say_nothing_about_rest():
    """And no warning of NumPy reaches the user."""
    t = np.arange(60) / 100
    places = np.zeros((60, 3, 2))
    places[:, 0, 1] = -1.0
    places[:, 1], places[:30, 2] = np.nan, np.nan
    seen = StrikeRecording(t, places, ("tip", "loose", "late"))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert [mask.all() for mask in rests(seen)] == [True]
