"""All formats: how one is found, and what is said where its package is missing."""

import pytest
from recordings import full

from whiptool.errors import InputError
from whiptool.recording.readers import (
    open_video,
    read_recording,
)


def test_registry(tmp_path):
    (tmp_path / "a.xyz").write_text("?")
    with pytest.raises(InputError) as caught:
        read_recording(tmp_path / "a.xyz")
    kinds = ("CSV", "TSV", "TRC", "MAT", "C3D", "HDF5", "NPZ", "film", "ROS bag", "LeRobot")
    assert all(kind in str(caught.value) for kind in kinds)
    for path in (tmp_path / "absent.csv", tmp_path, "a\0b"):
        with pytest.raises(InputError):
            read_recording(path)
    with pytest.raises(InputError, match="allowed: motive, nexus"):
        read_recording(tmp_path / "a.xyz", format="xyz")
    full().save(tmp_path / "a.npz")
    with pytest.raises(InputError, match="fps"):
        read_recording(tmp_path / "a.npz", fps=60)
    with pytest.raises(InputError, match="read_recording"):
        open_video(tmp_path / "a.npz")
    for suffix in ("csv", "npz", "mat", "c3d", "db3", "mp4"):
        (tmp_path / f"empty.{suffix}").touch()
        with pytest.raises(InputError, match="an empty file"):
            (open_video if suffix in ("db3", "mp4") else read_recording)(tmp_path / f"empty.{suffix}")


def test_missing_packages(tmp_path, monkeypatch):
    import sys

    for module in ("ezc3d", "pyarrow.parquet", "rosbags.rosbag2", "cv2"):
        monkeypatch.setitem(sys.modules, module, None)
    (tmp_path / "d/meta").mkdir(parents=True)
    (tmp_path / "d/meta/info.json").write_text("{}")
    for name in ("a.c3d", "a.mp4", "a.db3"):
        (tmp_path / name).write_bytes(b"x")
    for path, reader, extra in (
        (tmp_path / "a.c3d", read_recording, "io"),
        (tmp_path / "d", read_recording, "io"),
        (tmp_path / "a.db3", open_video, "io"),
        (tmp_path / "a.mp4", open_video, "vision"),
    ):
        with pytest.raises(InputError, match=rf"pip install 'whiptool\[{extra}\]'"):
            reader(path)
