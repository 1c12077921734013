"""Unknown whips: how far they deviate, node by node, against the powers and waves that are stated."""

from __future__ import annotations

import numpy as np
import pytest

from papers.aim.published import CONTROLLER as PRESCRIBED
from papers.aim.published import MODEL as ROBOT
from whiptool.adaptation.materials import stock_of_material
from whiptool.adaptation.twins import BEND, NODES, _strange_whip, _waves, draw_twin
from whiptool.impedance import Controller, oiac_preset
from whiptool.models.presets import preset
from whiptool.models.strike import Strike, default_bounds
from whiptool.rollout import CompiledRollout

NUMBERS = {
    "length": 0.9, "linear_density": 0.15, "bending_stiffness": 0.02, "bending_damping": 0.003,
    "drag": 0.008, "dry_friction": 1e-4,
}  # fmt: skip
PLACES = (np.arange(NODES) + 0.5) / NODES


def test_waves_have_the_stated_spread():
    rng = np.random.default_rng(0)
    logs = np.log([_waves(PLACES, rng, 0.12) for _ in range(4000)])
    assert np.std(logs) == pytest.approx(0.12, rel=0.03)
    assert np.mean(logs) == pytest.approx(0, abs=0.005)


@pytest.mark.parametrize("seed", range(4))
def test_a_stranger_whip_deviates_twice_as_much(seed):
    """Beside the cone (mass with its square, bending with its fourth power) the logarithms of the waves double; the
    bead and the soft joint are single nodes."""
    taper = np.random.default_rng(seed).uniform(0.1, 0.3)
    l = NUMBERS["length"] / NODES
    handle = {"m": NUMBERS["linear_density"] * l, "k": NUMBERS["bending_stiffness"] / l}
    handle["b"] = NUMBERS["bending_damping"] / l
    waves = {}
    for size in (1.0, 2.0):
        whip = _strange_whip(NUMBERS, np.random.default_rng(seed), size)
        for name, power in (("m", 2), ("k", 4), ("b", 4)):
            per_node = np.array(getattr(whip, name))[1:]  # the first joint is a free hinge
            cone = (1 - size * taper * PLACES[1:]) ** power
            waves[name, size] = np.log(per_node / handle[name] / cone)
    for name, odd in (("m", 1), ("k", 0), ("b", 0)):  # the bead's mass is added, the soft joint a factor
        off = ~np.isclose(waves[name, 2.0], 2 * waves[name, 1.0], atol=1e-9)
        assert off.sum() == odd, name
    assert np.abs(np.diff(waves["k", 1.0], 2)).max() == pytest.approx(-2 * np.log(0.4), abs=0.1)  # waves are smooth
    assert np.abs(np.diff(waves["b", 1.0], 2)).max() < 0.1


@pytest.mark.slow
def test_the_bend_that_stiffening_counts_from_is_that_of_strikes():
    """The joint that bends most stays below it in nine random strikes of ten."""
    model = preset("lemon2024")
    rollout = CompiledRollout(model, Controller(oiac_preset("table4")))
    strikes = default_bounds(model.arm).sample(np.random.default_rng(5), 200)
    paths = [rollout.trajectory(Strike.from_vector(s), t_stay=0.3) for s in strikes]
    bends = [np.abs(path.q[:, 3:]).max(axis=0) for path in paths]
    most = np.quantile(bends, 0.9, axis=0).max() / model.whip.per_node("l")[0]
    assert most == pytest.approx(BEND, rel=0.05)


@pytest.mark.parametrize(
    ("model", "law"),
    [(preset("lemon2024"), Controller(oiac_preset("table4"))), (ROBOT, PRESCRIBED)],
    ids=["plane", "space"],
)
def test_a_clock_is_late_or_early_by_what_is_stated(model, law):
    for family, most in (("strange", 0.008), ("stranger", 0.016)):
        late = np.array([draw_twin(family, seed, model, law).clock_offset for seed in range(40)])
        assert np.abs(late).max() <= most
        assert late.min() < -most / 2 < most / 2 < late.max()


def test_air_meets_a_chain_on_its_mean_width():
    """rho C_d w / 2 of a cylinder 2.3 wires thick, at the geometric middle of 2 to 3 mm and of C_d from 1 to 1.3."""
    drag = stock_of_material("steel-chain").numbers["drag"]
    assert drag == pytest.approx(1.2 * np.sqrt(1.0 * 1.3) * 2.3 * np.sqrt(0.002 * 0.003) / 2)


def test_a_twin_introduces_itself_in_one_line():
    twin = draw_twin("strange", 3, preset("lemon2024"), Controller())
    whip = twin.model.whip
    assert repr(twin) == f"Twin(strange, seed 3: whip of {whip.length:.2f} m and {whip.mass:.3f} kg, 36 nodes)"
