"""Units of free numbers by their names."""

from __future__ import annotations

import re

import pytest

from whiptool.identification.parameter_units import unit_of, with_unit
from whiptool.identification.plant import Plant, units
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
    found = units(plant, [name for name in plant.values() if not name.startswith("whip.")])
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
    found = units(Plant(preset("lemon2024"), controller), ["law.K[0]", "law.B[3]", "arm.friction[0]"])
    assert list(found.values()) == ["N/m", "N s/m", "N m s/rad"]
