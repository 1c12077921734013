"""Figures of the dynamics show the numbers that they are given, with units."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure
from scipy.special import j0, jn_zeros
from space_swing import swing

from whiptool.dynamics import hanging_modes
from whiptool.errors import InputError
from whiptool.models import Model, WhipProfile, preset
from whiptool.models.kinematics import joint_points
from whiptool.models.parameters import in_space
from whiptool.models.trajectory import Trajectory
from whiptool.rollout.energy import Energies, energies
from whiptool.viz import plots_dynamics
from whiptool.viz.drawn_posture import arm_and_whip

LEMON = preset("lemon2024")
CHAIN = WhipProfile(length=0.9, linear_density=0.17, bending_stiffness=1e-9, bending_damping=0.0)
LIMP = replace(LEMON, whip=CHAIN.lump(60))


def turning(omega=2.0, instants=50):
    """Arm and whip stretched, turning about the shoulder like one rigid rod."""
    t, n = np.linspace(0, 0.5, instants), LEMON.n
    q, v = np.zeros((instants, n)), np.zeros((instants, n))
    q[:, 0], v[:, 0] = omega * t, omega
    two, gains = np.zeros((instants, 2)), np.zeros((instants, 2, 2))
    return Trajectory(t=t, q=q, v=v, q_d=two, v_d=two, tau=two, K=gains, B=gains, tip=two, tip_velocity=two)


def has_units(ax, *units):
    return all(unit in label for unit, label in zip(units, (ax.get_xlabel(), ax.get_ylabel()), strict=True))


def test_speeds_of_a_rigid_rod_grow_with_the_distance_from_the_shoulder():
    ax = Figure().subplots()
    for omega in (6.0, 2.0):  # the slower one does not cut the faster one off
        plots_dynamics.plot_speed_along_whip(ax, turning(omega), LEMON, label="rod")
    assert has_units(ax, "[m]", "[m/s]")
    s, speed = ax.lines[1].get_data()
    np.testing.assert_allclose(speed, 2.0 * (LEMON.arm.length + s), rtol=1e-12)
    assert s[-1] == pytest.approx(LEMON.whip.length)
    assert ax.get_ylim()[1] > 6.0 * LEMON.reach


def test_speeds_in_space_are_those_of_the_places():
    model = preset("nah2023")
    path = swing(model, instants=3001)
    places = np.stack(arm_and_whip(model, path.q)[1], axis=0)  # (T, N + 1, 3)
    speed = np.linalg.norm(np.gradient(places, path.t, axis=0, edge_order=2), axis=-1).max(axis=0)
    ax = plots_dynamics.plot_speed_along_whip(Figure().subplots(), path, model)
    np.testing.assert_allclose(ax.lines[0].get_ydata(), speed, rtol=1e-4)


def test_energies_in_space_are_drawn_node_by_node():
    model = preset("nah2023")
    model = replace(model, whip=replace(model.whip, node_inertia=0.0))
    path = swing(model, instants=500)
    e = energies(model, path)
    image, *_ = plots_dynamics.plot_energy_flow(Figure().subplots(), e, model).collections
    shown = np.asarray(image.get_array())
    speed = np.linalg.norm(np.gradient(joint_points(model, path.q), path.t, axis=0, edge_order=2), axis=-1)[:, 5:]
    expected = 1e3 * model.whip.per_node("m") * speed**2 / 2
    assert shown.shape == (25, 500)
    np.testing.assert_allclose(shown[:, 250], expected[250], rtol=1e-3, atol=1e-3)


def test_the_image_shows_each_node_where_it_is():
    e = energies(LEMON, turning())
    kinetic = np.zeros_like(e.kinetic)
    kinetic[:, -1] = 0.003  # [J], all at the tip
    ax = plots_dynamics.plot_energy_flow(Figure().subplots(), replace(e, kinetic=kinetic), LEMON)
    assert has_units(ax, "[s]", "[m]")
    (image,) = (x for x in ax.collections if isinstance(x, QuadMesh))
    shown = np.asarray(image.get_array())
    assert shown.shape == (12, 50)
    assert shown[-1] == pytest.approx(3.0)  # [mJ]
    assert not shown[:-1].any()
    assert ax.lines[0].get_ydata() == pytest.approx(LEMON.whip.length)


def test_the_balance_shows_all_terms():
    T, n = 20, LEMON.n
    t, ones = np.linspace(0, 1, T), np.ones((T, n))
    e = Energies(t=t, kinetic=ones * t[:, None], weight=ones, springs=ones, work=5 * t, lost=2 * t)
    ax = plots_dynamics.plot_energy_balance(Figure().subplots(), e)
    assert has_units(ax, "[s]", "[J]")
    last = {line.get_label(): line.get_ydata()[-1] for line in ax.lines}
    assert last == pytest.approx({"work of the motors": 5, "kinetic": n, "weight and springs": 0, "lost": 2})


def test_mode_i_crosses_the_vertical_i_times():
    ax = plots_dynamics.plot_mode_shapes(Figure().subplots(), hanging_modes(LIMP), LIMP, count=3)
    assert ax.yaxis_inverted()  # the hand is above
    for i, line in enumerate(ax.lines[:3]):
        x = line.get_xdata()
        assert np.abs(x).max() == pytest.approx(1)
        assert (np.diff(np.sign(x[1:])) != 0).sum() == i
        # of a hanging chain: J_0(j sqrt(height over the tip / length)), j its zeros
        above = 1 - line.get_ydata() / LIMP.whip.length
        assert x[-1] * x == pytest.approx(j0(jn_zeros(0, 3)[i] * np.sqrt(above.clip(0))), abs=0.03)
    with pytest.raises(InputError, match="count"):
        plots_dynamics.plot_mode_shapes(ax, hanging_modes(LIMP, count=3), LIMP)


@pytest.mark.parametrize("joints", ["universal", "rod"])
def test_modes_in_space_are_drawn_like_those_of_the_plane(joints):
    """Each twice, whatever the directions that it moves in."""
    limp = replace(LEMON, whip=CHAIN.lump(8))
    space = Model(replace(limp.whip, joints=joints), in_space(LEMON.arm))
    posture = np.array([0.5, 0.4])
    flat = plots_dynamics.plot_mode_shapes(Figure().subplots(), hanging_modes(limp), limp, count=2)
    both = plots_dynamics.plot_mode_shapes(Figure().subplots(), hanging_modes(space, posture=posture), space, count=4)
    for i, line in enumerate(both.lines[:4]):
        expected = flat.lines[i // 2].get_xdata()
        np.testing.assert_allclose(line.get_xdata(), expected, atol=1e-6)
        assert "Hz" in both.get_legend().get_texts()[i].get_text()


def test_the_legend_says_what_is_overdamped():
    ax = plots_dynamics.plot_mode_shapes(Figure().subplots(), hanging_modes(LEMON), LEMON)
    said = [text.get_text() for text in ax.get_legend().get_texts()]
    assert ["overdamped" in text for text in said] == [False, False, True, True]
    assert all("Hz" in text for text in said)
