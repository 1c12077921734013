"""The names and numbers of a plant: what is changed, how it scales with the nodes, and slopes by differences."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from pendulum_data import DATA
from pendulum_swing import angles_of, pendulum
from scipy.integrate import quad
from spatial_arms import of_universal_nodes

from whiptool.dynamics.structure import LUMPED, PROFILE, lumping
from whiptool.errors import InputError
from whiptool.identification.fit import FitOptions, fit
from whiptool.identification.inputs import profile_of
from whiptool.identification.plant import Plant, slopes
from whiptool.impedance import OIAC, ConstantImpedance, Controller
from whiptool.models import preset
from whiptool.models.parameters import ArmLink
from whiptool.models.profile import WhipProfile
from whiptool.models.whip import WhipParameters
from whiptool.recording.strike_recording import StrikeRecording

pytestmark = pytest.mark.skipif(
    not DATA.is_dir(), reason=f"no recorded pendulum in {DATA}; set WHIPTOOL_DATA to the folder that holds it"
)


def swings(name: str, *, every: int, last: int | None = None) -> list[StrikeRecording]:
    """All pieces of a file, every so many samples, up to sample `last`."""
    data = np.load(DATA / f"{name}.npz")
    t = np.arange(data["angle"].shape[1]) * float(data["dt"])
    return [
        angles_of(t[:last:every], (q - np.pi)[:last:every], np.array([q[0] - np.pi, v[0]]), 2e-3, f"{name} {i}")
        for i, (q, v) in enumerate(zip(data["angle"], data["velocity"], strict=True))
    ]


@pytest.mark.slow
def test_double_pendulum_predicts_the_held_out_pieces():
    held = (4, 11, 18, 25)
    train = [r for i, r in enumerate(swings("double", every=12)) if i not in held]
    unseen = [swings("double", every=4, last=1801)[i] for i in held]
    # two uniform rods of 0.2 m, as one would guess from afar
    guess = pendulum((ArmLink(mass=0.2, length=0.2), ArmLink(mass=0.1, length=0.2)), (1e-3, 1e-3))
    free = [
        f"link.{q}[{i}]"
        for q in ("mass", "com", "inertia", "friction", "dry_friction", "drag", "zero")
        for i in range(2)
    ]
    options = FitOptions(drive="free", pieces=(0.3,), starts=3, dispersion=3.0)
    result = fit(train, guess, [*free, "link.length[0]"], held_out=unseen, options=options)

    rmse = [1e3 * r.rmse for r in result.held_out]
    print("held-out angle RMSE [mrad]", np.round(rmse, 2), "median", np.median(rmse))
    assert np.median(rmse) <= 1.5
    inside = np.mean([[r.coverage(0.5), r.coverage(0.9)] for r in result.held_out], axis=0)
    print("within 50 and 90 % intervals", inside)
    assert 0.3 < inside[0] < 0.75
    assert inside[1] > 0.8
    costs = [run.solution.cost for run in result.runs]
    assert max(costs) < 1.01 * min(costs), "all three starts end alike"
    # free swing sees ratios: neither the scale of masses and losses, nor (twice) how a link's mass is spread
    assert result["link.length[0]"].kind == "well determined"
    assert result.uncertainty.flat.sum() == 3
    for name in (f"link.{q}[{i}]" for q in ("mass", "dry_friction", "drag") for i in range(2)):
        assert result[name].kind == "flat"
        assert result[name].interval is None
    assert result.uncertainty.product({"link.mass[1]": 1})[1] is None


@pytest.mark.slow
def test_single_pendulum_with_and_without_dry_friction():
    """Each piece held out in turn and predicted for 9 s: dry friction explains how small swings end."""
    pieces = swings("single", every=25)
    guess = pendulum((ArmLink(mass=0.2, length=0.3),))
    options = FitOptions(drive="free", pieces=(1.0, 3.0))
    found = {}
    for dry in (True, False):
        free = ["link.inertia[0]", "link.friction[0]", "link.drag[0]", *(["link.dry_friction[0]"] if dry else [])]
        found[dry] = []
        for i, unseen in enumerate(pieces):
            train = [r for j, r in enumerate(pieces) if j != i]
            found[dry].append(1e3 * fit(train, guess, free, held_out=[unseen], options=options).held_out[0].rmse)
    print("held-out RMSE [mrad] with dry friction", np.round(found[True], 1), "without", np.round(found[False], 1))
    assert np.median(found[True]) < 0.7 * np.median(found[False])


LEMON = preset("lemon2024")
PROFILE_OF_ALL = WhipProfile(
    0.9, 0.2, 0.02, 0.007, 0.3, 0.4, 0.5, 0.1, 0.01, 0.003, 0.02, 0.55, (0.1, -0.2, 0.05), (0.3, 0.1, -0.1)
)
PLANT = Plant(LEMON, Controller(OIAC(), torque_limit=3.0))
PROFILED = Plant(LEMON, Controller(), PROFILE_OF_ALL)


def test_a_change_changes_what_it_names_and_nothing_else():
    changes = {"whip.k": 0.5, "arm.mass[1]": 0.7, "gravity": 3.7, "law.beta": 0.1, "torque_limit": 2.0}
    changed, before = PLANT.changed(changes), PLANT.values()
    assert changed.values() == before | changes
    assert PLANT.values() == before
    assert changed.model.gravity == 3.7
    assert changed.controller is not None
    assert changed.controller.torque_limit == 2.0
    assert changed.controller.law.parameters()["beta"].tolist() == [0.1]
    with pytest.raises(InputError, match="one of"):
        PLANT.changed({"whip.colour": 1.0})
    with pytest.raises(InputError):
        PLANT.changed({"whip.k": -1.0})


def test_matrices_of_a_law_are_changed_entry_by_entry():
    plant = Plant(LEMON, Controller(ConstantImpedance(((3.0, 2.0), (1.0, 4.0)))))
    law = plant.changed({"law.K[1]": 20.0, "law.K[3]": 40.0, "law.B[0]": 9.0}).controller.law
    assert law.parameters()["K"].tolist() == [3.0, 20.0, 1.0, 40.0]
    assert law.parameters()["B"].tolist() == [9.0, 1.43, 1.43, 3.93]


def test_a_profile_stands_in_place_of_the_whips_numbers():
    values = PROFILED.values()
    assert {f"profile.{name}" for name in PROFILE} <= set(values)
    assert not any(name.startswith(("whip.k", "whip.m", "whip.l", "whip.b")) for name in values)
    assert "whip.dry_friction" in values
    longer = PROFILED.changed({"profile.length": 1.2, "whip.dry_friction": 1e-3})
    assert longer.model.whip.length == pytest.approx(1.2)
    np.testing.assert_allclose(longer.model.whip.dry_friction, 1e-3)
    held = np.r_[np.zeros(5), 0.008, 0.012, np.zeros(4), 0.003]  # bead and tip do not grow with the whip
    mass, before = longer.model.whip.per_node("m") - held, PROFILED.model.whip.per_node("m") - held
    np.testing.assert_allclose(mass, before * 1.2 / 0.9)


def test_a_clamp_bends_at_the_hand_as_half_a_link():
    """Half a link of a uniform whip: twice the stiffness, half the rest angle; 8 times the cubic stiffness (half the
    bend at the same moment, cubed). A profile is lumped anew, its first joint by the half hat at the hand."""
    whip = WhipParameters(N=10, l=0.08, m=0.02, k=0.3, b=0.05, cubic_stiffness=0.7, rest_angle=0.01)
    plant = Plant(type(LEMON)(arm=LEMON.arm, whip=whip), clamp=0.0)
    held = plant.held.whip
    assert held.per_node("k").tolist() == pytest.approx([0.6, *[0.3] * 9])
    assert held.per_node("b").tolist() == pytest.approx([0.1, *[0.05] * 9])
    assert held.per_node("rest_angle").tolist() == pytest.approx([0.005, *[0.01] * 9])
    assert held.per_node("cubic_stiffness").tolist() == pytest.approx([5.6, *[0.7] * 9])
    assert Plant(plant.model).held is plant.model
    cone = Plant(LEMON, None, PROFILE_OF_ALL, clamp=0.0)
    stiffness, l = cone.held.whip.per_node("k"), cone.held.whip.per_node("l")
    free = Plant(LEMON, None, PROFILE_OF_ALL).held.whip.per_node("k")
    np.testing.assert_allclose(stiffness[1:], free[1:])
    assert free[0] == 0
    p = PROFILE_OF_ALL

    def bend(s: float) -> float:
        waves = sum(w * np.cos(i * np.pi * s / p.length) for i, w in enumerate(p.stiffness_waves, start=1))
        return (1 - s / l[0]) * p.stiffness_taper ** (-s / p.length) / p.bending_stiffness / np.exp(waves)

    assert stiffness[0] == pytest.approx(1 / quad(bend, 0, l[0])[0])  # what the half hat at the hand sees


def test_more_nodes_are_the_same_whip():
    """Uniform: length, mass, total drag and the bending of the whole are kept."""
    whip = WhipParameters(N=10, l=0.08, m=0.02, k=0.3, b=0.05, drag=1e-3, cubic_stiffness=0.7, rest_angle=0.01,
                          node_inertia=2e-5)  # fmt: skip
    plant = Plant(type(LEMON)(arm=LEMON.arm, whip=whip))
    finer = plant.with_nodes(25).model.whip
    assert finer.N == 25
    assert finer.length == pytest.approx(0.8)
    assert finer.per_node("m").sum() == pytest.approx(0.2)
    assert finer.per_node("drag").sum() == pytest.approx(1e-2)
    assert finer.per_node("node_inertia").sum() == pytest.approx(2e-4)
    assert 25 * finer.per_node("rest_angle")[-1] == pytest.approx(0.1)
    for name in ("k", "b"):  # in series: a moment M bends the whole by N M / k
        assert 25 / finer.per_node(name)[-1] == pytest.approx(10 / whip.per_node(name)[-1])
    # M = c theta^3 with theta the whole bend over N: the whole bends by N (M / c)^(1/3)
    assert 25**3 / finer.per_node("cubic_stiffness")[-1] == pytest.approx(10**3 / 0.7)
    assert finer.hinge_mass == whip.hinge_mass
    back = plant.with_nodes(25).with_nodes(10).model.whip
    assert back.l == pytest.approx(0.08)
    with pytest.raises(InputError, match="a value per node"):
        Plant(PROFILED.model).with_nodes(20)
    lumped = Plant(LEMON, None, PROFILE_OF_ALL).with_nodes(20)
    np.testing.assert_allclose(lumped.model.whip.per_node("k"), PROFILE_OF_ALL.lump(20).per_node("k"))


def test_blocks_hold_the_models_numbers():
    blocks = PLANT.quantities()
    np.testing.assert_array_equal(blocks["arm.mass"], LEMON.arm.per_link("mass"))
    np.testing.assert_array_equal(blocks["whip.k"], LEMON.whip.per_node("k"))
    assert blocks["whip.hinge_mass"].tolist() == [LEMON.whip.hinge_mass]
    assert blocks["gravity"].tolist() == [LEMON.gravity]
    assert blocks["law.beta"].tolist() == [0.6]
    assert blocks["torque_limit"].tolist() == [3.0]
    assert "torque_limit" not in Plant(LEMON, Controller()).quantities()
    assert not any(name.startswith("law") for name in Plant(LEMON).quantities())


@pytest.mark.parametrize("plant", [PLANT, PROFILED], ids=["uniform", "profile"])
def test_slopes_are_those_of_differences(plant):
    names = [x for x in plant.values() if x != "whip.friction_velocity"]
    known, found = plant.values(), slopes(plant, names)
    for name, slope in zip(names, found, strict=True):
        h = 1e-6 * max(abs(known[name]), 1e-3)
        both = [plant.changed({name: known[name] + s * h}).quantities() for s in (1, 0 if known[name] == 0 else -1)]
        for block, exact in slope.items():
            by_difference = (both[0][block] - both[1][block]) / (h if known[name] == 0 else 2 * h)
            scale = max(1.0, float(np.abs(exact).max()))
            np.testing.assert_allclose(by_difference / scale, exact / scale, atol=2e-5, err_msg=f"{block} by {name}")
    with pytest.raises(InputError, match="parameter"):
        slopes(plant, ["whip.colour"])


def test_slopes_keep_within_the_bounds_of_a_parameter():
    """One more metre of the longest link that is allowed was refused, and ended a whole fit."""
    arm = pendulum((ArmLink(mass=0.2, length=99.5), ArmLink(mass=0.1, length=0.3)))
    (slope,) = slopes(arm, ["link.length[0]"])
    for block, x in slope.items():
        by_difference = arm.changed({"link.length[0]": 99.75}).quantities()[block] - arm.quantities()[block]
        np.testing.assert_allclose(x, by_difference / 0.25, atol=1e-9)


def test_lumping_in_casadi_is_that_of_numpy():
    """Two derivations of the same hats, at two numbers of nodes."""
    for N in (3, 12):
        found = dict(zip(LUMPED, lumping(N)[0](np.array([*PROFILE_OF_ALL.numbers.values()])), strict=True))
        lumped = PROFILE_OF_ALL.lump(N)
        for name, block in found.items():
            own = lumped.hinge_mass if name == "hinge_mass" else lumped.per_node(name)
            np.testing.assert_allclose(np.ravel(block.full()), own, rtol=1e-12, atol=1e-15)


def test_a_profile_in_space_keeps_how_its_nodes_are_joined():
    """And has no curvature at rest, which would need a direction; its slopes are those of differences."""
    model = of_universal_nodes("ur5e")
    plant = Plant(model, None, profile_of(model, ""))
    assert plant.model.whip.joints == "universal"
    for name in ("l", "m", "k", "b", "node_inertia"):
        np.testing.assert_allclose(plant.model.whip.per_node(name), model.whip.per_node(name), rtol=1e-9)
    assert "profile.rest_curvature" not in plant.values()
    assert "profile.bending_stiffness" in plant.values()
    coarse = plant.with_nodes(10).model.whip
    assert coarse.per_node("node_inertia").sum() == pytest.approx(model.whip.per_node("node_inertia").sum())
    bent = dataclasses.replace(model, whip=dataclasses.replace(model.whip, rest_angle_x=0.01))
    kept = Plant(bent, None, profile_of(model, "")).changed({"profile.linear_density": 0.2}).model.whip
    np.testing.assert_allclose(kept.per_node("rest_angle_x"), bent.whip.per_node("rest_angle_x"), rtol=1e-12)
    (slope,) = slopes(plant, ["profile.linear_density"])
    h = 1e-6 * plant.values()["profile.linear_density"]
    up, down = (
        plant.changed({"profile.linear_density": plant.values()["profile.linear_density"] + s}).quantities()["whip.m"]
        for s in (h, -h)
    )
    np.testing.assert_allclose(slope["whip.m"], (up - down) / (2 * h), rtol=1e-6)


def test_what_has_no_place_in_space_is_refused():
    with pytest.raises(InputError, match=r"^clamp"):
        Plant(preset("ur5e"), clamp=0.1)
