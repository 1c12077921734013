"""The cost of Eqs. 5-7 against its definition."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from whiptool.errors import InputError
from whiptool.impedance import ConstantImpedance, Controller, impedance_cost
from whiptool.impedance.arm import Arm
from whiptool.models import preset
from whiptool.models.strike import Strike
from whiptool.rollout import CompiledRollout


def test_cost_of_a_strike_against_its_definition():
    """Eq. 6 by Riemann sum on the trajectory's own steps, Eq. 7 by integrating dV/dt with finite differences."""
    model, law = preset("lemon2024"), ConstantImpedance()
    strike = Strike.from_vector([-1.2, 0.9, 1.2, 0.3, 0.7])
    path = CompiledRollout(model, Controller(law), timestep=1e-4).trajectory(strike, t_stay=0.0)
    cost = impedance_cost(path, model, D=strike.D, beta=0.6)
    K, B = np.array(law.K), np.array(law.B)
    assert cost.J_c == pytest.approx(0.5 * strike.D * ((K**2).sum() + (B**2).sum()), rel=1e-9)
    arm = Arm(model)
    epsilon = (path.q_d - path.q[:, :2]) + 0.6 * (path.v_d - path.v[:, :2])
    V = np.array([0.5 * x @ arm.inertia(q) @ x for x, q in zip(epsilon, path.q[:, :2], strict=True)])
    assert cost.J_p == pytest.approx(np.trapezoid(np.gradient(V, path.t), path.t), rel=1e-3)
    assert pytest.approx(cost.J_c + cost.J_p) == cost.J
    heavier = impedance_cost(path, model, D=strike.D, beta=0.6, Q_K=2 * np.eye(4), Q_B=2 * np.eye(4))
    assert heavier.J_c == pytest.approx(2 * cost.J_c)
    with pytest.raises(InputError, match="Q_K"):
        impedance_cost(path, model, D=strike.D, beta=0.6, Q_K=np.eye(2))
    with pytest.raises(InputError, match="trajectory"):
        impedance_cost(path, model, D=2.0, beta=0.6)


def test_stored_error_is_counted_from_the_first_instant():
    """Eq. 7 at D less Eq. 7 at 0, of a coarse path that begins off its reference."""
    model, law = preset("lemon2024"), ConstantImpedance()
    strike = Strike.from_vector([-1.2, 0.9, 1.2, 0.3, 0.7])
    path = CompiledRollout(model, Controller(law), timestep=1e-3).trajectory(strike, t_stay=0.0)
    some = np.linspace(0, len(path.t) - 1, 6).astype(int)
    names = ("t", "q", "v", "q_d", "v_d", "tau", "K", "B", "tip", "tip_velocity")
    coarse = replace(path, **{name: np.array(getattr(path, name))[some] for name in names})
    coarse.q[:, :2] += np.array([0.3, -0.2])
    arm = Arm(model)
    ends = []
    for i in (0, -1):
        epsilon = coarse.q_d[i] - coarse.q[i, :2] + 0.6 * (coarse.v_d[i] - coarse.v[i, :2])
        ends.append(0.5 * epsilon @ arm.inertia(coarse.q[i, :2]) @ epsilon)
    cost = impedance_cost(coarse, model, D=float(coarse.t[-1]), beta=0.6)
    assert cost.J_p == pytest.approx(ends[1] - ends[0], rel=1e-9)
