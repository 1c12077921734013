"""Columns and structures of the compiled code, and derivatives of its parameters against differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rich_model import CONTROLLERS, LEMON, everything

from whiptool.dynamics.structure import (
    PROFILE,
    ArmShape,
    Columns,
    Structure,
    arm_column,
    outcome_columns,
    parameter_directions,
    row_columns,
)
from whiptool.errors import InputError
from whiptool.impedance import OIAC, ConstantImpedance, Controller
from whiptool.models import WhipProfile, preset
from whiptool.models.spatial_arm import SpatialArm


def test_blocks_stand_where_concatenation_puts_them():
    sizes = {"first": 2, "none": 0, "one": 1, "last": 5}
    parts = {name: np.full(size, k) for k, (name, size) in enumerate(sizes.items())}
    row, columns = np.concatenate(list(parts.values())), Columns(sizes)
    assert list(columns) == list(sizes)
    assert columns.width == len(row) == 8
    for name, part in parts.items():
        np.testing.assert_array_equal(row[columns[name]], part)


def test_no_blocks_have_no_width():
    assert Columns({}).width == 0
    assert Columns({}).constants("OUT") == {"OUT": 0}


def test_constants_say_the_width_and_where_each_block_begins():
    found = Columns({"t": 1, "x": 4, "tau": 2}).constants("ROW")
    assert found == {"ROW": 7, "ROW_t": 0, "ROW_x": 1, "ROW_tau": 5}


@pytest.mark.parametrize(("n", "a", "d"), [(4, 1, 2), (12, 2, 2), (54, 4, 3)])
def test_a_row_holds_time_state_torques_and_the_tip(n: int, a: int, d: int):
    """Every number of a row is in exactly one block, in the order that the docstring gives."""
    columns = row_columns(n, a, d)
    state, row = np.arange(2 * n), np.r_[-1.0, np.arange(2 * n), np.full(a, -2.0), np.full(d, -3.0), np.full(d, -4.0)]
    assert columns.width == len(row)
    np.testing.assert_array_equal(row[columns["x"]], state)
    for name, value, size in (("t", -1, 1), ("tau", -2, a), ("tip", -3, d), ("velocity", -4, d)):
        assert row[columns[name]].tolist() == [value] * size


@pytest.mark.parametrize(("a", "d"), [(1, 2), (2, 2), (7, 3)])
def test_an_outcome_has_every_number_once(a: int, d: int):
    columns = outcome_columns(a, d)
    covered = np.concatenate([np.arange(columns.width)[block] for block in columns.values()])
    np.testing.assert_array_equal(covered, np.arange(5 + 4 * d + 7 * a))
    sizes = {name: block.stop - block.start for name, block in columns.items()}
    of_tip = {"velocity", "tip", "tip_slope", "velocity_slope"}
    of_joints = {"max_joint_speed", "max_torque", "lowest", "highest", "effort", "effort_slope", "max_torque_slope"}
    assert of_tip | of_joints | {"distance", "time", "diverged", "last_step", "slope"} == set(sizes)
    assert {name for name, size in sizes.items() if size == d and name in of_tip} == of_tip
    assert all(sizes[name] == a for name in of_joints)


UR5E = preset("ur5e")
PLAIN = Controller(ConstantImpedance())


@pytest.mark.parametrize(
    ("changes", "optional"),
    [
        ({}, ()),
        ({"rest_angle": 0.1}, ("rest_angle",)),
        ({"drag": 0.01, "dry_friction": 0.1}, ("dry_friction", "drag")),
        ({"drag": 0.01, "drag_ratio": 0.3}, ("drag", "drag_ratio")),
        ({"drag_ratio": 0.3}, ()),  # nothing is dragged
        ({"hinge_mass": 0.05}, ("hinge_mass",)),
        ({"cubic_stiffness": (0.0,) * 11 + (0.2,)}, ("cubic_stiffness",)),
        ({"node_inertia": 1e-5, "hinge_mass": 0.05}, ("node_inertia", "hinge_mass")),
    ],
)
def test_terms_are_generated_only_where_they_act(changes: dict, optional: tuple[str, ...]):
    model = replace(LEMON, whip=replace(LEMON.whip, **changes))
    assert Structure.of(model, PLAIN).optional == optional


@pytest.mark.parametrize(
    ("free", "optional"),
    [
        (["whip.rest_angle[2]"], ("rest_angle",)),
        (["whip.friction_velocity"], ("dry_friction",)),  # says nothing without friction
        (["whip.drag_ratio"], ("drag", "drag_ratio")),
        (["whip.hinge_mass"], ("hinge_mass",)),
        (["whip.node_inertia"], ("node_inertia",)),
        (["whip.k[3]", "q_si"], ()),
    ],
)
def test_terms_of_free_parameters_are_generated(free: list[str], optional: tuple[str, ...]):
    found = Structure.of(LEMON, PLAIN, free=free)
    assert found.optional == optional
    assert Structure.of(LEMON, PLAIN) in found
    assert (found in Structure.of(LEMON, PLAIN)) == (not optional)


def test_a_structure_holds_no_other_kind_of_loop():
    mine = Structure.of(everything(), PLAIN)
    for other in (
        Structure.of(everything(), Controller(OIAC())),
        Structure.of(everything(), replace(PLAIN, feedforward=True)),
        Structure.of(everything(), replace(PLAIN, control_period=0.01)),
        Structure.of(UR5E, PLAIN),
        replace(mine, n_whip=mine.n_whip + 1),
    ):
        assert other not in mine
        assert mine not in other


@pytest.mark.parametrize("name", CONTROLLERS)
def test_every_number_of_a_model_stands_in_its_column(name: str):
    """Each block, read back by its columns, is what the model says; together they are the whole vector."""
    model, controller = everything(), CONTROLLERS[name]
    structure = Structure.of(model, controller)
    strikes = np.random.default_rng(0).uniform(0.2, 1, (3, 5))
    p = structure.pack(model, controller, strikes)
    assert p.shape == (3, structure.n_parameters) == (3, sum(structure.layout.values()))
    taken = np.concatenate([np.arange(p.shape[1])[structure.columns(block)] for block in structure.layout])
    np.testing.assert_array_equal(taken, np.arange(p.shape[1]))

    def read(block: str) -> np.ndarray:
        np.testing.assert_array_equal(np.ptp(p[:, structure.columns(block)], axis=0), 0)  # the same in all strikes
        return p[0, structure.columns(block)]

    np.testing.assert_array_equal(p[:, :5], strikes)
    assert [structure.columns(x) for x in ("q_i", "q_f", "D")] == [slice(0, 2), slice(2, 4), slice(4, 5)]
    for quantity in ("length", "mass", "com", "inertia", "friction"):
        np.testing.assert_array_equal(read(f"arm.{quantity}"), model.arm.per_link(quantity))
    for quantity in ("l", "m", "k", "b", "rest_angle", "dry_friction", "drag", "cubic_stiffness", "node_inertia"):
        np.testing.assert_array_equal(read(f"whip.{quantity}"), model.whip.per_node(quantity))
    for quantity in ("drag_ratio", "hinge_mass", "friction_velocity"):
        assert read(f"whip.{quantity}") == getattr(model.whip, quantity)
    assert read("gravity") == model.gravity
    for quantity, value in controller.law.parameters().items():
        np.testing.assert_array_equal(read(f"law.{quantity}"), np.ravel(value))
    assert ("torque_limit" in structure.layout) == (controller.torque_limit is not None)
    if controller.torque_limit is not None:
        assert read("torque_limit") == controller.torque_limit
    assert structure.held == (controller.control_period is not None)


def test_limits_and_masses_of_the_controller_have_their_blocks():
    controller = Controller(ConstantImpedance(), torque_limit=(3.0, 4.0), compensated=(1.0, 2.0, 0.5))
    structure = Structure.of(LEMON, controller)
    p = structure.pack(LEMON, controller, np.ones((1, 5)))[0]
    assert p[structure.columns("torque_limit")].tolist() == [3, 4]
    assert p[structure.columns("compensated")].tolist() == [1, 2, 0.5]
    assert structure.limits == 2
    assert structure.compensated


@pytest.mark.parametrize(
    ("name", "place"),
    [
        ("arm.mass[3]", ("mass", 3)),
        ("arm.com[1].x", ("com", 3)),
        ("arm.position[2].z", ("position", 8)),
        ("arm.inertia[1].xx", ("inertia", 6)),
        ("arm.hand_position.y", ("hand_position", 1)),
    ],
)
def test_a_parameter_of_an_arm_in_space_has_its_place(name: str, place: tuple[str, int]):
    assert arm_column(name) == place


def test_every_parameter_of_an_arm_in_space_is_where_it_is_packed():
    """A changed number changes its own column, and no other."""
    names = [name for name in UR5E.parameters() if name.startswith("arm.")]
    structure = Structure.of(UR5E, PLAIN, free=names)
    before = structure.pack(UR5E, PLAIN, np.ones((1, 13)))[0]
    assert len(names) > 60
    for name in names:
        quantity, place = arm_column(name)
        moved = UR5E.with_parameters({name: UR5E.parameters()[name] * (1 + 1e-6) + 1e-9})
        after = structure.pack(moved, PLAIN, np.ones((1, 13)))[0]
        assert np.flatnonzero(after != before).tolist() == [structure.columns(f"arm.{quantity}").start + place], name


def test_numbers_that_are_zero_are_not_present_unless_free():
    arm = UR5E.arm
    assert isinstance(arm, SpatialArm)
    shape = ArmShape.of(UR5E, [])
    present = dict(shape.present)
    for quantity in ("com", "position", "inertia"):
        flat = np.ravel(arm.per_link(quantity))
        assert set(present[quantity]) == set(np.flatnonzero(flat).tolist())
    zero = next(name for name, x in UR5E.parameters().items() if name.startswith("arm.com") and x == 0)
    more = ArmShape.of(UR5E, [zero, "whip.k[0]"])
    assert set(dict(more.present)["com"]) - set(present["com"]) == {arm_column(zero)[1]}
    assert shape in more
    assert more not in shape
    turned = replace(more, axes=(more.axes[1], *more.axes[1:]))
    assert (turned == more) == (turned.axes == more.axes)
    assert (shape in turned) == (turned.axes == more.axes)


@pytest.mark.parametrize(("joints", "per_node", "dimension"), [("universal", 2, 3), ("rod", 3, 3)])
def test_coordinates_are_counted(joints: str, per_node: int, dimension: int):
    whip = replace(UR5E.whip, joints=joints, node_inertia=0.0)
    structure = Structure.of(replace(UR5E, whip=whip), PLAIN)
    assert structure.n == 6 + per_node * whip.N
    assert structure.dimension == dimension
    assert Structure.of(LEMON, PLAIN).n == LEMON.n
    assert Structure.of(LEMON, PLAIN).dimension == 2


PROFILED = WhipProfile(
    1.2, 0.1, 0.02, 0.003, density_taper=0.25, stiffness_taper=0.06, damping_taper=0.1, rest_curvature=0.3, drag=0.01,
    tip_mass=0.02,
)  # fmt: skip
CONTROLLER = Controller()
LUMPED = replace(LEMON, whip=PROFILED.lump(9))
UNEVEN = replace(
    LEMON, whip=replace(LEMON.whip, k=tuple(np.linspace(0.0, 0.4, 12)), m=tuple(np.linspace(0.02, 0.01, 12)))
)


def rows(model, names, free=()):
    structure = Structure.of(model, CONTROLLER, free=free)
    return parameter_directions(structure, model, CONTROLLER, names, {})


def differences(model, names, step=1e-6):
    """Central differences of the parameter vector by numbers that `with_parameters` changes."""
    structure, none = Structure.of(model, CONTROLLER), np.zeros((1, 5))
    of_profile = PROFILED.numbers
    found = []
    for name in names:
        value = of_profile[name[8:]] if name.startswith("profile.") else model.whip.common(name[5:])
        h = step * max(abs(value), 1e-3)
        ends = (model.with_parameters({name: value + side * h}) for side in (1, -1))
        high, low = (structure.pack(end, CONTROLLER, none)[0] for end in ends)
        found.append((high - low) / (2 * h))
    return np.array(found)


def test_numbers_of_a_profile_move_all_nodes():
    seen = [f"profile.{x}" for x in PROFILE if not x.startswith("bead") and "waves" not in x]
    np.testing.assert_allclose(rows(LUMPED, seen), differences(LUMPED, seen), rtol=1e-6, atol=1e-6)


def test_one_name_stands_for_the_values_of_all_nodes_in_proportion():
    names = ["whip.k", "whip.m"]
    found = rows(UNEVEN, names)
    np.testing.assert_allclose(found, differences(UNEVEN, names), atol=1e-8)
    columns = Structure.of(UNEVEN, CONTROLLER).columns("whip.k")
    assert found[0, columns].mean() == pytest.approx(11 / 12)  # of the joints beside the hinge: 1
    assert UNEVEN.with_parameters({"whip.k": 2 * UNEVEN.whip.common("k")}).whip.k == pytest.approx(
        2 * np.array(UNEVEN.whip.k)
    )
    even = replace(LEMON, whip=replace(LEMON.whip, k=tuple(LEMON.whip.per_node("k").tolist())))
    np.testing.assert_allclose(rows(even, ["whip.k"]), rows(LEMON, ["whip.k"]), atol=1e-12)


def test_what_has_no_such_number_is_refused():
    for model, name in ((LEMON, "profile.length"), (LUMPED, "profile.colour"), (LUMPED, "whip.colour")):
        with pytest.raises(InputError, match=f"parameter: got '{name}'"):
            rows(model, [name])
    straight = replace(LEMON, whip=replace(PROFILED, drag=0.0).lump(9))
    with pytest.raises(InputError, match=r"name whip\.drag in `free`"):
        rows(straight, ["profile.drag"])
    assert rows(straight, ["profile.drag"], free=["whip.drag"]).any()
    with pytest.raises(InputError, match=r"parameter: got 'profile\.length'; allowed: parameters of a whip that was"):
        LEMON.with_parameters({"profile.length": 1.0})
    with pytest.raises(InputError, match=r"whip\.rest_angle: got 0\.1; allowed: a value per node"):
        replace(LEMON, whip=replace(LEMON.whip, rest_angle=(0.0,) * 12)).with_parameters({"whip.rest_angle": 0.1})
