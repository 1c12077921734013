"""The minimum-jerk reference and the bounds."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from whiptool.errors import InputError
from whiptool.goals.target import Target
from whiptool.models import ArmLink, ArmParameters, preset
from whiptool.models.strike import Strike, StrikeBounds, default_bounds, named_strike, strike_names


@given(st.lists(st.floats(-3, 3), min_size=4, max_size=4), st.floats(0.1, 2))
@settings(max_examples=50, deadline=None, derandomize=True)
def test_reference_is_eq_1_with_its_derivatives(angles, D):
    strike = Strike.from_vector([*angles, D])
    q_i, q_f = np.array(angles[:2]), np.array(angles[2:])
    t = np.linspace(0, D, 4001)
    q, v, a = strike.reference(t)
    s = t[:, None] / D
    np.testing.assert_allclose(q, q_i + (q_f - q_i) * (10 * s**3 - 15 * s**4 + 6 * s**5), atol=1e-12)
    scale = 1 + np.abs(q_f - q_i).max()
    np.testing.assert_allclose(np.gradient(q, t, axis=0, edge_order=2), v, atol=2e-6 * scale / D)
    np.testing.assert_allclose(np.gradient(v, t, axis=0, edge_order=2), a, atol=2e-5 * scale / D**2)
    for end in (0, -1):  # at rest, without acceleration, at both ends
        np.testing.assert_allclose([v[end], a[end]], 0, atol=1e-10 * scale / D**2)


def test_reference_waits_at_the_start():
    strike = Strike((0.0, 0.1), (1.0, -1.0), 0.5)
    before = np.array([-9.0, -0.2, -1e-9, 0.0])
    q, v, a = strike.reference(before)
    np.testing.assert_array_equal(q, [[0.0, 0.1]] * 4)
    np.testing.assert_array_equal(v, 0)
    np.testing.assert_array_equal(a, 0)
    for single, several in zip(strike.reference(-0.2), strike.reference(before), strict=True):
        np.testing.assert_array_equal(single, several[1])


def test_reference_stays_at_the_end_and_takes_single_times():
    strike = Strike((0.0, 0.1), (1.0, -1.0), 0.5)
    q, v, a = strike.reference(np.array([0.5, 0.7, 9.0]))
    np.testing.assert_array_equal(q, [[1.0, -1.0]] * 3)
    np.testing.assert_array_equal(v, 0)
    np.testing.assert_array_equal(a, 0)
    for single, several in zip(strike.reference(0.2), strike.reference(np.array([0.2])), strict=True):
        np.testing.assert_array_equal(single, several[0])


def test_vector_goes_there_and_back():
    vector = [-1.0, 0.5, 1.5, 0.2, 0.8]
    assert Strike.from_vector(vector).vector.tolist() == vector
    assert repr(Strike.from_vector(vector)) == "Strike(q_i=(-1, 0.5), q_f=(1.5, 0.2), D=0.8 s)"
    for wrong in ([1.0], [1.0, 2.0], [0, 0, 0, 0, 0.0], [0, 0, 0, float("nan"), 1.0], [0, 0, 0, 0, -1.0]):
        with pytest.raises(InputError):
            Strike.from_vector(wrong)


def test_names_follow_the_arm():
    assert strike_names(preset("lemon2024").arm) == ("q_si", "q_ei", "q_sf", "q_ef", "D")
    four = ArmParameters((ArmLink(1.0, 0.3),) * 4)
    assert strike_names(four)[:5] == ("q_1i", "q_2i", "q_3i", "q_4i", "q_1f")
    with pytest.raises(InputError, match="9 numbers each"):
        default_bounds(four)
    three = ArmParameters((ArmLink(1.0, 0.3),) * 3, ("shoulder", "elbow", "wrist"))
    assert strike_names(three) == ("q_si", "q_ei", "q_wi", "q_sf", "q_ef", "q_wf", "D")
    alike = ArmParameters((ArmLink(1.0, 0.3),) * 2, ("shoulder", "slide"))
    assert strike_names(alike) == ("q_shoulder_i", "q_slide_i", "q_shoulder_f", "q_slide_f", "D")
    assert named_strike(Strike((1.0, 2.0), (3.0, 4.0), 5.0), alike) == {
        "q_shoulder_i": 1.0, "q_slide_i": 2.0, "q_shoulder_f": 3.0, "q_slide_f": 4.0, "D": 5.0,
    }  # fmt: skip


def test_bounds():
    bounds = default_bounds(preset("lemon2024").arm)
    samples = bounds.sample(np.random.default_rng(0), 1000)
    lower, upper = bounds.box
    assert ((samples >= lower) & (samples <= upper)).all()
    np.testing.assert_allclose(lower, [-0.5 * np.pi, 0, 0.1 * np.pi, 0, 0.4])
    np.testing.assert_allclose(upper, [-0.1 * np.pi, 0.9 * np.pi, np.pi, 0.9 * np.pi, 1.5])
    for lower, upper in (([0, 0, 1], [1, 1, 0.5]), ([0, 0, 0], [1, 1, 1]), ([0, 0, 0.4], [1, 1])):
        with pytest.raises(InputError, match="bounds"):
            StrikeBounds(tuple(lower), tuple(upper))


def test_the_bounds_of_a_model_are_its_arm_s_and_random_strikes_have_a_generator_or_a_seed():
    bounds = default_bounds(preset("lemon2024"))
    assert bounds == default_bounds(preset("lemon2024").arm)
    np.testing.assert_array_equal(bounds.sample(5, seed=3), bounds.sample(np.random.default_rng(3), 5))
    np.testing.assert_array_equal(bounds.sample(5), bounds.sample(np.random.default_rng(0), 5))
    with pytest.raises(InputError, match="size: got None"):
        bounds.sample(np.random.default_rng(0))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Strike(q_si=0.1), r"argument of Strike: got 'q_si'; .*D; did you mean q_i\?"),
        (lambda: Strike((0.1,), (0.2,)), r"arguments of Strike: got nothing; .*D; missing .*'D'"),
        (
            lambda: Strike(1, 2, 3, 4),
            r"strike: got .*; allowed: joint positions q_i, as many q_f, ",
        ),
        (
            lambda: Target((1.2, 0.1), radius=0.1),
            r"argument of Target: got 'radius'; allowed: position, hit",
        ),
    ],
)
def test_calls_that_make_no_strike_or_target_are_refused_in_a_line(call, message):
    with pytest.raises(InputError, match=f"^{message}"):
        call()
