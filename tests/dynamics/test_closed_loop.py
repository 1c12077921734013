"""The closed loop's generated code, its reference, and its order of convergence."""

from __future__ import annotations

import dataclasses
from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from rich_model import CONTROLLERS, LEMON

from whiptool.dynamics.closed_loop import ClosedLoop, Structure, closed_loop
from whiptool.impedance.constant import ConstantImpedance
from whiptool.impedance.controller import Controller
from whiptool.impedance.oiac import OIAC, oiac_preset
from whiptool.models.parameters import WhipParameters
from whiptool.models.presets import preset
from whiptool.models.strike import Strike
from whiptool.rollout.compiled import CompiledRollout


def test_a_joint_takes_one_division():
    """CasADi writes a product with a reciprocal as a division, each as slow as five products."""
    functions = closed_loop(Structure.of(LEMON, CONTROLLERS["oiac"])).functions
    for name in ("outward", "inward", "accelerate", "predict", "advance"):
        f = functions[name]
        divisions = [f.instruction_id(k) in (ca.OP_DIV, ca.OP_INV) for k in range(f.n_instructions())]
        assert sum(divisions) == (1 if name == "inward" else 0), name


def test_generated_code_does_not_grow_with_the_whip():
    sizes = []
    for N in (5, 40):
        model = dataclasses.replace(LEMON, whip=WhipParameters(N=N, l=0.9 / N, m=0.2 / N, k=0.1, b=0.1))
        system = closed_loop(Structure.of(model, CONTROLLERS["oiac"]))
        sizes.append([f.n_instructions() for name, f in system.functions.items() if name != "react"])
    assert sizes[0] == sizes[1]


STRIKES = [
    Strike((-1.0, 1.0), (1.5, 0.5), 0.6),
    Strike((-0.8, 0.3), (2.0, 1.5), 0.6),
    Strike((-1.4, 2.0), (1.0, 0.1), 0.6),
]
LOOPS = {
    "constant": (Controller(ConstantImpedance()), 5e-4),
    "constant, feedforward": (Controller(ConstantImpedance(), feedforward=True), 5e-4),
    "OIAC printed": (Controller(OIAC()), 2.5e-4),
    "OIAC table4": (Controller(oiac_preset("table4")), 6.25e-5),
}


@pytest.mark.parametrize("name", [pytest.param(x, marks=[pytest.mark.slow] * ("feedforward" in x)) for x in LOOPS])
def test_the_closed_loop_is_of_second_order(name: str):
    """Richardson: states over the whole strike and 0.2 s more, at h, h/2, h/4, root mean square."""
    controller, h = LOOPS[name]
    rollouts = [CompiledRollout(preset("lemon2024"), controller, timestep=h / 2**i) for i in range(3)]
    squares = []
    for strike in STRIKES:
        trajectories = [rollout.trajectory(strike, t_stay=0.2) for rollout in rollouts]
        assert not any(x.diverged for x in trajectories)
        q = [x.q[:: 2**i] for i, x in enumerate(trajectories)]  # at the same times
        squares.append([((a - b) ** 2).mean() for a, b in pairwise(q)])
    coarse, fine = np.sqrt(np.mean(squares, axis=0))
    assert 1.85 < np.log2(coarse / fine) < 2.15
    assert fine < 1e-4


def test_compiled_reference_is_the_strikes_before_during_and_after():
    strike, t = Strike((0.0, 0.1), (1.0, -1.0), 0.5), ca.SX.sym("t")
    loop = ClosedLoop(Structure.of(preset("lemon2024"), Controller(ConstantImpedance())))
    loop.parameters.update({"q_i": ca.DM(strike.q_i), "q_f": ca.DM(strike.q_f), "D": ca.DM(strike.D)})
    compiled = ca.Function("reference", [t], loop.reference(t))
    for at in (-0.3, 0.0, 0.2, 0.5, 0.8):
        for ours, its in zip(strike.reference(at), compiled(at), strict=True):
            np.testing.assert_allclose(ours, np.asarray(its)[:, 0], atol=1e-12)
