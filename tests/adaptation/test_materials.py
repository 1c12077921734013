"""What whips of a material may be, the prior that follows, and twins: against sources and closed forms."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from whiptool.adaptation.materials import (
    AIR,
    CAUSES,
    MATERIALS,
    NUMBERS,
    USUAL,
    stock_of_material,
    stock_of_model,
    uniform_whip,
)
from whiptool.adaptation.prior import Belief, default_prior, knowing, read_belief
from whiptool.adaptation.twins import NODES, draw_twin
from whiptool.errors import InputError
from whiptool.impedance import Controller, oiac_preset
from whiptool.models.presets import preset
from whiptool.models.profile import WhipProfile

MODEL, CONTROLLER = preset("lemon2024"), Controller(oiac_preset("table4"))
LOGS = ("profile.length", "profile.linear_density", "profile.bending_stiffness")


def drawn(name: str, size: int = 4000) -> np.ndarray:
    """Logarithms of the numbers of many whips, from the definitions: cross-sections, not matrices."""
    material, rng = MATERIALS[name], np.random.default_rng(1)
    causes = {c: np.exp(rng.uniform(*np.log(getattr(material, c)).tolist(), size)) for c in CAUSES}
    d = causes["diameter"]
    inertia = np.pi * d**4 / 64  # second moment of a disc's area
    EI = causes["modulus"] * inertia
    numbers = {
        "length": causes["length"],
        "linear_density": causes["density"] * np.pi * (d / 2) ** 2,
        "bending_stiffness": EI,
        "bending_damping": causes["relaxation"] * EI,
        "drag": 0.5 * AIR * causes["drag_coefficient"] * d * material.width,
        "dry_friction": causes["friction"],
    }
    return np.log([numbers[name] for name in NUMBERS])


@pytest.mark.parametrize("name", MATERIALS)
def test_numbers_follow_from_the_cross_section(name):
    stock, expected = stock_of_material(name), drawn(name)
    deviation = np.sqrt(np.diag(stock.covariance))
    np.testing.assert_allclose((stock.centre - expected.mean(axis=1)) / deviation, 0, atol=0.06)
    np.testing.assert_allclose(stock.covariance, np.cov(expected), atol=0.06 * deviation.max() ** 2)
    whips = [stock.draw(np.random.default_rng(i)) for i in range(1000)]
    own = np.log([[whip[n] for n in NUMBERS] for whip in whips]).T
    np.testing.assert_allclose((own.mean(axis=1) - stock.centre) / deviation, 0, atol=0.12)
    np.testing.assert_allclose(own.std(axis=1), deviation, rtol=0.08)
    assert (own.min(axis=1) >= expected.min(axis=1) - 0.3 * deviation).all()
    assert (own.max(axis=1) <= expected.max(axis=1) + 0.3 * deviation).all()


def test_the_table_agrees_with_its_sources():
    """Weights of ropes and chains as makers give them, and the fitted whip of Table 2, from which nothing was taken."""

    def weights(name: str, diameter: float) -> tuple[float, float]:
        low, high = MATERIALS[name].density
        return low * np.pi / 4 * diameter**2, high * np.pi / 4 * diameter**2

    for name, diameter, weight in (
        ("nylon", 0.00635, 0.0223),
        ("nylon", 0.009525, 0.0521),
        ("nylon", 0.0127, 0.0967),
        ("polypropylene", 0.00794, 0.0268),
        ("polypropylene", 0.009525, 0.0417),
        ("polypropylene", 0.0127, 0.0699),
        ("manila", 0.00794, 0.0432),
        ("manila", 0.009525, 0.0610),
        ("manila", 0.0127, 0.1116),
        ("steel-chain", 0.002, 0.07),
        ("steel-chain", 0.003, 0.16),
        ("steel-chain", 0.004, 0.32),
    ):
        low, high = weights(name, diameter)
        assert 0.99 * low <= weight <= 1.01 * high
    for name, shortest, longest in (("cotton", 0.05, 0.09), ("nylon", 0.08, 0.18)):  # Peirce's bending length
        whip = stock_of_material(name, diameter=0.01).numbers
        assert shortest < (whip["bending_stiffness"] / (9.81 * whip["linear_density"])) ** (1 / 3) < longest
    leather = stock_of_material("leather", diameter=0.015)
    # links of a chain are 3.3 to 3.7 wires wide outside, and every other one is seen from its edge
    assert (3.3 + 1) / 2 <= MATERIALS["steel-chain"].width <= (3.7 + 1) / 2
    assert all(MATERIALS[name].width == 1.0 for name in ("cotton", "leather", "nylon", "silicone"))
    whip = MODEL.whip
    published = {"linear_density": whip.m / whip.l, "bending_stiffness": whip.k * whip.l}
    for number, value in published.items():
        i = NUMBERS.index(number)
        assert abs(np.log(value) - leather.centre[i]) < np.abs(leather.spread[i]).sum() + 0.05
    assert MATERIALS["leather"].relaxation[1] == pytest.approx(whip.b / whip.k, rel=0.06)


def test_a_measure_narrows_what_depends_on_it():
    wide, thick, long = (stock_of_material("leather", **m) for m in ({}, {"diameter": 0.014}, {"length": 1.5}))
    errors = [np.sqrt(np.diag(stock.covariance)) for stock in (wide, thick, long)]
    narrower = errors[1] < 0.99 * errors[0]
    assert [n for n, less in zip(NUMBERS, narrower, strict=True) if less] == list(NUMBERS[1:5])
    assert thick.numbers["bending_stiffness"] == pytest.approx(np.sqrt(2e6 * 15e6) * np.pi * 0.014**4 / 64, rel=2e-3)
    assert long.numbers["length"] == pytest.approx(1.5, rel=1e-3)
    assert errors[2][0] == pytest.approx(0.02 / np.sqrt(3), rel=0.01)
    with pytest.raises(InputError, match="steel-chain"):
        stock_of_material("steel")
    with pytest.raises(InputError, match="diameter"):
        stock_of_material("cotton", diameter=0.0)


def test_a_uniform_whip_has_the_numbers_of_its_stock():
    numbers = stock_of_material("nylon").numbers
    whip = uniform_whip(numbers, MODEL.whip)
    assert whip.length == pytest.approx(numbers["length"])
    assert whip.mass == pytest.approx(numbers["linear_density"] * numbers["length"])
    given = {name: numbers[name] for name in NUMBERS[:5]}
    lumped = WhipProfile(**given).lump(12)
    for name in ("k", "b"):  # but for the last joint, beyond which there is half a link
        np.testing.assert_allclose(whip.per_node(name)[1:], lumped.per_node(name)[1:], rtol=1e-9)
    np.testing.assert_allclose(whip.per_node("drag")[:-1], lumped.per_node("drag")[:-1], rtol=1e-9)


def test_around_ones_own_model():
    """Centred on its numbers, as wide as materials on average; drag and friction, which it leaves out, are there."""
    stock = stock_of_model(MODEL)
    assert stock.numbers["length"] == pytest.approx(MODEL.whip.length)
    assert stock.numbers["bending_stiffness"] == pytest.approx(0.242 * 0.072)
    others = [stock_of_material(name) for name in USUAL]
    np.testing.assert_allclose(
        np.diag(stock.covariance), np.mean([np.diag(x.covariance) for x in others], axis=0), rtol=1e-12
    )
    low, high = (f(x.numbers["drag"] for x in others) for f in (min, max))
    assert low < stock.numbers["drag"] < high
    windy = dataclasses.replace(MODEL, whip=dataclasses.replace(MODEL.whip, drag=0.02 * 0.072, dry_friction=1e-3))
    assert stock_of_model(windy).numbers["drag"] == pytest.approx(0.02)
    assert stock_of_model(windy).numbers["dry_friction"] == pytest.approx(1e-3)
    with pytest.raises(InputError, match="per node"):
        stock_of_model(dataclasses.replace(MODEL, whip=dataclasses.replace(MODEL.whip, dry_friction=(1e-4,) * 12)))


def marginal(belief: Belief, names: tuple[str, ...]) -> np.ndarray:
    at = [belief.names.index(name) for name in names]
    return belief.covariance[np.ix_(at, at)]


def test_the_prior_of_a_material_is_that_of_its_table():
    stock = stock_of_material("silicone")
    belief = default_prior(MODEL, CONTROLLER, stock=stock)
    np.testing.assert_allclose(marginal(belief, LOGS), stock.covariance[:3, :3], rtol=1e-9)
    values, errors = belief.values(), belief.errors()
    for number in NUMBERS[:5]:
        assert values[f"profile.{number}"] == pytest.approx(stock.numbers[number])
    i = NUMBERS.index("bending_damping")  # it has no logarithm here: a relative error is one of its value
    assert errors["profile.bending_damping"] == pytest.approx(
        stock.numbers["bending_damping"] * np.sqrt(stock.covariance[i, i])
    )
    correlation = np.corrcoef(drawn("silicone"))[1, 2]
    C = marginal(belief, LOGS)
    assert C[1, 2] / np.sqrt(C[1, 1] * C[2, 2]) == pytest.approx(correlation, abs=0.03)
    assert np.linalg.eigvalsh(belief.covariance).min() > 0
    assert [values[f"profile.{x}_taper"] for x in ("density", "stiffness", "damping")] == [1, 1, 1]
    tapers = marginal(belief, ("profile.density_taper", "profile.stiffness_taper"))
    assert tapers[1, 1] == pytest.approx(4 * tapers[0, 0], rel=1e-9)  # thickness to the fourth, and to the second
    assert tapers[0, 1] > 0.9 * np.sqrt(tapers[0, 0] * tapers[1, 1])


def test_the_prior_of_uniform_whips_is_that_of_their_nodes():
    stock = stock_of_material("leather")
    belief = default_prior(MODEL, CONTROLLER, whip="uniform", stock=stock)
    whips = [uniform_whip(stock.draw(np.random.default_rng(i)), MODEL.whip) for i in range(3000)]
    nodes = np.log([[getattr(w, n) for n in ("k", "b", "m", "l")] for w in whips])
    names = ("whip.k", "whip.b", "whip.m", "whip.l")
    z = belief.z[[belief.names.index(name) for name in names]]
    np.testing.assert_allclose(z, nodes.mean(axis=0), atol=0.08)
    np.testing.assert_allclose(marginal(belief, names), np.cov(nodes.T), atol=0.08)
    own = default_prior(MODEL, CONTROLLER, whip="uniform")
    assert own.values()["whip.k"] == pytest.approx(0.242)
    assert own.plant.model.whip.drag == 0.0  # one's own model, as it is


def test_what_a_file_names_is_independent_of_the_rest(tmp_path):
    file = tmp_path / "prior.toml"
    file.write_text('"profile.linear_density" = {value = 0.05, error = 0.1}\n"delay" = {value = 0.0, error = 0}\n')
    stock = stock_of_material("cotton")
    before, after = (
        default_prior(MODEL, CONTROLLER, stock=stock),
        read_belief(str(file), MODEL, CONTROLLER, stock=stock),
    )
    assert after.values()["profile.linear_density"] == pytest.approx(0.05)
    assert after.errors()["profile.linear_density"] == pytest.approx(0.1)
    assert marginal(after, LOGS)[1, 2] == 0
    kept = ("profile.bending_stiffness", "profile.bending_damping", "profile.drag")
    np.testing.assert_array_equal(marginal(after, kept), marginal(before, kept))
    assert "delay" not in after.names
    told = knowing(before, {"profile.length": 0.95})
    assert set(before.names) - set(told.names) == {"profile.length"}
    assert told.at().model.whip.length == pytest.approx(0.95)


def test_a_twin_has_its_numbers_from_the_stock_and_its_structure_from_the_family():
    stock = stock_of_material("nylon")
    for seed in range(4):
        kin, strange, stranger = (draw_twin(f, seed, MODEL, CONTROLLER, stock) for f in ("kin", "strange", "stranger"))
        assert len(set(kin.model.whip.per_node("m"))) == 1
        assert kin.model.whip.drag_ratio == 1
        for number, value in zip(NUMBERS[:2], (kin.model.whip.length, kin.model.whip.mass / kin.model.whip.length)):
            i = NUMBERS.index(number)
            assert abs(np.log(value) - stock.centre[i]) <= np.abs(stock.spread[i]).sum() + 1e-9
        assert strange.model.whip.length == pytest.approx(stranger.model.whip.length)
        assert strange.model.whip.N == NODES
        thin = [np.diff(x.model.whip.per_node("drag")).mean() for x in (strange, stranger)]  # the width of a cone
        assert thin[1] == pytest.approx(2 * thin[0])
        share = strange.model.whip.per_node("drag")[-1] / strange.model.whip.per_node("drag")[0]
        assert 0.7 <= share <= 0.91
        assert 0.525 <= strange.model.whip.drag_ratio <= 0.8
        assert 1 - stranger.model.whip.drag_ratio == pytest.approx(2 * (1 - strange.model.whip.drag_ratio))
        assert strange.controller != CONTROLLER
