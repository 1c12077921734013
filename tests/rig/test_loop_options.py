"""Rates, waits and limits of a strike: what is refused, and the bounds that are allowed."""

from __future__ import annotations

import math

import numpy as np
import pytest

from whiptool.errors import InputError
from whiptool.impedance import OIAC, ConstantImpedance, Controller
from whiptool.impedance.arm import Arm
from whiptool.models import preset
from whiptool.models.strike import Strike
from whiptool.rig.loop_options import FASTEST, LONGEST_DELAY, SLOWEST, CappedLoop, Caps, LoopOptions, default_caps


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("rate", 0),
        ("rate", 9.99),
        ("rate", 10_001),
        ("rate", math.nan),
        ("approach_speed", 0.0),
        ("approach_speed", 2.01),
        ("delay", -1e-3),
        ("delay", 0.101),
        ("t_stay", -0.1),
        ("t_stay", 601),
        ("settle", -1),
        ("settle", math.inf),
        ("stiffness", 0),
        ("damping", -0.7),
    ],
)
def test_what_is_out_of_bounds_is_refused_by_its_name(name: str, value: float):
    with pytest.raises(InputError, match=rf"^{name}: got "):
        LoopOptions(**{name: value})


@pytest.mark.parametrize(
    "options",
    [
        {"rate": 10},
        {"rate": 10_000},
        {"approach_speed": SLOWEST},
        {"approach_speed": FASTEST},
        {"delay": 0.0},
        {"delay": LONGEST_DELAY},
        {"t_stay": 0, "settle": 0},
        {"stiffness": 1e-3, "damping": 5.0},
    ],
)
def test_bounds_themselves_are_allowed(options: dict):
    found = LoopOptions(**options)
    assert all(getattr(found, name) == value for name, value in options.items())


def test_safe_by_default():
    """Every strike is rehearsed, and the arm goes back; the rehearsal's delay is less than a cycle."""
    found = LoopOptions()
    assert found.rehearse
    assert found.go_back
    assert found.delay < 1 / found.rate


MODEL = preset("lemon2024")
ARM = Arm(MODEL)
STRIKE = Strike((-1.2, 0.4), (1.5, 1.0), 1.0)
T = 0.37
Q_D, V_D, A_D = STRIKE.reference(T)
E, DE = np.array([0.3, -0.2]), np.array([1.0, 0.5])


def feedback(law, caps: Caps | None, e: np.ndarray = E, de: np.ndarray = DE, **options) -> np.ndarray:
    """What the loop adds to gravity compensation, for tracking errors e and de."""
    loop = CappedLoop(Controller(law, **options), ARM, STRIKE, caps)
    return loop.torque(T, Q_D - e, V_D - de) - ARM.gravity_compensation(Q_D - e)


def printed(e: np.ndarray, de: np.ndarray, a: float, beta: float, C: float) -> np.ndarray:
    """`tau = eps (|e|^2 + |de|^2) / gamma` (Eqs. 2, 8-10)."""
    eps = e + beta * de
    return eps * (e @ e + de @ de) * (1 + C * (eps @ eps)) / a


def test_oiac_is_capped_by_the_factor_of_its_error():
    plain = printed(E, DE, 0.2, 0.6, 5.0)
    stiffness = (E @ E + DE @ DE) * (1 + 5 * ((E + 0.6 * DE) @ (E + 0.6 * DE))) / 0.2
    law = OIAC(0.2, 0.6, 5.0)
    np.testing.assert_allclose(feedback(law, None), plain)
    np.testing.assert_allclose(feedback(law, Caps(stiffness * 1.01, stiffness)), plain)
    np.testing.assert_allclose(feedback(law, Caps(stiffness / 4, stiffness)), plain / 4)
    np.testing.assert_allclose(feedback(law, Caps(stiffness * 9, 0.6 * stiffness / 5)), plain / 5)
    np.testing.assert_allclose(feedback(law, Caps(stiffness / 4, 0.6 * stiffness / 5)), plain / 5)
    np.testing.assert_allclose(feedback(law, Caps(stiffness / 6, 0.6 * stiffness / 5)), plain / 6)
    assert not feedback(law, Caps(1.0, 1.0), np.zeros(2), np.zeros(2)).any()


def test_constant_impedance_is_capped_by_the_norms_of_its_matrices():
    K, B = np.array([[3.0, 1.0], [1.0, 2.0]]), np.array([[0.5, 0.1], [0.1, 0.8]])
    law = ConstantImpedance(tuple(map(tuple, K)), tuple(map(tuple, B)))
    plain = K @ E + B @ DE
    largest_K, largest_B = np.linalg.eigvalsh(K)[-1], np.linalg.eigvalsh(B)[-1]
    np.testing.assert_allclose(feedback(law, Caps(largest_K * 1.01, largest_B * 1.01)), plain)
    np.testing.assert_allclose(feedback(law, Caps(largest_K / 3, largest_B)), plain / 3)
    np.testing.assert_allclose(feedback(law, Caps(largest_K, largest_B / 7)), plain / 7)


def test_what_is_not_feedback_is_not_scaled_and_limits_come_last():
    law, tight = OIAC(0.2, 0.6, 5.0), Caps(1.0, 1.0)
    bare = feedback(law, tight)
    with_feedforward = feedback(law, tight, feedforward=True)
    np.testing.assert_allclose(with_feedforward - bare, ARM.feedforward(Q_D, V_D, A_D), rtol=1e-9)
    loop = CappedLoop(Controller(law, torque_limit=0.3), ARM, STRIKE, Caps(1e9, 1e9))
    tau = loop.torque(T, Q_D - E, V_D - DE)
    wanted = printed(E, DE, 0.2, 0.6, 5.0) + ARM.gravity_compensation(Q_D - E)
    np.testing.assert_allclose(tau, np.clip(wanted, -0.3, 0.3))
    assert (np.abs(wanted) > 0.3).any()
    masses = (0.1, 0.1, 0.0001)
    compensated = CappedLoop(Controller(law, compensated=masses), ARM, STRIKE, tight).torque(T, Q_D - E, V_D - DE)
    np.testing.assert_allclose(compensated - bare, ARM.gravity_compensation(Q_D - E, masses))


def smallest_inertia() -> float:
    """Of the two-joint arm over all elbow angles, from its mass matrix by hand (Eq. 5's inertia of two links)."""
    m, l, c, I = (MODEL.arm.per_link(x) for x in ("mass", "length", "com", "inertia"))
    least = np.inf
    for elbow in np.linspace(-np.pi, np.pi, 721):
        a = I[0] + m[0] * c[0] ** 2 + I[1] + m[1] * (l[0] ** 2 + c[1] ** 2 + 2 * l[0] * c[1] * np.cos(elbow))
        b = I[1] + m[1] * (c[1] ** 2 + l[0] * c[1] * np.cos(elbow))
        d = I[1] + m[1] * c[1] ** 2
        least = min(least, (a + d) / 2 - np.hypot((a - d) / 2, b))
    return least


@pytest.mark.parametrize(("period", "delay", "rotor"), [(0.002, 0.0, 0.0), (0.002, 0.003, 0.0), (0.01, 0.0, 0.02)])
def test_default_caps_are_half_of_what_the_lightest_posture_carries(period, delay, rotor):
    caps = default_caps(MODEL, period=period, delay=delay, rotor_inertia=rotor)
    I = smallest_inertia() + rotor
    B = I / (period + 2 * delay)
    assert pytest.approx(B, rel=5e-3) == caps.B  # of 200 random postures
    assert pytest.approx(B**2 / (4 * I), rel=5e-3) == caps.K


def test_default_caps_know_of_no_delay_and_no_rotor():
    assert default_caps(MODEL, period=0.002) == default_caps(MODEL, period=0.002, delay=0.0, rotor_inertia=0.0)


def test_default_caps_keep_a_held_delayed_loop_stable():
    """An inertia under `-K q - B v`, computed every period from what was a delay ago and held: it settles at the caps,
    quickly and without much overshoot, and diverges at some five times their damping."""
    inertia, period, delay = 0.05, 0.002, 0.003
    B = 0.5 * inertia / (0.5 * period + delay)
    caps = Caps(B**2 / (4 * inertia), B)

    def swing(factor: float) -> np.ndarray:
        h, q, v, torque, seen = 1e-4, 1.0, 0.0, 0.0, []
        for step in range(4000):
            seen.append((q, v))
            if step % round(period / h) == 0:
                then = seen[max(0, step - round(delay / h))]
                torque = -caps.K * then[0] - factor * caps.B * then[1]
            v += h * torque / inertia
            q += h * v
        return np.array([x for x, _ in seen])

    assert np.abs(swing(1.0)[-500:]).max() < 1e-3
    assert swing(1.0).min() > -0.2
    assert np.abs(swing(5.0)).max() > 1e3


def test_caps_are_positive():
    for bad in ((0.0, 1.0), (1.0, 0.0), (np.nan, 1.0)):
        with pytest.raises(InputError):
            Caps(*bad)
