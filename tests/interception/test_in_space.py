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
from whiptool.rollout import CompiledRollout, ReferenceRollout
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


@pytest.fixture(scope="module")
def library() -> Library:
    return Library.build(Striker(CompiledRollout(preset("ur5e"))), size=24)


HIGH, LOW = np.argmax, np.argmin


def passing(library: Library, which, away: float, velocity: tuple[float, float, float]) -> TargetTrack:
    """A target that passes near the highest or lowest point of the library's strikes in time."""
    i = int(which(library.points[:, 2]))
    numbers = np.r_[library.points[i] + away - np.array(velocity) * (1.5 + library.tau[i]), velocity]
    return TargetTrack.known(find_motion("straight", dimension=3), numbers)


def test_all_strikes_of_a_robots_library_keep_its_limits(library):
    assert len(library.strikes) == 24
    assert library.striker.keep(library.strikes).all()
    assert library.points[:, 2].min() > 0


def test_a_robot_meets_a_target_that_flies_past_within_its_limits(library):
    track = passing(library, HIGH, -0.01, (-0.3, 0.4, 0.1))
    met = Interceptor(library).plan(track, now=0.0, earliest=0.2, rng=np.random.default_rng(0))
    assert met is not None
    assert met.probability == 1
    assert library.striker.keep(met.strike.vector[None]).all()
    assert np.array(met.point) == pytest.approx(track.position(met.contact)[0], abs=3e-3)
    assert library.strikes.tolist().count(list(met.strike.vector)) == 0  # it was steered
    path = ReferenceRollout(preset("ur5e")).trajectory(met.strike, t_stay=library.striker.t_stay)
    assert closest_on_segments(path.tip - track.position(met.start + path.t), np.zeros(3)).distance < 3e-3
    assert path.tip[:, 2].min() > 0


def test_a_strike_of_the_library_is_chosen_where_no_steered_one_keeps_the_limits(library, monkeypatch):
    """What is asked last is `keep`; here it knows the library's strikes alone."""
    track, known = passing(library, HIGH, -0.01, (-0.3, 0.4, 0.1)), library.strikes.tolist()
    monkeypatch.setattr(Striker, "keep", lambda self, strikes: np.array([list(x) in known for x in strikes]))
    met = Interceptor(library).plan(track, now=0.0, earliest=0.2, rng=np.random.default_rng(0))
    assert met is not None
    assert list(met.strike.vector) in known
    again = Interceptor(library).refresh(met, track, now=0.1, earliest=0.2, rng=np.random.default_rng(0))
    assert again is not None
    assert again.strike == met.strike
    monkeypatch.setattr(Striker, "keep", lambda self, strikes: np.zeros(len(strikes), bool))
    assert Interceptor(library).plan(track, now=0.0, earliest=0.2, rng=np.random.default_rng(0)) is None
    assert Interceptor(library).refresh(met, track, now=0.1, earliest=0.2, rng=np.random.default_rng(0)) is None


def test_a_track_ends_at_the_floor(library):
    """A target that sinks to the floor is met no later than there, and not within the hit radius below it."""
    track, times = passing(library, LOW, 0.0, (0.0, 0.0, -0.3)), np.linspace(0, 4, 4001)
    lands = times[np.argmax(track.position(times)[:, 2] < 0)]
    aim = Aim(Interceptor(library), track, 0.0, 0.2, 5.0)
    assert aim.latest == pytest.approx(lands, abs=0.011)
    assert Aim(Interceptor(library), passing(library, LOW, 1.0, (0.1, 0.0, 0.1)), 0.0, 0.2, 5.0).latest == 5.0
    below, above = (
        TargetTrack.known(find_motion("still", dimension=3), np.array([0.5, 0.2, z])) for z in (-0.01, 0.01)
    )
    assert Interceptor(library).plan(below, now=0.0, rng=np.random.default_rng(0)) is None
    tip, when = np.tile([0.5, 0.2, 0.02], (3, 1)), np.arange(3.0)  # 3 cm from the one, 1 cm from the other
    met = [aim.outlook(tip, when, one, np.random.default_rng(0), 4).probability for one in (below, above)]
    assert met == [0, 1]
