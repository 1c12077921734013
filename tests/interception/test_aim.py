"""How strikes are brought onto moving targets, on toy paths in closed form that any formula can be checked against."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.stats import ncx2
from straight_tip import HOME, LOWER, MIDDLE, PUSH, SPEED, UPPER, Straight, known, library

from whiptool.errors import InputError
from whiptool.interception.interceptor import Aim, Interceptor, TargetCamera
from whiptool.interception.library import Library
from whiptool.interception.target_tracks import TargetTrack, find_motion


def aim(track: TargetTrack, lib: Library, *, earliest=0.0, latest=3.0, radius=0.06, now=0.0, camera=None) -> Aim:
    return Aim(Interceptor(lib, radius, camera), track, now, earliest, latest)


def test_a_camera_is_checked():
    assert (TargetCamera().rate, TargetCamera().sigma) == (60.0, 0.005)
    for bad in ({"rate": 0.0}, {"sigma": 0.0}, {"rate": np.nan}):
        with pytest.raises(InputError):
            TargetCamera(**bad)


def test_gauss_newton_meets_a_target_at_rest_by_the_smallest_change():
    """Linear paths: one step ends it, of the least norm in units of ranges, 0.3 s of t0 and 0.1 s of tau."""
    offset = np.array([0.03, -0.02])
    x, start, tau = aim(known(*(HOME + offset)), library(MIDDLE)).steer(
        MIDDLE, np.array([1.0]), np.array([0.5]), free=np.ones(5, bool), steps=1
    )
    A = np.hstack([PUSH * (UPPER - LOWER), np.zeros((2, 1)), 0.1 * SPEED[:, None]])
    least = A.T @ np.linalg.solve(A @ A.T, offset)
    np.testing.assert_allclose(x[0], MIDDLE[0] + (UPPER - LOWER) * least[:5], atol=1e-10)
    assert start[0] == pytest.approx(1.0)
    assert tau[0] == pytest.approx(0.5 + 0.1 * least[6])


def test_gauss_newton_meets_a_moving_target_by_its_start_too():
    velocity = np.array([0.5, -0.8])
    target = HOME + np.array([0.02, 0.03]) - velocity * 1.5  # near the tip at 1.5 s
    falling = TargetTrack.known(find_motion("ballistic"), np.r_[HOME + np.array([0.02, 0.03]), velocity], epoch=1.5)
    one = aim(falling, library(MIDDLE)).steer(MIDDLE, np.array([1.0]), np.array([0.5]), free=np.ones(5, bool), steps=1)
    x, start, tau = aim(known(*target, *velocity), library(MIDDLE)).steer(
        MIDDLE, np.array([1.0]), np.array([0.5]), free=np.ones(5, bool), steps=1
    )
    A = np.hstack([PUSH * (UPPER - LOWER), -0.3 * velocity[:, None], 0.1 * (SPEED - velocity)[:, None]])
    least = A.T @ np.linalg.solve(A @ A.T, [0.02, 0.03])
    np.testing.assert_allclose(x[0], MIDDLE[0] + (UPPER - LOWER) * least[:5], atol=1e-7)
    assert start[0] == pytest.approx(1.0 + 0.3 * least[5], abs=1e-7)
    assert tau[0] == pytest.approx(0.5 + 0.1 * least[6], abs=1e-7)
    for straight, ballistic in zip((x, start, tau), one, strict=True):  # the velocity at the contact is the same
        np.testing.assert_allclose(straight, ballistic, atol=1e-6)
    tip = x[0] @ PUSH.T + SPEED * (tau[0] - 0.5)
    np.testing.assert_allclose(tip, target + velocity * (start[0] + tau[0]), atol=1e-7)


def test_a_step_is_cut_and_several_arrive():
    """0.4 m away: one step goes 0.15 of a range in the same direction, ten arrive."""
    far = HOME + np.array([0.3, -0.25])
    judge, free = aim(known(*far), library(MIDDLE)), np.ones(5, bool)
    x, _, tau = judge.steer(MIDDLE, np.array([1.0]), np.array([0.5]), free=free, steps=1)
    moved = np.r_[(x[0] - MIDDLE[0]) / (UPPER - LOWER), (tau[0] - 0.5) / 0.1]
    assert np.linalg.norm(moved) == pytest.approx(0.15)
    x, start, tau = judge.steer(MIDDLE, np.array([1.0]), np.array([0.5]), free=free, steps=10)
    np.testing.assert_allclose(x[0] @ PUSH.T + SPEED * (tau[0] - 0.5), far, atol=1e-9)
    assert start[0] == 1.0


def test_what_is_not_free_stays_and_the_box_is_kept():
    free = np.array([False, True, True, False, False])
    x, _, _ = aim(known(*(HOME + 0.02)), library(MIDDLE)).steer(
        MIDDLE, np.array([1.0]), np.array([0.5]), free=free, steps=3
    )
    np.testing.assert_array_equal(x[0, ~free], MIDDLE[0, ~free])
    assert (x[0, free] != MIDDLE[0, free]).all()
    edge = np.array([[0.0, 1.0, 2.0, 1.0, 1.0]])
    up = aim(known(*((edge @ PUSH.T)[0] + [0.1, 0.1])), library(edge))
    x, _, _ = up.steer(edge, np.array([1.0]), np.array([0.5]), free=np.ones(5, bool), steps=5)
    assert (x >= LOWER).all()
    assert (x <= UPPER).all()


def test_starts_and_contacts_stay_within_their_times():
    """t0 wants to go before the earliest: it is held there and the strike does the rest; contacts end at the latest."""
    velocity = np.array([1.0, 0.3])
    late = known(*(HOME - velocity * 1.46 + [0.0, 0.02]), *velocity)
    judge = aim(late, library(MIDDLE), earliest=1.0)
    x, start, tau = judge.steer(MIDDLE, np.array([1.0]), np.array([0.5]), free=np.ones(5, bool), steps=4)
    assert start[0] == 1.0
    at = start[0] + tau[0]
    np.testing.assert_allclose(x[0] @ PUSH.T + SPEED * (tau[0] - 0.5), late.position(at)[0], atol=1e-6)
    hasty = aim(late, library(MIDDLE), earliest=0.2, latest=1.3)
    _, start, tau = hasty.steer(MIDDLE, np.array([1.0]), np.array([0.5]), free=np.zeros(5, bool), steps=1)
    assert start[0] + tau[0] == pytest.approx(1.3)


def test_crossings_are_ranked_by_the_miss_that_is_expected_across():
    """Tips in parallel, at known distances from a target at rest: the nearest first, and each strike once."""
    across = np.array([-SPEED[1], SPEED[0]]) / np.linalg.norm(SPEED)
    offsets = np.array([0.03, 0.005, -0.015, 0.3])
    strikes = MIDDLE + offsets[:, None] * (np.linalg.pinv(PUSH) @ across)
    which, start, tau = aim(known(*HOME), library(strikes)).crossings(8)
    assert which.tolist() == [1, 2, 0]
    np.testing.assert_allclose(tau, 0.5, atol=0.02)
    np.testing.assert_allclose(start, 0, atol=0.02)  # as soon as may be, all else equal
    assert aim(known(*HOME), library(strikes)).crossings(2)[0].tolist() == [1, 2]
    assert not len(aim(known(*(HOME + 5)), library(strikes)).crossings(8)[0])


def test_a_miss_is_measured_across_whatever_the_speed():
    """The fast tip passes 5 mm from the target, a slow one 10 mm."""
    across = np.array([-SPEED[1], SPEED[0]]) / np.linalg.norm(SPEED)
    strikes = MIDDLE + np.array([[0.010], [0.005]]) * (np.linalg.pinv(PUSH) @ across)
    lib = library(strikes)
    speed = np.where(lib.owner == 0, 0.2, 1.0)[:, None]
    mixed = dataclasses.replace(lib, velocities=lib.velocities * speed)
    assert aim(known(*HOME), mixed).crossings(2)[0].tolist() == [1, 0]


def test_crossings_leave_time_and_follow_the_target():
    lib = library(MIDDLE)
    velocity = np.array([-0.5, 0.4])
    _, start, tau = aim(known(*(HOME - 2 * velocity), *velocity), lib, earliest=0.5, latest=2.6).crossings(1)
    np.testing.assert_allclose(start + tau, 2.0, atol=0.1)
    np.testing.assert_allclose(tau, 0.5, atol=0.1)
    assert not len(aim(known(*(HOME - 2 * velocity), *velocity), lib, earliest=1.8, latest=2.6).crossings(1)[0])
    assert not len(aim(known(*(HOME - 2 * velocity), *velocity), lib, earliest=0.0, latest=1.7).crossings(1)[0])


def test_doubt_along_the_relative_velocity_is_only_a_matter_of_when():
    """Two strikes from different sides; the target's doubt lies along the path of the one, across that of the other."""

    class Crossing(Straight):
        def tip_path(self, strikes, *, t_stay, rate, names=()):
            t, path, slope = super().tip_path(strikes, t_stay=t_stay, rate=rate, names=names)
            path[strikes[:, 0] > -0.5] = path[strikes[:, 0] > -0.5][..., ::-1] - HOME[::-1] + HOME  # x and y exchanged
            return t, path, slope

    strikes = np.vstack([MIDDLE, MIDDLE])
    strikes[1, 0] += 1e-9
    lib = library(strikes, Crossing())
    for first, along in ((0, SPEED), (1, SPEED[::-1])):
        unit = along / np.linalg.norm(along)
        doubt = 1e-3 * np.outer(unit, unit) + 1e-9 * np.eye(2)
        track = TargetTrack(find_motion("still"), HOME, doubt)
        assert aim(track, lib).crossings(2)[0][0] == first


def test_a_later_start_is_worth_a_miss_that_the_doubt_outweighs():
    """The first strike goes through the target but must start at once; the second passes 15 mm aside, 1.3 s later, when
    26 frames have made 20 mm of doubt to 4 mm."""
    across = np.array([-SPEED[1], SPEED[0]]) / np.linalg.norm(SPEED)
    shifts = np.array([-0.9 * SPEED, 0.4 * SPEED + 0.015 * across])
    strikes = MIDDLE + shifts @ np.linalg.pinv(PUSH).T
    strikes[:, -1] = 1.4
    track, late = TargetTrack(find_motion("still"), HOME, 4e-4 * np.eye(2)), {"earliest": 1.0, "latest": 2.45}
    blind, seeing = (
        aim(track, library(strikes), now=1.0, camera=camera, **late) for camera in (None, TargetCamera(20.0, 0.02))
    )
    assert blind.crossings(2)[0].tolist() == [0, 1]
    which, start, tau = seeing.crossings(2)
    assert which.tolist() == [1, 0]
    assert 2.2 < start[0] < start[0] + tau[0] <= 2.45


def test_contacts_stay_on_the_tips_path():
    """A target far ahead or behind on the tip's line: contacts end 2 ms within the path, and come back from beyond."""
    none = np.zeros(5, bool)
    for ahead, end in ((9.0, 1.3 - 0.002), (-9.0, 0.002)):
        _, start, tau = aim(known(*(HOME + ahead * SPEED)), library(MIDDLE)).steer(
            MIDDLE, np.array([1.0]), np.array([0.5]), free=none, steps=80
        )
        assert (start[0], tau[0]) == (1.0, pytest.approx(end))
        far = aim(known(*(HOME + ahead * SPEED)), library(MIDDLE), latest=9.0)
        _, _, tau = far.steer(MIDDLE, np.array([1.0]), np.array([0.65 + ahead / 14]), free=none, steps=1)
        assert tau[0] == pytest.approx(end)
    _, _, tau = aim(known(*HOME), library(MIDDLE)).steer(MIDDLE, np.array([1.0]), np.array([1.5]), free=none, steps=80)
    assert tau[0] == pytest.approx(0.5)


def test_the_track_is_as_certain_as_at_the_start():
    """A frame every 1/20 s until the tenth in which the strike starts adds its information; without a camera, none."""
    doubt = 4e-4 * np.eye(2)
    track = TargetTrack(find_motion("still"), HOME, doubt)
    plain = aim(track, library(MIDDLE), earliest=1.0, now=1.0)
    assert plain.at_start(1.5) is track
    watched = aim(track, library(MIDDLE), earliest=1.0, now=1.0, camera=TargetCamera(20.0, 0.01))
    for start, frames in ((1.0, 0), (1.05, 0), (1.1, 2), (1.19, 2), (1.31, 6), (1.7, 14)):
        expected = 1 / (1 / 4e-4 + frames / 0.01**2)
        np.testing.assert_allclose(watched.at_start(start).covariance, expected * np.eye(2), rtol=1e-6, atol=1e-15)
    told = known(*HOME)
    assert aim(told, library(MIDDLE), camera=TargetCamera()).at_start(2.0) is told


@pytest.mark.parametrize("sigma", [0.02, 0.06])
def test_the_stated_probability_is_that_of_a_hit(sigma):
    """A straight flight by a target in round doubt, 3 cm aside: only the doubt across matters, which is normal."""
    unit = SPEED / np.linalg.norm(SPEED)
    aside = HOME + 0.03 * np.array([-unit[1], unit[0]])
    track = TargetTrack(find_motion("still"), aside, sigma**2 * np.eye(2))
    rng = np.random.default_rng(0)
    found = aim(track, library(MIDDLE)).best(MIDDLE, np.array([1.0]), np.array([0.5]), rng=rng, samples=4000, began=0.0)
    exact = ncx2.cdf((0.06 / sigma) ** 2, 1, (0.03 / sigma) ** 2)  # of the squared distance across, in units of sigma
    assert found.probability == pytest.approx(exact, abs=4 * np.sqrt(exact * (1 - exact) / 4000))
    across = 0.03 + sigma * np.random.default_rng(1).standard_normal(200_000)
    assert found.expected_miss == pytest.approx(np.abs(across).mean(), rel=0.05)
    assert found.mean_miss == pytest.approx(0.03, abs=1e-9)
    assert found.tip_speed == pytest.approx(np.linalg.norm(SPEED))
    np.testing.assert_allclose(found.point, HOME, atol=1e-9)
    assert (found.start, found.contact) == (1.0, 1.5)


def test_a_moving_target_is_where_it_is_when_the_tip_comes():
    """It crosses the tip's way at the contact, 1.5 s on its clock, or 0.1 s sooner: then it is 5 cm off, across."""
    unit = np.array([-SPEED[1], SPEED[0]]) / np.linalg.norm(SPEED)
    for late, miss in ((0.0, 0.0), (0.1, 0.05)):
        track = known(*(HOME - 0.5 * unit * (1.5 - late)), *(0.5 * unit))
        found = aim(track, library(MIDDLE)).best(
            MIDDLE, np.array([1.0]), np.array([0.5]), rng=np.random.default_rng(0), samples=4, began=0.0
        )
        assert found.mean_miss == pytest.approx(miss, abs=2e-3)
        assert found.expected_miss == pytest.approx(found.mean_miss)


def test_only_the_window_around_the_contact_counts():
    """The tip passes the target 0.2 s after the planned contact: that is no hit, 0.09 s after is."""
    for late, hits in ((0.2, False), (0.09, True), (-0.2, False), (-0.09, True)):
        track = TargetTrack(find_motion("still"), HOME + late * SPEED, 1e-10 * np.eye(2))
        found = aim(track, library(MIDDLE)).best(
            MIDDLE, np.array([1.0]), np.array([0.5]), rng=np.random.default_rng(0), samples=50, began=0.0
        )
        assert (found.probability == 1.0) is hits
        beyond = max(0.0, abs(late) - 0.1) * np.linalg.norm(SPEED)
        assert found.expected_miss == pytest.approx(beyond, abs=1e-3)


def test_the_best_hits_most_probably_is_near_and_is_allowed():
    across = np.array([-SPEED[1], SPEED[0]]) / np.linalg.norm(SPEED)
    offsets = np.array([0.09, 0.02, 0.01, 0.5])
    strikes = MIDDLE + offsets[:, None] * (np.linalg.pinv(PUSH) @ across)
    some, rng = (np.full(4, 1.0), np.full(4, 0.5)), np.random.default_rng(0)
    still = TargetTrack(find_motion("still"), HOME, 1e-6 * np.eye(2))
    found = aim(still, library(strikes)).best(strikes, *some, rng=rng, samples=64, began=0.0)
    np.testing.assert_allclose(found.strike.vector, strikes[2])  # all but one hit surely: the nearest
    away = TargetTrack(find_motion("still"), HOME - 0.2 * across, 1e-6 * np.eye(2))
    found = aim(away, library(strikes)).best(strikes, *some, rng=rng, samples=64, began=0.0)
    np.testing.assert_allclose(found.strike.vector, strikes[2])  # none hits: the nearest
    assert found.probability == 0
    assert found.expected_miss == pytest.approx(0.21, abs=2e-3)
    diverging = strikes.copy()
    diverging[2] += 6 * (np.eye(5) - np.linalg.pinv(PUSH) @ PUSH)[0] / (np.eye(5) - np.linalg.pinv(PUSH) @ PUSH)[0, 0]
    found = aim(still, library(strikes)).best(diverging, *some, rng=rng, samples=64, began=0.0)
    np.testing.assert_allclose(found.strike.vector, strikes[1])  # the nearest is not possible
