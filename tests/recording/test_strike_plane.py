"""The strike plane through points in space: planes that are known, errors that are drawn."""

from __future__ import annotations

import numpy as np
import pytest

from whiptool.errors import InputError
from whiptool.recording.strike_plane import fit_plane
from whiptool.recording.strike_recording import StrikeRecording


def frame(yaw: float, tilt: float) -> np.ndarray:
    """Axes (3, 3) of a plane: x horizontal, turned by yaw from forward; y up in the plane, tilted; normal."""
    x = np.array([np.cos(yaw), 0.0, -np.sin(yaw)])
    aside = np.array([np.sin(yaw), 0.0, np.cos(yaw)])
    y = np.cos(tilt) * np.array([0.0, 1.0, 0.0]) + np.sin(tilt) * aside
    return np.stack([x, y, np.cross(x, y)])


def recording(points: np.ndarray, **known) -> StrikeRecording:
    t = np.arange(len(points)) / 60
    return StrikeRecording(t, points[:, None], ("tip",), np.array(0.005), **known)


def flat(count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform([-1.0, -0.5], [1.0, 0.7], (count, 2))


@pytest.mark.parametrize(("yaw", "tilt", "offset"), [(0, 0, 0), (0.4, 0.1, 0.05), (-0.7, -0.3, -0.2), (0.9, 0.5, 0.3)])
def test_a_plane_is_found_with_its_axes(yaw, tilt, offset):
    axes, uv = frame(yaw, tilt), flat(50)
    plane = fit_plane([recording(uv @ axes[:2] + offset * axes[2])])
    assert plane is not None
    np.testing.assert_allclose(plane.axes, axes, atol=1e-9)
    assert plane.offset == pytest.approx(offset)
    assert plane.tilt == pytest.approx(abs(tilt))
    assert plane.rms < 1e-9
    projected = plane.project(recording(uv @ axes[:2] + offset * axes[2], target=(1.0, 0.2, 0.1)))
    np.testing.assert_allclose(projected.points[:, 0], uv, atol=1e-9)
    np.testing.assert_allclose(projected.target, axes[:2] @ [1.0, 0.2, 0.1])


def test_distances_from_the_plane_are_told():
    rng, axes = np.random.default_rng(0), frame(0.3, 0.1)
    away = rng.normal(0, 0.01, 3000)
    both = [
        recording((flat(3000, 1) @ axes[:2] + away[:, None] * axes[2])[some])
        for some in (slice(2000), slice(2000, 3000))
    ]
    plane = fit_plane(both)
    assert plane is not None
    assert plane.rms == pytest.approx(0.01, rel=0.05)
    assert plane.largest == pytest.approx(np.abs(away).max(), rel=0.02)
    np.testing.assert_allclose(plane.axes, axes, atol=2e-3)
    assert str(plane).startswith(f"fitted through the points in space: {1e3 * plane.rms:.2f} mm RMS")
    assert f"{np.rad2deg(plane.tilt):.2f} deg from the vertical, {1e3 * plane.offset:+.1f} mm from the shoulder" in str(
        plane
    )


def test_planar_recordings_stay_as_they_are():
    planar = recording(flat(10), target=(1.0, 0.2))
    assert fit_plane([planar]) is None
    plane = fit_plane([planar, recording(flat(50) @ frame(0.2, 0.0)[:2])])
    assert plane is not None
    assert plane.project(planar) is planar
    np.testing.assert_allclose(plane.axes, frame(0.2, 0.0), atol=1e-9)
    beside = plane.project(recording(flat(10) @ frame(0.2, 0.0)[:2], target=(1.0, 0.2)))
    assert beside.target == (1.0, 0.2)


def test_frames_without_the_marker_do_not_count():
    axes, uv = frame(0.2, 0.1), flat(30)
    points = uv @ axes[:2]
    points[5] = np.nan
    plane = fit_plane([recording(points)])
    assert plane is not None
    np.testing.assert_allclose(plane.axes, axes, atol=1e-9)


def test_planes_at_the_edge_of_what_is_allowed():
    """30 degrees from the vertical, 60 degrees aside of forward, a breadth of a hundredth of the length."""
    uv = flat(50)
    for tilt, fine in ((29.5, True), (30.5, False)):
        points = recording(uv @ frame(0.0, np.deg2rad(tilt))[:2])
        if fine:
            fit_plane([points])
        else:
            with pytest.raises(InputError, match=r"30 deg from the vertical.*within 30 deg"):
                fit_plane([points])
    for yaw, fine in ((59.5, True), (60.5, False), (-59.5, True), (-60.5, False)):
        points = recording(uv @ frame(np.deg2rad(yaw), 0.0)[:2])
        if fine:
            fit_plane([points])
        else:
            with pytest.raises(InputError, match="60 deg aside of x"):
                fit_plane([points])
    line = np.stack([np.linspace(-1, 1, 50), np.zeros(50)], axis=1)
    zigzag = np.where(np.arange(50) % 2, 1.0, -1.0) / np.sqrt(1 - 1 / 2500) * np.std(line[:, 0])
    for breadth, fine in ((0.012, True), (0.008, False)):
        points = recording((line + breadth * zigzag[:, None] * [0, 1]) @ frame(0.3, 0.0)[:2])
        if fine:
            fit_plane([points])
        else:
            with pytest.raises(InputError, match="points on a line"):
                fit_plane([points])
