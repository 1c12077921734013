"""An arm that sags: what the law holds, what it will be elsewhere, and that strikes begin there."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.optimize import brentq

from whiptool.adaptation.plan_search import PlanningEffort
from whiptool.adaptation.planner import plan
from whiptool.adaptation.posterior import update
from whiptool.adaptation.prior import default_prior
from whiptool.adaptation.sag import expected_sag
from whiptool.goals.target import Target
from whiptool.impedance import OIAC, ConstantImpedance, Controller, oiac_preset
from whiptool.models.presets import preset
from whiptool.models.strike import Strike
from whiptool.recording.strike_recording import AT_REST, StrikeRecording
from whiptool.rollout.compiled import CompiledRollout

MODEL, CONTROLLER = preset("lemon2024"), Controller(oiac_preset("table4"))
RESTING = Strike((-0.9, 1.4), (-0.9, 1.4), 0.5)
STRIKE = Strike((-1.0, 0.5), (2.0, 0.8), 0.8)
RESTING_SOURCE = "at rest"
SAG = np.array([-0.015, 0.012])


def measured(strike: Strike, sag, points=None, **more) -> StrikeRecording:
    """A recording whose encoders show where the arm stood."""
    t = np.arange(0, 0.1, 0.002)
    points = np.zeros((len(t), 1, 2)) if points is None else points
    joints = np.tile(np.add(strike.q_i, sag), (len(t), 1))
    joints[t > AT_REST] += 1.0  # by then it moves
    given = {"t": t, "joints_t": t, "joints_q": joints} | more
    return StrikeRecording(points=points, markers=("tip",), strike=strike, **given)


def test_what_a_recording_says_of_the_sag():
    np.testing.assert_allclose(measured(STRIKE, SAG).sag, SAG)
    np.testing.assert_allclose(measured(STRIKE, (0.001, 0.02)).sag, [0.0, 0.02])  # less than encoders can tell
    bare = measured(STRIKE, SAG, joints_t=None, joints_q=None)
    assert bare.sag is None
    assert bare.stood is None
    late = measured(STRIKE, SAG, joints_t=np.arange(0.05, 0.15, 0.002))
    assert late.sag is None
    assert measured(STRIKE, SAG[:1].repeat(2)).stood is not None


def heavier(law, q_i: np.ndarray, extra: tuple[float, float]) -> np.ndarray:
    """Where the law holds weights that compensation does not know, by bisection on the error's size: the reference."""
    e = np.zeros(2)
    for _ in range(30):
        first, second = np.sin((q_i - e)[0]), np.sin((q_i - e).sum())
        torque = np.array([extra[0] * first + extra[1] * second, extra[1] * second])
        if isinstance(law, ConstantImpedance):
            e = np.linalg.solve(law.parameters()["K"].reshape(2, 2), torque)
            continue
        size = float(np.linalg.norm(torque))
        error = brentq(lambda x, size: x**3 * (1 + law.C * x**2) / law.a - size, 0, 1, args=(size,))  # Eqs. 2, 8-10
        e = error * torque / size
    return -e


@pytest.mark.parametrize("law", [oiac_preset("table4"), OIAC(a=1e-3), ConstantImpedance()])
def test_sag_in_one_posture_tells_that_in_others(law):
    extra, look = (0.5, -1.2) if isinstance(law, ConstantImpedance) else (0.05, -0.12), np.array([-0.9, 1.4])
    seen = measured(RESTING, heavier(law, look, extra))
    assert np.abs(seen.sag).min() > 0
    others = np.array([[-1.4, 0.6], [-0.5, 2.5], [-1.0, 0.2]])
    told = expected_sag(law, [None, measured(RESTING, SAG, joints_t=None, joints_q=None), seen])
    assert told is not None
    expected = np.array([heavier(law, q, extra) for q in others])
    np.testing.assert_allclose(told(others), expected, atol=2e-3)
    assert np.abs(expected).max() > 5e-3


def test_no_sag_is_expected_where_none_was_measured():
    assert expected_sag(CONTROLLER.law, []) is None
    assert expected_sag(CONTROLLER.law, [measured(STRIKE, (0.0, 0.0))]) is None


def test_a_rollout_begins_where_the_arm_stands():
    """Its whip hangs from there; with derivatives as differences have them."""
    rollout = CompiledRollout(MODEL, CONTROLLER, sag=lambda q: np.broadcast_to(SAG, q.shape))
    path = rollout.trajectory(STRIKE, t_stay=0.1)
    np.testing.assert_allclose(path.q[0, :2], np.add(STRIKE.q_i, SAG), atol=1e-12)
    np.testing.assert_allclose(path.q[0].cumsum()[2:], 0, atol=1e-12)
    target, name = np.array((1.2, 0.1)), "q_si"
    _, slope = rollout.gradient(STRIKE.vector[None], target, t_stay=0.3, names=[name])
    moved = np.array([STRIKE.vector + s * 1e-5 * np.eye(5)[0] for s in (1, -1)])
    ahead, behind = rollout.approach(moved, target, t_stay=0.3).distance
    assert slope[0, 0] == pytest.approx((ahead - behind) / 2e-5, rel=1e-3)


@pytest.mark.slow
def test_a_hanging_whip_is_measured_from_where_the_arm_stands():
    """A sag of 45 mrad moves the tip by some centimetres; taken for the whip's, no whip hangs like that."""
    prior = default_prior(MODEL, CONTROLLER, whip="uniform")
    long = dataclasses.replace(MODEL, whip=dataclasses.replace(MODEL.whip, l=1.1 * MODEL.whip.l))
    sagged = CompiledRollout(long, CONTROLLER, sag=lambda q: np.broadcast_to(3 * np.abs(SAG), q.shape))
    tip = sagged.trajectory(RESTING, t_stay=0.01).tip[0]
    t = np.arange(40) / 60
    points = tip + 0.005 * np.random.default_rng(0).standard_normal((len(t), 1, 2))
    joints = {"t": t, "points": points, "sigma": np.array(0.005), "source": RESTING_SOURCE}
    with_joints = measured(RESTING, 3 * np.abs(SAG), **joints)
    without = measured(RESTING, SAG, **joints | {"joints_t": None, "joints_q": None})
    explained, not_explained = (update(prior, [r]).rmse[RESTING_SOURCE] for r in (with_joints, without))
    assert explained < 0.003
    assert not_explained > 0.02


@pytest.mark.slow
def test_a_plan_counts_with_the_sag():
    """Of an arm that sags by 50 mrad; a plan that does not count with it misses."""
    sure = default_prior(MODEL, CONTROLLER, whip="uniform")
    sure = dataclasses.replace(sure, covariance=1e-8 * sure.covariance)
    brief = PlanningEffort(pool=96, polished=4, steps=4, whips=4, population=4, rounds=1)
    stands = lambda q: np.broadcast_to(3 * SAG, q.shape)  # noqa: E731
    truth, target = CompiledRollout(MODEL, CONTROLLER, sag=stands), Target((1.2, 0.1))
    misses = []
    for sag in (stands, None):
        chosen = plan(sure, target, rng=np.random.default_rng(0), effort=brief, sag=sag)
        near = truth.approach(np.array([chosen.strike]), np.array(target.position), t_stay=0.3)
        misses.append(float(near.distance[0]))
    assert misses[0] < 0.01
    assert misses[1] > 2 * misses[0]
