"""Readings of joints that move are believed; an encoder that jumps, stops or flickers is found within two cycles."""

from __future__ import annotations

import numpy as np
import pytest

from whiptool.rig.dynamixel.control_table import Units
from whiptool.rig.dynamixel.encoders import LACKS, Encoders
from whiptool.rig.dynamixel.joints import Guards

COUNT, UNIT = Units().position, Units().velocity
PERIOD = 0.002


def readings(speed, n: int = 200, start: int = 0):
    """Readings of a joint whose speed [rad/s] is a function of time, and of one at rest."""
    t = np.arange(n) * PERIOD
    fine = np.linspace(0, t[-1], 50 * n)
    q = np.interp(t, fine, np.cumsum(speed(fine)) * (fine[1] - fine[0]))
    q, v = np.round(q / COUNT) * COUNT, np.round(speed(t) / UNIT) * UNIT
    ticks = (start + 2 * np.arange(n)) % 32_768
    return [(np.array([a, 0.5]), np.array([b, 0.0]), np.array([c, c])) for a, b, c in zip(q, v, ticks, strict=True)]


INERTIA = np.diag([0.01, 0.07])  # [kg m^2]


def first_fault(rows, push=0.0, short=0.0, inertia=None, emf=0.0) -> tuple[int, str] | None:
    """The number of the reading that is found to be wrong, and what is said; `push` may be a function of its number."""
    guards = Guards()
    encoders = Encoders(2, jump=guards.jump, push=guards.push)
    for k, (q, v, tick) in enumerate(rows):
        load = np.array([[push(k) if callable(push) else push, 0.0], [short, 0.0]])
        fault = encoders.read(q, v, tick, np.array([emf * (k >= 100), 0.0]), load, inertia)
        if fault is not None:
            assert fault.kind == "encoder"
            return k, str(fault)
    return None


@pytest.mark.parametrize("speed", [
    lambda t: 6.0 * np.sin(40 * t),  # 240 rad/s2
    lambda t: 3.0 * np.sign(np.sin(200 * t)),  # a torque that changes its sign at once
    lambda t: np.where(t < 0.2, 4.8, 0.0) * np.clip((0.2 - t) / 0.02, 0, 1),  # braked within 20 ms
    lambda t: 0.05 * np.sin(9 * t),
])  # fmt: skip
@pytest.mark.parametrize("start", [0, 32_700])
def test_joints_that_move_are_believed_also_where_samples_are_missing(speed, start):
    rows = readings(speed, start=start)
    assert first_fault(rows) is None
    assert first_fault([row for k, row in enumerate(rows) if k % 7 not in (3, 4)]) is None


@pytest.mark.parametrize("angle", [0.05, -0.05, 0.4, -1.1])
@pytest.mark.parametrize("cycles", [1, 1000])
@pytest.mark.parametrize("speed", [0.0, 3.0, -5.0])
def test_a_jump_is_found_in_its_first_cycle(angle, cycles, speed):
    rows = readings(lambda t: speed * np.sin(10 * t))
    for k in range(100, min(100 + cycles, len(rows))):
        rows[k][0][0] += angle
    found = first_fault(rows)
    assert found is not None
    assert found[0] == 100
    assert "encoder: that of joint 0 jumped by" in found[1]


def stopped(speed: float, flickers: int = 0, at: int = 100):
    """Readings of a joint that turns evenly, whose encoder stops."""
    rows = readings(lambda t: speed + 0 * t)
    for k in range(at, len(rows)):
        rows[k][0][0] = rows[at - 1][0][0] + COUNT * (flickers * (k % 2))
        rows[k][1][0] = 0.0
    return rows


@pytest.mark.parametrize("flickers", [0, 1, -1])
@pytest.mark.parametrize("speed", [0.45, 0.7, -2.0, 5.0])
def test_an_encoder_that_stops_is_found_within_two_cycles(speed, flickers):
    found = first_fault(stopped(speed, flickers), inertia=INERTIA)
    assert found is not None
    assert 100 <= found[0] <= 101
    assert "joint 0" in found[1]


@pytest.mark.parametrize("speed", [0.3, -2.0])
def test_a_joint_that_torques_stop_is_believed_and_one_that_they_drive_on_is_not(speed):
    """The same readings: friction stops a joint within a cycle, if the torque is there that this takes."""
    total = INERTIA[0, 0] + 0.005  # with the rotor

    def brake(k):
        return -total * speed / PERIOD if k in (99, 100) else 0.0  # whose mean acts from reading 99 to reading 100

    assert first_fault(stopped(speed), brake, inertia=INERTIA) is None
    found = first_fault(stopped(speed), lambda k: brake(k) + np.sign(speed) * (k > 100), inertia=INERTIA)
    assert found is not None
    assert found[0] <= 109  # by when 1 N m would have given it 1 rad/s


@pytest.mark.parametrize("torque", [1.0, -2.0])
def test_a_torque_that_should_turn_a_resting_joint_and_does_not_is_found_within_cycles(torque):
    """Long before the mean torque of a tenth of a second has reached `push`."""
    rows = readings(lambda t: 0 * t)
    push = lambda k: torque * (k >= 100)  # noqa: E731
    assert first_fault(rows, lambda k: 0.9 * LACKS * (k >= 100), inertia=INERTIA) is None
    found = first_fault(rows, push, inertia=INERTIA)
    assert found is not None
    # 9 counts of velocity times 0.015 kg m^2, over what exceeds 0.7 N m; the step of the torque itself is not counted
    late = 9 * UNIT * 0.015 / (abs(torque) - 0.7) / PERIOD
    assert found[0] == pytest.approx(100 + late, abs=2)


def test_a_joint_that_the_whip_pulls_may_rest_if_it_was_pulled_while_it_moved():
    rows = readings(lambda t: np.clip(3.0 - 20 * t, 0, None))  # rests from reading 75 on
    slows = [-20 * (INERTIA[0, 0] + 0.005) * (k < 75) for k in range(200)]  # [N m]
    assert first_fault(rows, lambda k: 1.2 + slows[k], inertia=INERTIA) is None
    found = first_fault(rows, lambda k: 1.2 * (k >= 75) + slows[k], inertia=INERTIA)
    assert found is not None
    assert found[0] <= 85


def test_a_joint_that_reads_as_resting_while_its_motor_has_a_back_emf_is_found_in_the_second_reading():
    found = first_fault(readings(lambda t: 0 * t), emf=0.1)
    assert found is not None
    assert found[0] == 101
    assert first_fault(readings(lambda t: 1.0 + 0 * t), emf=0.1) is None


def test_a_position_that_stands_while_its_velocity_says_that_it_moves_is_found():
    rows = readings(lambda t: 1.0 + 0 * t)
    for k in range(100, len(rows)):
        rows[k][0][0] = rows[99][0][0] + COUNT * (k % 2)
    found = first_fault(rows)
    assert found is not None
    assert found[0] <= 99 + np.ceil(Guards().jump / PERIOD) + 2  # at 1 rad/s it is off by `jump`; and two cycles


@pytest.mark.parametrize(("torque", "most"), [("push", 1.5), ("short", 0.5)])
def test_a_joint_that_stands_is_believed_until_the_torques_tell_otherwise(torque, most):
    rows = readings(lambda t: 0 * t)
    assert first_fault(rows, **{torque: 0.9 * most}) is None
    found = first_fault(rows, **{torque: 2 * most})
    assert found is not None
    assert found[0] == pytest.approx(np.log(2) * 0.1 / PERIOD, abs=1)  # the mean of a first-order filter
    assert first_fault(readings(lambda t: 3.0 + 0 * t), **{torque: 2 * most}) is None
