"""Files in the manner of exporters and makers: inertia, weight and kinematics as Pinocchio and MuJoCo read them."""

from __future__ import annotations

import re
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from exporter_files import EXPORTED
from robot_data import example_robots

from whiptool.errors import InputError
from whiptool.impedance.arm import Arm
from whiptool.models import Model
from whiptool.models.files import read_robot
from whiptool.models.kinematics import arm_frames
from whiptool.models.presets import rope
from whiptool.models.spatial_arm import SpatialArm
from whiptool.models.strike import default_bounds

GRAVITY = 9.81
POSTURES = np.random.default_rng(0).uniform(-1.5, 1.5, (3, 7))


def read(name: str, folder: Path) -> SpatialArm:
    path = folder / name
    path.write_text(EXPORTED[name].text)
    return read_robot(path, EXPORTED[name].choice)


def weight(arm: SpatialArm, q: np.ndarray) -> np.ndarray:
    """Torques that hold the arm against gravity, (a,) [N m]."""
    jacobians = Arm(Model(rope(1), arm)).gravity_jacobians(q)[:-1, 2]  # heights of the links' centres of mass
    return GRAVITY * arm.per_link("mass") @ jacobians


@pytest.mark.parametrize("name", [name for name, file in EXPORTED.items() if file.joints and name.endswith(".urdf")])
def test_urdf_files_are_as_pinocchio_reads_them(tmp_path, name):
    file = EXPORTED[name]
    arm, whole = read(name, tmp_path), pin.buildModelFromXML(file.text)
    assert arm.names == file.joints
    assert bool(arm.weightless) == file.weightless
    assert default_bounds(arm).upper[: arm.n] == tuple(np.pi if joint == "Rev 1" else 2.0 for joint in arm.names)
    data, moving = whole.createData(), [whole.idx_vs[whole.getJointId(name)] for name in file.joints]
    for posture in POSTURES:
        q = posture[: arm.n]
        at = np.zeros(whole.nv)
        at[moving] = q
        there = pin.integrate(whole, pin.neutral(whole), at)
        pin.framesForwardKinematics(whole, data, there)
        tips = [frame for frame in whole.frames if frame.type == pin.FrameType.BODY]
        hand = arm_frames(arm, q)[-1]
        places = [data.oMf[whole.getFrameId(tip.name, pin.FrameType.BODY)].translation for tip in tips]
        assert min(np.linalg.norm(hand.origin - place) for place in places) < 1e-12
        M = pin.crba(whole, data, there)
        M = (np.triu(M) + np.triu(M, 1).T)[np.ix_(moving, moving)]
        np.testing.assert_allclose(
            Arm(Model(rope(1), arm)).inertia(q) - np.diag(arm.per_link("armature")), M, atol=1e-12
        )
        expected = pin.computeGeneralizedGravity(whole, data, there)[moving]
        np.testing.assert_allclose(weight(arm, q), expected, atol=1e-11)


def test_an_mjcf_file_is_as_mujoco_reads_it(tmp_path):
    """Without its meshes, which are nowhere; masses do not come from them."""
    arm = read("menagerie.xml", tmp_path)
    text = re.sub(r"<asset>.*?</asset>", "", EXPORTED["menagerie.xml"].text)
    robot = mujoco.MjModel.from_xml_string(re.sub(r'<geom class="visual".*?/>', "", text))
    data, M = mujoco.MjData(robot), np.empty((2, 2))
    assert [link.limits.torque for link in arm.links] == [40, 9]
    for posture in POSTURES:
        data.qpos[:] = posture[:2]
        mujoco.mj_forward(robot, data)
        mujoco.mj_fullM(robot, data, M)
        np.testing.assert_allclose(Arm(Model(rope(1), arm)).inertia(posture[:2]), M, atol=1e-9)
        np.testing.assert_allclose(weight(arm, posture[:2]), data.qfrc_bias, atol=1e-9)
        np.testing.assert_allclose(arm_frames(arm, posture[:2])[-1].origin, data.body("fore").xpos, atol=1e-12)


@pytest.mark.parametrize("name", [name for name, file in EXPORTED.items() if file.refusal])
def test_what_cannot_be_read_is_refused_by_name_with_a_cure(tmp_path, name):
    with pytest.raises(InputError, match=EXPORTED[name].refusal) as caught:
        read(name, tmp_path)
    assert "\n" not in str(caught.value)


def test_rotors_of_drake_s_files_are_heard(tmp_path):
    """Their inertia times the square of their gear, at the joint."""
    assert read("drake.urdf", tmp_path).per_link("armature").tolist() == [0, pytest.approx(1.0)]


def test_all_arms_of_example_robot_data_load_or_are_refused_by_name():
    loaded, refused = [], []
    for path in sorted(example_robots().rglob("*.urdf")):
        try:
            loaded += [path.stem] * (read_robot(path).n <= 7)
        except InputError as error:
            refused.append(str(error))
    known = re.compile(r"tip: got 'none'.*--arm-tip|lower 0 and upper 0|there are none|links: got 'none'")
    assert [error for error in refused if not known.search(error)] == []
    assert {"xarm7", "z1", "so100", "panda", "ur5_robot", "ur10_robot", "TwoDofs", "finger_edu"} <= set(loaded)
