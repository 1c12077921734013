"""Postures that hold a hand: against frames of the arm, a general optimiser, closed forms, and differences."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize
from spatial_arms import random_arm

from whiptool.models import preset
from whiptool.models.inverse_kinematics import HandKinematics
from whiptool.models.kinematics import arm_frames

RNG = np.random.default_rng(3)
PLANAR, UR5E, PANDA = (preset(name).arm for name in ("lemon2024", "ur5e", "panda"))
SLIDING = random_arm(5, RNG, prismatic=(1, 3))
HOMES = {
    "plane": (PLANAR, [0.4, 1.5]),
    "ur5e": (UR5E, [0, -1.2, 1.5, -0.5, -1.5, 0.5]),
    "panda": (PANDA, [0, -0.5, 0, -2.0, 0, 1.7, 0.7]),
    "sliding": (SLIDING, [0.3, 0.1, -0.4, 0.2, 0.5]),
}
CASES = [(arm, home, False) for arm, home in HOMES.values()]
CASES += [(*HOMES[name], True) for name in ("ur5e", "panda")]
every_case = pytest.mark.parametrize(("arm", "home", "orientation"), CASES)


@every_case
def test_the_hand_is_where_the_arms_frames_have_it_and_moves_as_they_do(arm, home, orientation):
    kinematics = HandKinematics(arm, np.array(home), orientation=orientation)
    q, v = home + 0.5 * RNG.normal(size=(5, len(home))), RNG.normal(size=(5, len(home)))
    speeds = np.einsum("bmj,bj->bm", kinematics.jacobian(q), v)
    if arm.dimension == 2:
        theta, omega, l = np.cumsum(q, axis=1), np.cumsum(v, axis=1), arm.per_link("length")
        place = np.stack([(l * np.sin(theta)).sum(1), -(l * np.cos(theta)).sum(1)], axis=1)
        speed = np.stack([(l * np.cos(theta) * omega).sum(1), (l * np.sin(theta) * omega).sum(1)], axis=1)
    else:
        hand = arm_frames(arm, q, v)[-1]
        place, speed = hand.origin, np.hstack([hand.velocity, hand.spin])[:, : kinematics.size]
    np.testing.assert_allclose(kinematics.coordinates(q)[:, : arm.dimension], place, atol=1e-14)
    np.testing.assert_allclose(speeds, speed, atol=1e-13)


@every_case
def test_postures_hold_the_hand_and_change_with_it_as_differences_say(arm, home, orientation):
    kinematics = HandKinematics(arm, np.array(home), orientation=orientation)
    x = kinematics.coordinates(home + 0.15 * RNG.normal(size=(6, len(home))))
    found = kinematics.solve(x)
    assert (found.missed < 1e-9).all()
    np.testing.assert_allclose(kinematics.coordinates(found.q), x, atol=1e-9)
    h, slopes = 1e-6, found.slopes @ kinematics.spins(x)
    for j, step in enumerate(h * np.eye(kinematics.size)):
        change = (kinematics.solve(x + step).q - kinematics.solve(x - step).q) / (2 * h)
        np.testing.assert_allclose(slopes[..., j], change, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("name", ["ur5e", "panda", "sliding"])
def test_no_posture_that_holds_the_hand_there_is_nearer(name):
    arm, home = HOMES[name]
    kinematics = HandKinematics(arm, np.array(home))
    x = kinematics.coordinates(home + 0.2 * RNG.normal(size=len(home)))
    holds = {"type": "eq", "fun": lambda q: kinematics.coordinates(q) - x, "jac": kinematics.jacobian}
    other = minimize(
        lambda q: ((q - home) ** 2).sum() / 2,
        np.array(home),
        jac=lambda q: q - home,
        constraints=[holds],
        method="SLSQP",
        options={"ftol": 1e-14, "maxiter": 200},
    )
    assert other.success
    np.testing.assert_allclose(kinematics.solve(x).q, other.x, atol=1e-6)


def test_two_joints_in_the_plane_against_the_law_of_cosines():
    l1, l2 = PLANAR.per_link("length")
    kinematics = HandKinematics(PLANAR, np.array([0.4, 1.5]))
    r, angle = RNG.uniform(0.3, 0.6, 20), RNG.uniform(0.6, 1.6, 20)  # from straight down
    found = kinematics.solve(np.stack([r * np.sin(angle), -r * np.cos(angle)], axis=1))
    elbow = np.arccos((r**2 - l1**2 - l2**2) / (2 * l1 * l2))
    shoulder = angle - np.arctan2(l2 * np.sin(elbow), l1 + l2 * np.cos(elbow))
    np.testing.assert_allclose(found.q, np.stack([shoulder, elbow], axis=1), atol=1e-9)


def test_what_is_out_of_reach_is_not_found():
    kinematics = HandKinematics(UR5E, np.array(HOMES["ur5e"][1]))
    found = kinematics.solve(np.array([[2.5, 0.0, 0.3], [0.8, 0.1, 0.4]]))
    assert np.isinf(found.missed).tolist() == [True, False]
