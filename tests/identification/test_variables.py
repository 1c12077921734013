"""Free numbers as a solver sees them: transformations, bounds and priors, against densities of SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from whiptool.errors import InputError
from whiptool.identification.variables import Prior, room, variable, variables_of


def test_positive_numbers_are_logarithms_within_a_factor_of_a_thousand():
    v = variable("whip.k[3]", 0.2)
    assert v.log
    assert v.z(0.2) == pytest.approx(np.log(0.2))
    assert v.value(v.z(0.7)) == pytest.approx(0.7)
    assert v.slope(v.z(0.7)) == pytest.approx(0.7)  # d e^z / dz
    assert np.exp([v.lower, v.upper]) == pytest.approx([0.2e-3, 0.2e3])
    bounded = variable("whip.k", 0.2, (0.1, 0.5))
    assert np.exp([bounded.lower, bounded.upper]) == pytest.approx([0.1, 0.5])
    half = variable("whip.k", 0.2, (-1.0, np.inf))
    assert np.exp([half.lower, half.upper]) == pytest.approx([0.2e-3, 0.2e3])
    for bad in (0.0, -1.0):
        with pytest.raises(InputError, match=r"start of whip.k"):
            variable("whip.k", bad)
    with pytest.raises(InputError, match="lower < upper"):
        variable("whip.k", 0.2, (0.5, 0.5))


@pytest.mark.parametrize(
    ("name", "scale"),
    [
        ("profile.drag", 1e-3), ("whip.drag_ratio", 1.0), ("link.dry_friction[1]", 1e-3), ("whip.cubic_stiffness", 1.0),
        ("whip.hinge_mass", 1e-2), ("profile.tip_mass", 1e-2), ("arm.friction[0]", 1e-2),
        ("profile.bending_damping", 1e-3),
    ],
)  # fmt: skip
def test_what_may_be_zero_is_counted_in_its_usual_size_from_zero(name, scale):
    v = variable(name, 0.0)
    assert (v.log, v.lower, v.upper) == (False, 0.0, np.inf)
    assert v.value(2.0) == pytest.approx(2 * scale)
    assert v.z(v.value(3.5)) == pytest.approx(3.5)
    assert v.slope(7.0) == pytest.approx(scale)
    bounded = variable(name, 0.0, (-scale, 5 * scale))
    assert (bounded.lower, bounded.upper) == (0.0, pytest.approx(5.0))
    above = variable(name, 2 * scale, (2 * scale, 5 * scale))
    assert (above.lower, above.upper) == (pytest.approx(2.0), pytest.approx(5.0))


@pytest.mark.parametrize(
    ("name", "scale"),
    [
        ("whip.rest_angle[2]", 0.1), ("profile.rest_curvature", 0.1), ("delay", 0.01), ("rotation", 0.01),
        ("shift_x", 0.01), ("shift_y", 0.01), ("law.K[1]", 1.0), ("law.B[1]", 0.1),
    ],
)  # fmt: skip
def test_what_has_either_sign_is_counted_in_its_usual_size(name, scale):
    v = variable(name, -1.0, (-3 * scale, 4 * scale))
    assert (v.lower, v.upper) == (pytest.approx(-3.0), pytest.approx(4.0))
    assert v.value(-2.0) == pytest.approx(-2 * scale)
    assert v.slope(-2.0) == pytest.approx(scale)
    assert variable(name, 0.0).lower == -np.inf


def test_slopes_are_those_of_differences():
    for v in (variable("whip.k", 0.3), variable("whip.drag", 0.0), variable("delay", 0.0)):
        h = 1e-6
        assert v.slope(0.4) == pytest.approx((v.value(0.4 + h) - v.value(0.4 - h)) / (2 * h), rel=1e-6)


def test_a_fit_starts_off_its_bounds():
    wide = variable("delay", 0.0, (-0.1, 0.1))  # -10 .. 10 in units of 0.01 s
    assert wide.off_bounds(-10.0) == pytest.approx(-9.95)
    assert wide.off_bounds(99.0) == pytest.approx(9.95)
    assert wide.off_bounds(1.3) == 1.3
    narrow = variable("delay", 0.0, (0.0, 0.002))  # 0 .. 0.2: 5 % of the range
    assert narrow.off_bounds(0.0) == pytest.approx(0.01)
    assert narrow.off_bounds(0.2) == pytest.approx(0.19)
    open_ended = variable("whip.drag", 0.0)
    assert open_ended.off_bounds(0.0) == pytest.approx(0.05)


def test_a_priors_rows_are_its_normal_distribution():
    """Half the squared rows are the negative logarithm of the density in the solver's numbers, up to a constant."""
    variables = [variable("whip.k", 0.3), variable("gravity", 9.81), variable("delay", 0.0), variable("whip.m", 0.02)]
    covariance = np.array([[0.04, 1e-3, 0.002], [1e-3, 4e-4, 1e-4], [0.002, 1e-4, 0.09]])
    prior = Prior(("whip.m", "delay", "whip.k"), (0.02, 0.01, 0.3), covariance)
    W, mean = prior.rows(variables)
    assert W.shape == (3, 4)
    assert not W[:, 1].any()
    units = np.array([1.0, 0.01, 1.0])
    density = multivariate_normal([np.log(0.02), 1.0, np.log(0.3)], covariance / np.outer(units, units))
    rng = np.random.default_rng(0)
    best = density.logpdf(density.mean)
    for _ in range(10):
        z = mean + rng.normal(0, 1, 4)
        r = W @ (z - mean)
        assert r @ r / 2 == pytest.approx(best - density.logpdf([z[3], z[2], z[0]]))


def test_priors_are_checked():
    with pytest.raises(InputError, match="2 means"):
        Prior(("a",), (1.0, 2.0), np.eye(1))
    with pytest.raises(InputError, match="covariance"):
        Prior(("a", "b"), (1.0, 2.0), np.eye(1))
    for bad in (np.array([[1.0, 2.0], [2.0, 1.0]]), np.array([[1.0, 0.5], [0.0, 1.0]]), np.zeros((2, 2))):
        with pytest.raises(InputError, match="positive definite"):
            Prior(("a", "b"), (1.0, 2.0), bad)
    with pytest.raises(InputError, match=r"one of the free numbers whip.k"):
        Prior(("whip.m",), (1.0,), np.eye(1)).rows([variable("whip.k", 0.3)])


def test_the_room_of_an_unknown():
    """A factor of e of what is positive, ten usual sizes of what may be zero; an inertia may fall by as many factors
    of e as a rod of the link's mass and length (m l^2 / 12) has of it, and never by less than one."""
    inertia, mass = variable("link.inertia[1]", 1e-4), variable("link.mass[1]", 0.3)
    drag, delay = variable("whip.drag", 0.0), variable("delay", 0.0)
    values = {"link.mass[1]": 0.3, "link.length[1]": 0.2, "link.mass[0]": 9.0, "link.length[0]": 9.0}
    z = np.array([inertia.z(1e-4), mass.z(0.3), 0.5, -3.0])
    rod = 0.3 * 0.2**2 / 12  # 1e-3 kg m^2
    assert room([inertia, mass, drag, delay], z, values) == pytest.approx([rod / 1e-4, 1.0, 10.0, 30.0])
    z[0] = inertia.z(5e-3)
    assert room([inertia], z[:1], values) == pytest.approx([1.0])


def test_variables_by_name_and_their_bounds():
    found = variables_of({"whip.k": 0.3, "whip.m": 0.1, "delay": 0.0}, ["delay", "whip.k"], {"whip.k": (0.1, 0.9)}, {})
    assert [v.name for v in found] == ["delay", "whip.k"]
    assert np.exp(found[1].upper) == pytest.approx(0.9)
    with pytest.raises(InputError, match=r"bounds of whip.m"):
        variables_of({"whip.k": 0.3, "whip.m": 0.1}, ["whip.k"], {"whip.m": (0.1, 0.9)}, {})


def test_a_number_knows_which_bound_it_lies_at():
    v = variable("whip.k", 0.2, (0.1, 0.5))
    assert [v.bound(z) for z in (v.lower, v.lower + 1e-3, v.z(0.2), v.upper - 1e-9, v.upper)] == [
        "lower", "", "", "upper", "upper",
    ]  # fmt: skip
    assert variable("whip.drag", 0.0).bound(0.0) == "lower"
