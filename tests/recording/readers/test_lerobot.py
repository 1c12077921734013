"""LeRobot datasets, written by pyarrow and OpenCV, and every kind of damage."""

import numpy as np
import pytest
import tomli_w
from recordings import STRIKE, TABLE, H, T, fuzz, images, places, times, write_lerobot, write_video

from whiptool.errors import InputError
from whiptool.recording.readers import (
    lerobot_episode,
    lerobot_video,
    open_video,
    read_recording,
)


def test_lerobot(tmp_path):
    write_lerobot(tmp_path)
    (tmp_path / "whiptool.toml").write_text(tomli_w.dumps({"camera": "front", "episode": {"1": {"strike": TABLE}}}))
    r = read_recording(tmp_path, episode=1)
    np.testing.assert_allclose(r.points, places(), rtol=1e-6)
    np.testing.assert_allclose(r.t, times(), atol=1e-6)
    assert (r.markers, r.strike, r.camera) == (("tip", "handle"), STRIKE, "front")
    assert r.joints_q is not None
    np.testing.assert_allclose(r.joints_q[:, 0], np.arange(T, 2 * T) / 50, rtol=1e-6)
    assert read_recording(tmp_path, episode=0).strike is None
    assert set(lerobot_episode(tmp_path, 1).columns) >= {"action", "observation.state"}


NAMED = {"dtype": "float32", "shape": [3], "names": ["elbow_flex.pos", "gripper.pos", "shoulder_pan.pos"]}
STATES = np.column_stack([np.linspace(-40, 60, 2 * T), np.full(2 * T, 99.0), np.linspace(10, 50, 2 * T)])


@pytest.mark.parametrize(
    ("options", "joints"),
    [
        ({"joint_units": "deg"}, np.deg2rad(STATES[T:, [2, 0]])),
        (
            {"joint_units": "normalized", "joint_ranges": {"shoulder_pan": [-2, 2], "elbow_flex": [-1, 0]}},
            [0, -0.5] + STATES[T:, [2, 0]] / 100 * [2, 0.5],
        ),
        (
            {
                "joint_units": "deg",
                "joint_columns": {"elbow_flex": "shoulder_pan.pos", "shoulder_pan": "elbow_flex.pos"},
            },
            np.deg2rad(STATES[T:, [0, 2]]),
        ),
    ],
)
def test_lerobots_names_units_and_grippers_are_heard(tmp_path, options, joints):
    write_lerobot(tmp_path, features={"observation.state": NAMED}, data={"observation.state": STATES.tolist()})
    r = read_recording(tmp_path, episode=1, **options).ordered(("shoulder_pan", "elbow_flex"))
    np.testing.assert_allclose(r.joints_q, joints, rtol=1e-5, atol=1e-6)
    if "joint_columns" not in options:
        assert "left aside gripper.pos" in "; ".join(r.remarks)


def test_lerobots_units_are_never_guessed(tmp_path):
    write_lerobot(tmp_path, features={"observation.state": NAMED}, data={"observation.state": STATES.tolist()})
    with pytest.raises(InputError, match=r"joint_units.*deg, or normalized with joint_ranges"):
        read_recording(tmp_path, episode=1)
    with pytest.raises(InputError, match="column: got 'wrist'"):
        read_recording(tmp_path, episode=1, joint_columns=["wrist"])


def test_lerobot_video(tmp_path):
    write_lerobot(tmp_path, whip=False)
    write_video(tmp_path / "videos/observation.images.front/chunk-000/file-000.mp4", images(T) + images(T), "mp4v")
    with pytest.raises(InputError, match=r"track one of its cameras: observation\.images\.front"):
        read_recording(tmp_path, episode=1)
    video = lerobot_video(tmp_path, episode=1, homography=H)
    np.testing.assert_allclose(video.times, times(), atol=1e-6)
    columns = [np.argwhere(image[..., 0] > 127).mean(axis=0)[1] for _, image in video]
    np.testing.assert_allclose(columns, np.arange(T) + 3.5, atol=0.5)
    assert video.about["joints_q"].shape == (T, 2)
    assert len(open_video(tmp_path, episode=0)) == T
    write_video(tmp_path / "videos/observation.images.front/chunk-000/file-000.mp4", images(T + 5), "mp4v")
    with pytest.raises(InputError, match="cut off"):
        list(lerobot_video(tmp_path, episode=1).frames())


@pytest.mark.parametrize(
    ("written", "options", "said"),
    [
        ({"info": {"codebase_version": "v1.6"}}, {}, "v3.0"),
        ({"info": {"fps": 0}}, {}, "rows per second"),
        ({"info": {"features": 3}}, {}, "table of features"),
        ({"info": {"data_path": "../{chunk_index}.parquet"}}, {}, "inside the dataset"),
        ({"info": {"data_path": "{chunk_index.real}.parquet"}}, {}, "template"),
        ({"info": {"data_path": "gone/{file_index}.parquet"}}, {}, "gone"),
        ({"episodes": {"length": [T, T + 1]}}, {}, "31"),
        ({"episodes": {"data/file_index": [-1, -1]}}, {}, "two indices"),
        ({"data": {"timestamp": np.zeros(2 * T)}}, {}, "later than"),
        ({"data": {"observation.state": [[90.0, 90.0]] * 2 * T}}, {}, "degrees"),
        ({"data": {"observation.whip": [[900.0] * 4] * 2 * T}}, {}, "millimetres"),
        ({"data": {"observation.whip": [[1.0] * 3] * 2 * T}}, {}, "3 names"),
        ({}, {"episode": 7}, "one of 2 episodes"),
        ({}, {"episode": -1}, "an index"),
        ({}, {"colour": 1}, "colour"),
    ],
)
def test_lerobot_damage(tmp_path, written, options, said):
    write_lerobot(tmp_path, **written)
    with pytest.raises(InputError, match=said):
        read_recording(tmp_path, **{"episode": 1, **options})


@pytest.mark.parametrize(
    "name", ["meta/info.json", "meta/episodes/chunk-000/file-000.parquet", "data/chunk-000/file-000.parquet"]
)
def test_fuzz_lerobot(tmp_path, name):
    write_lerobot(tmp_path)
    fuzz(tmp_path / name, 60, lambda: read_recording(tmp_path, episode=1))
