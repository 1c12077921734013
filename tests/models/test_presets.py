"""Presets: published figures, and forward kinematics known from elsewhere."""

from __future__ import annotations

import math

import numpy as np
import pytest

from whiptool.errors import InputError
from whiptool.impedance import constant_preset, oiac_preset
from whiptool.limits.arm_limits import limits_preset
from whiptool.models import Strike, default_bounds, load_model, preset, read_model, write_model
from whiptool.models.kinematics import arm_frames, rotation_about
from whiptool.models.presets import PANDA_ARM, UR5E_ARM
from whiptool.models.strike import named_strike, strike_names


def hand(arm, q) -> np.ndarray:
    return arm_frames(arm, np.array(q, float))[-1].origin


def test_the_ur5e_stands_where_its_denavit_hartenberg_parameters_say():
    """The maker's table, multiplied out; its base frame is turned by half a turn from ours."""
    d, a = (0.1625, 0, 0, 0.1333, 0.0997, 0.0996), (0, -0.425, -0.3922, 0, 0, 0)
    alpha = (math.pi / 2, 0, 0, math.pi / 2, -math.pi / 2, 0)

    def tool(q):
        T = np.diag([-1.0, -1.0, 1.0, 1.0])
        for theta, offset, length, twist in zip(q, d, a, alpha, strict=True):
            step = np.eye(4)
            step[:3, :3] = rotation_about((0, 0, 1), theta) @ rotation_about((1, 0, 0), twist)
            step[:3, 3] = length * math.cos(theta), length * math.sin(theta), offset
            T = T @ step
        return T

    for q in np.random.default_rng(0).uniform(-3, 3, (10, 6)):
        frame, T = arm_frames(UR5E_ARM, q)[-1], tool(q)
        np.testing.assert_allclose(frame.origin, T[:3, 3], atol=1e-15)
        np.testing.assert_allclose(-frame.rotation[:, 2], T[:3, 2], atol=1e-14)  # the whip goes on out of the flange


def test_the_panda_stands_where_its_denavit_hartenberg_parameters_say():
    """Craig's convention, as the maker's table has them."""
    d, a = (0.333, 0, 0.316, 0, 0.384, 0, 0, 0.107), (0, 0, 0, 0.0825, -0.0825, 0, 0.088, 0)
    alpha = np.array([0, -1, 1, 1, -1, 1, 1, 0]) * math.pi / 2
    for q in np.random.default_rng(1).uniform(-3, 3, (10, 7)):
        T = np.eye(4)
        for theta, offset, length, twist in zip([*q, 0], d, a, alpha, strict=True):
            R = rotation_about((1, 0, 0), twist) @ rotation_about((0, 0, 1), theta)
            step = np.eye(4)
            step[:3, :3] = R
            step[:3, 3] = length, -math.sin(twist) * offset, math.cos(twist) * offset
            T = T @ step
        frame = arm_frames(PANDA_ARM, q)[-1]
        np.testing.assert_allclose(frame.origin, T[:3, 3], atol=1e-15)
        np.testing.assert_allclose(-frame.rotation[:, 2], T[:3, 2], atol=1e-14)


def test_figures_of_the_robots():
    ur5e, panda = preset("ur5e"), preset("panda")
    assert UR5E_ARM.per_link("mass").sum() == pytest.approx(17.7)  # without the base's 4 kg, of 20.6 kg with cable
    assert [link.limits.torque for link in ur5e.arm.links] == [150, 150, 150, 28, 28, 28]
    assert {link.limits.velocity for link in ur5e.arm.links} == {math.pi}
    assert [link.limits.acceleration for link in panda.arm.links] == [15, 7.5, 10, 12.5, 15, 20, 20]
    assert [link.limits.jerk for link in panda.arm.links] == [7500, 3750, 5000, 6250, 7500, 10000, 10000]
    assert {link.limits.torque_rate for link in panda.arm.links} == {1000}
    for model, bare in ((ur5e, UR5E_ARM), (panda, PANDA_ARM)):
        assert model.arm.per_link("mass").sum() == pytest.approx(bare.per_link("mass").sum() + 0.09)
        q = np.linspace(-1, 1, bare.n)
        assert np.linalg.norm(hand(model.arm, q) - hand(bare, q)) == pytest.approx(0.65)
        assert (model.whip.N, model.whip.length) == (20, pytest.approx(1.0))
        assert model.whip.mass == pytest.approx(700 * math.pi * 0.00635**2)
        assert model.whip.per_node("k")[5] == pytest.approx(2e5 * math.pi / 4 * 0.00635**4 / 0.05)


def test_the_person_s_arm_hangs_and_points():
    """Flexion lifts it forward; abduction, before rotation, moves it in the frontal plane; the elbow bends forward."""
    arm = preset("nah2023").arm
    reach = 0.294 + 0.291
    np.testing.assert_allclose(hand(arm, [0, 0, 0, 0]), [0, 0, -reach], atol=1e-15)
    np.testing.assert_allclose(hand(arm, [np.pi / 2, 0, 0, 0]), [reach, 0, 0], atol=1e-15)
    np.testing.assert_allclose(hand(arm, [0, np.pi / 2, 0, 0]), [0, -reach, 0], atol=1e-15)
    np.testing.assert_allclose(hand(arm, [0, 0, 0, np.pi / 2]), [0.291, 0, -0.294], atol=1e-15)
    np.testing.assert_allclose(hand(arm, [0, 0, np.pi / 2, np.pi / 2]), [0, 0.291, -0.294], atol=1e-15)
    whip = preset("nah2023").whip
    assert (whip.N, whip.length, whip.mass) == (25, pytest.approx(1.8), pytest.approx(0.3))
    assert whip.per_node("node_inertia")[0] == pytest.approx(1.92e-6)
    assert whip.per_node("k")[0] == whip.per_node("b")[0] == 0


def test_bounds_of_strikes():
    person = default_bounds(preset("nah2023").arm)
    assert np.array(person.lower[:8]) == pytest.approx(np.pi * np.array([-0.5, -0.5, -0.5, 0, 0.1, -0.5, -0.5, 0]))
    assert np.array(person.upper[:8]) == pytest.approx(np.pi * np.array([-0.1, 0.5, 0.5, 0.9, 1, 0.5, 0.5, 0.9]))
    assert (person.lower[8], person.upper[8]) == (0.4, 1.5)
    panda = default_bounds(preset("panda").arm)
    assert panda.lower[:7] == panda.lower[7:14] == tuple(link.limits.position[0] for link in preset("panda").arm.links)
    assert panda.upper[5] == 3.7525
    assert set(default_bounds(preset("ur5e").arm).upper[:12]) == {np.pi}
    on_and_on = default_bounds(type(preset("nah2023").arm)(preset("nah2023").arm.links))  # no names, and no limits
    assert set(on_and_on.lower[:8]) == {-np.pi}
    assert set(on_and_on.upper[:8]) == {np.pi}


def test_names_of_strikes():
    names = strike_names(preset("nah2023").arm)
    assert names[:2] == ("q_shoulder_flexion_i", "q_shoulder_abduction_i")
    assert names[-2:] == ("q_elbow_f", "D")
    assert strike_names(preset("panda").arm)[:2] == ("q_1i", "q_2i")
    strike = Strike(range(6), range(6, 12), 0.8)
    assert named_strike(strike, preset("ur5e").arm)["q_wrist_3_f"] == 11.0


@pytest.mark.parametrize("name", ["nah2023", "ur5e", "panda"])
def test_presets_read_back_the_same_from_files(name, tmp_path):
    write_model(preset(name), tmp_path / "model.toml")
    assert read_model(tmp_path / "model.toml") == load_model(name)


def test_published_presets():
    lemon = preset("lemon2024")
    w = lemon.whip
    assert (w.N, w.l, w.m, w.k, w.b) == (12, 0.072, 0.012, 0.242, 0.092)  # Table 2
    assert [(link.mass, link.length) for link in lemon.arm.links] == [(0.25, 0.31), (0.274, 0.34)]  # Table 3
    assert lemon.whip.length == pytest.approx(0.864)
    assert lemon.whip.mass == pytest.approx(0.144)
    fitted = preset("nah2020-fitted")
    assert (fitted.whip.length, fitted.whip.mass) == (pytest.approx(1.8), pytest.approx(0.3))
    assert {preset(f"nah2020-n{n}").whip.N for n in (10, 15, 20)} == {10, 15, 20}


def test_a_preset_of_no_such_name_is_refused_with_all_names():
    names = "lemon2024, nah2020-n10.*fr3; did you mean lemon2024"
    with pytest.raises(InputError, match=rf"^model preset: got 'lemon2023'; allowed: {names}\?$"):
        preset("lemon2023")


@pytest.mark.parametrize("written", ["UR5e", "UR5E", "ur5e"])
def test_capital_letters_make_no_difference(written):
    assert preset(written) == load_model(written) == preset("ur5e")
    assert limits_preset("XM430") is limits_preset("xm430")
    assert oiac_preset("Table4") is oiac_preset("table4")
    assert constant_preset(written) is constant_preset("ur5e")


@pytest.mark.parametrize("name", ["ur5e", "panda", "fr3"])
def test_robots_default_to_what_they_accept_and_stand_on_a_floor(name):
    """Position control, a rope of rods, the floor of their base, and a start posture that is clear of it."""
    from whiptool.impedance import default_controller
    from whiptool.models.mount import default_floor

    model = preset(name)
    assert default_controller(model).prescribed
    assert model.whip.joints == "rod"
    assert default_floor(model.arm) == 0.0
    assert model.arm.rate in (500.0, 1000.0)
    assert all(joint.endswith(("_joint", *"1234567")) for joint in model.arm.names)
    assert set(model.arm.names).isdisjoint(model.arm.joints)
