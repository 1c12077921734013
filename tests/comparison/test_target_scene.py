"""Target zones of comparisons: their names and words."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from lemon_scene import scene

from whiptool.comparison.series import difficulty_sentence
from whiptool.comparison.target_scene import check_zone, words, zone_named
from whiptool.errors import InputError
from whiptool.goals.zone import Disc, ReachableDisc, Region
from whiptool.models import preset


def test_zones_have_names_and_words():
    reach = preset("lemon2024").reach
    assert zone_named("0.2", scene(0.1), None) == Disc((1.3, 0.0), 0.2)
    wide = zone_named("0.3", scene(0.1), None)
    assert wide == ReachableDisc(Disc((1.3, 0.0), 0.3), reach)
    assert zone_named("0.2", replace(scene(0.1), zone=wide), None) == Disc((1.3, 0.0), 0.2)
    assert words(wide) == f"what is within reach ({reach:.3f} m) of a disc of radius 0.3 m around (1.3, 0) m"
    assert words(Disc((1.3, 0.0), 0.3)) == "a disc of radius 0.3 m around (1.3, 0) m"
    assert words(Region(np.zeros((50, 2)), 0.2)) == "wherever the tip can pass with 3 m/s, 2.00 m^2"
    assert difficulty_sentence({"one_strike_hits": 0.92, "random_strikes_hit": 0.086}) == (
        "One and the same strike hits 92.0 % of the targets; random strikes hit 8.6 %."
    )
    for bad in ("slow", "-1", "0", "nan"):
        with pytest.raises(InputError, match="zone"):
            check_zone(bad)
