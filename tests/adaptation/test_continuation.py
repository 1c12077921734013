"""Strikes that are followed from one whip to another one."""

from dataclasses import replace

import numpy as np
import pytest

import whiptool as wt
from whiptool.adaptation.continuation import between, continued
from whiptool.models import preset
from whiptool.strike_map.map_files import shipped_map
from whiptool.strike_map.striker import Striker

MODEL = preset("lemon2024")
FIRST = MODEL.whip
TAPERED = replace(FIRST, m=tuple(np.linspace(0.02, 0.01, FIRST.N).tolist()), l=0.09, k=0.4, drag=0.01)


def test_between_two_whips_numbers_are_means_node_by_node():
    middle = between(FIRST, TAPERED, 0.25)
    np.testing.assert_allclose(middle.m, 0.75 * FIRST.m + 0.25 * np.linspace(0.02, 0.01, FIRST.N))
    assert middle.l == pytest.approx(0.75 * FIRST.l + 0.25 * 0.09)
    assert middle.drag == pytest.approx(0.0025)
    assert (middle.N, middle.joints) == (FIRST.N, FIRST.joints)
    for name in ("m", "k", "b", "drag", "dry_friction"):
        np.testing.assert_allclose(between(FIRST, TAPERED, 0.0).per_node(name), FIRST.per_node(name))
        np.testing.assert_allclose(between(FIRST, TAPERED, 1.0).per_node(name), TAPERED.per_node(name))


def test_strikes_hit_with_the_other_whip_in_mujoco():
    goal = wt.Target((1.2, 0.1), hit_radius=0.01).goals
    strikes = shipped_map("lemon2024").refined(goal).strikes

    def striker(whip):
        return Striker(wt.CompiledRollout(replace(MODEL, whip=whip)))

    assert not striker(TAPERED).strike(strikes, goal).hit[0]
    (found,) = continued(strikes, FIRST, TAPERED, goal, striker)
    path = wt.ReferenceRollout(replace(MODEL, whip=TAPERED)).trajectory(wt.Strike.from_vector(found))
    assert path.approach(wt.Target((1.2, 0.1))).distance < 0.01


def test_whips_of_other_numbers_of_nodes_and_goals_out_of_reach_have_none():
    goal = wt.Target((1.2, 0.1), hit_radius=0.01).goals
    strikes = shipped_map("lemon2024").refined(goal).strikes

    def striker(whip):
        return Striker(wt.CompiledRollout(replace(MODEL, whip=whip)))

    assert not len(continued(strikes, FIRST, replace(FIRST, N=8), goal, striker))
    assert not len(continued(strikes, FIRST, replace(FIRST, l=0.02), goal, striker))
