"""Every key of a sidecar changes what is read of a file, or is refused by its name: none is accepted and ignored."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lab_files import FORMATS, Motion, swing
from recordings import FPS, TABLE, H, T, images, places, plain_rows, write_lerobot, write_rows, write_video
from robot_log_files import BagWriter

from whiptool.errors import InputError
from whiptool.recording.camera import Camera, write_cameras
from whiptool.recording.readers import READERS, c3d, hdf5, mat, open_video, read_recording
from whiptool.recording.readers.keys import Keys
from whiptool.recording.readers.lerobot import KEYS
from whiptool.recording.readers.poses import KEYS as OF_POSES
from whiptool.recording.readers.sidecar import CLOCK, COMMON, FILM, PIXELS, SPACE, VIEW

VALUES: dict[str, list[Any]] = {
    "camera": ["left"], "exposure": [0.003], "target": [[1.0, 0.2]], "t_stay": [0.31], "start": [0.01],
    "joints": ["log.csv"], "joint_columns": [["q_2", "q_1"]], "joint_units": ["deg"],
    "joint_ranges": [{"q_1": [-1.0, 1.0], "q_2": [-1.0, 1.0]}], "joints_start": [0.03], "joints_topic": ["/other"],
    "hand": ["hand.csv"], "hand_start": [0.03], "hand_topic": ["/other"], "hand_frames": [["base", "tool"]],
    "hand_axes": [["x", "-y", "-z"]], "hand_offset": [[0.0, 0.0, 0.3]], "hand_up": ["y"], "strike": [TABLE],
    "controller": [{"law": "oiac"}], "units": ["in"], "axes": [["y", "x"], ["y", "z", "x"]],
    "origin": [[0.1, 0.2], [0.1, 0.2, 0.3]], "up": ["y", "z"], "cameras": ["others.toml"], "sigma": [0.02],
    "depth_units": ["cm"], "baseline": [0.07], "subpixel": [0.3], "homography": [(1.1 * H).tolist()],
    "known_points": [{"pixels": [[0, 0], [9, 0], [9, 9], [0, 9]], "metres": [[0, 0], [1, 0], [1, 1], [0, 1]]}],
    "scale": [0.0021], "kind": ["infrared"], "synthetic": [True], "fps": [77.0],
    "timestamps": [(np.arange(T) / 50).tolist(), (np.arange(80) / 50).tolist()], "stamp": ["start"],
    "readout": [0.01], "shutter": ["rolling"], "markers": [{"node1": "tip"}, ["a", "b"], {"tip": "/b"}],
    "individual": ["mouse"], "likelihood": [0.95], "sigma_pixels": [3.0], "rows": [480], "topic": ["/images"],
    "markers_feature": ["observation.other"], "joints_feature": ["action"],
}  # fmt: skip
BESIDE = ("log.csv", "hand.csv", "cameras.toml", "others.toml")
CALIBRATED = {"homography": H.tolist(), "exposure": 0.004}
LEFT = Camera("left", 64, 48, np.array([[50.0, 0, 32], [0, 50, 24], [0, 0, 1]]), np.eye(3), np.ones(3))


def beside(folder: Path) -> None:
    """Files that keys name."""
    t = np.arange(100) / 100
    write_rows(folder / "log.csv", [["t", "q_1", "q_2"], *np.column_stack([t, np.sin(t), np.cos(t)]).tolist()])
    names = ["t", *(f"hand_{x}" for x in ("x", "y", "z", "qx", "qy", "qz", "qw"))]
    write_rows(folder / "hand.csv", [names, *np.column_stack([t, t, t, t, 0 * t, 0 * t, 0 * t, 1 + 0 * t]).tolist()])
    for file, exposure in (("cameras.toml", 0.001), ("others.toml", 0.002)):
        left = dataclasses.replace(LEFT, exposure=exposure)
        write_cameras(folder / file, {"left": left, "right": dataclasses.replace(left, name="right")})


def plane(folder: Path) -> tuple[Path, dict]:
    write_rows(folder / "a.csv", plain_rows(2))
    return folder / "a.csv", {}


def space(folder: Path) -> tuple[Path, dict]:
    write_rows(folder / "a.csv", plain_rows(3))
    return folder / "a.csv", {}


def with_sigma(folder: Path) -> tuple[Path, dict]:
    rows = [["t", "tip_x", "tip_y", "tip_sigma"], *([k / FPS, 0.1 * k, 0.0, 0.001] for k in range(T))]
    write_rows(folder / "a.csv", rows)
    return folder / "a.csv", {}


def seen(folder: Path, *more: str) -> tuple[Path, dict]:
    names = ["t", "tip_u", "tip_v", *more]
    write_rows(folder / "a.csv", [names, *([k / FPS, 20 + 0.1 * k, 24, *[0.5] * len(more)] for k in range(T))])
    return folder / "a.csv", {"camera": "right", "cameras": "cameras.toml"}


def seen_in_depth(folder: Path) -> tuple[Path, dict]:
    return seen(folder, "tip_depth")


def seen_with_errors(folder: Path) -> tuple[Path, dict]:
    return seen(folder, "tip_sigma", "tip_depth", "tip_depth_sigma")


def matlab(folder: Path) -> tuple[Path, dict]:
    from scipy.io import savemat

    savemat(folder / "a.mat", {"t": np.arange(T) / FPS, "points": places()[:, :1]})
    return folder / "a.mat", {}


def metric_nwb(folder: Path) -> tuple[Path, dict]:
    import h5py

    with h5py.File(folder / "a.nwb", "w") as file:
        file.attrs["nwb_version"] = "2.8.0"
        one = file.create_group("processing/behavior/whip/tip")
        one.attrs["neurodata_type"] = "PoseEstimationSeries"
        one["data"] = np.column_stack([np.arange(T), np.ones(T), np.ones(T)])
        one["data"].attrs["unit"] = "centimeters"
        one["confidence"], one["timestamps"] = np.linspace(0.9, 1, T), np.arange(T) / FPS
    return folder / "a.nwb", {"axes": ["x", "z", "-y"]}


def dataset(folder: Path) -> tuple[Path, dict]:
    write_lerobot(folder / "set")
    for file in BESIDE:
        (folder / "set" / file).write_bytes((folder / file).read_bytes())
    return folder / "set", {"episode": 1}


def filmed_dataset(folder: Path) -> tuple[Path, dict]:
    path, base = dataset(folder)
    write_lerobot(path, whip=False)
    write_video(path / "videos/observation.images.front/chunk-000/file-000.mp4", images(2 * T), "mp4v")
    for file in BESIDE:
        (path / file).write_bytes((folder / file).read_bytes())
    return path, base | CALIBRATED


def film(folder: Path) -> tuple[Path, dict]:
    write_video(folder / "a.avi", images())
    return folder / "a.avi", {**CALIBRATED, "fps": FPS}


def bag(folder: Path) -> tuple[Path, dict]:
    with BagWriter(folder / "a.bag") as file:
        for k in range(T):
            for name, y in (("/tip", 0.0), ("/b", 1.0)):
                point = file.make("geometry_msgs/msg/Point", 0.1 * k, y, 1.0)
                stamped = file.make("geometry_msgs/msg/PointStamped", file.header(0.1 + k / FPS), point)
                file.write(name, 0.1 + k / FPS, stamped)
    return folder / "a.bag", {}


def filmed_bag(folder: Path) -> tuple[Path, dict]:
    with BagWriter(folder / "a.bag") as file:
        for k, image in enumerate(images()):
            fields = (48, 64, "bgr8", 0, 3 * 64, image.ravel())
            file.write("/film", 0.1 + k / FPS, file.make("sensor_msgs/msg/Image", file.header(0.1 + k / FPS), *fields))
    return folder / "a.bag", dict(CALIBRATED)


def laboratory(name: str) -> Callable[[Path], tuple[Path, dict]]:
    def write(folder: Path) -> tuple[Path, dict]:
        file, make, needs = FORMATS[name]
        for package in needs:
            pytest.importorskip(package)
        motion = Motion(swing().places, ("handle", "tip"))
        return folder / file, dict(make(folder / file, motion))

    return write


OWN = (
    plane, space, with_sigma, seen, seen_in_depth, seen_with_errors, matlab, metric_nwb, dataset, filmed_dataset, film,
    bag, filmed_bag,
)  # fmt: skip
FILES = {write.__name__: write for write in OWN} | {name: laboratory(name) for name in FORMATS}
FILMS = ("filmed_dataset", "film", "filmed_bag")
NEEDS = {"matlab": "scipy", "metric_nwb": "h5py", "dataset": "pyarrow", "filmed_dataset": "pyarrow", "film": "cv2"}
NEEDS |= {"bag": "rosbags", "filmed_bag": "rosbags"}


def contents(found: Any) -> Iterator[tuple[str, Any]]:
    """Names and values of what was read."""
    for name, value in vars(found).items():
        if name == "about":
            yield from value.items()
        elif name != "frames":
            yield name, value.table() if isinstance(value, Camera) else value


def differs(one: Any, other: Any) -> bool:
    a, b = dict(contents(one)), dict(contents(other))
    return set(a) != set(b) or any(not np.array_equal(np.array(a[x], object), np.array(b[x], object)) for x in a)


ALONE, LOGGED = {}, {"joints": "log.csv", "hand": "hand.csv"}


FAST = ("Motive", "DeepLabCut CSV", "Anipose", "NWB, stamped")  # the others share what reads their keys
CASES = [(name, ALONE) for name in FILES if name in FAST or name not in FORMATS]
CASES += [(name, LOGGED) for name in ("plane", "dataset", "film", "bag")]
SLOW = [pytest.param(name, ALONE, marks=pytest.mark.slow) for name in FORMATS if name not in FAST]


@pytest.mark.parametrize(("name", "logs"), [*CASES, *SLOW])
def test_every_key_has_an_effect_or_is_refused(name, logs, tmp_path, monkeypatch):
    if name in NEEDS:
        pytest.importorskip(NEEDS[name])
    for module in (c3d, hdf5, mat):
        monkeypatch.setattr(module, "parsed_apart", lambda path, kind, parse: parse(str(path)))
    beside(tmp_path)
    path, base = FILES[name](tmp_path)
    base |= logs
    read = open_video if name in FILMS else read_recording
    plain = read(path, **base)
    ignored = []
    for key, values in VALUES.items():
        for value in [x for x in values if x != base.get(key) and (key, x) != ("up", getattr(plain, "up", ""))]:
            try:
                if not differs(plain, read(path, **{**base, key: value})):
                    ignored.append((key, value))
            except InputError as error:
                last = key.rpartition("_")[2].removesuffix("s")
                if not re.search(rf"\b({key}|{last}s?)\b|no effect on|no body part was seen", str(error)):
                    raise
    assert ignored == []


def test_all_keys_and_readers_are_asked_about():
    keys = {*COMMON, *SPACE, *VIEW, *PIXELS, *FILM, *CLOCK, *OF_POSES, *KEYS, "topic", "markers"}
    assert set(VALUES) == keys
    without = {"angles", "log", "npz"}  # whose readers have no sidecar, or check its keys one by one
    own = {"csv", "mat", "hdf5", "lerobot", "video", "rosbag"}
    assert {name.split()[0].lower() for name in FORMATS} >= set(READERS) - without - own - {"deeplabcut"}


def test_what_was_not_asked_for_is_refused(tmp_path):
    """Whether a key is there is no use of it; a changed copy shares what was asked for."""
    keys = Keys({"a": 1.0, "b": 2.0, "c": 3.0}, tmp_path, "a.toml: ")
    assert "a" in keys.table
    assert keys.changed(a=None, d=4.0).number("c", 0.0) == 3
    with pytest.raises(InputError, match=r"^a.toml: a: got 1.0; allowed: none, for it has no effect on this file"):
        keys.check_used(("b",))
    assert keys.number("a", 0.0) == 1
    keys.check_used(("b",))
