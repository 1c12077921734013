"""The range of trust: what is beyond it, and that documents and commands have the same one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from repository import ROOT

from whiptool import preset
from whiptool.dynamics.rods import half_square
from whiptool.models.trajectory import Trajectory
from whiptool.rollout.trust import BEND, MACH, ROD_BEND, SOUND, beyond_trust, joint_bends, trust_table

MODEL = preset("lemon2024")


def posed(bend: float, speed: float) -> Trajectory:
    """Two instants of a whip that is bent at one joint [rad] at the second, its tip at a speed [m/s]."""
    a, n = MODEL.arm.n, MODEL.n
    q = np.zeros((2, n))
    q[1, a + 3] = bend
    gains = np.zeros((2, a, a))
    still = np.zeros((2, a))
    velocity = np.array([[0.0, 0.0], [speed, 0.0]])
    return Trajectory(np.array([0.0, 0.1]), q, 0 * q, still, still, still, gains, gains, 0 * velocity, velocity)


@pytest.mark.parametrize(
    ("bend", "speed", "said"),
    [
        (1.0, 100.0, None),
        (-1.1, 100.0, "bend by 63 degrees: beyond 60"),
        (0.0, 170.0, "170 m/s, Mach 0.50: beyond Mach 0.3"),
    ],
)
def test_what_is_beyond_is_said(bend, speed, said):
    found = beyond_trust(MODEL, posed(bend, speed))
    assert found is None if said is None else said in found
    assert joint_bends(MODEL, posed(bend, speed))[1, 2] == pytest.approx(abs(bend), abs=1e-7)
    assert beyond_trust(MODEL, replace(posed(bend, speed), diverged=True)) is None


def test_bends_after_the_tip_was_fastest_do_not_count():
    path = posed(1.5, 5.0)
    assert beyond_trust(MODEL, path) is not None
    assert beyond_trust(MODEL, replace(path, tip_velocity=path.tip_velocity[::-1])) is None


def test_rods_bend_like_a_spring_up_to_their_bound():
    """The torque is `w'(u) sin`, of a linear spring the angle."""
    for angle, within in ((ROD_BEND.limit, True), (1.2 * ROD_BEND.limit, False)):
        bend = np.radians(angle)
        torque = half_square(1 - np.cos(bend))[1] * np.sin(bend)
        assert (abs(torque / bend - 1) < 0.01) == within


def test_the_documents_have_the_bounds():
    page = (ROOT / "docs" / "how-to" / "crack.md").read_text()
    for row in trust_table():
        assert "| " + " | ".join(row) + " |" in page
    assert (MACH.limit, BEND.limit, SOUND) == (0.3, 60.0, 340.0)
