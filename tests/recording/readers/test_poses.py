"""Pose estimation: animals, corrections, units, and pickled names."""

from __future__ import annotations

import pickle
import sys

import numpy as np
import pytest
from lab_files import FORMATS, PLANE, Motion, sleap_labels, swing

from whiptool.errors import InputError
from whiptool.recording.camera import write_cameras
from whiptool.recording.readers import needed_for, read_recording
from whiptool.recording.readers.deeplabcut import plain_names


@pytest.fixture
def motion() -> Motion:
    return swing()


def test_several_animals_have_to_be_told_apart(motion, tmp_path):
    for name in ("DeepLabCut CSV, animals", "SLEAP CSV"):
        file, write, _ = FORMATS[name]
        options = {**write(tmp_path / file, motion), "individual": None}
        if name == "SLEAP CSV":
            text = (tmp_path / file).read_text()
            mice = text.replace("whip", "mouse").splitlines(True)[1:]
            (tmp_path / file).write_text(text + "".join(mice))
        with pytest.raises(InputError, match=r"individuals, (mouse, whip|whip, mouse).*state individual"):
            read_recording(tmp_path / file, **options)
        with pytest.raises(InputError, match=r"individual: got 'cat'; allowed: one of (mouse, whip|whip, mouse)"):
            read_recording(tmp_path / file, **{**options, "individual": "cat"})


def test_a_project_of_sleap_counts_what_was_corrected(motion, tmp_path):
    sio = pytest.importorskip("sleap_io")
    labels = sleap_labels(motion)
    frame = labels[10]
    points = motion.pixels[10] + 5.0
    frame.instances.append(sio.Instance.from_numpy(points, skeleton=labels.skeleton, track=labels.tracks[0]))
    sio.save_slp(labels, str(tmp_path / "a.slp"))
    found = read_recording(tmp_path / "a.slp", **PLANE, fps=100)
    shift = (found.points[10] - motion.places[10] / 1e3) / 1e-3
    np.testing.assert_allclose(shift, [[5, -5], [5, -5]], atol=1e-9)
    sio.save_analysis_h5(labels, str(tmp_path / "a.analysis.h5"))  # a point that a person placed has no score
    for options in ({}, {"likelihood": 0.5}):
        again = read_recording(tmp_path / "a.analysis.h5", **PLANE, fps=100, **options)
        np.testing.assert_allclose(again.points[10], found.points[10], atol=1e-9)
    assert not read_recording(tmp_path / "a.analysis.h5", **PLANE, fps=100, likelihood=0.95).seen[9].any()
    frame.instances[-1].track = None
    frame.instances.append(sio.PredictedInstance.from_numpy(points, labels.skeleton, track=labels.tracks[0], score=1.0))
    sio.save_slp(labels, str(tmp_path / "b.slp"))
    with pytest.raises(InputError, match="several instances of one track in frame 10"):
        read_recording(tmp_path / "b.slp", **PLANE, fps=100)


def test_places_of_nwb_are_in_the_files_unit(motion, tmp_path):
    """In space, in centimetres by a factor, with two clocks refused."""
    h5py = pytest.importorskip("h5py")
    points = motion.in_space("z")
    with h5py.File(tmp_path / "a.nwb", "w") as file:
        file.attrs["nwb_version"] = "2.8.0"
        for i, name in enumerate(motion.markers):
            one = file.create_group(f"processing/behavior/whip/{name}")
            one.attrs["neurodata_type"] = "PoseEstimationSeries"
            one["data"] = points[:, i] - 1000
            one["data"].attrs.update({"unit": "centimeters", "conversion": 0.1, "offset": 100.0})
            one["timestamps"] = motion.t
    found = read_recording(tmp_path / "a.nwb", axes=["x", "z", "-y"])
    np.testing.assert_allclose(found.points[..., :2], motion.places / 1e3, atol=1e-12)
    assert any("timestamps" in note for note in found.remarks)
    with pytest.raises(InputError, match=r"axes: got None; .*the file does not state them"):
        read_recording(tmp_path / "a.nwb")
    with h5py.File(tmp_path / "a.nwb", "a") as file:
        whip = file["processing/behavior/whip"]
        for name in motion.markers:
            whip[f"{name}/timestamps"][-1] = np.nan
    late = read_recording(tmp_path / "a.nwb", axes=["x", "z", "-y"])  # one clock, of which a stamp is lost
    np.testing.assert_allclose(late.points, found.points[:-1])
    with h5py.File(tmp_path / "a.nwb", "a") as file:
        for name in motion.markers:
            file[f"processing/behavior/whip/{name}/timestamps"][-1] = motion.t[-1]
        file["processing/behavior/whip/tip/timestamps"][3] += 0.001
    with pytest.raises(InputError, match="series with different times"):
        read_recording(tmp_path / "a.nwb", axes=["x", "z", "-y"])
    with h5py.File(tmp_path / "a.nwb", "a") as file:  # a tip that is left out where it was not seen, as sleap-io does
        for name, values in (("data", points[5:, 1] - 1000), ("timestamps", motion.t[5:] + 1e-9)):
            attributes = dict(file[f"processing/behavior/whip/tip/{name}"].attrs)
            del file[f"processing/behavior/whip/tip/{name}"]
            file[f"processing/behavior/whip/tip/{name}"] = values
            file[f"processing/behavior/whip/tip/{name}"].attrs.update(attributes)
    less = read_recording(tmp_path / "a.nwb", axes=["x", "z", "-y"])
    tip, handle = less.marker("tip")[:, :2], less.marker("handle")[:, :2]
    np.testing.assert_allclose(tip, np.where(np.arange(len(less.t))[:, None] < 5, np.nan, motion.places[:, 1] / 1e3))
    np.testing.assert_allclose(handle, motion.places[:, 0] / 1e3)
    np.testing.assert_allclose(less.t, motion.t, atol=1e-8)
    with h5py.File(tmp_path / "c.nwb", "w") as file:
        file.attrs["nwb_version"] = "2.8.0"
    with pytest.raises(InputError, match=r"c\.nwb: NWB: got 'no PoseEstimation'; allowed: a PoseEstim"):
        read_recording(tmp_path / "c.nwb")
    with h5py.File(tmp_path / "b.h5", "w") as file:
        file["images"] = np.zeros(3)
    with pytest.raises(InputError, match=r"contents: got 'images'; allowed: tracks, as in an HDF5 file of DeepLabCut"):
        read_recording(tmp_path / "b.h5")


class Filmed(Motion):
    """Places that are pixels."""

    @property
    def pixels(self) -> np.ndarray:
        return self.places


@pytest.mark.parametrize("name", ["DeepLabCut CSV", "DeepLabCut h5", "Lightning Pose", "SLEAP CSV"])
def test_pixels_of_two_cameras_in_space_meet_where_the_markers_were(name, tmp_path):
    """The pixels are OpenCV's; a camera's own exposure and readout count where the sidecar states none."""
    by_opencv = pytest.importorskip("space_films").by_opencv
    from space_films import camera

    from whiptool.vision.multi_view import strike_in_space

    file, write, needs = FORMATS[name]
    for package in needs:
        pytest.importorskip(package)
    t = np.arange(30) / 100
    tip = np.stack([0.5 + 0.4 * np.sin(5 * t), 0.3 * np.cos(4 * t), 0.5 + 0.2 * t], axis=1)
    truth = np.stack([tip, tip + np.array([0.1, 0, 0.3])], axis=1)
    cameras = [camera(*x, fps=100.0, readout=0.0) for x in (("left", (1.6, 2.9, 1.1)), ("right", (2.4, -2.4, 0.7)))]
    write_cameras(tmp_path / "cameras.toml", {one.name: one for one in cameras})
    read = []
    for one in cameras:
        (tmp_path / one.name).mkdir()
        path = tmp_path / one.name / file
        write(path, Filmed(by_opencv(one, truth), ("tip", "node1")))
        side = {"cameras": tmp_path / "cameras.toml", "camera": one.name, "fps": 100}
        read.append(read_recording(path, **side))
        rolling = read_recording(path, **side, readout=0.008, exposure=0.001)
        assert (rolling.view.readout, rolling.view.exposure) == (pytest.approx(0.008 * 480 / 479), 0.001)
        for key, given in (({"rows": 480}, "none, for it has no effect"), (PLANE, "got 'together with cameras'")):
            with pytest.raises(InputError, match=given):
                read_recording(path, **side, **key)
        with pytest.raises(InputError, match=r"homography: got None; .* or camera and cameras of one in space"):
            read_recording(path, fps=100)
    assert [one.sigma_assumed for one in read] == ["sigma_pixels"] * 2
    assert any("errors: 1 pixel taken as" in note and note.endswith("say sigma_pixels") for note in read[0].notes)
    stated = read_recording(tmp_path / "left" / file, **(side | {"camera": "left"}), sigma_pixels=1.0)
    assert stated.assumed_error == 0
    assert not any("errors:" in note for note in stated.notes)
    found = strike_in_space(read)
    np.testing.assert_allclose(found.points[:, [found.markers.index(x) for x in ("tip", "node1")]], truth, atol=2e-5)


def test_nothing_of_a_pickle_is_run():
    """pandas pickles names of columns; a function among them is named, not called."""

    class Bomb:
        def __reduce__(self):
            return (print, ("boom",))

    for bomb in (Bomb(), [("a", Bomb())]):
        with pytest.raises(InputError, match=r"a pickle with GLOBAL .*print'; allowed: lists of texts"):
            plain_names(pickle.dumps(bomb, 0))
    with pytest.raises(InputError, match="a pickle with INT 1"):
        plain_names(pickle.dumps([("a", 1)], 0))
    names = [("net", "tip", "x"), ("net", "tip", "y"), ("net",)]
    for protocol in range(pickle.HIGHEST_PROTOCOL + 1):
        assert plain_names(pickle.dumps(names, protocol)) == names
    for damaged in (b"(lp0\ng5\na.", b"a.", b"(lp0\n(V", b"t."):
        with pytest.raises(InputError, match="a list of tuples of texts"):
            plain_names(damaged)


def test_without_h5py_its_extra_is_named_before_anything_is_read(tmp_path, monkeypatch):
    (tmp_path / "a.h5").write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(80))
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(InputError, match=r"HDF5 files: the package h5py is not .*pip install 'whiptool\[io\]'"):
        read_recording(tmp_path / "a.h5")
    assert needed_for([tmp_path / "a.h5"]) == ("h5py",)


@pytest.mark.slow
def test_the_nwb_file_that_sleap_io_writes_is_read(tmp_path):
    """Its series leave out the frames in which a node was not seen, and it writes a frame a second."""
    sio = pytest.importorskip("sleap_io")
    skeleton, track, video = sio.Skeleton(["tip", "handle"], name="whip"), sio.Track("whip"), sio.Video("v.mp4")
    pixels = np.random.default_rng(0).uniform(10, 90, (20, 2, 2))
    pixels[3:5, 0] = np.nan
    frames = []
    for i, one in enumerate(pixels):
        found = sio.PredictedInstance.from_numpy(
            one, skeleton=skeleton, point_scores=np.ones(2), score=1.0, track=track
        )
        frames.append(sio.LabeledFrame(video=video, frame_idx=i, instances=[found]))
    sio.save_nwb(sio.Labels(frames), str(tmp_path / "a.nwb"))
    found = read_recording(tmp_path / "a.nwb", scale=0.01, origin=[0, 0], fps=100)
    np.testing.assert_allclose(found.t, np.arange(20) / 100)
    for i, name in enumerate(("tip", "handle")):
        np.testing.assert_allclose(found.marker(name), pixels[:, i] * [0.01, -0.01])
    with pytest.raises(InputError, match="fps: got None; allowed: frames per second"):
        read_recording(tmp_path / "a.nwb", scale=0.01, origin=[0, 0])
