"""Chains that begin with a fold, on the interpreter of the house's engine."""

from __future__ import annotations

import numpy as np
import pytest

from papers.crack import published
from papers.crack.chains import folded, lumped, moved
from papers.crack.closed_forms import hanging_frequencies, lumped_frequencies, moving_mass
from papers.crack.report import TAPERS, _loops, modes_of
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


def test_the_tip_can_have_no_more_than_all_energy_of_the_motion_at_first():
    """The last node is half a link. With few nodes the half circle is a link wide, and moves, too."""
    for taper in (1.0, 0.3):
        ideal = np.sqrt(moving_mass(0.3, taper) * 2 * 2000 / taper**2)
        assert LoopUnit(nodes=2000, taper=taper).most == pytest.approx(ideal, rel=2e-3)
    few = LoopUnit(nodes=12, taper=1.0)
    angles, rates = folded(few.whip, 0.48, 0.06, 10.0)
    velocity = np.cumsum(few.whip["l"] * rates * np.array([np.cos(angles), np.sin(angles)]), axis=1)  # (2, N)
    energy = (few.whip["m"] * velocity**2).sum() / 2
    fastest = np.sqrt(2 * energy / few.whip["m"][-1])
    assert few.most == pytest.approx(fastest / np.linalg.norm(velocity[:, -1]))


@pytest.mark.parametrize("nodes", [8, 12])
def test_a_loop_of_few_links_is_counted_over_the_speed_that_its_tip_has_at_first(nodes, monkeypatch):
    """A half circle of two links moves its tip at 10.4 m/s, not at 10; energy allows no more than `most` over that."""
    monkeypatch.setenv("WHIPTOOL_ENGINE", "interpreter")
    unit = LoopUnit(nodes=nodes, taper=1.0)
    found = unit.run(None, 1)
    assert unit.first.tip_speed[0] == pytest.approx(found["tip_speed"][0]) == pytest.approx(10.403, abs=1e-3)
    gain = unit.over_first(found["peak"])
    assert gain == pytest.approx(max(found["tip_speed"]) / found["tip_speed"][0])
    assert gain <= unit.most


def test_a_whip_cracks_when_its_loop_is_faster_than_sound():
    """The loop is half as fast as the tip: 34 m/s at first, and a tip ten times as fast, are half of what it takes."""
    loops = [LoopUnit(nodes=2000, taper=taper) for taper in TAPERS]
    done = {"peak": 10.0, "energy": 1.0, "bend": 1.0}
    rows = _loops({unit.key: done for unit in loops}, loops, {"as it is": loops[1]}).parts[2].rows
    assert rows[0][-2:] == ["start for a tip at 340 m/s", "speed to crack at: a loop at 340 m/s"]
    assert [row[-2:] for row in rows[1:]] == [["34 m/s", "68 m/s"]] * 3
    assert published.CRACK_SPEED > published.CRACK * 340
