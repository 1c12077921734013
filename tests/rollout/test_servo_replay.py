"""An exported strike through MuJoCo's position servos: motion and miss are those of position control."""

from __future__ import annotations

import numpy as np
import pytest

from whiptool.errors import InputError
from whiptool.impedance import Controller
from whiptool.impedance.laws import PositionControl
from whiptool.models import preset
from whiptool.models.joint_trajectory import JointTrajectory
from whiptool.models.strike import Strike
from whiptool.rollout.reference import ReferenceRollout
from whiptool.rollout.servo_replay import replay_trajectory

LEMON, STRIKE, TARGET = preset("lemon2024"), Strike((-1.2, 0.9), (1.2, 0.3), 0.7), (1.3, 0.0)


@pytest.fixture(scope="module")
def exact():
    return ReferenceRollout(LEMON, Controller(PositionControl())).trajectory(STRIKE, t_stay=0.3)


def replayed(**options):
    commanded = JointTrajectory.of_strike(STRIKE, LEMON.arm.joints, t_stay=0.3, **options)
    return replay_trajectory(LEMON, commanded), commanded


def test_servos_make_the_strike_that_position_control_makes(exact):
    path, commanded = replayed(rest=0.1)
    strike = path.since(commanded.strike_begins)
    assert 0 <= strike.t[0] < 1e-4
    q_d, v_d, _ = STRIKE.reference(strike.t)
    np.testing.assert_allclose(strike.q_d, q_d, atol=1e-8)
    np.testing.assert_allclose(strike.v_d, v_d, atol=1e-5)
    assert np.abs(strike.q[:, :2] - q_d).max() < 2e-3
    expected, found = exact.approach(TARGET), strike.approach(TARGET)
    assert found.distance[0] == pytest.approx(expected.distance[0], abs=2e-3)
    assert found.time[0] == pytest.approx(expected.time[0], abs=1e-3)
    np.testing.assert_allclose(found.velocity, expected.velocity, atol=0.1)


def test_the_torques_are_those_of_the_motion_and_of_the_rotors(exact):
    """Beside those of the arm and the whip, a geared motor's rotor of 0.1 kg m2 asks for its own."""
    path, commanded = replayed(rest=0.0)
    strike = path.since(commanded.strike_begins)
    middle = np.linspace(0.1, 0.6, 50)
    ours, theirs = (np.array([np.interp(middle, x.t, x.tau[:, j]) for j in range(2)]) for x in (strike, exact))
    rotors = 0.1 * STRIKE.reference(middle)[2].T
    assert np.abs(ours - theirs - rotors).max() < 0.05 * np.abs(theirs + rotors).max()


def test_a_trajectory_of_other_joints_is_refused():
    commanded = JointTrajectory.of_strike(STRIKE, ("a", "b"))
    with pytest.raises(InputError, match=r"^joints of the trajectory: got .*shoulder, elbow"):
        replay_trajectory(LEMON, commanded)
