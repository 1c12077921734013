"""Chains that begin with a fold, on the interpreter of the house's engine."""

from __future__ import annotations

import numpy as np
import pytest

from papers.crack.chains import folded, lumped, moved
from papers.crack.closed_forms import hanging_frequencies, lumped_frequencies
from papers.crack.report import modes_of
from papers.crack.units import GRAVITY, LoopUnit
from whiptool import WhipProfile

LIMP = WhipProfile(length=1.0, linear_density=1.0, bending_stiffness=1e-9, bending_damping=0.0)


def test_hanging_modes_are_those_of_the_closed_forms():
    np.testing.assert_allclose(modes_of(12, hats=False), lumped_frequencies(12, 1.0, GRAVITY, 3), rtol=1e-6)
    np.testing.assert_allclose(modes_of(80, hats=True), hanging_frequencies(1.0, GRAVITY, 3), rtol=0.004)


def test_a_fold_moves_its_free_part_as_one():
    whip = lumped(LIMP, 60)
    angles, rates = folded(whip, 0.4, 0.05, 3.0)
    velocity = np.cumsum(whip["l"] * rates * np.array([np.cos(angles), np.sin(angles)]), axis=1)
    np.testing.assert_allclose(velocity[1, 30:], -3.0, rtol=0.02)
    np.testing.assert_allclose(velocity[0, 30:], 0.0, atol=0.05)


def test_a_short_chain_keeps_energy_and_pulls_with_its_weight_at_first(monkeypatch):
    monkeypatch.setenv("WHIPTOOL_ENGINE", "interpreter")
    whip = lumped(LIMP, 4)
    hanging = np.full(4, 0.05), np.zeros(4)
    seen = moved(whip, hanging, until=0.1, step=5e-4, gravity=GRAVITY)
    assert np.ptp(seen.energy) < 1e-6
    assert seen.pull[0] == pytest.approx(GRAVITY * whip["m"].sum(), rel=0.01)
    assert seen.tip_speed[-1] == pytest.approx(
        np.linalg.norm(np.gradient(seen.places[:, -1], seen.t, axis=0)[-1]), rel=0.01
    )


def test_drag_thins_with_the_whip():
    unit = LoopUnit(nodes=10, taper=0.2, drag=0.01)
    assert unit.whip["drag"][-1] == pytest.approx(0.2 * 0.01 * 0.16 / 2)
