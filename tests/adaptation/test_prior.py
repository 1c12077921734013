"""Beliefs: a normal distribution over a plant's numbers, its samples, its bounds, and what a fit is told of it."""

from __future__ import annotations

import numpy as np
import pytest

from whiptool.adaptation.prior import Belief
from whiptool.errors import InputError
from whiptool.identification.plant import Plant
from whiptool.identification.variables import variable
from whiptool.impedance import OIAC, Controller
from whiptool.models import preset

PLANT = Plant(preset("lemon2024"), Controller(OIAC()))
NAMES = ("whip.k", "arm.friction[0]", "delay", "whip.l")
ROOT = np.array([[0.2, 0, 0, 0], [0.1, 0.3, 0, 0], [0, 0.2, 0.4, 0], [0.05, 0, 0.1, 0.1]])
Z = np.array([np.log(0.3), 1.5, -0.7, np.log(0.08)])
BELIEF = Belief(PLANT, NAMES, Z, ROOT @ ROOT.T)


def test_the_means_numbers():
    """Logarithms of positive numbers; friction and delay in hundredths."""
    assert BELIEF.values() == pytest.approx({"whip.k": 0.3, "arm.friction[0]": 0.015, "delay": -0.007, "whip.l": 0.08})
    assert BELIEF.at().values()["whip.l"] == pytest.approx(0.08)
    assert BELIEF.at().values()["arm.friction[0]"] == pytest.approx(0.015)
    other = {name: x for name, x in BELIEF.at().values().items() if name not in NAMES}
    assert other == {name: x for name, x in PLANT.values().items() if name not in NAMES}
    moved = BELIEF.values(Z + np.array([np.log(2), 1.0, 0.0, 0.0]))
    assert moved["whip.k"] == pytest.approx(0.6)
    assert moved["arm.friction[0]"] == pytest.approx(0.025)


def test_numbers_stay_within_their_bounds():
    """Friction is not negative; a length stays within a factor of a thousand."""
    far = BELIEF.values(Z + np.array([0.0, -5.0, 0.0, 20.0]))
    assert far["arm.friction[0]"] == 0.0
    assert far["whip.l"] == pytest.approx(1000 * PLANT.values()["whip.l"])


def test_errors_are_relative_or_in_the_numbers_own_unit():
    errors = np.sqrt((ROOT**2).sum(axis=1))
    assert BELIEF.errors() == pytest.approx(dict(zip(NAMES, errors * [1, 0.01, 0.01, 1])))


def test_errors_in_a_file_are_in_the_unit_of_the_values():
    table, errors = BELIEF.to_table(), np.sqrt((ROOT**2).sum(axis=1))
    values = np.array(list(table["values"].values()))
    assert list(table["errors"].values()) == pytest.approx(errors * [values[0], 0.01, 0.01, values[3]])


def test_samples_have_the_mean_and_covariance():
    numbers = ("whip.k", "whip.l", "arm.friction[0]")
    drawn = [plant.values() for plant in BELIEF.sample(np.random.default_rng(0), 1601)]
    z = np.array([[np.log(x["whip.k"]), np.log(x["whip.l"]), x["arm.friction[0]"] / 0.01] for x in drawn])
    assert len(z) == 1601
    chosen = [NAMES.index(name) for name in numbers]
    np.testing.assert_allclose(z[:-1].mean(axis=0), Z[chosen], atol=1e-9)  # every draw has its mirror image
    np.testing.assert_allclose(z[0] + z[1], 2 * Z[chosen])
    np.testing.assert_allclose(np.cov(z.T), (ROOT @ ROOT.T)[np.ix_(chosen, chosen)], atol=0.015)
    again = BELIEF.sample(np.random.default_rng(0), 3)
    assert [x.values() for x in again] == drawn[:3]


def test_a_fit_is_told_the_same_distribution():
    """The prior's rows in the solver's numbers, squared: the distance of Mahalanobis."""
    prior = BELIEF.as_prior()
    variables = [variable(name, {**PLANT.values(), "delay": 0.0}[name]) for name in NAMES]
    W, mean = prior.rows(variables)
    np.testing.assert_allclose(mean, Z)
    for z in np.random.default_rng(1).normal(0, 1, (5, 4)) + Z:
        expected = (z - Z) @ np.linalg.solve(ROOT @ ROOT.T, z - Z)
        assert ((W @ (z - mean)) ** 2).sum() == pytest.approx(expected)


def test_what_does_not_fit_is_refused():
    for names, z, covariance, said in (
        (("whip.k", "whip.colour"), Z[:2], np.eye(2), "one of"),
        (("whip.k",), Z[:2], np.eye(2), "shapes"),
        (("whip.k", "whip.l"), Z[:2], np.eye(3), "shapes"),
    ):
        with pytest.raises(InputError, match=said):
            Belief(PLANT, names, z, covariance)


def test_in_and_out_of_a_table():
    again = Belief.from_table(PLANT, BELIEF.to_table())
    np.testing.assert_array_equal(again.z, BELIEF.z)
    np.testing.assert_array_equal(again.covariance, BELIEF.covariance)
    assert (again.names, again.model_error) == (BELIEF.names, BELIEF.model_error)
    with pytest.raises(InputError, match="belief"):
        Belief.from_table(PLANT, {"names": ["whip.k"]})
