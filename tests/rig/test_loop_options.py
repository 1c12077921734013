"""Rates, waits and limits of a strike: what is refused, and the bounds that are allowed."""

from __future__ import annotations

import math

import pytest

from whiptool.errors import InputError
from whiptool.rig.loop_options import FASTEST, LONGEST_DELAY, SLOWEST, LoopOptions


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("rate", 0),
        ("rate", 9.99),
        ("rate", 10_001),
        ("rate", math.nan),
        ("approach_speed", 0.0),
        ("approach_speed", 2.01),
        ("delay", -1e-3),
        ("delay", 0.101),
        ("t_stay", -0.1),
        ("t_stay", 601),
        ("settle", -1),
        ("settle", math.inf),
        ("stiffness", 0),
        ("damping", -0.7),
    ],
)
def test_what_is_out_of_bounds_is_refused_by_its_name(name: str, value: float):
    with pytest.raises(InputError, match=rf"^{name}: got "):
        LoopOptions(**{name: value})


@pytest.mark.parametrize(
    "options",
    [
        {"rate": 10},
        {"rate": 10_000},
        {"approach_speed": SLOWEST},
        {"approach_speed": FASTEST},
        {"delay": 0.0},
        {"delay": LONGEST_DELAY},
        {"t_stay": 0, "settle": 0},
        {"stiffness": 1e-3, "damping": 5.0},
    ],
)
def test_bounds_themselves_are_allowed(options: dict):
    found = LoopOptions(**options)
    assert all(getattr(found, name) == value for name, value in options.items())


def test_safe_by_default():
    """Every strike is rehearsed, and the arm goes back; the rehearsal's delay is less than a cycle."""
    found = LoopOptions()
    assert found.rehearse
    assert found.go_back
    assert found.delay < 1 / found.rate
