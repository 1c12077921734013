"""Planned strikes of a UR5e through the client ur_rtde, as it is installed, on the emulated robot."""

from __future__ import annotations

import numpy as np
import pytest
from ur_robot import ARM, columns, driver, emulated

from whiptool.goals.target import Target
from whiptool.identification.servo_lag import fit_servo_lag
from whiptool.models import preset
from whiptool.models.joint_trajectory import JointTrajectory
from whiptool.models.strike import Strike
from whiptool.objective import Objective
from whiptool.optimizers import search
from whiptool.rollout import CompiledRollout

pytest.importorskip("rtde_control", reason="ur-rtde is not installed, or has no wheel here")
PERIOD, LATENCY = 0.002, 3


def planned(count: int) -> list[Strike]:
    """Strikes at points, and at points from given directions, each the best of 60 trials."""
    rollout, rng, strikes = CompiledRollout(preset("ur5e")), np.random.default_rng(0), []
    for k in range(count):
        azimuth, height, r = rng.uniform((-1.0, 0.1, 0.9), (1.0, 1.0, 1.6))
        point = np.array([r * np.cos(azimuth), r * np.sin(azimuth), height])
        goal = {"direction": tuple(point / np.linalg.norm(point)), "cone": 0.5} if k % 2 else {}
        objective = Objective(rollout, Target(tuple(point), hit_radius=0.05, **goal), max_trials=60, stop_at_hit=True)
        strikes.append(search(objective, "cma-es", seed=k).strike)
    return strikes


@pytest.mark.parametrize("count", [pytest.param(3, marks=pytest.mark.slow), pytest.param(20, marks=pytest.mark.hours)])
def test_planned_strikes_are_carried_out_and_each_tells_the_lag(count):
    """The first is commanded as it is planned, the others lead by the lag that it tells."""
    off, lags, strikes = [], [], planned(count)
    with emulated(latency=LATENCY, posture=strikes[0].q_i) as emulator, driver(emulator) as robot:
        for strike in strikes:
            path = JointTrajectory.of_strike(
                strike, ARM.names, start=robot.posture(), limits=ARM.joint_limits, rest=0.05, t_stay=0.1
            )
            assert path.beyond(ARM.joint_limits) is None
            samples = []
            robot.follow(path, samples.append, lambda: None)
            t, u, q = columns(samples)
            found = fit_servo_lag(t, u, q)
            lags.append((found.lag, found.delay))
            late = found.delay + PERIOD / 2
            plan = np.stack([np.interp(t - late, path.t, x) for x in path.q.T], axis=1)
            off.append(np.abs(q - plan).max())
            print(strike.D, found, off[-1], flush=True)
            robot.lag = robot.lag or found
        assert emulator.state()["safety"] == "normal"
    print(f"lag {np.min(lags, axis=0)} to {np.max(lags, axis=0)} s; off the plan {off[0]:.3f}, then {max(off[1:]):.5f}")
    assert np.abs(np.array(lags) - (0.1, (LATENCY - 1) * PERIOD)).max() < 0.002
    assert off[0] > 0.02  # the lag matters
    assert max(off[1:]) < 2e-3
