"""The whip on a handle: limits that have a closed form, and what was measured."""

from __future__ import annotations

import numpy as np
import pytest
from human_data import write_made_up

from papers.human.bullwhip import DENSITY, LENGTH, PLACES, Bullwhip, cascades
from papers.human.cascade_fit import start, unpacked
from papers.human.reading import read_people
from papers.human.throw_path import mean_hand, thrown


@pytest.fixture(scope="module")
def hand(tmp_path_factory):
    people = read_people(write_made_up(tmp_path_factory.mktemp("people")))
    return mean_hand(people.of_style("discrete"), cyclic=False)


def test_places_of_markers():
    assert PLACES[0] == pytest.approx(LENGTH)
    assert PLACES[-1] == pytest.approx(0)
    assert pytest.approx(1.615) == LENGTH  # as they say, 1.6 m


def test_mass_and_stiffness_go_with_the_diameter():
    profile = Bullwhip(0.2, 0.5, 0.1).profile
    assert profile.linear_density == pytest.approx(DENSITY)
    assert profile.density_taper == pytest.approx(0.25)
    assert profile.stiffness_taper == profile.damping_taper == pytest.approx(0.0625)
    assert profile.bending_damping == pytest.approx(0.02)


def test_a_very_stiff_whip_is_a_rod(hand):
    """Every marker then moves as on one rigid body with the handle."""
    path, _ = unpacked(start())
    found = cascades(hand, [path], [Bullwhip(3e4, 1.0, 0.02)])[0]
    handle = thrown(hand, path, 5e-4)
    theta, omega = handle.inputs[:, 0], handle.inputs[:, 1]
    side = np.stack([np.cos(theta), np.sin(theta)], axis=1)
    velocity = handle.inputs[:, 3:5][:, None] + (omega[:, None] * PLACES)[..., None] * side[:, None]
    speeds = np.linalg.norm(velocity, axis=2)[handle.onset : handle.end + 1]
    np.testing.assert_allclose(found.peaks, speeds.max(axis=0), rtol=0.02)
    out = np.array([np.sin(theta[handle.peak]), -np.cos(theta[handle.peak])])
    np.testing.assert_allclose(found.shape, PLACES[:, None] * out, atol=0.03)


def test_more_nodes_say_the_same(hand):
    path, whip = unpacked(start())
    coarse, fine = (cascades(hand, [path], [whip], nodes=count)[0] for count in (20, 40))
    np.testing.assert_allclose(coarse.peaks, fine.peaks, rtol=0.05)
    np.testing.assert_allclose(coarse.times, fine.times, atol=0.03)


def test_only_ratios_to_the_mass_matter(hand, monkeypatch):
    import papers.human.bullwhip as module

    path, whip = unpacked(start())
    one = cascades(hand, [path], [whip])[0]
    monkeypatch.setattr(module, "DENSITY", 2 * DENSITY)
    monkeypatch.setattr(module, "DRAG", 2 * module.DRAG)
    other = cascades(hand, [path], [Bullwhip(2 * whip.stiffness, whip.taper, whip.damping_time)])[0]
    np.testing.assert_allclose(one.peaks, other.peaks, rtol=1e-6)
