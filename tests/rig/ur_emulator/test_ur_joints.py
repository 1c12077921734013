import numpy as np
import pytest
from scipy.signal import lsim

from whiptool.rig.ur_emulator.ur_joints import PERIOD, ServoJ, UrJoints


def moved(joints, count, command=None):
    """Positions and speeds of a joint over periods, (count, 2)."""
    rows = []
    for k in range(count):
        if command is not None:
            command(k)
        joints.step()
        rows.append((joints.q[0], joints.v[0]))
    return np.array(rows)


@pytest.mark.parametrize(("lookahead", "gain"), [(0.1, 300.0), (0.03, 2000.0)])
def test_servoj_accelerates_by_the_gain_towards_where_the_look_ahead_expects_the_joint(lookahead, gain):
    joints = UrJoints(np.zeros(6))
    joints.servo(ServoJ(np.full(6, 0.2), lookahead, gain))
    t = np.arange(1, 301) * PERIOD
    _, expected, _ = lsim(([gain], [1, gain * lookahead, gain]), np.full(301, 0.2), np.arange(301) * PERIOD)
    assert np.abs(moved(joints, 300)[:, 0] - expected[1:]).max() < 1e-9
    assert t[-1] == pytest.approx(0.6)


def test_the_lag_behind_a_ramp_is_the_look_ahead_time():
    joints = UrJoints(np.zeros(6))
    rows = moved(joints, 1000, lambda k: joints.servo(ServoJ(np.full(6, k * PERIOD), 0.1, 300.0)))
    assert 999 * PERIOD + PERIOD / 2 - rows[-1, 0] == pytest.approx(0.1, abs=1e-9)  # held commands, on average


def test_movej_keeps_speed_and_acceleration_and_arrives():
    joints = UrJoints(np.zeros(6))
    joints.move(np.array([1.0, -0.5, 0, 0, 0, 0]), 1.05, 1.4)
    rows = moved(joints, 2000)
    assert joints.q[:2] == pytest.approx([1.0, -0.5], abs=1e-12)
    assert rows[:, 1].max() == pytest.approx(1.05, abs=1e-3)
    assert np.abs(np.diff(rows[:, 1]) / PERIOD).max() < 1.4 * 1.01
    assert np.argmax(rows[:, 0] > 1 - 1e-9) * PERIOD == pytest.approx(1 / 1.05 + 1.05 / 1.4, abs=0.01)


def test_a_short_movej_does_not_reach_the_speed():
    joints = UrJoints(np.zeros(6))
    joints.move(np.full(6, 0.1), 1.05, 1.4)
    assert moved(joints, 500)[:, 1].max() == pytest.approx(np.sqrt(0.1 * 1.4), rel=0.01)
    assert joints.q[0] == pytest.approx(0.1)


@pytest.mark.parametrize("way", ["brake", "brake_within"])
def test_stops_slow_all_joints_down_together(way):
    joints = UrJoints(np.zeros(6))
    joints.v = np.array([2.0, -1.0, 0, 0, 0, 0])
    getattr(joints, way)({"brake": 10.0, "brake_within": 0.2}[way])  # of either 0.2 s
    ended = [joints.step() for _ in range(110)]
    assert ended.index(True) == 99
    assert not joints.moving
    assert joints.q[:2] == pytest.approx([0.2, -0.1], rel=0.02)


def test_speedj_changes_the_speed_by_the_acceleration():
    joints = UrJoints(np.zeros(6))
    joints.accelerate(np.array([0.5, 0.25, 0, 0, 0, 0]), 2.5)
    rows = moved(joints, 150)
    assert rows[49, 1] == pytest.approx(0.25)
    assert joints.v[:2] == pytest.approx([0.5, 0.25])
