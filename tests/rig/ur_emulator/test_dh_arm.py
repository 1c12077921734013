import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from whiptool.models.kinematics import arm_poses
from whiptool.models.presets import preset
from whiptool.rig.ur_emulator.dh_arm import speeds, tool_pose

HALF_TURN = np.diag([-1.0, -1.0, 1.0])  # between the controller's `base` and ROS's `base_link`
RNG = np.random.default_rng(0)


@pytest.mark.parametrize("q", RNG.uniform(-3, 3, (5, 6)))
def test_the_preset_is_in_base_link_which_differs_from_the_controllers_base_by_half_a_turn(q):
    arm = preset("ur5e").arm
    pose = tool_pose(q, np.zeros(6))
    origins, rotations = arm_poses(arm, q[None])
    flange = rotations[0, -1] @ np.array(arm.hand_rotation).T
    place = origins[0, -1] - flange @ np.array(arm.hand_position)  # without the stick
    assert np.allclose(pose[:3], HALF_TURN @ place, atol=1e-12)
    assert np.allclose(Rotation.from_rotvec(pose[3:]).as_matrix(), HALF_TURN @ flange, atol=1e-12)


def test_speeds_are_the_rates_of_the_points():
    q, v, offset, dt = RNG.uniform(-3, 3, 6), RNG.uniform(-1, 1, 6), np.array([0, 0.1, 0.65, 0, 0, 0]), 1e-6
    _, flange, tool = speeds(q, v, offset)
    for found, given in ((flange, np.zeros(6)), (tool, offset)):
        moved = (tool_pose(q + v * dt, given) - tool_pose(q - v * dt, given))[:3] / (2 * dt)
        assert found == pytest.approx(np.linalg.norm(moved), rel=1e-6)


def test_the_elbow_turns_about_the_shoulder():
    elbow, _, _ = speeds(np.array([0, -np.pi / 2, 0, 0, 0, 0.0]), np.array([0, 2.0, 0, 0, 0, 0]), np.zeros(6))
    assert elbow == pytest.approx(0.425 * 2)
