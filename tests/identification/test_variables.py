"""Free numbers as a solver sees them: transformations, bounds and priors, against densities of SciPy."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from whiptool.errors import InputError
from whiptool.identification.plant import Plant
from whiptool.identification.variables import Prior, room, unit_of, units, variable, variables_of, with_unit
from whiptool.impedance import ConstantImpedance, Controller
from whiptool.impedance.controller import HandControl
from whiptool.models import ArmLink, ArmParameters, Model, WhipParameters, preset
from whiptool.models.presets import rope
from whiptool.models.spatial_arm import JointLimits, SpatialArm, SpatialLink


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("whip.k[3]", "N m/rad"), ("whip.cubic_stiffness", "N m/rad^3"), ("whip.l", "m"), ("whip.drag_ratio", ""),
        ("profile.length", "m"), ("profile.bending_damping", "N m^2 s"), ("profile.density_taper", ""),
        ("arm.inertia[0]", "kg m^2"), ("arm.friction[1]", "N m s/rad"), ("link.dry_friction[0]", "N m"),
        ("law.beta", "s"), ("law.K[0]", "N m/rad"), ("law.a", ""), ("arm.drag", ""),
        ("delay", "s"), ("gravity", "m/s^2"), ("scale", ""), ("clamp", "rad"), ("nobody.k", ""),
    ],
)  # fmt: skip
def test_units(name, unit):
    assert unit_of(name) == unit


def test_every_number_of_a_planar_model_has_its_unit_but_ratios():
    """By what the docstrings say of them, `[N m/rad]` behind each."""
    model = Model(WhipParameters(N=2, l=0.1, m=(0.01, 0.02), k=0.1, b=0.01), ArmParameters((ArmLink(1.0, 0.3),)))
    said = documented(WhipParameters) | documented(ArmLink)
    assert said["cubic_stiffness"] == "N m/rad^3"
    for name in model.parameters():
        quantity = name.rpartition(".")[2].split("[")[0]
        assert unit_of(name) == ("m/s^2" if quantity == "gravity" else said.get(quantity, "")), name
    assert [name for name in model.parameters() if not unit_of(name)] == ["whip.drag_ratio"]


def documented(kind: type) -> dict[str, str]:
    """Units of a dataclass's fields by its docstring: the last brackets of a line that begins with the field."""
    assert kind.__doc__
    fields = re.split(r"\n {8}(?=\w+: )", kind.__doc__)[1:]
    units = {}
    for field in fields:
        name, _, text = field.partition(":")
        found = re.findall(r"\[([^\]]*)\]", text)
        if found:
            units[name] = found[0]
    return units


@pytest.mark.parametrize(
    ("name", "value", "digits", "said"),
    [
        ("whip.k[3]", 0.1234567, 5, "0.12346 N m/rad"), ("delay", 0.01, 5, "0.01 s"), ("law.a", 1.3e-4, 5, "0.00013"),
        ("whip.l", 0.1234567, 2, "0.12 m"), ("gravity", 9.81, 5, "9.81 m/s^2"), ("shift_x", -2e-5, 5, "-2e-05 m"),
    ],
)  # fmt: skip
def test_a_value_is_told_with_its_unit(name, value, digits, said):
    assert with_unit(value, unit_of(name), digits) == said


def test_numbers_of_joints_that_slide_are_per_length():
    """A rail and a hinge: of the gain K[1] the force along the rail per turn of the hinge."""
    body = {"mass": 1.0, "com": (0, 0, 0), "inertia": (0.1, 0.1, 0.1, 0, 0, 0), "axis": (0, 1, 0)}
    rail = SpatialLink(**body, position=(0, 0, 0), kind="prismatic", limits=JointLimits((-1, 1)))
    arm = SpatialArm((rail, SpatialLink(**body, position=(0, 0, -0.3))), ("rail", "wrist"), (0, 0, -0.2))
    gains = ConstantImpedance(((9.0, 0.0), (0.0, 9.0)), ((1.0, 0.0), (0.0, 1.0)))
    plant = Plant(Model(rope(3), arm), Controller(gains, torque_limit=(50.0, 5.0)))
    found = units(plant.model.arm, plant.controller, [name for name in plant.values() if not name.startswith("whip.")])
    assert [found[f"law.K[{i}]"] for i in range(4)] == ["N/m", "N/rad", "N m/m", "N m/rad"]
    assert [found[f"law.B[{i}]"] for i in range(4)] == ["N s/m", "N s/rad", "N m s/m", "N m s/rad"]
    assert [found[f"{x}[{i}]"] for x in ("arm.friction", "torque_limit") for i in range(2)] == [
        "N s/m", "N m s/rad", "N", "N m",
    ]  # fmt: skip
    assert (found["arm.armature[0]"], found["arm.armature[1]"], found["arm.com[0].x"]) == ("kg", "kg m^2", "m")
    assert not [name for name in found if not found[name]]


def test_gains_of_the_hand_are_per_length():
    """In the plane the hand's place has two coordinates."""
    controller = Controller(ConstantImpedance(((9.0, 0.0), (0.0, 9.0)), ((1.0, 0.0), (0.0, 1.0))), hand=HandControl())
    found = units(preset("lemon2024").arm, controller, ["law.K[0]", "law.B[3]", "arm.friction[0]"])
    assert list(found.values()) == ["N/m", "N s/m", "N m s/rad"]


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
    with pytest.raises(InputError, match=r"one of the free parameters whip.k"):
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
