"""Recordings of arms on walls and ceilings, in the axes of the world: fits honour the mount, and say where it lacks."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from whiptool.errors import InputError
from whiptool.identification.fit import Fit, FitOptions, fit
from whiptool.identification.plant import Plant
from whiptool.identification.predict import Predictor
from whiptool.impedance import Controller, PositionControl
from whiptool.models import Model, WhipParameters, preset
from whiptool.models.joint_trajectory import JointTrajectory
from whiptool.models.kinematics import arm_poses
from whiptool.models.mount import mount_rotation, mounted
from whiptool.models.strike import Strike
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.rollout.servo_replay import replay_trajectory

WHIP = WhipParameters(N=4, l=0.2, m=0.02, k=0.05, b=0.004, joints="rod")
FLOOR = dataclasses.replace(preset("ur5e"), whip=WHIP)
STRIKE = Strike((0.1, -1.9, 1.2, -0.9, 0.3, 0.0), (0.5, -1.2, 0.6, -1.6, -0.4, 0.2), 0.6)
FREE = ("whip.k", "whip.b")  # masses have no effect of their own where the motion is prescribed
NOISE, KNOTS = 5e-4, 0.03  # [m], [s]


def on(mount: str) -> Model:
    return dataclasses.replace(FLOOR, arm=mounted(FLOOR.arm, mount))


def recorded(mount: str) -> StrikeRecording:
    """A strike by MuJoCo's servos on that mount: the tip in the world's axes, the joints, and the hand's poses.

    The poses are those of the arm on a floor, turned as the base is.
    """
    model = on(mount)
    trajectory = JointTrajectory.of_strike(STRIKE, model.arm.joints, rest=0.1, t_stay=0.15)
    path = replay_trajectory(model, trajectory)
    log = np.arange(0.0, path.t[-1], 0.01)
    q = CubicSpline(path.t, path.q[:, : model.arm.n])(log)
    origins, rotations = arm_poses(FLOOR.arm, q)
    R = mount_rotation(mount)
    pose = np.hstack([origins[:, -1] @ R.T, Rotation.from_matrix(R @ rotations[:, -1]).as_quat()])
    t = np.arange(0.0, path.t[-1] - 0.02, 1 / 100)
    tip = CubicSpline(path.t, path.tip)(t) + NOISE * np.random.default_rng(0).normal(size=(len(t), 3))
    begins = trajectory.strike_begins
    return StrikeRecording(
        t - begins, tip[:, None], ("tip",), NOISE, joints_t=log - begins, joints_q=q, joint_names=model.arm.joints,
        hand_t=log - begins, hand_pose=pose, t_stay=0.15,
    )  # fmt: skip


def predicted(recording: StrikeRecording, model: Model, drive: str) -> np.ndarray:
    """Predicted places of the tip (T, 3) [m]."""
    plant = Plant(model, Controller(PositionControl()))
    predictor = Predictor([recording], plant, drive=drive, shared=(), knots=KNOTS)
    (found,) = predictor(plant, {}, predictor.start, derivatives=False)
    return found.value.reshape(-1, 3)


@pytest.fixture(scope="module")
def on_wall() -> StrikeRecording:
    return recorded("wall")


def test_a_mounted_arms_joints_move_the_whip_as_its_hand_does_in_the_world(on_wall):
    """MuJoCo's whip hangs and swings in the world's gravity; the hand's poses are a floor's, turned as the base is."""
    by_joints, by_hand = predicted(on_wall, on("wall"), "joints"), predicted(on_wall, FLOOR, "hand")
    off = np.linalg.norm(by_joints - on_wall.points[:, 0], axis=1)
    assert np.sqrt(np.mean(off**2)) < 4 * NOISE
    assert np.abs(by_joints - by_hand).max() < NOISE
    down = on_wall.points[0, 0] - (on_wall.hand_pose[0, :3])
    np.testing.assert_allclose(down, [0, 0, -0.8], atol=0.03)  # it hangs along the world's z


@pytest.mark.slow
def test_a_mount_that_is_not_given_is_named(on_wall):
    with pytest.raises(InputError, match="as if the arm's base were on the wall: give --mount wall"):
        fitted(on_wall, FLOOR, "joints")
    floor = dataclasses.replace(on_wall, points=predicted(on_wall, FLOOR, "joints")[:, None])
    with pytest.raises(InputError, match="as if the arm's base were on the floor: give --mount floor"):
        fitted(floor, on("wall"), "joints")


@pytest.mark.slow
@pytest.mark.parametrize("mount", ["wall", "ceiling"])
def test_a_mounted_arm_fits_the_same_numbers_as_a_hand_whose_poses_were_turned(mount):
    recording = recorded(mount)
    by_joints, by_hand = fitted(recording, on(mount), "joints"), fitted(recording, FLOOR, "hand")
    for a, b, true in zip(by_joints.parameters, by_hand.parameters, (WHIP.k, WHIP.b), strict=True):
        assert a.error is not None
        left_out = 0.1 * a.error  # each fit leaves out what moves its values by less
        assert a.value == pytest.approx(b.value, abs=2 * left_out)
        assert a.value == pytest.approx(true, rel=0.1)


def fitted(recording: StrikeRecording, model: Model, drive: str) -> Fit:
    plant = Plant(model, Controller(PositionControl())).changed({"whip.k": 0.07, "whip.b": 0.003})
    return fit(recording, plant, FREE, options=FitOptions(drive=drive, knots=KNOTS))
