"""Numbers as people read them."""

from __future__ import annotations

import math

from whiptool.words import counted, fixed, rounded, times


def test_one_thing_is_singular():
    assert counted(1, "strike") == "1 strike"
    assert counted(0, "strike") == "0 strikes"
    assert counted(1200, "strike") == "1,200 strikes"
    assert counted(2, "axis", "axes") == "2 axes"


def test_what_has_no_ratio_gets_none():
    assert times(2.54, "DDPG") == "2.5 times DDPG"
    for none in (math.inf, math.nan, 0.0, -3.0):
        assert times(none, "DDPG") == "no ratio to DDPG"


def test_the_rest_of_a_rounding_is_nothing():
    assert rounded(1.753e-20, 4) == "0"
    assert rounded(-1e-16) == "0"
    assert rounded(2.5e-7, 4) == "2.5e-07"
    assert rounded(math.inf) == "none"
    assert (fixed(2.5), fixed(math.inf), fixed(0.4, 0)) == ("2.50", "none", "0")
