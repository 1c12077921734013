"""The closed loop's integrator: order of convergence, invariants, and motions with closed forms.

Where one pendulum is wanted, the other joint is made to stay: an arm of 1e14 kg hangs at rest below the shoulder, or
a whip of 1e-12 kg follows an arm.
"""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.special import ellipj, ellipk

from whiptool.dynamics.chain import chain_of, kinetic_energy, potential_energy
from whiptool.dynamics.closed_loop import closed_loop
from whiptool.dynamics.integrator import GAMMA
from whiptool.dynamics.structure import Structure
from whiptool.impedance.controller import Controller
from whiptool.impedance.laws import ConstantImpedance
from whiptool.models.parameters import ArmLink, ArmParameters, Model
from whiptool.models.presets import preset
from whiptool.models.whip import WhipParameters

HEAVY = ArmParameters((ArmLink(mass=1e14, length=0.3),))


def roll(model: Model, x0: np.ndarray, h: float, steps: int, tau: np.ndarray | float = 0.0) -> np.ndarray:
    """States (steps + 1, 2 n) under a constant torque of the arm."""
    a = model.arm.n
    none = tuple(map(tuple, np.zeros((a, a))))
    controller = Controller(ConstantImpedance(K=none, B=none), control_period=1.0)
    structure = Structure.of(model, controller)
    assert structure.held
    p = structure.pack(model, controller, np.ones((1, 2 * a + 1)))[0]
    step = closed_loop(structure).step
    states, torque = [np.asarray(x0, float)], np.full(a, tau)
    for i in range(steps):
        states.append(np.array(step(states[-1], i * h, h, p, torque, torque)[0])[:, 0])
    return np.array(states)


def order(errors: list[float]) -> float:
    """Least slope of log error against log step, over steps halved from one error to the next."""
    return float(np.log2(np.array(errors[:-1]) / errors[1:]).min())


# ---------------------------------------------------------------------------------------------------------------------
# Invariants


def undamped(model: Model) -> Model:
    return replace(
        model,
        whip=replace(model.whip, b=0.0),
        arm=replace(model.arm, links=tuple(replace(link, friction=0.0) for link in model.arm.links)),
    )


CURVED = WhipParameters(N=6, l=0.1, m=0.03, k=0.3, b=0.1, rest_angle=0.2, hinge_mass=0.05)
FREE = {
    "lemon2024": undamped(preset("lemon2024")),
    "nah2020-n10": undamped(preset("nah2020-n10")),
    "three joints, curved whip": undamped(
        Model(CURVED, ArmParameters(tuple(ArmLink(mass=0.3, length=0.2, com=0.05, friction=0.1) for _ in range(3))))
    ),
}


def swinging(model: Model) -> np.ndarray:
    rng = np.random.default_rng(3)
    return np.r_[rng.uniform(0.3, 0.8, model.arm.n), rng.uniform(-0.1, 0.1, model.whip.N),
                 rng.uniform(-1, 1, model.n)]  # fmt: skip


def invariants(model: Model) -> ca.Function:
    """Energy [J], and momentum of the first joint [kg m^2/s]: of the whole chain about the shoulder."""
    chain, q, v = chain_of(model), ca.SX.sym("q", model.n), ca.SX.sym("v", model.n)
    T = kinetic_energy(chain, q, v)
    return ca.Function("invariants", [q, v], [T + potential_energy(chain, q), ca.gradient(T, v)[0], T])


@pytest.mark.parametrize("name", FREE)
def test_energy_error_shrinks_with_the_second_order_or_faster(name: str):
    """0.5 s of free swinging, without damping, torque and friction."""
    model = FREE[name]
    x0, n, energy, errors = swinging(model), model.n, invariants(model), []
    for h in (5e-4, 2.5e-4, 1.25e-4):
        states = roll(model, x0, h, round(0.5 / h))
        E = np.array([float(energy(x[:n], x[n:])[0]) for x in states[:: round(0.025 / h)]])
        T = [float(energy(x[:n], x[n:])[2]) for x in states[:: round(0.025 / h)]]
        assert np.ptp(T) > 0.05  # energy does change its form
        errors.append(np.abs(E - E[0]).max())
    assert order(errors) >= 1.9
    assert errors[-1] < 1e-4 * np.ptp(T)


@pytest.mark.parametrize("name", FREE)
def test_angular_momentum_stays_without_gravity(name: str):
    model = replace(FREE[name], gravity=0.0)
    x0, n, momentum, errors = swinging(model), model.n, invariants(model), []
    x0[n:] += 2  # so that there is some
    for h in (5e-4, 2.5e-4, 1.25e-4):
        p = [float(momentum(x[:n], x[n:])[1]) for x in roll(model, x0, h, round(0.25 / h))[:: round(0.025 / h)]]
        errors.append(np.abs(np.array(p) - p[0]).max() / abs(p[0]))
    assert order(errors) >= 1.9
    assert errors[-1] < 1e-6


def test_a_stretched_chain_turns_uniformly_without_gravity():
    """Free fall of a straight chain: an exact solution, and one that the method follows exactly."""
    model = replace(FREE["lemon2024"], gravity=0.0)
    x0 = np.zeros(2 * model.n)
    x0[0], x0[model.n] = 0.3, 4.0
    x = roll(model, x0, 1e-3, 500)
    t = 1e-3 * np.arange(501)
    np.testing.assert_allclose(x[:, 0], 0.3 + 4 * t, rtol=0, atol=1e-11)
    np.testing.assert_allclose(x[:, 1 : model.n], 0, atol=1e-11)


# ---------------------------------------------------------------------------------------------------------------------
# Pendulums


def pendulum(t: np.ndarray, amplitude: float, omega: float) -> np.ndarray:
    """Angle [rad] of a pendulum let go at `amplitude`, omega [rad/s] its small-angle frequency."""
    m = np.sin(amplitude / 2) ** 2
    sn = ellipj(ellipk(m) + omega * t, m)[0]
    return 2 * np.arcsin(np.sqrt(m) * sn)


def whip_pendulum(g: float) -> tuple[Model, int, float]:
    """Model, joint that swings, small-angle frequency."""
    return Model(WhipParameters(N=1, l=0.4, m=0.2, k=0, b=0), HEAVY, gravity=g), 1, np.sqrt(g / 0.4)


def arm_pendulum(g: float) -> tuple[Model, int, float]:
    link = ArmLink(mass=0.8, length=0.5, com=0.2, inertia=0.03)
    whip = WhipParameters(N=1, l=0.4, m=1e-12, k=0, b=0)
    return Model(whip, ArmParameters((link,)), gravity=g), 0, np.sqrt(0.8 * g * 0.2 / (0.03 + 0.8 * 0.2**2))


@pytest.mark.parametrize("make", [whip_pendulum, arm_pendulum])
@pytest.mark.parametrize("amplitude", [0.1, 1.5, 2.8])
def test_pendulum_of_any_amplitude(make, amplitude: float):
    """Against Jacobi's elliptic functions over one period: 1e-3 rad at a thousandth of the period, and order 2."""
    model, joint, omega = make(9.81)
    period = 4 * ellipk(np.sin(amplitude / 2) ** 2) / omega
    x0 = np.zeros(4)
    x0[joint] = amplitude
    errors = []
    for steps in (1000, 2000, 4000):
        x = roll(model, x0, period / steps, steps)[:, joint]
        exact = pendulum(np.linspace(0, period, steps + 1), amplitude, omega)
        errors.append(np.abs(x - exact).max())
    assert exact[-1] == pytest.approx(amplitude)  # the closed form has that period
    assert exact[steps // 2] == pytest.approx(-amplitude)
    assert order(errors) > 1.9
    assert errors[0] < 1e-3


def test_constant_torque_against_viscous_friction():
    """Torque [N m] on an arm alone: v = tau / f (1 - exp(-f t / I))."""
    f, tau, link = 0.05, 0.4, ArmLink(mass=0.8, length=0.5, com=0.2, inertia=0.03, friction=0.05)
    model = Model(WhipParameters(N=1, l=0.4, m=1e-12, k=0, b=0), ArmParameters((link,)), gravity=0.0)
    inertia, t, errors = 0.03 + 0.8 * 0.2**2, 0.5, []
    for steps in (50, 100, 200):
        x = roll(model, np.zeros(4), t / steps, steps, tau)[-1]
        decay = np.exp(-f * t / inertia)
        exact = tau / f * (t - inertia / f * (1 - decay)), tau / f * (1 - decay)
        errors.append(max(abs(x[0] - exact[0]), abs(x[2] - exact[1])))
    assert order(errors) > 1.9
    assert errors[-1] < 1e-5


# ---------------------------------------------------------------------------------------------------------------------
# Springs and dampers


INERTIA = 0.012 * 0.072**2  # [kg m^2] of a node of Table 2 about its joint


def sprung(k: float, b: float, rest: float = 0.0) -> Model:
    """One node of Table 2 on a spring and a damper, without weight."""
    whip = WhipParameters(N=1, l=0.072, m=0.012, k=(k,), b=(b,), rest_angle=(rest,))
    return Model(whip, HEAVY, gravity=0.0)


@pytest.mark.parametrize(
    ("k", "b", "steps"), [(0.01, 1e-4, 200), (0.01, 3e-3, 200), (0.242, 0.092, 1600)], ids=["light", "over", "table2"]
)
def test_spring_and_damper_follow_the_exponential(k: float, b: float, steps: int):
    """From 0.5 rad off and 1 rad/s, over 0.5 s; `table2` decays 1500 times a second at first."""
    generator = np.array([[0, 1], [-k / INERTIA, -b / INERTIA]])
    exact = expm(generator * 0.5) @ [0.5, 1.0] + [0.1, 0]
    errors = []
    for n in (steps, 2 * steps, 4 * steps):
        x = roll(sprung(k, b, 0.1), [0, 0.6, 0, 1.0], 0.5 / n, n)[-1]
        errors.append(np.abs(x[[1, 3]] - exact).max())
    assert order(errors) > 1.9
    assert errors[-1] < 1e-3


@pytest.mark.parametrize("z", [-0.1, -1.0, -10.0, -1e3, -1e6])
def test_a_damper_decays_by_the_methods_stability_function(z: float):
    """R(z) = (1 + (1 - 2 gamma) z) / (1 - gamma z)^2, which vanishes as z grows: stiff joints do not ring."""
    h = -z * INERTIA / 0.092
    v = roll(sprung(0.0, 0.092), [0, 0, 0, 3.0], h, 1)[1, 3]
    R = (1 + (1 - 2 * GAMMA) * z) / (1 - GAMMA * z) ** 2
    assert v == pytest.approx(3.0 * R, rel=1e-9)
    assert abs(R) < 1
    assert pytest.approx(1 - 1 / np.sqrt(2)) == GAMMA
