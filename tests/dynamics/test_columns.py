"""Columns against plain indexing of arrays that are put together block by block."""

from __future__ import annotations

import numpy as np
import pytest

from whiptool.dynamics.columns import Columns, outcome_columns, row_columns


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
