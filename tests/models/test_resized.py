"""Whips of another length, number of nodes or taper: what is the same along them stays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from whiptool.dynamics.modes import hanging_modes
from whiptool.errors import InputError
from whiptool.models import Model, WhipProfile, preset
from whiptool.models.profile import lumped_from
from whiptool.models.resized import resized
from whiptool.models.whip import WhipParameters

LEMON = preset("lemon2024")
TAPERED = WhipProfile(
    1.2, 0.1, 0.02, 0.003, density_taper=0.25, stiffness_taper=0.06, damping_taper=0.1, rest_curvature=0.3, drag=0.01,
    tip_mass=0.02,
)  # fmt: skip
EVEN = WhipParameters(
    N=10, l=0.1, m=0.02, k=0.3, b=0.05, rest_angle=0.1, drag=2e-3, hinge_mass=0.01, cubic_stiffness=0.4,
    dry_friction=1e-3, friction_velocity=0.2,
)  # fmt: skip


@pytest.mark.parametrize("N", [3, 8, 25])
def test_a_tapered_profile_is_known_by_its_nodes(N):
    found = lumped_from(TAPERED.lump(N))
    assert found is not None
    assert found.numbers == pytest.approx(TAPERED.numbers, rel=1e-12)
    beaded = replace(TAPERED, bead_mass=0.01, bead_place=0.4).lump(N)
    assert lumped_from(beaded) is None


@pytest.mark.parametrize("clamped", [False, True])
def test_a_whip_of_a_profile_is_lumped_anew_from_it(clamped):
    longer = replace(TAPERED, length=1.5)
    made, expected = (resized(TAPERED.lump(12, clamped=clamped), length=1.5, nodes=7), longer.lump(7, clamped=clamped))
    for name in ("l", "m", "k", "b", "rest_angle", "drag"):
        np.testing.assert_allclose(made.per_node(name), expected.per_node(name), rtol=1e-9)


def test_an_even_whip_keeps_what_it_has_per_length():
    """Moments of the same curvature, 0.7 1/m, and of the same rate of it; friction, which has no length."""
    made, curvature = resized(EVEN, length=1.3, nodes=20), 0.7
    bend, was = made.l * curvature, EVEN.l * curvature
    assert made.m / made.l == pytest.approx(EVEN.m / EVEN.l)
    assert made.drag / made.l == pytest.approx(EVEN.drag / EVEN.l)
    assert made.rest_angle / made.l == pytest.approx(EVEN.rest_angle / EVEN.l)
    assert made.k * bend == pytest.approx(EVEN.k * was)
    assert made.b * bend == pytest.approx(EVEN.b * was)
    assert made.cubic_stiffness * bend**3 == pytest.approx(EVEN.cubic_stiffness * was**3)
    assert made.friction_velocity / bend == pytest.approx(EVEN.friction_velocity / was)
    assert made.dry_friction == EVEN.dry_friction
    assert resized(EVEN) == EVEN


def test_more_nodes_swing_alike():
    """The slowest modes of a whip of 24 and 48 nodes: the same to what lumping leaves."""
    few, many = (hanging_modes(Model(resized(EVEN, nodes=N), LEMON.arm), count=2).frequencies for N in (24, 48))
    np.testing.assert_allclose(few, many, rtol=0.02)


def test_an_uneven_whip_can_only_be_stretched():
    uneven = replace(EVEN, k=tuple(np.linspace(0.1, 0.3, 10)))
    assert resized(uneven, length=2.0).k == pytest.approx(np.linspace(0.05, 0.15, 10))
    with pytest.raises(InputError, match=r"nodes: got 3; allowed: 10, as whip\.k is given node by node"):
        resized(uneven, nodes=3)
    with pytest.raises(InputError, match=r"whip\.k: got 'a value per node'"):
        resized(uneven, taper=0.5)
