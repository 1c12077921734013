"""How a strike starts: where weight and springs balance, against the minimum of the energy and against differences."""

from __future__ import annotations

import dataclasses

import numpy as np
import pinocchio as pin
import pytest
from random_space import bent, passive, pinocchio_of, random_model
from rich_model import everything
from scipy.optimize import minimize
from start_slopes import check_start_slopes

from whiptool.dynamics.posture import _settle, hangs_straight, hinge_is_free, start_derivative, start_posture
from whiptool.dynamics.structure import Structure
from whiptool.impedance import ConstantImpedance, Controller
from whiptool.models import preset
from whiptool.models.parameters import Model
from whiptool.models.strike import Strike
from whiptool.models.whip import WhipParameters
from whiptool.rollout import CompiledRollout

LEMON = preset("lemon2024")
POSTURES = np.array([[-1.2, 0.4], [0.3, 1.0], [0.0, 0.0]])


def whip(**changes) -> Model:
    numbers = {"N": 4, "l": 0.15, "m": 0.01, "k": 0.02, "b": 0.01, "cubic_stiffness": 0.03, **changes}
    return dataclasses.replace(LEMON, whip=WhipParameters(**numbers))


CURVED = whip(rest_angle=0.3)
SPRUNG = whip(k=(0.02, 0.02, 0.03, 0.02), rest_angle=(0.2, -0.3, 0.4, 0.1))  # a spring at the hinge, too


def energy(model: Model, q: np.ndarray) -> float:
    """Weight and springs of the whip's joints q behind an arm's posture, written out anew."""
    w, a = model.whip, model.arm.n
    theta = np.cumsum(q)
    depth = -np.cumsum(w.per_node("l") * np.cos(theta[a:]))
    bend = q[a:] - w.per_node("rest_angle")
    springs = w.per_node("k") * bend**2 / 2 + w.per_node("cubic_stiffness") * bend**4 / 4
    return float(model.gravity * w.per_node("m") @ depth + springs.sum())


@pytest.mark.parametrize("model", [CURVED, SPRUNG], ids=["curved", "sprung hinge"])
def test_a_bent_whip_starts_where_its_energy_is_least(model):
    for posture, found in zip(POSTURES, start_posture(model, POSTURES)):
        np.testing.assert_array_equal(found[:2], posture)
        whole = lambda x, p=posture: energy(model, np.r_[p, x])  # noqa: E731
        hanging = np.r_[-posture.sum(), np.zeros(3)]
        least = minimize(whole, hanging, method="BFGS", options={"gtol": 1e-9})
        np.testing.assert_allclose(found[2:], least.x, atol=1e-5)
        assert whole(found[2:]) <= least.fun + 1e-12


def test_a_straight_whip_hangs_straight_down():
    found = start_posture(LEMON, POSTURES)
    np.testing.assert_allclose(found[:, 2], [0.8, -1.3, 0.0])
    np.testing.assert_array_equal(found[:, 3:], 0)
    np.testing.assert_allclose(np.cumsum(found, axis=1)[:, 2:], 0, atol=1e-15)


def test_a_free_hinge_keeps_the_whips_shape():
    """The whole whip turns with the arm, so that every node has the same angle in the world."""
    world = np.cumsum(start_posture(CURVED, POSTURES), axis=1)[:, 2:]
    np.testing.assert_allclose(world, np.tile(world[2], (3, 1)), atol=1e-12)
    world = np.cumsum(start_posture(SPRUNG, POSTURES), axis=1)[:, 2:]
    assert np.ptp(world, axis=0).min() > 1e-3


def test_which_whips_hang_straight():
    assert hangs_straight(LEMON)
    assert hinge_is_free(LEMON)
    assert hinge_is_free(CURVED)
    assert not hangs_straight(CURVED)
    for stiff in (
        whip(k=(0.02, 0.02, 0.02, 0.02), cubic_stiffness=0.0),
        whip(k=0.02, cubic_stiffness=(0.01, 0.0, 0.0, 0.0)),
    ):
        assert not hinge_is_free(stiff)
        assert not hangs_straight(stiff)


@pytest.mark.parametrize("model", [LEMON, CURVED, SPRUNG], ids=["straight", "curved", "sprung hinge"])
def test_starts_change_with_the_parameters_as_differences_say(model):
    controller = Controller()
    structure = Structure.of(model, controller)
    strikes = np.hstack([POSTURES, np.zeros((3, 2)), np.ones((3, 1))])
    p = structure.pack(model, controller, strikes)
    names = ("whip.k", "whip.m", "whip.l", *(("whip.rest_angle",) if model is not LEMON else ()))

    def moved(dq_i: np.ndarray, name: str, factor: float) -> tuple[Model, np.ndarray]:
        value = getattr(model.whip, name.split(".")[1])
        scaled = tuple(factor * x for x in value) if isinstance(value, tuple) else factor * value
        return dataclasses.replace(model, whip=dataclasses.replace(model.whip, **{name.split(".")[1]: scaled})), (
            POSTURES + dq_i
        )

    for name in names:
        h, dq_i = 1e-6, np.array([0.3, -0.7])
        ahead, behind = (moved(s * h * dq_i, name, 1 + s * h) for s in (1, -1))
        packed = [structure.pack(m, controller, np.hstack([q, strikes[:, 2:]])) for m, q in (ahead, behind)]
        dp = (packed[0] - packed[1]) / (2 * h)
        found = start_derivative(model, structure, start_posture(model, POSTURES), p, dp)
        by_difference = (start_posture(*ahead) - start_posture(*behind)) / (2 * h)
        np.testing.assert_allclose(found, by_difference, atol=1e-6)


def test_many_starts_at_once_are_each_as_alone():
    """More than fit into one call."""
    rng = np.random.default_rng(0)
    postures = rng.uniform(-1, 1, (30, 2))
    controller = Controller()
    structure = Structure.of(SPRUNG, controller)
    p = structure.pack(SPRUNG, controller, np.hstack([postures, np.zeros((30, 2)), np.ones((30, 1))]))
    dp = rng.normal(size=p.shape) * 1e-3 * np.abs(p)
    q = start_posture(SPRUNG, postures)
    together = start_derivative(SPRUNG, structure, q, p, dp)
    for i in (0, 23, 24, 29):
        alone = start_derivative(SPRUNG, structure, q[i : i + 1], p[i : i + 1], dp[i : i + 1])
        np.testing.assert_allclose(together[i], alone[0], atol=1e-12)


def test_a_whip_with_rest_angles_starts_at_rest():
    """Held in its start posture by a stiff arm, a curved whip stays where it is."""
    model = everything()
    still = Strike((-0.5, 0.3), (-0.5, 0.3), 0.5)
    stiff = Controller(ConstantImpedance(K=((1e4, 0), (0, 1e4)), B=((1e2, 0), (0, 1e2))), torque_limit=1e3)
    path = CompiledRollout(model, stiff).trajectory(still, t_stay=0.0)
    assert np.abs(path.tip - path.tip[0]).max() < 2e-4  # the arm sags a little
    assert abs(path.q[0, 3:]).max() > 0.01


def test_behind_a_free_hinge_the_whips_shape_does_not_know_the_arm():
    """Each posture as found alone, from straight down; and a spring at the hinge, where it does."""
    model = everything()
    free = {name: (0.0, *model.whip.per_node(name)[1:].tolist()) for name in ("k", "cubic_stiffness")}
    whip = dataclasses.replace(model.whip, **free)
    cubic = dataclasses.replace(whip, cubic_stiffness=model.whip.cubic_stiffness)
    q_i = np.random.default_rng(3).uniform(-1.5, 1.5, (5, 2))
    for changed in (dataclasses.replace(model, whip=w) for w in (whip, cubic, model.whip)):
        q = start_posture(changed, q_i)
        for row in q:
            one = row.copy()
            one[2:] = 0.0
            one[2] = -row[:2].sum()
            _settle(changed, one[None])
            np.testing.assert_allclose(row, one, atol=1e-10)
        absolute = q[:, 2] + q[:, :2].sum(axis=1)
        bent_alike = np.ptp(q[:, 3:], axis=0).max() < 1e-10 and np.ptp(absolute) < 1e-10
        assert bent_alike == hinge_is_free(changed) == (changed.whip is whip)


# ---------------------------------------------------------------------------------------------------------------------
# In space


@pytest.mark.parametrize("kind", ["straight", "sprung", "bent"])
def test_a_whip_in_space_starts_in_static_balance(kind: str):
    """A free first joint: straight down. Else where nothing pulls, and no torque is needed but the arm's."""
    for seed in range(3):
        model = random_model(seed, 3, 5)
        if kind != "sprung":
            model = dataclasses.replace(model, whip=dataclasses.replace(model.whip, k=0.2, cubic_stiffness=0.1))
        if kind == "bent":
            model = bent(model, seed)
        q_i = np.random.default_rng(seed).uniform(-1, 1, (4, 3))
        q = start_posture(model, q_i)
        its = pinocchio_of(model)
        for row, arm in zip(q, q_i, strict=True):
            np.testing.assert_array_equal(row[:3], arm)
            weight = pin.computeGeneralizedGravity(its, its.createData(), row)
            assert np.abs((weight - passive(model, row, 0 * row))[3:]).max() < 1e-10
            data = its.createData()
            pin.forwardKinematics(its, data, row)
            down = -np.array([data.oMi[its.getJointId(f"y{i}")].rotation[:, 2] for i in range(5)])
            straight = np.abs(down - [0, 0, -1]).max() < 1e-9
            assert straight == (kind == "straight")


@pytest.mark.parametrize("kind", ["straight", "sprung", "bent"])
def test_a_start_in_space_moves_as_differences_say(kind: str):
    model, names = random_model(5, 3, 4), ["gravity", "arm.mass[1]"]
    if kind != "sprung":
        model = dataclasses.replace(model, whip=dataclasses.replace(model.whip, k=0.2, cubic_stiffness=0.0))
    if kind == "bent":
        model = bent(model)
    if kind != "straight":
        names = ["whip.m[3]", "whip.k[1]"] if kind == "sprung" else ["whip.rest_angle[1]", "whip.rest_angle_x[2]"]
    check_start_slopes(model, np.array([0.3, -0.4, 0.6]), names, rtol=1e-6)
