"""The Cosserat rod by closed forms, and our chain against it."""

from __future__ import annotations

import importlib
import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import brentq
from scipy.special import j0

from whiptool.errors import InputError
from whiptool.impedance import Controller, constant_preset
from whiptool.models import WhipProfile, preset
from whiptool.rollout import ReferenceRollout
from whiptool.rollout.cosserat import CosseratWhip, hand_path

BEAM = WhipProfile(length=0.8, linear_density=0.15, bending_stiffness=0.02, bending_damping=0.0)
STILL = CubicHermiteSpline([0.0, 10.0], np.zeros((2, 3)), np.zeros((2, 3)))


def needs_elastica():
    pytest.importorskip("elastica", reason="needs the extra `oracle`")
    return importlib.import_module("whiptool.rollout.cosserat_parts")


def set_going(whip: CosseratWhip, velocity: np.ndarray, seconds: float, h: float, *, energies: bool = False):
    """The rod on a hand that rests, given velocities along x (elements + 1,): times, the tip's x, and its energies."""
    parts, ea = needs_elastica(), importlib.import_module("elastica")
    steps = round(seconds / h)
    bench, zeros = parts.Bench(), np.zeros((2 * steps + 2, 3))
    rod = whip.add_hanging(bench, np.zeros(3), h)
    bench.constrain(rod).using(parts.MovedHand, places=zeros, velocities=zeros, half=h / 2)
    bench.finalize()
    rod.velocity_collection[0] = velocity
    turning = np.outer([0.0, -1.0, 0.0], np.diff(velocity) / rod.rest_lengths)  # about y in the world
    rod.omega_collection[:] = np.einsum("ijk,jk->ik", rod.director_collection, turning)
    stepper, time = ea.PositionVerlet(), np.float64(0.0)
    t, x, energy = np.arange(steps + 1) * h, np.empty(steps + 1), np.empty(steps + 1)
    for i in range(steps + 1):
        time = stepper.step(bench, time, h) if i else time
        x[i] = rod.position_collection[0, -1]
        if not energies:
            continue
        rod.compute_internal_forces_and_torques(time)  # strains of this instant; those kept are half a step old
        moving = rod.compute_translational_energy() + rod.compute_rotational_energy()
        weight = whip.gravity * rod.mass @ rod.position_collection[2]
        energy[i] = moving + rod.compute_bending_energy() + rod.compute_shear_energy() + weight
    return t, x, energy


@pytest.mark.slow
def test_a_hanging_chain_swings_as_bessel_has_it():
    """Without bending the lowest mode is J0 and its frequency j01 / 2 sqrt(g / L), j01 = 2.4048; to 0.3 %."""
    needs_elastica()
    chain = replace(BEAM, bending_stiffness=1e-7)
    whip = CosseratWhip(chain, elements=24, wave_speed=60.0)
    omega = 2.404826 / 2 * np.sqrt(9.81 / chain.length)
    below = np.linspace(1.0, 0.0, 25)  # of the length
    shape = j0(2.404826 * np.sqrt(below))
    t, x, _ = set_going(whip, 0.02 * shape, 0.5 * np.pi / omega + 0.05, whip.timestep)
    quarter = t[x.argmax()]
    assert quarter == pytest.approx(0.5 * np.pi / omega, rel=3e-3)


@pytest.mark.parametrize("share", [0.0, 0.1])
def test_a_pinned_beam_rings_and_fades_as_its_closed_form(share):
    """Of a beam with one end free tan(beta) = tanh(beta) gives `omega = (beta / L)^2 sqrt(EI / lambda)`, and
    Kelvin-Voigt damping a ratio of `zeta = eta omega / (2 EI)`: half periods to 0.5 %, their decay to 1 %."""
    needs_elastica()
    beta = brentq(lambda x: np.tan(x) - np.tanh(x), 3.5, 4.5)
    omega = (beta / BEAM.length) ** 2 * np.sqrt(BEAM.bending_stiffness / BEAM.linear_density)
    damping = 2 * share * BEAM.bending_stiffness / omega
    whip = CosseratWhip(
        replace(BEAM, bending_damping=damping), elements=32, wave_speed=100.0, radius=0.012, gravity=0.0
    )
    s = np.linspace(0.0, beta, 33)
    shape = np.sin(s) + np.sin(beta) / np.sinh(beta) * np.sinh(s)
    masses = np.r_[np.ones(32), 0.5]
    shape -= s * (masses * s @ shape) / (masses * s @ s)  # of lumps, too, it is not to turn as a whole
    damped = omega * np.sqrt(1 - share**2)
    t, x, _ = set_going(whip, 0.01 * shape, 2.2 * np.pi / damped, whip.timestep)
    zeros = t[1:][np.diff(np.sign(x)) != 0][-2:]
    assert np.diff(zeros)[0] == pytest.approx(np.pi / damped, rel=5e-3)
    first, second = np.abs(x[t < zeros[0]]).max(), np.abs(x[(t > zeros[0]) & (t < zeros[1])]).max()
    assert second / first == pytest.approx(np.exp(-np.pi * share / np.sqrt(1 - share**2)), rel=1e-2)


def test_a_rod_without_damping_keeps_its_energy():
    """To 5e-5 of its kinetic energy, through a wide swing."""
    needs_elastica()
    whip = CosseratWhip(BEAM, elements=10, wave_speed=60.0, radius=0.03)
    energy = set_going(whip, 2.0 * np.linspace(0.0, 1.0, 11), 0.2, 1e-4, energies=True)[2]
    assert np.abs(energy - energy[0]).max() < 5e-5 * 0.5 * BEAM.linear_density * BEAM.length * 4 / 3


def test_a_hinged_chain_moves_as_a_rod_of_as_many_elements():
    """A strike in MuJoCo, drag, a bead and a mass at the tip included: the tip to 0.3 mm on 1 m, at 5 m/s and more."""
    needs_elastica()
    profile = WhipProfile(0.8, 0.15, 0.015, 0.004, drag=0.02, tip_mass=0.01, bead_mass=0.008, bead_place=3 / 8)
    model = replace(preset("lemon2024"), whip=profile.lump(8))
    rollout = ReferenceRollout(model, Controller(constant_preset("nah2020")), timestep=2e-4)
    path = rollout.trajectory(np.array([-1.2, 0.2, 1.2, 1.0, 0.5]), t_stay=0.1)
    assert np.linalg.norm(path.tip_velocity, axis=1).max() > 5
    hand = hand_path(model, path)
    whip = CosseratWhip(profile, elements=8, wave_speed=300.0, radius=0.02, gravity=model.gravity)
    rod, itself = whip.limit([hand], elements=False)
    tip = rod.curve(0)(path.t)
    assert np.abs(tip[:, 1]).max() < 1e-9
    assert np.linalg.norm(tip[:, [0, 2]] - path.tip, axis=1).max() < 3e-4
    assert np.linalg.norm(itself.curve(0)(path.t) - tip, axis=1).max() < 1e-2


@pytest.mark.parametrize("spins", [True, False])
def test_a_bent_rod_that_turns_as_a_whole_loses_nothing(spins):
    """Damping resists bending, and no rotation of the whole; that of elements which cannot spin resists it."""
    parts = needs_elastica()
    bench, whip = parts.Bench(), CosseratWhip(replace(BEAM, bending_damping=0.01), elements=6, spins=spins)
    rod = whip.add_hanging(bench, np.zeros(3), 1e-3)
    bench.finalize()
    for i in range(6):  # bent by 0.3 rad at each node, and turning about the vertical
        along, across = np.array([np.sin(0.3 * i), 0.0, -np.cos(0.3 * i)]), np.array([0.0, 1.0, 0.0])
        rod.director_collection[:, :, i] = [across, np.cross(along, across), along]
        rod.omega_collection[:, i] = rod.director_collection[:, :, i] @ [0.0, 0.0, 2.0]
    rod.omega_collection[2] *= spins
    before = rod.omega_collection.copy()
    bench.constrain_rates(np.float64(0.0))
    lost = 1 - (rod.omega_collection**2).sum() / (before**2).sum()
    assert abs(lost) < 1e-9 if spins else lost > 0.2


def test_what_a_straight_hanging_rod_cannot_be_is_refused():
    with pytest.raises(InputError, match="rest_curvature"):
        CosseratWhip(replace(BEAM, rest_curvature=1.0))


def test_without_pyelastica_the_install_command_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "elastica", None)
    with pytest.raises(InputError, match=r"pip install 'whiptool\[oracle\]'"):
        CosseratWhip(BEAM)
