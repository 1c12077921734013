"""Moving targets in space: tracks against closed forms, and a robot's strike that meets one."""

from __future__ import annotations

import numpy as np
import pytest

from whiptool.errors import InputError
from whiptool.interception.interceptor import Aim, Interceptor
from whiptool.interception.library import Library
from whiptool.interception.target_tracks import GRAVITY, TargetTrack, find_motion, fit_track
from whiptool.models import preset
from whiptool.models.trajectory import closest_on_segments
from whiptool.rollout import CompiledRollout
from whiptool.strike_map.striker import Striker

T = np.linspace(-0.5, 0.0, 31)


def thrown(t: np.ndarray) -> np.ndarray:
    return np.array([1.2, -0.4, 0.6]) + t[:, None] * [-0.8, 1.1, 2.5] - 0.5 * GRAVITY * t[:, None] ** 2 * [0, 0, 1]


def test_a_thrown_target_is_predicted():
    seen = thrown(T) + 0.005 * np.random.default_rng(3).standard_normal((len(T), 3))
    track = fit_track(T, seen, sigma=0.005)
    later = np.array([0.3, 0.5])
    assert track.motion.name == "ballistic"
    assert track.motion.names == ("x", "y", "z", "vx", "vy", "vz")
    assert track.dof == 3 * len(T) - 6
    off = track.position(later) - thrown(later)
    assert (np.einsum("ti,tij,tj->t", off, np.linalg.inv(track.covariance_at(later)), off) < 16).all()
    assert fit_track(T, thrown(T), sigma=0.005).position(later) == pytest.approx(thrown(later), abs=1e-7)


def test_a_pendulum_is_refused_by_name():
    with pytest.raises(InputError, match="auto, still, straight, ballistic; a pendulum swings in the plane"):
        fit_track(T, thrown(T), sigma=0.005, motion="pendulum")


def test_a_robot_meets_a_target_that_flies_past():
    library = Library.build(Striker(CompiledRollout(preset("ur5e"))), size=12)
    i = int(np.argmax(library.points[:, 0]))
    place, velocity, meeting = library.points[i] + 0.02, np.array([-0.3, 0.4, 0.1]), 1.5 + library.tau[i]
    track = TargetTrack.known(find_motion("straight", dimension=3), np.r_[place - velocity * meeting, velocity])
    aim = Aim(Interceptor(library), track, 0.0, 0.2, 5.0)
    which, start, tau = (x[:1] for x in aim.crossings(8))
    x, start, tau = aim.steer(library.strikes[which], start, tau, free=library.free, steps=3)
    path = library.striker.rollout.trajectory(x[0], t_stay=library.striker.t_stay)
    assert closest_on_segments(path.tip - track.position(start[0] + path.t), np.zeros(3)).distance < 2e-3
    met = aim.best(x, start, tau, rng=np.random.default_rng(0), samples=8, began=0.0)
    assert met.probability == 1
    assert np.array(met.point) == pytest.approx(track.position(met.contact)[0], abs=3e-3)
