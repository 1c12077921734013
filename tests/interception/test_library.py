"""The library of strikes against numbers of toy paths that are known in closed form."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from whiptool.errors import InputError
from whiptool.interception.library import RATE, Library
from whiptool.limits.arm_limits import MotorLimits
from whiptool.models import preset
from whiptool.models.strike import StrikeBounds
from whiptool.strike_map.striker import Striker

MODEL = preset("lemon2024")
BOUNDS = StrikeBounds((-1.0, 0.0, 0.0, 0.0, 0.5), (0.0, 1.0, 2.0, 1.0, 1.5))
MOTOR = MotorLimits("toy", stall_torque=2.0, no_load_speed=10.0, stall_current=1.0)


class Circling:
    """Tips on circles of radius 1 m with the angle `q_f[0] t^2`: their speed is `2 q_f[0] t`. Torques are |q_i|."""

    model, prescribed, space = MODEL, False, SimpleNamespace(kind="joint")

    def tip_path(self, strikes, *, t_stay, rate, names=()):
        t = np.arange(int((strikes[:, -1].max() + t_stay) * rate + 1e-9) + 1) / rate
        angle = strikes[:, 2, None] * t**2
        path = np.stack([np.sin(angle), -np.cos(angle)], axis=-1)
        return t, np.where(t[:, None] <= strikes[:, -1, None, None] + t_stay + 1e-9, path, np.nan), None

    def peaks_and_path(self, strikes, *, t_stay, rate):
        near = SimpleNamespace(
            diverged=strikes[:, 4] > 1.4,
            max_torque=np.abs(strikes[:, :2]),
            max_joint_speed=np.zeros((len(strikes), 2)),
        )
        return near, self.tip_path(strikes, t_stay=t_stay, rate=rate)[1]

    def trajectories(self, strikes, *, t_stay):
        for strike in strikes:
            tau = np.abs(strike[None, :2])
            yield SimpleNamespace(diverged=strike[4] > 1.4, tau=tau, v=np.zeros((1, 2)), low=strike[1])

    def trajectory(self, strike, *, t_stay):
        return next(self.trajectories(strike.vector[None], t_stay=t_stay))


class High(MotorLimits):
    """Limits that peak values do not show: the whole trajectory has to be above 0.3."""

    of_candidates, by_peaks = True, True

    def violation_of_peaks(self, near):
        return np.where(near.diverged, np.inf, -1.0)

    def violation(self, trajectory):
        return np.inf if trajectory.diverged else 0.3 - trajectory.low


def build(limits: MotorLimits | None = None, **options) -> Library:
    striker = Striker(Circling(), bounds=BOUNDS, limits=limits, t_stay=0.2)
    return Library.build(striker, **{"size": 50, **options})


def test_points_are_those_of_the_paths_where_the_tip_is_fast():
    lib = build(speed=1.5)
    spin, tau = lib.strikes[lib.owner, 2], lib.tau
    np.testing.assert_allclose(lib.points, np.stack([np.sin(spin * tau**2), -np.cos(spin * tau**2)], axis=1))
    exact = (2 * spin * tau)[:, None] * np.stack([np.cos(spin * tau**2), np.sin(spin * tau**2)], axis=1)
    np.testing.assert_allclose(lib.velocities, exact, atol=0.02)
    np.testing.assert_allclose(tau * RATE, np.round(tau * RATE), atol=1e-9)
    assert np.linalg.norm(lib.velocities, axis=1).min() >= 1.5
    ends = np.floor((lib.strikes[:, -1] + 0.2) * RATE + 1e-9)  # the last sample has no neighbour: no velocity
    first = np.ceil(1.5 / 2 / lib.strikes[:, 2] * RATE)
    count = np.bincount(lib.owner, minlength=len(lib.strikes))
    np.testing.assert_allclose(count, np.maximum(ends - first, 0), atol=2)
    assert lib.tree.query(lib.points[7])[0] == 0


def test_strikes_are_uniform_in_the_box_and_those_of_the_seed():
    lib = build(size=4000, seed=3)
    lower, upper = np.array(BOUNDS.lower), np.array(BOUNDS.upper)
    upper[-1] = 1.4  # beyond, they diverge
    share = (lib.strikes - lower) / (upper - lower)
    assert share.min() >= 0
    assert share.max() <= 1
    np.testing.assert_allclose(share.mean(axis=0), 0.5, atol=0.02)
    np.testing.assert_allclose(share.std(axis=0), 1 / np.sqrt(12), rtol=0.03)
    np.testing.assert_array_equal(lib.striker.bounds.box, (BOUNDS.lower, BOUNDS.upper))
    assert lib.free.all()
    assert len(Library.build(build().striker).strikes) == 2000
    assert len(build(size=1, seed=1, speed=0.5).strikes) == 1
    np.testing.assert_array_equal(build(size=40, seed=3).strikes, build(size=40, seed=3).strikes)
    assert (build(size=40, seed=3).strikes[0] != build(size=40, seed=4).strikes[0]).all()


def test_an_arm_that_waits_starts_where_it_waits():
    lib = build(q_i=(-1.0, 1.0))
    np.testing.assert_array_equal(lib.strikes[:, :2], np.tile([-1.0, 1.0], (len(lib.strikes), 1)))
    assert lib.free.tolist() == [False, False, True, True, True]
    for bad in ((-1.01, 0.5), (-0.5, 1.01), (-0.5,)):
        with pytest.raises(InputError, match="q_i"):
            build(q_i=bad)


def test_strikes_beyond_the_motor_or_that_diverge_are_left_out_and_others_drawn():
    assert len(build().strikes) == 50
    assert build().strikes[:, -1].max() <= 1.4
    weak = build(limits=MotorLimits("weak", 0.6, 10.0, 1.0))
    assert np.abs(weak.strikes[:, :2]).max() <= 0.6
    assert len(weak.strikes) == 50
    strikes = np.array([[-0.5, 0.5, 1, 0, 1.0], [-0.9, 0.5, 1, 0, 1.0], [-0.5, 0.5, 1, 0, 1.45]])
    assert weak.striker.paths(strikes, rate=RATE)[0].tolist() == [True, False, False]
    exactly = weak.strikes[:1].copy()
    exactly[0, 0] = -0.6
    assert weak.striker.paths(exactly, rate=RATE)[0].all()
    assert build().striker.paths(strikes, rate=RATE)[0].tolist() == [True, True, False]


def test_limits_that_peak_values_do_not_show_are_kept_too():
    """A third of the box breaks a limit that needs the whole trajectory, such as the distance from the floor."""
    high = build(limits=High("high", 2.0, 10.0, 1.0), size=200)
    assert len(high.strikes) == 200
    assert high.strikes[:, 1].min() >= 0.3
    assert high.striker.keep(high.strikes).all()


def test_what_no_strike_can_do_is_refused():
    with pytest.raises(InputError, match="limits: got \"the feeble's"):
        build(limits=MotorLimits("feeble", 1e-3, 10.0, 1.0))
    with pytest.raises(InputError, match=r"speed: got 100.0; allowed: at most 6\.[0-9]+ m/s"):
        build(size=1000, speed=100.0)
    with pytest.raises(InputError, match="size"):
        build(size=0)
    with pytest.raises(InputError, match="speed"):
        build(speed=-1.0)
