"""The closed loop and its rotations of symbols: against NumPy's controller and SciPy's rotations."""

from __future__ import annotations

import dataclasses
from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from rich_model import CONTROLLERS, LEMON
from scipy.spatial.transform import Rotation

from whiptool.dynamics.closed_loop import ClosedLoop, closed_loop, rotation_left, turned_by
from whiptool.dynamics.structure import Structure
from whiptool.impedance.controller import Controller
from whiptool.impedance.laws import OIAC, ConstantImpedance, oiac_preset
from whiptool.models import kinematics
from whiptool.models.presets import preset
from whiptool.models.strike import Strike
from whiptool.models.whip import WhipParameters
from whiptool.rollout.compiled import CompiledRollout

V, S = ca.SX.sym("v", 3), ca.SX.sym("s")
TURNED = ca.Function("turned", [V, S], [turned_by(V, S), ca.jacobian(ca.vec(turned_by(V, S)), V)])
A, B = ca.SX.sym("a", 3, 3), ca.SX.sym("b", 3, 3)
LEFT = ca.Function("left", [A, B], [rotation_left(A, B)])


@pytest.mark.parametrize("size", [0.0, 1e-9, 1e-4, 0.7, 3.0])
def test_a_share_of_a_rotation_vector_and_its_derivatives(size):
    vector, share, h = size * np.array([0.0, 0.6, -0.8]), 0.4, 1e-6
    found, slopes = (x.full() for x in TURNED(vector, share))
    np.testing.assert_allclose(found, kinematics.rotation_of(share * vector), atol=1e-14)
    for column, step in zip(slopes.T, h * np.eye(3), strict=True):
        after, before = (kinematics.rotation_of(share * (vector + sign * step)) for sign in (1, -1))
        np.testing.assert_allclose(column.reshape(3, 3).T, (after - before) / (2 * h), atol=1e-8)


def test_what_is_left_is_twice_the_quaternions_vector_part():
    pairs = Rotation.random(40, np.random.default_rng(3)).as_matrix().reshape(20, 2, 3, 3)
    for wanted, present in pairs:
        found = LEFT(wanted, present).full().ravel()
        np.testing.assert_allclose(found, kinematics.rotation_left(wanted, present), atol=1e-9)
    np.testing.assert_allclose(LEFT(np.eye(3), np.eye(3)).full(), 0, atol=1e-15)
    assert np.isfinite(LEFT(np.diag([1.0, -1.0, -1.0]), np.eye(3)).full()).all()  # half a turn


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
