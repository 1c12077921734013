import dataclasses

import numpy as np
import pytest

from whiptool.errors import InputError
from whiptool.impedance import Controller
from whiptool.impedance.laws import PositionControl
from whiptool.limits.all_limits import AllLimits, named_limits
from whiptool.limits.point_speeds import PathSpeeds, PointSpeeds, point_speeds
from whiptool.models import preset
from whiptool.models.files import arm_from_table, arm_to_table
from whiptool.models.kinematics import arm_poses
from whiptool.models.strike import FASTEST, Strike
from whiptool.objective import Objective
from whiptool.rollout import CompiledRollout

UR5E = preset("ur5e")
ARM, PLANAR = UR5E.arm, preset("lemon2024")
RNG = np.random.default_rng(0)
# of the pan alone, stretched out: the elbow is 0.425 m from the axis, the stick's end farther than the flange
PAN = Strike((0.0, 0.0, 0.0, 0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0, 0.0, 0.0), 0.5)


def test_speeds_are_the_rates_of_the_points():
    q, v, dt = RNG.uniform(-3, 3, (4, 6)), RNG.uniform(-2, 2, (4, 6)), 1e-6
    origins = [arm_poses(ARM, q + sign * v * dt)[0] for sign in (1, -1)]
    rates = np.linalg.norm(origins[0] - origins[1], axis=2) / (2 * dt)
    assert point_speeds(ARM, ("elbow", "flange", "hand"), q, v) == pytest.approx(rates[:, [2, 5, 6]], rel=1e-6)


def test_a_commanded_turn_about_one_axis_uses_its_largest_speed():
    """Eq. 1: 15/8 of the span by the duration."""
    limits = PathSpeeds(ARM, (("elbow", 1.5), ("hand", 100.0)))
    elbow = FASTEST * 1.0 / 0.5 * 0.425 / 1.5
    assert limits.violation(PAN.vector[None])[0] == pytest.approx(elbow - 1)
    assert str(limits.explain(PAN.vector, ARM.joints)) == (
        f"at 0.250 s the elbow is commanded at {1.5 * elbow:.2f} m/s; its limit is 1.5 m/s"
    )


def test_strikes_are_shortened_until_the_points_are_within_their_limits():
    strikes = np.hstack([RNG.uniform(-2, 2, (40, 12)), RNG.uniform(0.3, 1.0, (40, 1))])
    limits = PathSpeeds(ARM, (("flange", 1.5), ("elbow", 0.8)))
    assert (limits.violation(strikes) > 0).sum() > 20
    shorter = limits.shortened(strikes)
    assert limits.violation(shorter).max() < 0.02
    assert np.array_equal(shorter[:, :6], strikes[:, :6])
    assert np.array_equal(shorter[:, -1], strikes[:, -1])


def test_a_motion_beyond_a_limit_is_told_by_its_point():
    path = CompiledRollout(UR5E, Controller(PositionControl())).trajectory(PAN)
    limits = PointSpeeds(ARM, (("flange", 2.0),))
    fastest = point_speeds(ARM, ("flange",), path.q[:, :6], path.v[:, :6]).max()
    assert limits.violation(path) == pytest.approx(fastest / 2 - 1)
    assert f"the flange moves at {fastest:.2f} m/s; its limit is 2 m/s" in str(limits.explain(path, ARM.joints))
    both = AllLimits([limits])
    assert both.judged_whole(path, PAN)[1] == "speed"
    assert "flange" in both.explain(path, ARM.joints, PAN)


def test_a_search_keeps_the_limits():
    rollout = CompiledRollout(UR5E, Controller(PositionControl()))
    limits = named_limits({"speed_limits": ("flange=1.0",)}, UR5E, prescribed=True)
    objective = Objective(rollout, (1.2, 0.2, 0.6), limits=limits, max_trials=20)
    outcome = objective(PAN)
    assert outcome.refused == "speed"


@pytest.mark.parametrize(
    ("given", "said"),
    [("elbow", "speed > 0"), ("elbow=fast", "speed > 0"), ("elbow=-1", "speed > 0"), ("knee=1", "shoulder_pan")],
)
def test_limits_are_written_as_points_and_speeds(given, said):
    with pytest.raises(InputError, match=said):
        PointSpeeds.of(ARM, [given])


def test_limits_of_the_arm_and_given_ones():
    arm = dataclasses.replace(ARM, speed_limits=(("elbow", 1.5), ("flange", 1.5)))
    assert arm_from_table(arm_to_table(arm), None) == arm
    assert PointSpeeds.of(arm, ["flange=5"], keep_free=0.1) == PointSpeeds(arm, (("elbow", 1.35), ("flange", 4.5)))
    assert PointSpeeds.of(ARM) is None
    assert PointSpeeds.of(PLANAR.arm) is None
    with pytest.raises(InputError, match="plane"):
        PointSpeeds.of(PLANAR.arm, ["hand=1"])
    with pytest.raises(InputError, match="pairs of a point"):
        dataclasses.replace(ARM, speed_limits=(("knee", 1.0),))
    with pytest.raises(InputError, match="speed_limits of elbow"):
        dataclasses.replace(ARM, speed_limits=(("elbow", 0.0),))
