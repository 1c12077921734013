"""The same motion from every laboratory's format is the same recording, and fits to the same numbers."""

from __future__ import annotations

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from films import film
from lab_files import FORMATS, Motion, swing
from recordings import fuzz

from whiptool.errors import InputError
from whiptool.identification.fit import FitOptions, fit
from whiptool.identification.plant import Plant
from whiptool.identification.summary import assumed_errors
from whiptool.impedance import Controller
from whiptool.models import preset
from whiptool.models.strike import Strike, default_bounds
from whiptool.recording.readers import find_format, read_recording, write_csv
from whiptool.recording.strike_recording import StrikeRecording

LEMON = Plant(preset("lemon2024")).with_nodes(3).model
VECTOR = default_bounds(LEMON.arm).sample(np.random.default_rng(0), 8)[0]
STRIKE = Strike.from_vector(VECTOR)
PLANT = Plant(LEMON.with_parameters({"whip.b": 0.07}), Controller())


@pytest.fixture(scope="module")
def motion() -> Motion:
    """A filmed strike, in whole millimetres, with a gap."""
    seen = film(LEMON, VECTOR, np.random.default_rng(0), markers=("handle", "tip"), sigma=2e-3, rate=100.0)
    places = np.round(1e3 * seen.points)
    places[20:24, 1] = np.nan
    return Motion(places, seen.markers)


def numbers_of(recording: StrikeRecording) -> tuple[float, float]:
    """Value and half interval of a fit."""
    found = fit(recording, PLANT, ["b"], options=FitOptions(starts=1, check=False, timestep=1e-3))["b"]
    return found.value, found.value - found.interval[0]


@pytest.fixture(scope="module")
def fitted(motion, tmp_path_factory) -> tuple[float, float]:
    """The numbers of our own CSV."""
    own = StrikeRecording(motion.t, motion.places / 1e3, motion.markers, strike=STRIKE)
    write_csv(own, tmp_path_factory.mktemp("own") / "own.csv")
    return numbers_of(own)


@pytest.mark.parametrize("name", FORMATS)
def test_the_same_motion_is_the_same_recording_and_fits_to_the_same_numbers(name, motion, fitted, tmp_path):
    file, write, needs = FORMATS[name]
    for package in needs:
        pytest.importorskip(package)
    options = write(tmp_path / file, motion)
    recording = read_recording(tmp_path / file, strike=STRIKE, **options)
    assert {"handle", "tip"} <= set(recording.markers)
    flat = recording.for_model(LEMON)
    for i, marker in enumerate(motion.markers):
        np.testing.assert_allclose(flat.marker(marker)[:, :2], motion.places[:, i] / 1e3, atol=1e-12)
    np.testing.assert_allclose(recording.t, motion.t, atol=1e-12)
    np.testing.assert_allclose(recording.sigma[recording.seen], 1e-3)
    value, half = numbers_of(recording)
    assert abs(value - fitted[0]) <= 1e-6 * fitted[1]
    assert half == pytest.approx(fitted[1], rel=1e-6)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("Motive", ["y is up, as is Motive's own convention", "as Motive solved them", "rotations of 1 rigid body",
                    "left out 1 unlabeled marker;"]),
        ("Nexus", ["z is up, as is Vicon's own convention", "x taken as forward", "sections Devices, Model Outputs"]),
        ("Qualisys TSV", ["z is up, as is Qualisys' own", "taken as mm", "4 points at (0, 0, 0)"]),
        ("TRC", ["y is up, as OpenSim has it"]),
        ("Tracker", ["taken as m, for the file does not state them", "100 even frames a second", "set in Tracker"]),
        ("DeepLabCut CSV, animals", ["4 points with a likelihood below 0.6", "individuals mouse"]),
        ("Lightning Pose", ["left out the columns x_posterior_var"]),
        ("Anipose", ["taken as mm, for the file does not state them"]),
    ],
)  # fmt: skip
def test_what_a_file_does_not_state_is_said(name, said, tmp_path):
    motion = swing()
    file, write, _ = FORMATS[name]
    options = write(tmp_path / file, motion)
    options.pop("markers", None)
    remarks = "; ".join(read_recording(tmp_path / file, **options).remarks)
    for words in said:
        assert words in remarks
    if "axes" in remarks and name != "Tracker":
        own = read_recording(tmp_path / file, **options, axes=["x", "z", "-y"], units="mm")
        assert not any(note.startswith(("axes", "units")) for note in own.remarks)


MOTIVE = "Format Version,1.23,Export Frame Rate,100,Length Units,Meters,Coordinate Space,Global\n\n"
BONES = ",Type,Bone,Bone,Bone\n,Name,Hip,Hip,Hip\n,ID,1,1,1\n,,Position,Position,Position\n"
FRAMES = "Frame,Time (Seconds),X,Y,Z\n0,0,1,2,3\n1,0.01,1,2,3\n"
QUALISYS = "NO_OF_FRAMES\t2\nFREQUENCY\t100\nDATA_INCLUDED\t6D\nBODY_NAMES\tstick\n" + "1.0\t" * 15 + "1.0\n"
TRC = "PathFileType\t4\t(X/Y/Z)\ta.trc\nDataRate\tUnits\n100\tmm\nFrame#\tTime\n\t\n1\t0.0\n2\t0.01\n"
LABELS = "scorer,me,me,me\nbodyparts,tip,tip,tip\ncoords,x,y,likelihood\nlabeled-data/a/img1.png,1,2,1\n"


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("a.csv", MOTIVE + BONES + FRAMES, "a CSV export of OptiTrack Motive without markers"),
        ("a.csv", "Devices\n1000\n,,F\nFrame,Sub Frame,Fx\n,,N\n1,0,5\n", "Vicon Nexus with Devices, without traj"),
        ("a.csv", "\n\nModel Outputs\n100\n,,A\nFrame,Sub Frame,X\n,,deg\n1,0,5\n", "Nexus with Model Outputs"),
        ("a.tsv", QUALISYS, "a TSV export of Qualisys Track Manager with 6D data, without 3D markers"),
        ("a.trc", TRC, "a TRC file of OpenSim or Cortex without markers"),
        ("a.txt", "mass A\nt\tv_{x}\n0\t1\n1\t2\n", "a text export of Tracker without x and y"),
        ("a.csv", LABELS, "labels of single images for training, as DeepLabCut keeps them"),
        ("a.csv", "track,frame_idx,instance.score\nwhip,0,0.9\nwhip,1,0.9\n", "a CSV file of SLEAP without body parts"),
        ("take.tak", "?", "a take of OptiTrack Motive.*export it as CSV"),
        ("swing.qtm", "?", "a project of Qualisys"),
        ("swing.trk", "<?xml", "a project of Tracker"),
        ("swing.x2d", "?", "a trial of Vicon Nexus"),
        ("swing.mot", "Coordinates\n", "a file of OpenSim"),
        ("a_full.pickle", "?", "a pickle, as DeepLabCut writes it"),
    ],
)
def test_a_known_format_without_tracks_is_refused_by_its_name(name, text, said, tmp_path):
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=said) as caught:
        read_recording(tmp_path / name)
    assert name in str(caught.value)
    assert "cut off" not in str(caught.value)
    assert "\n" not in str(caught.value)


def test_errors_that_are_assumed_are_said_and_after_a_fit_those_that_its_residuals_suggest(motion, tmp_path):
    """Of a film of 2 mm, which no file says; some of the misfit is what the fit holds fixed."""
    FORMATS["Motive"][1](tmp_path / "a.csv", motion)
    said = "errors: 1 mm taken as the standard error of each coordinate, for nothing states it; else say sigma"
    misfits = []
    for stated in (None, 2e-3):
        read = read_recording(tmp_path / "a.csv", strike=STRIKE, markers=list(motion.markers), sigma=stated)
        assert (said in read.remarks) == (stated is None)
        found = fit(read, PLANT, ["b"], options=FitOptions(starts=1, check=False, timestep=1e-3))
        misfits.append(found.misfit)
        lines = assumed_errors(found, [read])
        assert bool(lines) == (stated is None)
        if lines:
            assert float(lines[0].rpartition("sigma = ")[2]) == pytest.approx(1e-3 * found.misfit, rel=0.05)
    assert misfits[0] == pytest.approx(2 * misfits[1], rel=0.02)


@pytest.mark.parametrize(
    ("name", "label"),
    [("Motive", "Unlabeled 1042"), ("Nexus", "*112"), ("Qualisys TSV", "New 0004"), ("TRC", "U_17")],
)
def test_markers_without_a_label_are_left_out_unless_they_are_named(name, label, tmp_path):
    file, write, _ = FORMATS[name]
    options = write(tmp_path / file, Motion(swing().places, (label, "tip")))
    read = read_recording(tmp_path / file, **{**options, "markers": None})
    assert set(read.markers) <= {"tip", "Stick"}  # a body of Motive
    assert any(re.match(r"left out \d unlabeled markers?; name them in markers", note) for note in read.notes)
    named = read_recording(tmp_path / file, **{**options, "markers": {"tip": label}})
    assert not any("unlabeled" in note for note in named.notes)


def test_names_of_masses_may_stand_in_the_first_row_of_trackers_text(tmp_path):
    text = "#multi:\ttip\t\thandle\t\nt\tx\ty\tx\ty\n0\t1,5\t2\t3\t4\n0,01\t\t\t3\t4\n0,02\t1,5\t2\t3\t4\n"
    (tmp_path / "a.txt").write_text(text)
    read = read_recording(tmp_path / "a.txt")
    assert read.markers == ("tip", "handle")
    np.testing.assert_array_equal(read.points[0], [[1.5, 2], [3, 4]])
    assert read.seen.tolist() == [[True, True], [False, True], [True, True]]


def test_bodies_of_other_programs_than_motive_are_refused_as_the_hand(tmp_path):
    """Segments of Nexus by their name, 6D data of Qualisys as a file."""
    (tmp_path / "take_6D.tsv").write_text(QUALISYS)
    for name, hand in (("Nexus", "Grip:Grip"), ("Qualisys TSV", "take_6D.tsv")):
        file, write, _ = FORMATS[name]
        options = write(tmp_path / file, swing())
        with pytest.raises(InputError, match=r"hand: got '.*6D data and segments are not read") as caught:
            read_recording(tmp_path / file, **{**options, "hand": hand})
        assert "\n" not in str(caught.value)


def test_what_residuals_suggest_is_in_the_unit_and_under_the_key_of_what_was_assumed():
    """Of pixels, of places, and of recordings that do not agree; an error put in later counts."""
    t, fitted = np.arange(9) / 60, SimpleNamespace(explains=True, misfit=2.0)
    pixels = StrikeRecording(t, np.zeros((9, 1, 2)), ("tip",), 0.002, sigma_assumed="sigma_pixels")
    places = StrikeRecording(t, np.zeros((9, 1, 2)), ("tip",))
    ((said,), (other,)) = (assumed_errors(fitted, [one, one]) for one in (pixels, places))
    assert said.startswith("1 pixel was assumed")
    assert said.endswith("say sigma_pixels = 2")
    assert other.startswith("1 mm was assumed")
    assert other.endswith("say sigma = 0.002")
    assert assumed_errors(fitted, [pixels, places]) == []
    (said,) = assumed_errors(SimpleNamespace(explains=True, misfit=0.2), [pixels])
    assert said.startswith("1 pixel was assumed, 5 times as much as the readings scatter")
    assert said.endswith("say sigma_pixels = 0.2")
    assert assumed_errors(SimpleNamespace(explains=True, misfit=0.9), [pixels]) == []
    assert assumed_errors(fitted, [replace(places, sigma=3e-3)]) == []


@pytest.mark.parametrize("name", ["Motive", "Nexus", "Qualisys TSV", "TRC", "Tracker", "Anipose", "SLEAP CSV"])
def test_fuzz_texts(name, tmp_path):
    motion = swing(12)
    file, write, _ = FORMATS[name]
    options = write(tmp_path / file, motion)
    key = find_format(tmp_path / file)
    fuzz(tmp_path / file, 60, lambda: read_recording(tmp_path / file, format=key, **options))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["DeepLabCut h5", "DeepLabCut h5, animals", "SLEAP slp", "NWB"])
def test_fuzz_hdf5(name, tmp_path):
    motion = swing(12)
    file, write, needs = FORMATS[name]
    for package in needs:
        pytest.importorskip(package)
    options = write(tmp_path / file, motion)
    fuzz(tmp_path / file, 12, lambda: read_recording(tmp_path / file, format="hdf5", **options))
