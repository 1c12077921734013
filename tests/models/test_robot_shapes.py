"""Capsules of robots' files: where MuJoCo and Pinocchio have the shapes, at any posture."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from whiptool.models import Model, preset
from whiptool.models.files import read_robot
from whiptool.models.scene import Scene
from whiptool.models.spatial_arm import SpatialArm

INERTIAL = '<inertial pos="0.01 0 0" mass="1" diaginertia="0.1 0.1 0.1"/>'
MJCF = f"""
<mujoco><compiler angle="radian"/><worldbody>
  <geom type="box" size="1 1 0.1" pos="0 0 -0.5"/>
  <body name="stand" pos="0.1 0 0"><geom type="cylinder" size="0.1 0.2"/>
    <body name="one" pos="0 0 0.3" euler="0.3 0 0.2">{INERTIAL}<joint name="pan" axis="0 0 1"/>
      <geom type="capsule" size="0.05 0.1" pos="0 0.1 0.2" euler="0.5 0.2 0"/>
      <geom type="sphere" size="0.3" contype="0" conaffinity="0"/>
      <body name="two" pos="0.2 0 0.1">{INERTIAL}<joint name="slide" type="slide" axis="0.6 0 0.8" range="-1 1"/>
        <geom type="sphere" size="0.07" pos="0.1 0.2 0.3"/>
        <body name="held" pos="0 0.1 0" euler="0 0.4 0">{INERTIAL}<geom type="cylinder" size="0.02 0.3"/>
</body></body></body></body></worldbody></mujoco>"""

LINK = """<link name="{name}"><inertial><mass value="1"/>
  <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>{shapes}</link>"""
CYLINDER = """<collision><origin xyz="0 0.1 0.2" rpy="0.3 0.4 0"/>
  <geometry><cylinder radius="0.05" length="0.4"/></geometry></collision>
  <collision><geometry><mesh filename="package://nowhere/a.stl"/></geometry></collision>"""
BALL = '<collision><origin xyz="0.1 0 0"/><geometry><sphere radius="0.07"/></geometry></collision>'
URDF = f"""<robot name="r">{LINK.format(name="base", shapes=BALL)}{LINK.format(name="one", shapes=CYLINDER)}
{LINK.format(name="two", shapes=BALL)}{LINK.format(name="tool", shapes=CYLINDER)}
<joint name="pan" type="revolute"><parent link="base"/><child link="one"/><origin xyz="0 0 0.3" rpy="0 0.2 0"/>
  <axis xyz="0 0 1"/><limit lower="-2" upper="2" velocity="1" effort="9"/></joint>
<joint name="tilt" type="revolute"><parent link="one"/><child link="two"/><origin xyz="0.2 0 0.1" rpy="0 0 0.4"/>
  <axis xyz="0 0.6 0.8"/><limit lower="-2" upper="2" velocity="1" effort="9"/></joint>
<joint name="mount" type="fixed"><parent link="two"/><child link="tool"/><origin xyz="0 0.3 0" rpy="1 0 0"/></joint>
</robot>"""


def ends_of(arm: SpatialArm, q: np.ndarray) -> np.ndarray:
    """Both ends of the arm's capsules, (capsules, 2, 3) [m], at one posture."""
    scene = Scene(Model(preset("ur5e").whip, arm), of="apart")
    return np.stack(scene.segments(q[None]), axis=2)[0]


def shape_ends(R: np.ndarray, p: np.ndarray, half: float) -> np.ndarray:
    return np.stack([p - half * R[:, 2], p + half * R[:, 2]])


@pytest.fixture
def arms(tmp_path):
    """The same way from text to arm for both kinds of files."""

    def read(text: str, name: str) -> SpatialArm:
        (tmp_path / name).write_text(text)
        return read_robot(tmp_path / name)

    return read


def test_shapes_of_mjcf_are_where_mujoco_has_them(arms):
    arm = arms(MJCF, "arm.xml")
    assert [len(link.capsules) for link in arm.links] == [1, 2]  # not what does not collide
    assert [shape.name for shape in arm.base] == ["shape 0 of the world", ""]
    robot = mujoco.MjModel.from_xml_string(MJCF)
    data = mujoco.MjData(robot)
    shapes = [i for i in range(robot.ngeom) if robot.geom_contype[i] and robot.geom_bodyid[i]]
    halves = [0.2, 0.1, 0.0, 0.3]
    for q in np.random.default_rng(0).uniform(-1, 1, (3, 2)):
        data.qpos[:] = q
        mujoco.mj_kinematics(robot, data)
        poses = zip(shapes, halves, strict=True)
        theirs = [shape_ends(data.geom_xmat[i].reshape(3, 3), data.geom_xpos[i], half) for i, half in poses]
        np.testing.assert_allclose(ends_of(arm, q)[1:], theirs, atol=1e-12)  # but for the world's box
    assert [c.radius for c in (*arm.base, *(c for link in arm.links for c in link.capsules))] == [
        pytest.approx(math.hypot(1, 0.1)),
        0.1,
        0.05,
        0.07,
        0.02,
    ]


def test_shapes_of_urdf_are_where_pinocchio_has_them(arms):
    arm = arms(URDF, "arm.urdf")
    assert [len(link.capsules) for link in arm.links] == [1, 2]
    assert len(arm.base) == 1
    model = pin.buildModelFromXML(URDF)
    data = model.createData()
    places = [("base", (0.1, 0, 0), (0, 0, 0), 0.0), ("one", (0, 0.1, 0.2), (0.3, 0.4, 0), 0.2)]
    places += [("two", (0.1, 0, 0), (0, 0, 0), 0.0), ("tool", (0, 0.1, 0.2), (0.3, 0.4, 0), 0.2)]
    for q in np.random.default_rng(0).uniform(-1, 1, (3, 2)):
        pin.framesForwardKinematics(model, data, q)
        theirs = []
        for name, xyz, rpy, half in places:
            link = data.oMf[model.getFrameId(name)]
            M = link * pin.SE3(pin.rpy.rpyToMatrix(*map(float, rpy)), np.array(xyz, float))
            theirs.append(shape_ends(M.rotation, M.translation, half))
        np.testing.assert_allclose(ends_of(arm, q), theirs, atol=1e-12)
