"""Cameras that look at one board: they come back, as surely as the noise lets them, and from images."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from whiptool.errors import InputError
from whiptool.recording.camera import Camera, looking_at
from whiptool.vision.calibration import CharucoBoard, Corners
from whiptool.vision.space_calibration import Lens, Pose, agree, calibrate_cameras, calibrate_lens

cv2 = pytest.importorskip("cv2", reason="needs the extra `vision`")
BOARD = CharucoBoard((9, 7), 0.05, 0.035)
K = np.array([[610.0, 0, 420.5], [0, 605.0, 238.0], [0, 0, 1]])
LENS = (0.08, -0.15, 1e-3, -8e-4, 0.03)
PLACES = {"left": (1.6, 1.0, 0.9), "right": (1.5, -1.1, 0.7), "far": (0.2, -2.0, 1.4)}
CAMERAS = {
    name: Camera(name, 848, 480, K, looking_at(np.array(at), np.array([0, 0, 0.5])), np.array(at), LENS)
    for name, at in PLACES.items()
}
LENSES = {name: Lens(848, 480, K, LENS) for name in CAMERAS}


def board_poses(rng: np.random.Generator, count: int) -> list[Pose]:
    """Poses of a board about half a metre above the origin, that faces the cameras; the first on the floor."""
    poses = [Pose(Rotation.from_matrix(np.diag([1.0, -1.0, -1.0])), np.array([-0.2, 0.15, 0.0]))]
    for _ in range(count - 1):
        toward = np.array([1.4, -0.6, 0.3]) + rng.uniform(-0.5, 0.5, 3)
        R = looking_at(np.zeros(3), -toward).T @ Rotation.from_rotvec([0, 0, rng.uniform(-0.6, 0.6)]).as_matrix()
        poses.append(Pose(Rotation.from_matrix(R), np.array([0, 0, 0.5]) + rng.uniform(-0.3, 0.3, 3)))
    return poses


def corners_seen(camera: Camera, pose: Pose, rng: np.random.Generator, sigma: float) -> Corners:
    points = pose.rotation.apply(BOARD.points) + pose.position
    ids = np.flatnonzero(camera.sees(points))
    return Corners(ids, camera.project(points[ids]) + rng.normal(0, sigma, (len(ids), 2)))


def views_of(poses: list[Pose], sigma: float) -> dict[str, list[Corners | None]]:
    rng = np.random.default_rng(5)
    return {name: [corners_seen(c, pose, rng, sigma) for pose in poses] for name, c in CAMERAS.items()}


@pytest.mark.parametrize("sigma", [0.0, 0.2])
def test_cameras_come_back(sigma):
    poses = board_poses(np.random.default_rng(4), 12)
    found = calibrate_cameras(LENSES, views_of(poses, sigma), BOARD, position=(-0.2, 0.15, 0.0))
    for name, camera in CAMERAS.items():
        near = found.cameras[name]
        turned = Rotation.from_matrix(near.rotation @ camera.rotation.T).magnitude()
        assert np.linalg.norm(near.position - camera.position) < 1e-6 + 0.03 * sigma
        assert turned < 1e-6 + 0.01 * sigma
        # two coordinates each, less what the poses take: hardly anything
        assert found.residual[name] == pytest.approx(np.sqrt(2) * sigma, rel=0.08, abs=1e-5)
    for i, pose in enumerate(poses):
        assert np.linalg.norm(found.boards[i].position - pose.position) < 1e-6 + 0.03 * sigma


def test_one_view_that_was_misread_is_told():
    views = views_of(board_poses(np.random.default_rng(4), 8), 0.1)
    worst = views["left"][3]
    assert worst is not None
    views["left"][3] = Corners(worst.ids, worst.pixels + np.random.default_rng(0).normal(0, 4.0, worst.pixels.shape))
    found = calibrate_cameras(LENSES, views, BOARD)
    assert max(found.views["left"], key=found.views["left"].__getitem__) == 3
    assert found.views["left"][3] > 10 * np.median(list(found.views["left"].values()))


def test_a_camera_is_joined_over_another():
    """`far` never sees the board together with `left`, but `right` sees it with either."""
    views = views_of(board_poses(np.random.default_rng(4), 10), 0.0)
    for i in range(10):
        (views["far"] if i < 5 else views["left"])[i] = None
    found = calibrate_cameras(LENSES, views, BOARD, position=(-0.2, 0.15, 0.0))
    for name, camera in CAMERAS.items():
        np.testing.assert_allclose(found.cameras[name].position, camera.position, atol=1e-5)
    views["right"] = [None] * 10
    with pytest.raises(InputError, match=r"views: got .*far"):
        calibrate_cameras(LENSES, views, BOARD)
    with pytest.raises(InputError, match="instant: got 20"):
        calibrate_cameras(LENSES, views, BOARD, instant=20)
    with pytest.raises(InputError, match="views"):
        calibrate_cameras({"left": LENSES["left"]}, {"left": views["left"]}, BOARD)
    with pytest.raises(InputError, match="as many for every camera"):
        calibrate_cameras(LENSES, views | {"far": views["far"][:4]}, BOARD)


def test_a_camera_that_was_moved_is_told():
    """By two degrees, after the calibration: without it the others agree."""
    pose = board_poses(np.random.default_rng(6), 2)[1]
    rng = np.random.default_rng(1)
    seen: dict[str, Corners | None] = {name: corners_seen(c, pose, rng, 0.2) for name, c in CAMERAS.items()}
    kept = agree(CAMERAS, seen, BOARD)
    assert kept.misfit == pytest.approx(0.2 * np.sqrt(2), rel=0.15)
    assert set(kept.without) == set(CAMERAS)
    turned = Rotation.from_rotvec([0.0, np.radians(2.0), 0.0]).as_matrix() @ CAMERAS["right"].rotation
    seen["right"] = corners_seen(dataclasses.replace(CAMERAS["right"], rotation=turned), pose, rng, 0.2)
    moved = agree(CAMERAS, seen, BOARD)
    assert moved.misfit > 3
    assert moved.without["right"] == pytest.approx(0.2 * np.sqrt(2), rel=0.15)
    assert min(moved.without["left"], moved.without["far"]) > 2.5
    seen["far"] = None
    two = agree(CAMERAS, seen, BOARD)
    assert two.misfit > 2.5
    assert two.without == {}
    seen["left"] = None
    with pytest.raises(InputError, match="two cameras or more"):
        agree(CAMERAS, seen, BOARD)
    with pytest.raises(InputError, match="views: got 'third'"):
        agree(CAMERAS, {"third": None}, BOARD)


def drawn_view(camera: Camera, pose: Pose) -> np.ndarray:
    """An image of the board: each pixel looks where its sight meets the board's plane."""
    drawn, scale = BOARD.draw(80), 80 / BOARD.square
    grid = np.stack(np.meshgrid(np.arange(camera.width), np.arange(camera.height)), axis=-1).astype(float)
    inside = pose.inverse()
    start, away = (
        inside.rotation.apply(camera.position) + inside.position,
        camera.sights(grid) @ inside.rotation.as_matrix().T,
    )
    meets = start + away * (-start[2] / away[..., 2:])
    at = ((meets[..., :2] + BOARD.square) * scale - 0.5).astype(np.float32)  # its first corner lies a square in
    return cv2.remap(drawn, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderValue=128)


def tilted_before(camera: Camera, rng: np.random.Generator) -> Pose:
    """A board half a metre to a metre before a camera, tilted by up to 45 degrees."""
    tilt = rng.uniform(0.3, 0.8) * np.array([np.cos(a := rng.uniform(0, 2 * np.pi)), np.sin(a), 0])
    R = camera.rotation.T @ Rotation.from_rotvec(tilt).as_matrix()
    ahead = np.array([rng.uniform(-0.25, 0.25), rng.uniform(-0.15, 0.15), 1]) * rng.uniform(0.5, 1.0)
    middle = BOARD.points.mean(axis=0)
    return Pose(Rotation.from_matrix(R), camera.position + ahead @ camera.rotation - R @ middle)


@pytest.mark.slow
def test_lenses_and_places_are_told_by_images():
    rng, lenses = np.random.default_rng(4), {}
    for name in ("left", "right"):
        tilted = [BOARD.find(drawn_view(CAMERAS[name], tilted_before(CAMERAS[name], rng))) for _ in range(12)]
        lenses[name] = calibrate_lens(tilted, BOARD, width=848, height=480)
        assert lenses[name].residual < 0.3
        fx, fy, cx, cy = lenses[name].camera_matrix[[0, 1, 0, 1], [0, 1, 2, 2]] - [610, 605, 420.5, 238]
        assert (np.abs([fx, fy, cx, cy]) < 4 * lenses[name].sigma + 0.5).all()
    poses = board_poses(rng, 6)[1:]
    views = {name: [BOARD.find(drawn_view(CAMERAS[name], pose)) for pose in poses] for name in lenses}
    placed = {"rotation": poses[0].rotation.as_matrix(), "position": poses[0].position.tolist()}
    found = calibrate_cameras(lenses, views, BOARD, **placed)
    for name in lenses:
        assert found.residual[name] < 0.4
        np.testing.assert_allclose(found.cameras[name].position, CAMERAS[name].position, atol=0.02)
    with pytest.raises(InputError, match="tilt the board"):
        calibrate_lens([max(views["left"], key=lambda view: len(view.ids))] * 6, BOARD, width=848, height=480)


def test_a_lens_needs_views():
    with pytest.raises(InputError, match=r"views: got .0 of 3"):
        calibrate_lens([Corners(np.arange(3), np.zeros((3, 2)))] * 3, BOARD, width=848, height=480)
