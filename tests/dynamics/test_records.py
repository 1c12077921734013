"""Which numbers of a record become columns: chains of records that change in known ways."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca

from whiptool.dynamics.articulated import SpatialAcceleration, SpatialCarried, SpatialJoint, SpatialMoving
from whiptool.dynamics.records import Nothing, Stored
from whiptool.dynamics.rods import RodFrame, RodJoint
from whiptool.dynamics.serial_arm import ArmMotion


class Four(NamedTuple):
    """A record of four scalars."""

    a: ca.SX
    b: ca.SX
    c: ca.SX
    d: ca.SX

    def entries(self) -> list[ca.SX]:
        return [ca.SX(x) for x in self]

    def with_entries(self, entries: Sequence[ca.SX]) -> Four:
        return Four(*entries)


X, Y = ca.SX.sym("x"), ca.SX.sym("y")


def numbers(x: ca.SX, at: dict[str, float]) -> list[float]:
    """A column of X and Y as numbers."""
    return ca.Function("f", [X, Y], [x])(at["x"], at["y"]).full()[:, 0].tolist()


def test_equal_expressions_share_a_column_and_constants_have_none():
    stored = Stored.of(Four(X, ca.SX(2), X, X * Y), "s")
    assert stored.where == [0, None, 0, 1]
    assert stored.size == 2
    assert float(stored.record.b) == 2
    assert ca.is_equal(stored.record.a, stored.record.c)
    assert ca.is_equal(stored.record.a, stored.symbols[0])
    assert numbers(stored.column(Four(X, ca.SX(2), X, X * Y)), {"x": 3, "y": 5}) == [3, 15]


def test_a_column_of_a_record_puts_its_numbers_back():
    """What is stored, read back through the record of symbols, is what it was."""
    original = Four(X + Y, ca.SX(0), Y, X + Y)
    stored = Stored.of(original, "s")
    again = ca.Function("again", [stored.symbols], [ca.vertcat(*stored.record.entries())])
    column = numbers(stored.column(original), {"x": 3, "y": 5})
    assert again(column).full()[:, 0].tolist() == [8, 0, 5, 8]


def follow(record: Four) -> Four:
    """The next: b takes what a was, d adds c up, c stays."""
    return Four(record.a, record.a, record.c, record.d + record.c)


def test_columns_along_a_chain_are_what_changes_somewhere():
    """d grows from a constant 0 by a constant 1: only d is free, though it starts as a number."""
    start = Four(ca.SX(1), ca.SX(1), ca.SX(1), ca.SX(0))
    stored = Stored.along(start, "s", follow)
    assert stored.where == [None, None, None, 0]
    assert Stored.along(start, "s", follow, always=[2]).where == [None, None, 0, 1]


def test_what_changes_late_is_found():
    """b is 2 only before the first step, a is free: b must follow a."""
    start = Four(X, ca.SX(2), ca.SX(0), ca.SX(0))
    assert Stored.along(start, "s", follow).where == [0, 1, None, None]
    differs = Four(ca.SX(1), ca.SX(2), ca.SX(0), ca.SX(0))
    assert Stored.along(differs, "s", follow).where == [None, 0, None, None]


def test_columns_on_which_nothing_depends_are_left_out():
    """d depends on c by the next record alone, b on a; whoever wants d needs c and d, and neither a nor b."""
    start = Four(X, X, Y, Y)
    stored = Stored.along(start, "s", follow)
    assert stored.where == [0, 1, 2, 3]
    assert stored.needed(start, "s", lambda record: record.d, follow).where == [None, None, 0, 1]
    assert stored.needed(start, "s", lambda record: record.b, follow).where == [0, 1, None, None]
    assert stored.needed(start, "s", lambda record: record.a, follow).where == [0, None, None, None]


def test_nothing_has_no_numbers():
    stored = Stored.of(Nothing(), "s")
    assert stored.size == 0
    assert stored.column(Nothing()).numel() == 0


def test_records_survive_being_taken_apart():
    """Every record of the dynamics is, of its own entries, what it was: matrices neither transposed nor mixed up."""
    S = ca.SX.sym
    symmetric = [ca.SX(ca.DM(ca.reshape(ca.DM(range(9)), 3, 3) + ca.reshape(ca.DM(range(9)), 3, 3).T)) for _ in "JM"]
    vectors = [S(f"v{i}", 3) for i in range(7)]
    records = [
        (SpatialMoving(*vectors, S("axes", 3, 2)), 27),
        (SpatialCarried(symmetric[0], S("H", 3, 3), symmetric[1], vectors[0], vectors[1]), 27),
        (SpatialJoint(S("gains", 6, 3), S("free", 3), S("among", 3, 3)), 30),
        (SpatialAcceleration(vectors[0], vectors[1]), 6),
        (RodFrame(*vectors[:3], S("sums", 2), S("spun", 1), S("twists", 1), *vectors[3:5]), 19),
        (RodJoint(vectors[0], S("across", 3, 3), symmetric[0]), 18),
        (ArmMotion(S("I", 2, 2), S("b", 2), S("j", 6, 2), S("d", 6), S("w", 2)), 26),
    ]
    for record, count in records:
        entries = record.entries()
        assert len(entries) == count, record
        assert all(x.numel() == 1 for x in entries)
        again = record.with_entries(entries)
        for part, same in zip(record, again, strict=True):
            assert part.shape == same.shape
            assert ca.is_equal(ca.densify(part), ca.densify(same), 9), record
