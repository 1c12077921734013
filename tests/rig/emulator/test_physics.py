"""The arm behind the emulated servos: without torque, and with delays."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import whiptool as wt
from whiptool.errors import InputError
from whiptool.rig.emulator import TwinOptions
from whiptool.rig.emulator.physics import Physics


def test_a_dead_motor_lets_the_arm_swing_as_the_plain_simulation_does():
    # a pendulum's energy: torque off, no friction, the whip's own damping set aside by a short time
    options = TwinOptions(start=(0.4, 0.2))
    physics = Physics(options)
    ref = physics._rollout
    physics.advance_to(0.2)
    import mujoco

    data = mujoco.MjData(ref._mj)
    data.qpos[:] = [0.4, 0.2, -0.6] + [0.0] * 11
    ref._mj.opt.timestep = 2e-5  # an independent, finer integration
    for _ in range(10_000):
        mujoco.mj_step(ref._mj, data)
    assert np.abs(physics.data.qpos - data.qpos).max() < 1e-6


def test_sample_delay_shows_the_past():
    options = TwinOptions(start=(0.5, 0.0), sample_delay=0.01)
    physics = Physics(options)
    servos = physics.servos
    plain = dataclasses.replace(options, sample_delay=0.0)
    reference = Physics(plain)
    now = reference.servos
    physics.advance_to(0.1)
    reference.advance_to(0.09)
    assert servos[0].get("present_position") == now[0].get("present_position")
    reference.advance_to(0.1)
    assert servos[0].get("present_position") != now[0].get("present_position")


def test_command_delay_postpones_the_current():
    options = TwinOptions(command_delay=0.01)
    physics = Physics(options)
    servos = physics.servos
    for s in servos:
        s.set("operating_mode", 0)
        s.set("goal_current", 0)
        s.set("torque_enable", 1)
    physics.advance_to(0.05)
    servos[0].set("goal_current", 100)
    physics.advance_to(0.1)
    path = physics.trajectory()
    began = path["t"][np.flatnonzero(path["current"][:, 0])[0]]
    assert began == pytest.approx(0.061, abs=0.0015)


def test_options_are_checked():
    with pytest.raises(InputError, match="baud"):
        TwinOptions(baud=1234)
    with pytest.raises(InputError, match="ids"):
        TwinOptions(ids=(1, 1))
    o = TwinOptions(model=wt.preset("lemon2024"), start=(0.1,))
    with pytest.raises(InputError, match="start"):
        Physics(o)
