"""Steps, effort and derivatives that rollouts have: against closed forms, MuJoCo and differences."""

from __future__ import annotations

import dataclasses
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich_model import COMPUTED, everything
from scipy.integrate import simpson
from slopes import compare

from whiptool.errors import InputError
from whiptool.goals.target import Target
from whiptool.impedance import OIAC, ConstantImpedance, Controller, PositionControl
from whiptool.models import ArmLink, ArmParameters, Model, StrikeBounds, WhipParameters, preset
from whiptool.models.joint_trajectory import free_hand
from whiptool.models.strike import T_STAY, Strike, check_turns, default_bounds
from whiptool.models.trajectory import Approach
from whiptool.objective import Objective
from whiptool.rollout import CompiledRollout, ReferenceRollout
from whiptool.rollout.engine import RUNGS
from whiptool.rollout.interface import MOST_STEPS, joined, time_grid

durations = st.lists(st.floats(1e-3, 5.0), min_size=1, max_size=6).map(np.array)
timesteps = st.floats(1e-4, 1e-2)


@given(durations, timesteps)
def test_a_continuous_controller_takes_the_fewest_equal_steps(duration, timestep):
    h, h_last, steps, hold = time_grid(duration, timestep=timestep, control_period=None)
    np.testing.assert_array_equal(h, h_last)
    np.testing.assert_allclose(h * steps, duration, rtol=1e-12)
    assert (h <= timestep * (1 + 1e-6)).all()
    fewer = steps[steps > 1] - 1
    assert (duration[steps > 1] / fewer > timestep * (1 - 1e-6)).all()
    assert hold == 1


@given(durations, timesteps, st.floats(1e-3, 5e-2))
def test_a_held_torque_has_whole_steps_and_only_the_last_is_shorter(duration, timestep, period):
    h, h_last, steps, hold = time_grid(duration, timestep=timestep, control_period=period)
    np.testing.assert_allclose(h * hold, period, rtol=1e-12)
    assert (h <= timestep * (1 + 1e-6)).all()
    assert hold == 1 or period / (hold - 1) > timestep * (1 - 1e-6)
    np.testing.assert_allclose((steps - 1) * h + h_last, duration, rtol=1e-12)
    assert (h_last > 0).all()
    assert (h_last <= h * (1 + 1e-6)).all()


def test_steps_by_hand():
    """0.6 s and 0.25 s at 0.1 s, and under a torque held for 0.04 s, which makes steps of 0.04 s."""
    h, h_last, steps, hold = time_grid(np.array([0.6, 0.25]), timestep=0.1, control_period=None)
    assert steps.tolist() == [6, 3]
    assert h == pytest.approx([0.1, 0.25 / 3])
    h, h_last, steps, hold = time_grid(np.array([0.6, 0.25]), timestep=0.1, control_period=0.04)
    assert (steps.tolist(), hold) == ([15, 7], 1)
    assert h_last == pytest.approx([0.04, 0.01])
    assert time_grid(np.array([0.6]), timestep=0.015, control_period=0.04)[3] == 3


def test_too_many_steps_are_refused():
    """The longest strike decides, and the message names its duration."""
    longest = MOST_STEPS * 1e-6
    assert time_grid(np.array([0.1, longest]), timestep=1e-6, control_period=None)[2][1] == MOST_STEPS
    with pytest.raises(InputError, match=r"timestep: got 1e-06.*this strike lasts 2\.1 s"):
        time_grid(np.array([0.1, 1.05 * longest]), timestep=1e-6, control_period=None)
    assert len(time_grid(np.array([]), timestep=1e-6, control_period=None)[2]) == 0


LEMON = preset("lemon2024")
TARGET = np.array([1.3, 0.0])
STRIKES = default_bounds(LEMON.arm).sample(np.random.default_rng(21), 24)
CONSTANT = Controller(ConstantImpedance())
HELD = replace(CONSTANT, control_period=5e-4)


def test_effort_of_a_mass_on_a_minimum_jerk_path_has_a_closed_form():
    """Without gravity a joint takes the torque I q''; over Eq. 1 the integral of q''^2 is 120/7 span^2 / D^3."""
    mass, length, span, D = 0.4, 0.5, 1.7, 0.6
    whip = WhipParameters(N=2, l=0.01, m=1e-9, k=1e-6, b=1e-9)
    arm = ArmParameters((ArmLink(mass=mass, length=length, com=length, inertia=0.02),))
    model = Model(whip=whip, arm=arm, gravity=0.0)
    near = CompiledRollout(model, Controller(PositionControl()), timestep=2.5e-4).approach(
        np.array([[0.3, 0.3 + span, D]]), TARGET, t_stay=0.1
    )
    inertia = 0.02 + mass * length**2
    assert near.effort is not None
    assert near.effort[0, 0] == pytest.approx((inertia * span) ** 2 * 120 / 7 / D**3, rel=2e-5)


@pytest.mark.parametrize("controller", [CONSTANT, Controller(OIAC()), HELD], ids=["constant", "oiac", "held"])
def test_effort_is_that_of_mujoco(controller):
    """By Simpson's rule over MuJoCo's own steps."""
    strike = Strike.from_vector([-0.9, 0.4, 1.2, 0.8, 0.4])
    near = CompiledRollout(LEMON, controller).approach(strike, TARGET, t_stay=0.1)
    path = ReferenceRollout(LEMON, controller).trajectory(strike, t_stay=0.1)
    expected = simpson(path.tau**2, x=path.t, axis=0)
    assert near.effort is not None
    np.testing.assert_allclose(near.effort[0], expected, rtol=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize("controller", [CONSTANT, HELD], ids=["continuous", "held"])
def test_engines_agree_on_effort_and_on_derivatives(controller):
    strikes, found = np.c_[STRIKES[:2, :4], [0.4, 0.5]], []
    for rung in RUNGS:
        rollout = CompiledRollout(LEMON, controller, timestep=1e-3, engine=rung)
        near, slopes = rollout.slopes(strikes, TARGET, t_stay=0.1)
        plain = rollout.approach(strikes, TARGET, t_stay=0.1)
        np.testing.assert_allclose(near.effort, plain.effort, rtol=1e-6)
        found.append((near.effort, slopes.effort, slopes.max_torque))
    paths = [rollout.trajectory(strike, t_stay=0.1).approach(TARGET).effort for strike in strikes]
    np.testing.assert_allclose(np.concatenate(paths), found[0][0], rtol=1e-9)
    for other in found[1:]:
        for expected, seen in zip(found[0], other, strict=True):
            np.testing.assert_allclose(seen, expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max())


@pytest.mark.slow
@pytest.mark.parametrize("name", ["effort", "max_torque"])
def test_derivatives_against_differences(name):
    """Of each joint, by the whole strike: with D the steps move, too."""
    rollout = CompiledRollout(everything(), CONSTANT, timestep=1e-3)
    slopes = getattr(rollout.slopes(STRIKES, TARGET, t_stay=0.3)[1], name)
    compared = 0
    for j in range(5):
        for joint in range(2):

            def seen(by: float, j: int = j, joint: int = joint) -> np.ndarray:
                shifted = STRIKES.copy()
                shifted[:, j] += by
                return getattr(rollout.approach(shifted, TARGET, t_stay=0.3), name)[:, joint]

            wrong, still = compare(slopes[:, joint, j], seen, 3e-6)
            assert not wrong.any(), (j, joint, slopes[wrong, joint, j])
            compared += int(still.sum())
    assert compared > 0.8 * 5 * 2 * len(STRIKES)


MODEL, CONTROLLER = preset("lemon2024"), Controller(ConstantImpedance())
TARGET_INTERFACE = Target((1.1, 0.2))
STRIKES_INTERFACE = (Strike((-1.3, 0.5), (1.6, 1.2), 0.5), Strike((-1.0, 0.3), (1.1, 0.4), 0.6))
VECTORS = np.array([s.vector for s in STRIKES_INTERFACE])


def columns(near: Approach) -> np.ndarray:
    found = [np.asarray(getattr(near, f.name)) for f in dataclasses.fields(near) if f.name in COMPUTED]
    return np.concatenate([x.reshape(len(near.distance), -1) for x in found], axis=1)


@pytest.fixture(scope="module")
def compiled() -> CompiledRollout:
    return CompiledRollout(MODEL, CONTROLLER, timestep=1e-3)


@pytest.mark.parametrize("strikes", [STRIKES_INTERFACE, list(STRIKES_INTERFACE), VECTORS, VECTORS.tolist()])
@pytest.mark.parametrize("target", [TARGET_INTERFACE, (1.1, 0.2), np.array([1.1, 0.2]), np.array([[1.1, 0.2]] * 2)])
def test_strikes_and_targets_are_objects_or_arrays(compiled, strikes, target):
    np.testing.assert_array_equal(
        columns(compiled.approach(strikes, target)),
        columns(compiled.approach(VECTORS, np.array([1.1, 0.2]), t_stay=T_STAY)),
    )


def test_one_strike_is_a_batch_of_one(compiled):
    for one in (STRIKES_INTERFACE[1], VECTORS[1], VECTORS[1:]):
        near = compiled.approach(one, TARGET_INTERFACE)
        assert near.distance.shape == (1,)
        assert near.distance[0] == compiled.approach(VECTORS, TARGET_INTERFACE).distance[1]
    np.testing.assert_array_equal(compiled.trajectory(VECTORS[0]).q, compiled.trajectory(STRIKES_INTERFACE[0]).q)
    np.testing.assert_array_equal(
        compiled.gradient(STRIKES_INTERFACE[0], TARGET_INTERFACE)[1],
        compiled.gradient(VECTORS[:1], TARGET_INTERFACE)[1],
    )
    np.testing.assert_array_equal(
        compiled.tip_path(STRIKES_INTERFACE[0], rate=60)[1], compiled.tip_path(VECTORS[:1], rate=60, t_stay=T_STAY)[1]
    )


def test_the_reference_has_approaches_too(compiled):
    """Those of its trajectories, each to its own target; they agree with the compiled ones."""
    reference = ReferenceRollout(MODEL, CONTROLLER, timestep=1e-4)
    targets = np.array([[1.1, 0.2], [0.4, -0.9]])
    near = reference.approach(STRIKES_INTERFACE, targets)
    for i, (strike, target) in enumerate(zip(STRIKES_INTERFACE, targets, strict=True)):
        path = reference.trajectory(strike, t_stay=T_STAY)
        assert path.t[-1] == pytest.approx(strike.D + T_STAY)
        np.testing.assert_array_equal(columns(near)[i], columns(path.approach(target))[0])
    np.testing.assert_allclose(near.distance, compiled.approach(STRIKES_INTERFACE, targets).distance, atol=5e-3)
    with pytest.raises(InputError, match="a simulator with derivatives"):
        reference.gradient(STRIKES_INTERFACE, TARGET_INTERFACE)


def test_what_has_another_shape_is_refused(compiled):
    with pytest.raises(InputError, match=r"strikes.*\(B, 5\), for an arm of 2 joints"):
        compiled.vectors(np.zeros((3, 7)))
    with pytest.raises(InputError, match="D > 0"):
        compiled.vectors(np.zeros((1, 5)))


def test_approaches_are_joined_in_order():
    def one(x: float, error: float | None) -> Approach:
        two = np.full((1, 2), x)
        return Approach(two[:, 0], two[:, 0], two, two, two, two, np.array([x > 1]), error and np.array([error]))

    both = joined([one(1.0, None), one(2.0, None)], 2, 2)
    assert both.distance.tolist() == [1, 2]
    assert both.tip.tolist() == [[1, 1], [2, 2]]
    assert both.diverged.tolist() == [False, True]
    assert both.error is None
    assert joined([one(1.0, 0.1), one(2.0, 0.2)], 2, 2).error.tolist() == [0.1, 0.2]


NONE = {
    "approach": lambda rollout: rollout.approach(np.empty((0, 5)), np.empty((0, 2))).tip,
    "approach of one target": lambda rollout: rollout.approach(np.empty((0, 5)), (1.2, 0.1)).tip,
    "trajectories": lambda rollout: list(rollout.trajectories(np.empty((0, 5)))),
}
COMPILED_NONE = NONE | {
    "nearest node": lambda rollout: rollout.nearest_node(np.empty((0, 5)), (1.2, 0.1), nodes=[0, 11]).velocity,
    "gradient": lambda rollout: rollout.gradient(np.empty((0, 5)), (1.2, 0.1))[1],
    "tip path": lambda rollout: rollout.tip_path(np.empty((0, 5)), rate=100.0, names=["D"])[2],
    "peaks and path": lambda rollout: rollout.peaks_and_path(np.empty((0, 5)), rate=100.0)[1],
    "chain paths": lambda rollout: list(rollout.chain_paths(np.empty((0, 5)), names=["D"])),
}


@pytest.mark.parametrize(
    ("kind", "asked"),
    [(ReferenceRollout, name) for name in NONE] + [(CompiledRollout, name) for name in COMPILED_NONE],
)
def test_no_strikes_come_to_nothing(kind, asked):
    """A search, a map or a learner may have none left to strike."""
    rollout = kind(preset("lemon2024"), Controller(ConstantImpedance()))
    assert len(COMPILED_NONE[asked](rollout)) == 0


def test_no_approaches_have_their_columns():
    none = joined([], 6, 3)
    assert none.velocity.shape == none.tip.shape == (0, 3)
    assert none.max_torque.shape == none.max_joint_speed.shape == (0, 6)
    assert none.distance.shape == none.diverged.shape == (0,)


@pytest.mark.parametrize("kind", [CompiledRollout, ReferenceRollout])
def test_a_trajectory_is_of_one_strike(kind):
    rollout = kind(preset("lemon2024"), Controller(ConstantImpedance()))
    with pytest.raises(
        InputError, match=r"^number of strikes: got 2; allowed: 1; for several call trajectories\(strikes\)"
    ):
        rollout.trajectory(np.array([[-1.2, 0.9, 1.2, 0.3, 0.7]] * 2))


def test_angles_in_degrees_are_refused_before_anything_is_computed(compiled):
    """Two turns are the most that is taken: `77.9 rad` would be a strike of twelve turns."""
    degrees = STRIKES_INTERFACE[0].vector * np.r_[np.full(4, 180 / np.pi), 1]
    for asked in (compiled, ReferenceRollout(MODEL, CONTROLLER)):
        for door in (lambda x, by=asked: by.approach(x, TARGET_INTERFACE), asked.trajectory):
            with pytest.raises(InputError, match=r"got '-74.48\d* rad of shoulder'; .*radians; are these degrees"):
                door(degrees)
    with pytest.raises(InputError, match=r"bounds: got '-90 rad of shoulder"):
        Objective(compiled, TARGET_INTERFACE, bounds=StrikeBounds((-90, 0, -90, 0, 0.4), (90, 90, 90, 90, 1.5)))
    compiled.vectors(Strike((-4 * np.pi, 0), (4 * np.pi, 0), 2.0))


def test_lengths_of_slides_are_no_angles():
    hand = free_hand(np.eye(3))
    check_turns("strike", [15.0, 0, 0, 0, 0, 0], hand)
    with pytest.raises(InputError, match="got '15 rad of hand_yaw"):
        check_turns("strike", [[0.0] * 6, [0, 0, 0, 15.0, 0, 0]], hand)
