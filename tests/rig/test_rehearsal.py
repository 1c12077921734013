"""What a rehearsal refuses, and why, on paths that are made up; its chatter in closed form."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from whiptool.impedance import OIAC, ConstantImpedance, Controller
from whiptool.limits.arm_limits import XM430, MotorLimits
from whiptool.models import preset
from whiptool.models.strike import Strike
from whiptool.models.trajectory import Trajectory
from whiptool.rig.dynamixel.joints import Guards
from whiptool.rig.emulator.physics import Physics
from whiptool.rig.loop_options import CappedLoop, LoopOptions
from whiptool.rig.rehearsal import CHATTER, _chatter, _verdict, rehearse
from whiptool.rollout import CompiledRollout

MODEL = preset("lemon2024")
MOTOR = MotorLimits("toy", stall_torque=2.0, no_load_speed=10.0, stall_current=4.0)
GUARDS = Guards(low=(-1.0, -2.0), high=(1.5, 2.5), speed=3.0, tracking=0.5)


def path(**changes) -> Trajectory:
    """At rest at 0, the whip far beyond every guard."""
    q, v = np.zeros((4, 5)), np.zeros((4, 5))
    q[:, 2:], v[:, 2:] = 99.0, 99.0
    none, matrices = np.zeros((4, 2)), np.zeros((4, 2, 2))
    given = Trajectory(np.arange(4) * 0.002, q, v, none, none, none, matrices, matrices, none, none)
    for name, (row, column, value) in changes.items():
        array = getattr(given, name).copy()
        array[row, column] = value
        given = dataclasses.replace(given, **{name: array})
    return given


def verdict(trajectory: Trajectory, *, usage: float = 0.5, chatter: float = 0.1, margin: float = 0.05) -> str | None:
    return _verdict(trajectory, usage, chatter, LoopOptions(margin=margin), MOTOR, GUARDS, MODEL.arm)


@pytest.mark.parametrize("w", [0.1, 0.7, np.pi / 2])
def test_the_chatter_of_a_wave_is_its_second_difference(w):
    """`sin(w k)` has the second difference `-(2 - 2 cos w) sin(w k)`, an alternating torque 4 times its value."""
    wave = np.sin(w * np.arange(4000))
    both = np.stack([wave, np.full(4000, 3.0)], axis=1)
    assert _chatter(both) == pytest.approx(2 - 2 * np.cos(w), rel=5e-3)
    assert _chatter(both[:, ::-1] * 0.01) == pytest.approx(2 - 2 * np.cos(w), rel=5e-3)
    alternating = np.tile([[1.0], [-1.0]], (50, 2))
    assert _chatter(alternating) == pytest.approx(4.0)
    assert _chatter(np.zeros((9, 2))) == 0
    assert _chatter(alternating[:2]) == 0.0
    assert _chatter(alternating[:3]) == pytest.approx(4.0)


@pytest.mark.parametrize(
    ("within", "beyond", "said"),
    [
        ({"v": (2, 1, -3.0)}, {"v": (2, 1, -3.01)}, "a joint reaches 3.01 rad/s, and at most 3.00 rad/s are allowed"),
        ({"q_d": (1, 0, 0.5)}, {"q_d": (1, 0, 0.51)}, "a joint lags 0.51 rad behind its reference, and at most 0.50"),
        ({"q_d": (1, 0, -0.5)}, {"q_d": (1, 0, -0.51)}, "a joint lags 0.51 rad"),
    ],
)
def test_guards_are_kept(within, beyond, said):
    assert verdict(path(**within)) is None
    told = verdict(path(**beyond))
    assert told is not None
    assert told.startswith(said)


@pytest.mark.parametrize(
    ("joint", "edge", "past"), [(0, 1.5, 0.01), (0, -1.0, -0.01), (1, 2.5, 0.01), (1, -2.0, -0.01)]
)
def test_joints_stay_in_their_range(joint, edge, past):
    assert verdict(path(q=(1, joint, edge), q_d=(1, joint, edge))) is None
    told = verdict(path(q=(1, joint, edge + past), q_d=(1, joint, edge + past)))
    assert told is not None
    assert told.startswith("a joint leaves")


def test_motors_keep_a_margin():
    assert verdict(path(), usage=0.95) is None
    assert verdict(path(), usage=0.75, margin=0.25) is None
    told = verdict(path(tau=(2, 1, 1.95)), usage=0.96)
    assert told is not None
    assert told.startswith(
        f"it asks more than the motors give, with 5% kept free: at 0.004 s the {MODEL.arm.joints[1]}"
    )


@pytest.mark.parametrize(("end", "instant"), [("start", 0), ("end", -1)])
def test_a_posture_that_the_motors_cannot_hold_is_named(end, instant):
    """No longer D helps where gravity alone asks for too much."""
    assert verdict(path(tau=(instant, 1, 1.89))) is None
    told = verdict(path(tau=(instant, 1, 1.95)), usage=0.975)
    assert told is not None
    assert f"cannot hold the {end} posture, which takes" in told
    assert f"{MODEL.arm.joints[1]} 1.95 N m; {end} elsewhere" in told


def test_an_unstable_loop_is_refused_before_anything_else():
    assert verdict(path(), chatter=CHATTER) is None
    for bad in (
        verdict(path(), chatter=CHATTER + 0.01, usage=9.0),
        verdict(dataclasses.replace(path(), diverged=True), usage=9.0),
    ):
        assert bad is not None
        assert bad.startswith("the controller is unstable at 500 Hz")
    assert CHATTER == 0.6


def test_a_rehearsal_is_the_strike_that_the_other_engine_plays():
    """The twin's physics beside the compiled rollout, which holds no torque for 2 ms and rounds nothing to counts."""
    strike = Strike((-0.622, 0.221), (0.705, 2.122), 1.176)
    found = rehearse(MODEL, Controller(OIAC()), strike)
    path = found.trajectory
    assert len(path.t) == 738  # (1.176 + 0.3) s of 2 ms
    np.testing.assert_allclose(path.t, 0.002 * np.arange(738), atol=1e-12)
    other = CompiledRollout(MODEL, Controller(OIAC())).trajectory(strike, t_stay=0.3)
    tip = np.stack([np.interp(path.t, other.t, x) for x in other.tip.T], axis=1)
    assert np.linalg.norm(path.tip - tip, axis=1)[:600].max() < 0.05
    q = np.stack([np.interp(path.t, other.t, x) for x in other.q.T[:2]], axis=1)
    np.testing.assert_allclose(path.q[:, :2], q, atol=0.02)
    assert found.refused is None
    assert found.usage == pytest.approx(XM430.violation(other) + 1, abs=0.05)
    assert found.chatter < 0.4
    late = rehearse(MODEL, Controller(OIAC()), strike, LoopOptions(rate=400.0, delay=0.0, t_stay=0.1))
    assert len(late.trajectory.t) == 511  # 510.4 cycles


def test_the_loop_sees_the_posture_in_counts_from_the_middle(monkeypatch):
    """At rest on whole counts there is no error: the first torque is gravity's alone (Eq. 3), by hand.

    What is asked then acts until the next cycle: the physics goes to the end of each.
    """
    times, usual = [], Physics.advance_to
    monkeypatch.setattr(Physics, "advance_to", lambda self, t: (times.append(t), usual(self, t))[1])
    count = 2 * np.pi / 4096
    strike = Strike((-150 * count, 400 * count), (0.5, 1.0), 1.2)
    found = rehearse(MODEL, Controller(ConstantImpedance()), strike, LoopOptions(delay=0.0, t_stay=0.01))
    (first, second), whip, g = MODEL.arm.links, float(MODEL.whip.mass), MODEL.gravity
    upper = first.mass * first.com + (second.mass + whip) * first.length
    lower = second.mass * second.com + whip * second.length
    a, b = strike.q_i[0], sum(strike.q_i)
    gravity = g * np.array([upper * np.sin(a) + lower * np.sin(b), lower * np.sin(b)])
    np.testing.assert_allclose(found.trajectory.tau[0], gravity, atol=1e-6)
    np.testing.assert_allclose(times, 0.002 * np.arange(1, 606), atol=1e-12)  # (1.2 + 0.01) s


@pytest.mark.parametrize("what", ["physics", "torque"])
def test_what_is_not_finite_is_refused(what, monkeypatch):
    """A step that ends in no number, and a torque of which one joint's is none."""
    cycles = []

    def broken(self, *args):
        cycles.append(args)
        if len(cycles) > 3:
            if what == "physics":
                raise ValueError("cannot convert float NaN to integer")
            return np.array([np.nan, 0.0])
        return usual(self, *args)

    owner, name = (Physics, "advance_to") if what == "physics" else (CappedLoop, "torque")
    usual = getattr(owner, name)
    monkeypatch.setattr(owner, name, broken)
    found = rehearse(
        MODEL,
        Controller(ConstantImpedance()),
        Strike((-0.6, 0.2), (0.7, 1.2), 1.5),
        LoopOptions(delay=0.0, t_stay=0.01),
    )
    assert found.trajectory.diverged
    assert found.refused is not None
    assert found.refused.startswith("the controller is unstable at 500 Hz")
