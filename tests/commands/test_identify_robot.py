"""`identify` with what a robot's strike leaves: its run folder, its joints, and what cameras saw of the whip."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import tomli_w

from whiptool.commands import identify, recording
from whiptool.commands.options.identify_options import IdentifyOptions
from whiptool.models import preset
from whiptool.models.files import model_to_table
from whiptool.models.mount import mounted
from whiptool.models.strike import Strike
from whiptool.recording.readers import read_recording
from whiptool.recording.strike_recording import ENCODERS, StrikeRecording

UR5E = preset("ur5e")
HIGH = dataclasses.replace(UR5E, arm=mounted(UR5E.arm.in_space(), "pedestal", 0.8))
STRIKE = Strike((-1.63, -1.07, -0.22, -0.49, 2.16, 0.42), (-2.17, -2.07, -0.33, -1.73, -0.35, 2.09), 1.5)


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """The run folder of `robot strike` without a camera."""
    folder, t = tmp_path / "struck", np.linspace(0, 1.8, 91)
    folder.mkdir()
    table = {"command": "robot strike", "options": {"model": "ur5e"}, "model": model_to_table(HIGH)}
    (folder / "config.toml").write_text(tomli_w.dumps(table))
    joints = {"joints_t": t, "joints_q": np.array([STRIKE.reference(x)[0] for x in t]), "strike": STRIKE}
    points = np.full((len(t), 2, 3), 0.3)
    StrikeRecording(t, points, ("wrist_1", "handle"), np.array(1e-3), camera=ENCODERS, **joints).save(
        folder / "recording.npz"
    )
    return folder


def test_the_model_of_the_run_and_parameters_that_it_has_are_taken(run, capsys):
    found = identify.resolved(IdentifyOptions(recordings=(str(run),)))
    assert found.recordings == (str(run / "recording.npz"),)
    assert model_to_table(found.find_model()) == model_to_table(HIGH)
    assert (found.profile, found.free) == (True, ("bending_stiffness", "bending_damping", "linear_density"))
    said = capsys.readouterr().err
    assert f"--model {run / 'config.toml'}" in said
    assert "--profile --free bending_stiffness bending_damping linear_density by default" in said
    held_out = IdentifyOptions(recordings=("strike1.csv", str(run)), held_out=(str(run),), free=("k",))
    assert identify.resolved(held_out).held_out == found.recordings
    given = IdentifyOptions(recordings=(str(run),), model="fr3", free=("gravity",))
    assert identify.resolved(given) == dataclasses.replace(given, recordings=found.recordings)
    (run / "config.toml").write_text(tomli_w.dumps({"model": model_to_table(preset("lemon2024"))}))
    assert identify.resolved(IdentifyOptions(recordings=(str(run),))).model == "lemon2024"
    plane = IdentifyOptions(recordings=("strike1.csv",))
    assert identify.resolved(plane) == plane


def test_a_strike_in_a_run_of_adapt_is_of_the_model_and_mount_of_its_options(run):
    options = {"model": "ur5e", "mount": ["pedestal", "0.8"]}
    (run / "config.toml").write_text(tomli_w.dumps({"command": "adapt", "options": options}))
    (run / "strike-0001").mkdir()
    (run / "recording.npz").rename(run / "strike-0001" / "recording.npz")
    found = identify.resolved(IdentifyOptions(recordings=(str(run / "strike-0001"),)))
    assert (found.model, found.mount) == ("ur5e", ("pedestal", "0.8"))


@pytest.mark.parametrize("name", ["fr3", "panda"])
def test_each_robot_has_default_parameters(name):
    found = identify.resolved(IdentifyOptions(recordings=("a.csv",), model=name))
    assert (found.profile, found.free) == (True, identify.OF_PROFILE)


def test_joints_alone_and_a_model_of_another_arm_are_refused(run, capsys):
    assert identify.main([str(run)]) == 2
    assert "it holds the joints alone: add what cameras saw of the whip" in capsys.readouterr().err
    lone = run.parent / "lone.npz"
    (run / "recording.npz").rename(lone)
    assert identify.main([str(lone)]) == 2
    said = capsys.readouterr().err
    assert "--model: got 'lemon2024, 2 joints'" in said
    assert "which has 6 joints; such as --model ur5e" in said


def test_what_cameras_saw_is_put_in_place_of_the_joints_of_the_arm(run, tmp_path, capsys):
    """As docs/your-robot.md says: convert, and write the tracks where the arm's joints were."""
    assert recording.main(["convert", str(run / "recording.npz"), str(tmp_path / "strike.csv")]) == 0
    (tmp_path / "strike.csv").write_text("t,tip_x,tip_y,tip_z\n0.0,0.5,0.1,0.2\n0.1,0.5,0.1,0.3\n")
    found = read_recording(tmp_path / "strike.csv")
    assert (found.markers, found.strike) == (("tip",), STRIKE)
    assert found.joints_q is not None
    np.testing.assert_allclose(found.for_model(HIGH).joints_q[0], STRIKE.q_i, atol=1e-9)
    assert not found.joints_alone


def test_a_look_at_the_joints_alone_advises_cameras(run, tmp_path, capsys):
    assert recording.main(["show", str(run / "recording.npz"), "--out", str(tmp_path / "x.png")]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "name the tip tip" not in said
    assert "computed from its encoders: a fit needs what cameras saw of the whip" in said
