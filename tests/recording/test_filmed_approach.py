"""Closest approaches of filmed tips, of straight flights and of circles, by whoever asks."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from fallen_tip import struck

from whiptool.adaptation.steps import seen_of
from whiptool.errors import InputError
from whiptool.identification.similarity import similarity
from whiptool.recording.filmed_approach import approach_of_path, approach_seen, nearest_frame, tip_seen
from whiptool.recording.strike_recording import StrikeRecording

TARGET, OFF, FAST = np.array([1.2, 0.1]), np.array([0.3, 0.6]) / 15, np.array([20.0, -10.0])  # [m], [m], [m/s]


def filmed(off: np.ndarray = OFF, *, shift: float = 0.0, **changes) -> StrikeRecording:
    """A tip that moves straight on and passes by the target, `off` from it at 0.6 s; 37 cm from frame to frame."""
    t = np.arange(66) / 60 + shift
    points = TARGET + off + FAST * (t - 0.6)[:, None]
    return StrikeRecording(t, points[:, None], ("tip",), **changes)


@pytest.mark.parametrize("shift", [0.0, 0.004, 0.007])
def test_a_straight_flight_is_nearest_where_it_passes(shift):
    near = approach_seen(filmed(shift=shift), TARGET)
    assert near is not None
    assert (near.distance, near.time) == pytest.approx((np.linalg.norm(OFF), 0.6), abs=1e-9)
    np.testing.assert_allclose(near.place, TARGET + OFF, atol=1e-9)
    np.testing.assert_allclose(near.velocity, FAST, atol=1e-6)
    assert near.speed == pytest.approx(np.hypot(20, 10))


@pytest.mark.parametrize("shift", [0.0, 0.0041, 0.0073])
def test_whoever_asks_sees_a_tip_go_through_the_target(shift):
    """A port, the rig and a comparison of paths: none of them misses a tip that meets the target between two frames."""
    recording = filmed(0 * OFF, shift=shift)
    assert seen_of(recording, tuple(TARGET)).seen_miss == pytest.approx(0, abs=1e-9)
    on_rig = dataclasses.replace(struck(), recording=recording).approach(TARGET)
    assert (on_rig.distance[0], on_rig.time[0], on_rig.speed[0]) == pytest.approx((0, 0.6, np.hypot(20, 10)), abs=1e-6)
    t, points = tip_seen(recording, 2)
    apart = similarity(t, points, points + OFF, target=tuple(TARGET))
    assert (apart.hit_point, apart.hit_time, apart.hit_speed) == pytest.approx((np.linalg.norm(OFF), 0, 0), abs=1e-6)


def test_places_are_of_the_instants_at_which_they_were_exposed():
    late = 0.003
    t = np.arange(66) / 60
    points = (TARGET + OFF + FAST * (t + late - 0.6)[:, None])[:, None]
    near = approach_seen(StrikeRecording(t, points, ("tip",), t_points=(t + late)[:, None]), TARGET)
    assert near is not None
    assert near.time == pytest.approx(0.6, abs=1e-9)


def test_what_no_frame_shows_is_left_out_or_joined():
    recording = filmed()
    gap = recording.without(np.abs(recording.t - 0.6) < 0.03)  # frames at 0.55 and 0.65 s are the nearest
    seen, joined = approach_seen(gap, TARGET), approach_of_path(*tip_seen(gap, 2), TARGET)
    assert seen is not None
    assert joined is not None
    assert seen.time == pytest.approx(0.566667, abs=1e-6) or seen.time == pytest.approx(0.633333, abs=1e-6)
    assert joined.distance == pytest.approx(np.linalg.norm(OFF), abs=1e-9)
    lonely = recording.without((np.abs(recording.t - 0.6) < 0.05) & (np.abs(recording.t - 0.6) > 1e-6))
    alone = approach_seen(lonely, TARGET)  # the frame at 0.6 s, which has no neighbours
    assert alone is not None
    assert (alone.time, alone.distance) == pytest.approx((0.6, np.linalg.norm(OFF)))


def test_a_circle_in_space_is_followed():
    """One turn a second about the origin, seen 60 times: the nearest point is the target's own direction."""
    t = np.arange(45) / 60
    points = np.stack([np.cos(2 * np.pi * t), np.sin(2 * np.pi * t), np.zeros_like(t)], axis=1)[:, None]
    target = (1.3 * np.cos(2.0), 1.3 * np.sin(2.0), 0.4)
    near = approach_seen(StrikeRecording(t, points, ("tip",)), target)
    assert near is not None
    assert near.distance == pytest.approx(0.5, abs=1e-3)
    assert near.time == pytest.approx(1 / np.pi, abs=1e-3)
    assert near.speed == pytest.approx(2 * np.pi, rel=5e-3)


def test_few_frames_show_no_path():
    recording = filmed()
    assert approach_seen(recording.without(recording.t > 0.06), TARGET) is not None  # four frames
    assert approach_seen(recording.without(recording.t > 0.04), TARGET) is None
    with pytest.raises(InputError, match="marker"):
        approach_seen(dataclasses.replace(recording, markers=("handle",)), TARGET)


def test_the_nearest_frame():
    recording = filmed(shift=0.004)
    assert nearest_frame(recording, TARGET) == pytest.approx(0.604)
    assert nearest_frame(recording, TARGET, end=0.5) == pytest.approx(0.4873333, abs=1e-6)
    assert nearest_frame(recording, TARGET, end=-1.0) is None
