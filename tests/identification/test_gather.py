"""Recordings are gathered by what is named on the command line, and taken for what their name and first line say."""

from __future__ import annotations

import pytest
import tomli_w

from whiptool.errors import InputError
from whiptool.identification.gather import in_pixels, may_be_filmed, opened, tracked


@pytest.mark.slow
def test_an_episode_of_a_dataset_is_named_behind_its_folder(tmp_path):
    pytest.importorskip("pyarrow", reason="needs the extra `io`")
    from recordings import TABLE, H, T, write_lerobot

    write_lerobot(tmp_path / "set")
    sidecar = {"homography": H.tolist(), "episode": {"1": {"strike": TABLE}}}
    (tmp_path / "set" / "whiptool.toml").write_text(tomli_w.dumps(sidecar))
    recording, synthetic = tracked(opened(f"{tmp_path / 'set'}#1"), name="set#1")
    assert recording.strike is not None
    assert (len(recording.t), recording.markers, synthetic) == (T, ("tip", "handle"), False)
    with pytest.raises(InputError, match="episode"):
        opened(f"{tmp_path / 'set'}#7")
    with pytest.raises(InputError, match="exists"):
        opened(f"{tmp_path / 'none'}#1")


@pytest.mark.parametrize(
    ("name", "head", "pixels"),
    [
        ("left.csv", "t,tip_u,tip_v", True),
        ("left.csv", '"t" , "tip_u" , "tip_v"', True),
        ("places.csv", "t,tip_x,tip_y,tip_z", False),
        ("left.npz", "t,tip_u,tip_v", False),
    ],
)
def test_pixels_are_told_by_the_columns_of_a_csv(tmp_path, name, head, pixels):
    (tmp_path / name).write_text(f"{head}\n0,1,2,3\n")
    assert in_pixels(str(tmp_path / name)) is pixels


def test_a_file_that_is_not_there_is_not_in_pixels(tmp_path):
    assert not in_pixels(str(tmp_path / "absent.csv"))


def test_forms_that_can_hold_images(tmp_path):
    for name in ("strike.mp4", "strike.csv"):
        (tmp_path / name).write_bytes(b"t,tip_x,tip_y\n")
    assert may_be_filmed(str(tmp_path / "strike.mp4"))
    assert not may_be_filmed(str(tmp_path / "strike.csv"))


def test_cameras_are_for_what_is_in_pixels(tmp_path):
    """A table of places is read as it is, whatever cameras there are for the others."""
    (tmp_path / "places.csv").write_text("t,tip_x,tip_y\n0,1,2\n0.02,1,2\n")
    (tmp_path / "places.toml").write_text("sigma = 0.002\n")
    found = opened(str(tmp_path / "places.csv"), cameras=tmp_path / "absent.toml")
    assert found.view is None
    assert found.points[1, 0].tolist() == [1.0, 2.0]
