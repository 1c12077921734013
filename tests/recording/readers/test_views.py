"""What a camera in space saw, as CSV: pixels, the camera's file, and every slip."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from recordings import STRIKE, T, same, times, write_rows
from scipy.spatial.transform import Rotation

from whiptool.errors import InputError
from whiptool.recording.camera import Camera, looking_at, write_cameras
from whiptool.recording.readers import read_recording, write_csv
from whiptool.recording.strike_recording import DEFAULT_PIXELS, StrikeRecording

K = np.array([[430.0, 0, 424], [0, 432.0, 238], [0, 0, 1]])
LEFT = Camera(
    "left",
    848,
    480,
    K,
    looking_at((2, 3, 1), (0.5, 0, 0.5)),
    np.array([2.0, 3.0, 1.0]),
    (0.1, 0, 0, 0),
    60.0,
    3e-3,
    0.012,
)


def pixels() -> np.ndarray:
    """Two markers, one of them hidden for three frames, (T, 2, 2)."""
    found = np.random.default_rng(0).uniform(0, 480, (T, 2, 2))
    found[4:7, 1] = np.nan
    return found


def seen(**more) -> StrikeRecording:
    return StrikeRecording(
        times(), pixels(), ("tip", "node3"), view=LEFT, strike=STRIKE, target=(1.0, 0.1, 0.4), **more
    )


def rows() -> list[list]:
    table = np.column_stack([times(), pixels().reshape(T, -1)]).tolist()
    return [["t", "tip_u", "tip_v", "node3_u", "node3_v"], *table]


def test_rows_are_read_one_after_the_other():
    film = seen()
    assert film.exposure == LEFT.exposure
    assert film.camera == "left"
    np.testing.assert_array_equal(film.sigma, DEFAULT_PIXELS)
    np.testing.assert_allclose(film.t_points[:, 0], times() + pixels()[:, 0, 1] / 480 * 0.012)
    assert np.isfinite(film.t_points).all()
    assert "seen by left" in repr(film)
    assert seen(sigma=0.2).sigma.shape == (T, 2)


def test_files_give_back_what_was_seen(tmp_path):
    film = seen(sigma=np.random.default_rng(1).uniform(0.1, 0.4, (T, 2)), joints_t=times(), joints_q=np.zeros((T, 6)))
    names = [file.name for file in write_csv(film, tmp_path / "a.csv")]
    assert names == ["a.csv", "a.toml", "a.cameras.toml", "a.joints.csv"]
    film.save(tmp_path / "a.npz")
    for name in ("a.csv", "a.npz"):
        back = read_recording(tmp_path / name)
        assert back.view.table() == LEFT.table()
        put = dataclasses.replace(back, view=None, points=back.points / 1e3)
        same(put, dataclasses.replace(film, view=None, points=film.points / 1e3), but=("source", "sha256"))


def test_a_table_of_pixels_and_a_file_of_cameras(tmp_path):
    write_rows(tmp_path / "a.csv", rows())
    write_cameras(tmp_path / "cameras.toml", {"left": LEFT, "right": dataclasses.replace(LEFT, name="right")})
    (tmp_path / "a.toml").write_text('camera = "right"\ncameras = "cameras.toml"\nsigma = 0.3\nstart = 0.1\n')
    film = read_recording(tmp_path / "a.csv")
    assert film.view.name == film.camera == "right"
    np.testing.assert_allclose(film.t, times() - 0.1)
    np.testing.assert_array_equal(film.sigma, 0.3)
    np.testing.assert_array_equal(film.points, pixels())
    (tmp_path / "elsewhere").mkdir()
    moved = (tmp_path / "cameras.toml").rename(tmp_path / "elsewhere" / "others.toml")
    assert read_recording(tmp_path / "a.csv", cameras=moved, camera="left").view.name == "left"


def test_the_hands_poses_come_with_a_recording(tmp_path):
    """As an exported trajectory has them, by the hand's own clock; a quaternion of another length is none."""
    poses = np.hstack([np.zeros((T, 3)), Rotation.random(T, rng=np.random.default_rng(0)).as_quat()])
    film = seen(hand_t=times() - 0.05, hand_pose=poses)
    assert (tmp_path / "a.hand.csv") in write_csv(film, tmp_path / "a.csv")
    film.save(tmp_path / "a.npz")
    for name in ("a.csv", "a.npz"):
        back = read_recording(tmp_path / name)
        np.testing.assert_array_equal(back.hand_t, film.hand_t)
        np.testing.assert_allclose(back.hand_pose, poses, atol=1e-15)
    assert read_recording(tmp_path / "a.csv", hand_start=0.25).hand_t[0] == -0.3
    for change, said in (
        ({"hand_pose": 2 * poses}, "of length 1"),
        ({"hand_pose": poses[:, :6]}, "shape"),
        ({"hand_pose": None}, "both or neither"),
        ({"hand_pose": poses + 1e3 * np.eye(7)[0]}, "millimetres"),
    ):
        with pytest.raises(InputError, match=said):
            dataclasses.replace(film, **change)


@pytest.mark.parametrize(
    ("side", "damage", "said"),
    [
        ('camera = "left"', list, "cameras: .*in pixels"),
        ('cameras = "cameras.toml"', list, "camera: .*one of left"),
        ('camera = "top"\ncameras = "cameras.toml"', list, "camera: got 'top'.*one of left"),
        ('camera = "left"\ncameras = "absent.toml"', list, "absent.toml"),
        ('camera = "left"\ncameras = "../cameras.toml"', list, "without folders"),
        ('camera = "left"\ncameras = "cameras.toml"\nunits = "mm"', list, "one of the keys"),
        ('camera = "left"\ncameras = "cameras.toml"', lambda r: [row[:4] for row in r], "node3_u and node3_v"),
        ('camera = "left"\ncameras = "cameras.toml"', lambda r: [row[1:] for row in r], "a column t"),
        (
            'camera = "left"\ncameras = "cameras.toml"',
            lambda r: [r[0], *([t, *(5 * x for x in row)] for t, *row in r[1:])],
            "pixels of left, 848 x 480",
        ),
    ],
)
def test_slips_are_named(tmp_path, side, damage, said):
    write_rows(tmp_path / "a.csv", damage(rows()))
    write_cameras(tmp_path / "cameras.toml", {"left": LEFT})
    (tmp_path / "a.toml").write_text(side + "\n")
    with pytest.raises(InputError, match=said) as caught:
        read_recording(tmp_path / "a.csv")
    assert "\n" not in str(caught.value)


def depths() -> np.ndarray:
    """Of both markers [m]; of the second not measured in two frames."""
    found = np.random.default_rng(2).uniform(1, 3, (T, 2))
    found[10:12, 1] = 0
    return found


def test_depth_is_kept_where_it_was_measured():
    """0 means missing, a hidden marker has none, and the default error is that of a D435."""
    film = seen(depth=depths())
    there = np.isfinite(pixels()[..., 0]) & (depths() > 0)
    np.testing.assert_array_equal(np.isfinite(film.depth), there)
    np.testing.assert_array_equal(film.depth[there], depths()[there])
    np.testing.assert_allclose(film.depth_sigma[there], depths()[there] ** 2 * 0.08 / (430 * 0.05))
    assert film.seen[10, 1]
    assert seen(depth=np.zeros((T, 2))).depth is None
    assert seen(depth=depths(), depth_sigma=0.01).depth_sigma[0, 0] == 0.01
    assert np.isnan(film.without(film.t > 0.2).depth[film.t > 0.2]).all()


def test_depth_goes_through_files(tmp_path):
    film = seen(depth=depths(), depth_sigma=np.random.default_rng(3).uniform(0.01, 0.02, (T, 2)))
    write_csv(film, tmp_path / "a.csv")
    assert (tmp_path / "a.csv").read_text().startswith("t,tip_u,tip_v,tip_sigma,tip_depth,tip_depth_sigma,node3_u")
    film.save(tmp_path / "a.npz")
    for name in ("a.csv", "a.npz"):
        back = read_recording(tmp_path / name)
        np.testing.assert_array_equal(back.depth, film.depth)
        np.testing.assert_array_equal(back.depth_sigma, film.depth_sigma)
    write_csv(seen(), tmp_path / "b.csv")
    assert read_recording(tmp_path / "b.csv").depth is None


def test_a_table_says_depth_in_millimetres_and_of_which_pair(tmp_path):
    """Of one marker alone; the other has none."""
    head, *table = rows()
    deep = [[*row, 1e3 * z] for row, z in zip(table, depths()[:, 0], strict=True)]
    write_rows(tmp_path / "a.csv", [[*head, "tip_depth"], *deep])
    write_cameras(tmp_path / "cameras.toml", {"left": LEFT})
    said = 'camera = "left"\ncameras = "cameras.toml"\n'
    (tmp_path / "a.toml").write_text(f'{said}depth_units = "mm"\nbaseline = 0.1\nsubpixel = 0.04\n')
    film = read_recording(tmp_path / "a.csv")
    np.testing.assert_allclose(film.depth[:, 0], depths()[:, 0])
    np.testing.assert_allclose(film.depth_sigma[:, 0], depths()[:, 0] ** 2 * 0.04 / (430 * 0.1))
    assert np.isnan(film.depth[:, 1]).all()
    (tmp_path / "a.toml").write_text(said)
    with pytest.raises(InputError, match="are these millimetres"):
        read_recording(tmp_path / "a.csv")
    write_rows(tmp_path / "a.csv", [[*head, "tip_depth_sigma"], *deep])
    with pytest.raises(InputError, match="tip_depth together with its sigma"):
        read_recording(tmp_path / "a.csv")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"depth": -depths()}, "depths > 0"),
        ({"depth": 1e3 * depths()}, "are these millimetres"),
        ({"depth": depths()[:9]}, "broadcasts"),
        ({"depth": depths(), "depth_sigma": 0.0}, "> 0 m wherever there is a depth"),
        ({"depth_sigma": 0.1}, "None unless depth"),
        ({"depth": depths(), "view": None, "points": pixels() / 1e3}, "None unless a view"),
    ],
)
def test_depths_that_cannot_be(change, said):
    with pytest.raises(InputError, match=said) as caught:
        dataclasses.replace(seen(), **change)
    assert "\n" not in str(caught.value)


def test_a_view_has_two_coordinates():
    with pytest.raises(InputError, match="in pixels, with a view"):
        StrikeRecording(times(), np.zeros((T, 1, 3)), ("tip",), view=LEFT)
