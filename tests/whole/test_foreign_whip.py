"""A whip, an arm and a controller by other code than ours are learned, struck with and judged rightly."""

from __future__ import annotations

import sys

import mujoco
import numpy as np
import pytest
from foreign_whip import ARM, BELIEVED, ForeignPort, ForeignWhip, held_up, reference, torque
from repository import ROOT

from whiptool.impedance import Controller, oiac_preset
from whiptool.impedance.arm import Arm
from whiptool.models.presets import preset
from whiptool.models.strike import Strike

sys.path.insert(0, str(ROOT / "benchmarks"))
import foreign

STRIKE = Strike((-1.0, 0.5), (2.0, 0.8), 0.8)


def test_the_foreign_controller_is_the_papers():
    """Written anew, and the same torques as ours to rounding: with the weights that its owner believes in."""
    model = preset("lemon2024")
    masses = (*model.arm.per_link("mass"), model.whip.mass)
    np.testing.assert_allclose(masses, BELIEVED)
    ours = Controller(oiac_preset("table4")).reckoning_with(model).bind(Arm(model), STRIKE)
    rng = np.random.default_rng(0)
    for t in (0.0, 0.3, 0.8, 1.0):
        q_d, v_d = reference(STRIKE, t)
        q, v = q_d + 0.1 * rng.standard_normal(2), v_d + 0.3 * rng.standard_normal(2)
        foreign, steepest = torque(STRIKE, t, q, v, a=1.3e-4)
        np.testing.assert_allclose(foreign, ours.torque(t, q, v), rtol=1e-9)
        dv = 1e-6 * rng.standard_normal(2)
        fall = np.linalg.norm(torque(STRIKE, t, q, v + dv, a=1.3e-4)[0] - foreign) / np.linalg.norm(dv)
        assert fall <= steepest


def test_the_foreign_whip_is_what_it_says():
    whip = ForeignWhip()
    model = mujoco.MjModel.from_xml_string(whip.xml())
    assert model.nv == 42
    assert (model.dof_frictionloss[2:] > 0).all()
    assert (model.body_inertia[3:] > 0).all()
    assert model.opt.density > 0
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    tip = data.site_xpos[model.site("tip").id]
    np.testing.assert_allclose(tip, [0, 0, -sum(ARM) - whip.length], atol=1e-12)  # q = 0 hangs
    data.qpos[0] = np.pi / 2
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.site_xpos[model.site("tip").id], [sum(ARM) + whip.length, 0, 0], atol=1e-12)


@pytest.mark.slow
def test_the_arm_sags_before_a_strike_and_stays_there():
    port = ForeignPort(ForeignWhip(), (1.2, 0.1))
    recording = port.strike(Strike(STRIKE.q_i, STRIKE.q_i, 0.5), 0, None).recording
    assert recording is not None
    assert recording.sag is not None
    assert 0.005 < np.abs(recording.sag).max() < 0.05
    assert np.ptp(recording.joints_q, axis=0).max() < 1e-3
    assert np.abs(held_up(np.array(STRIKE.q_i))).max() > 1


@pytest.mark.hours
def test_the_foreign_whip_is_learned_and_judged():
    """One of the twelve targets that `benchmarks/foreign.py` has."""
    rows = foreign.struck(0)
    assert len(rows) == 2
    for row in rows:
        assert row["miss"] <= 0.06
        assert row["probability"] > 0.9
        assert abs(row["judged"] - row["miss"]) < max(4 * row["error"], 0.01)
