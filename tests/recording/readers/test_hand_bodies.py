"""The hand as a rigid body of motion capture: its poses against a simulated robot's, and a fit driven by them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from lab_files import cell, rows_to
from robot_log_files import write_table
from scipy.spatial.transform import Rotation

from whiptool.errors import InputError
from whiptool.identification.fit import FitOptions, fit
from whiptool.identification.plant import Plant
from whiptool.impedance import Controller, PositionControl
from whiptool.models import preset
from whiptool.models.kinematics import arm_frames, chain_motion
from whiptool.models.pose_columns import POSE
from whiptool.models.strike import Strike
from whiptool.models.whip import WhipParameters
from whiptool.recording.readers import read_recording, write_csv
from whiptool.recording.understood import understand
from whiptool.rollout import CompiledRollout

ROBOT = replace(preset("ur5e"), whip=WhipParameters(N=3, l=0.2, m=0.02, k=0.05, b=0.004, joints="rod"))
STRIKE = Strike((0.1, -1.9, 1.2, -0.9, 0.3, 0.0), (0.5, -1.2, 0.6, -1.6, -0.4, 0.2), 0.6)
RATE = 200.0
# which of the model's axes (x forward, y to the left, z up) are x, y and z in the laboratory, as rows
LABS = {
    "y": np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]),
    "z": np.eye(3),
    "x": np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]]),
    "-x forward, -z up": np.array([[-1, 0, 0], [0, 1, 0], [0, 0, -1]]),
}


@dataclass(frozen=True)
class Seen:
    """A strike in the model's axes: times (T,) [s], the tip (T, 3) [m], the hand's place (T, 3) and rotation."""

    t: np.ndarray
    tip: np.ndarray
    place: np.ndarray
    rotation: Rotation


@pytest.fixture(scope="module")
def seen() -> Seen:
    """A strike of a robot whose joints are on their reference, with its whip's motion."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("WHIPTOOL_ENGINE", "interpreter")
        path = CompiledRollout(ROBOT, Controller(PositionControl()), timestep=1e-3).trajectory(STRIKE, t_stay=0.1)
    some = slice(0, None, round(1e3 / RATE))
    hand = arm_frames(ROBOT.arm, path.q[some, : ROBOT.arm.n])[-1]
    tip = chain_motion(ROBOT, path.q[some])[0][:, -1]
    return Seen(path.t[some], tip, hand.origin, Rotation.from_matrix(hand.rotation))


def motive(path: Path, seen: Seen, lab: np.ndarray, up: str = "", rotation: str = "Quaternion") -> None:
    """A CSV file after OptiTrack's page on CSV export: a marker and a rigid body, in mm, quaternions as X, Y, Z, W."""
    head = ["Format Version", "1.23", "Export Frame Rate", f"{RATE:.6f}", "Rotation Type", rotation,
            "Length Units", "Millimeters", "Coordinate Space", "Global"]  # fmt: skip
    rows = [["", "Type"], ["", "Name"], ["", "ID"], ["", ""], ["Frame", "Time (Seconds)"]]
    turned = ("Rotation", "XYZW" if rotation == "Quaternion" else "XYZ")
    parts = [("Rigid Body", "Grip", *turned), ("Rigid Body", "Grip", "Position", "XYZ"),
             ("Marker", "Whip:tip", "Position", "XYZ")]  # fmt: skip
    for kind, name, quantity, axes in parts:
        for axis in axes:
            for row, text in zip(rows, (kind, name, f"{kind}1", quantity, axis), strict=True):
                row.append(text)
    quaternions = (Rotation.from_matrix(lab) * seen.rotation).as_quat()[:, : len(turned[1])]
    numbers = np.hstack([quaternions, 1e3 * seen.place @ lab.T, 1e3 * seen.tip @ lab.T])
    body = [[str(k), f"{t + 2:.6f}", *(cell(x, 9) for x in row)]
            for k, (t, row) in enumerate(zip(seen.t, numbers, strict=True))]  # fmt: skip
    rows_to(path, [[*head, *(["Up Axis", f"+{up}"] if up else [])], [], *rows, *body])


@pytest.mark.parametrize(
    ("lab", "up", "said"),
    [
        ("y", "", {}), ("z", "Z", {}), ("x", "X", {}),  # as Motive has it, and as the first row says
        ("z", "", {"up": "z"}), ("y", "Z", {"up": "y"}),
        ("y", "", {"axes": ["x", "-z", "y"]}), ("x", "", {"axes": ["y", "z", "x"]}),
        ("-x forward, -z up", "", {"axes": ["-x", "y", "-z"]}),
        ("y", "", {"axes": ["x", "y", "z"], "up": "y"}),
        ("y", "", {"origin": [1000.0, 200.0, -300.0]}), ("y", "", {"units": "cm"}),
    ],
)  # fmt: skip
def test_a_rigid_bodys_poses_are_the_hands_in_every_convention_of_axes(lab, up, said, seen, tmp_path):
    motive(tmp_path / "a.csv", seen, LABS[lab], up)
    read = read_recording(tmp_path / "a.csv", hand="Grip", start=2.0, **said).for_model(ROBOT)
    shift, factor = LABS[lab].T @ np.array(said.get("origin", [0, 0, 0])) / 1e3, 10 if "units" in said else 1
    np.testing.assert_allclose(read.hand_t, seen.t, atol=1e-12)
    np.testing.assert_allclose(read.marker("tip"), factor * (seen.tip - shift), atol=1e-10 * factor)
    np.testing.assert_allclose(read.hand_pose[:, :3], factor * (seen.place - shift), atol=1e-10 * factor)
    off = Rotation.from_quat(read.hand_pose[:, 3:]) * seen.rotation.inv()
    assert off.magnitude().max() < 1e-8


def test_it_is_written_as_our_own_csv_and_reads_back_bit_by_bit(seen, tmp_path):
    motive(tmp_path / "a.csv", seen, LABS["y"])
    read = read_recording(tmp_path / "a.csv", hand="Grip", start=2.0)
    write_csv(read, tmp_path / "b.csv")
    again = read_recording(tmp_path / "b.csv")
    np.testing.assert_array_equal(again.hand_pose, read.hand_pose)
    np.testing.assert_array_equal(again.points, read.points)
    assert again.up == read.up == "z"
    topics = {one.topic: one for one in understand(str(tmp_path / "a.csv"), hand="Grip").findings}
    assert topics["markers"].fix == ""  # the body need not be renamed, for it is the hand
    assert topics["axes"].value == "z is up, in the file y"
    assert "is up" not in topics["axes"].reason


def test_the_hand_may_be_elsewhere_in_the_body_and_frames_without_it_are_left_out(seen, tmp_path):
    """A body whose z points along the whip, 10 cm before the hand, hidden for some frames."""
    logged = seen.rotation * Rotation.from_euler("x", 180, degrees=True)
    place = seen.place - logged.apply([0, 0, 0.1])
    place[30:40] = np.nan
    motive(tmp_path / "a.csv", replace(seen, place=place, rotation=logged), LABS["y"])
    (tmp_path / "a.toml").write_text(
        'hand = "Grip"\nhand_axes = ["x", "-y", "-z"]\nhand_offset = [0, 0, 0.1]\nstart = 2.0\n'
    )
    read, there = read_recording(tmp_path / "a.csv"), np.isfinite(place[:, 0])
    np.testing.assert_allclose(read.hand_t, seen.t[there], atol=1e-12)
    np.testing.assert_allclose(read.hand_pose[:, :3], seen.place[there], atol=1e-9)
    off = Rotation.from_quat(read.hand_pose[:, 3:]) * seen.rotation[there].inv()
    assert off.magnitude().max() < 1e-8
    assert f"hand: the rigid body Grip, in {there.sum()} of {len(there)} frames" in read.remarks
    assert not any("rotations" in note for note in read.remarks)


def test_without_the_key_rotations_are_left_out_and_a_hand_that_is_not_there_is_named(seen, tmp_path):
    motive(tmp_path / "a.csv", seen, LABS["y"])
    assert any("left out the rotations of 1 rigid body; if one" in x for x in read_recording(tmp_path / "a.csv").notes)
    for said, words in (
        ({"hand": "Stick"}, "one of the rigid bodies Grip, or a file"),
        ({"hand": "Grip", "axes": ["x", "y"]}, "axes: .*three axes, right-handed"),
        ({"hand": "Grip", "axes": ["x", "y", "-z"]}, "axes: .*three axes, right-handed"),
        ({"hand": "Grip", "hand_start": 1.0}, "hand_start: .*no effect"),
        ({"hand": "Grip", "hand_topic": "/hand"}, "hand_topic: .*no effect"),
    ):
        with pytest.raises(InputError, match=words):
            read_recording(tmp_path / "a.csv", **said)
    motive(tmp_path / "b.csv", seen, LABS["y"], rotation="XYZ")
    with pytest.raises(InputError, match="export it with Rotation: Quaternion"):
        read_recording(tmp_path / "b.csv", hand="Grip")


@pytest.mark.slow
def test_the_body_drives_a_whip_whose_stiffness_is_found(seen, tmp_path):
    motive(tmp_path / "a.csv", seen, LABS["y"])
    read = read_recording(tmp_path / "a.csv", hand="Grip", start=2.0)
    begun = Plant(ROBOT, Controller(PositionControl())).changed({"whip.k": 0.07, "whip.b": 0.003})
    found = fit(read, begun, ["whip.k", "whip.b"], options=FitOptions(drive="hand", starts=1, check=False))
    assert found["k"].value == pytest.approx(0.05, rel=0.01)
    assert found["b"].value == pytest.approx(0.004, rel=0.01)


@pytest.mark.parametrize(("file", "said"), [("y", {"hand_up": "y"}), ("z", {}), ("z", {"hand_up": "z"})])
def test_a_log_of_the_hand_has_axes_of_its_own(file, said, seen, tmp_path):
    """Places of Motive, whose y is up, and poses in a file, whose y or z is up: for a model all are in its axes."""
    motive(tmp_path / "a.csv", seen, LABS["y"])
    turn = Rotation.from_matrix(LABS[file])
    poses = np.column_stack([seen.t, turn.apply(seen.place), (turn * seen.rotation).as_quat()])
    write_table(tmp_path / "hand.csv", ["t", *POSE], poses)
    read = read_recording(tmp_path / "a.csv", hand="hand.csv", start=2.0, hand_start=0.0, **said)
    assert read.up == "y"
    assert any("z is up in its log" in note for note in read.remarks) == (not said)
    model = read.for_model(ROBOT)
    np.testing.assert_allclose(model.marker("tip"), seen.tip, atol=1e-9)
    np.testing.assert_allclose(model.hand_pose[:, :3], seen.place, atol=1e-14)
    assert (Rotation.from_quat(model.hand_pose[:, 3:]) * seen.rotation.inv()).magnitude().max() < 1e-14
    write_csv(read, tmp_path / "b.csv")
    again = read_recording(tmp_path / "b.csv")
    np.testing.assert_array_equal(again.hand_pose, read.hand_pose)
    shown = understand(str(tmp_path / "a.csv"), hand="hand.csv", start=2.0, hand_start=0.0, **said)
    np.testing.assert_allclose(shown.logs.hand.q[:, :3], seen.place, atol=1e-14)
    elsewhen = understand(str(tmp_path / "a.csv"), hand="hand.csv", start=2.0, hand_start=900.0, **said)
    np.testing.assert_allclose(elsewhen.logs.hand.q[:, :3], seen.place, atol=1e-14)
