"""Derivatives of the parameter vector by names, against differences of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from whiptool.dynamics.directions import PROFILE, parameter_directions
from whiptool.dynamics.structure import Structure
from whiptool.errors import InputError
from whiptool.impedance import Controller
from whiptool.models import WhipProfile, preset

PROFILED = WhipProfile(
    1.2, 0.1, 0.02, 0.003, density_taper=0.25, stiffness_taper=0.06, damping_taper=0.1, rest_curvature=0.3, drag=0.01,
    tip_mass=0.02,
)  # fmt: skip
LEMON, CONTROLLER = preset("lemon2024"), Controller()
LUMPED = replace(LEMON, whip=PROFILED.lump(9))
UNEVEN = replace(
    LEMON, whip=replace(LEMON.whip, k=tuple(np.linspace(0.0, 0.4, 12)), m=tuple(np.linspace(0.02, 0.01, 12)))
)


def rows(model, names, free=()):
    structure = Structure.of(model, CONTROLLER, free=free)
    return parameter_directions(structure, model, CONTROLLER, names, {})


def differences(model, names, step=1e-6):
    """Central differences of the parameter vector by numbers that `with_parameters` changes."""
    structure, none = Structure.of(model, CONTROLLER), np.zeros((1, 5))
    of_profile = PROFILED.numbers
    found = []
    for name in names:
        value = of_profile[name[8:]] if name.startswith("profile.") else model.whip.common(name[5:])
        h = step * max(abs(value), 1e-3)
        ends = (model.with_parameters({name: value + side * h}) for side in (1, -1))
        high, low = (structure.pack(end, CONTROLLER, none)[0] for end in ends)
        found.append((high - low) / (2 * h))
    return np.array(found)


def test_numbers_of_a_profile_move_all_nodes():
    seen = [f"profile.{x}" for x in PROFILE if not x.startswith("bead") and "waves" not in x]
    np.testing.assert_allclose(rows(LUMPED, seen), differences(LUMPED, seen), rtol=1e-6, atol=1e-6)


def test_one_name_stands_for_the_values_of_all_nodes_in_proportion():
    names = ["whip.k", "whip.m"]
    found = rows(UNEVEN, names)
    np.testing.assert_allclose(found, differences(UNEVEN, names), atol=1e-8)
    columns = Structure.of(UNEVEN, CONTROLLER).columns("whip.k")
    assert found[0, columns].mean() == pytest.approx(11 / 12)  # of the joints beside the hinge: 1
    assert UNEVEN.with_parameters({"whip.k": 2 * UNEVEN.whip.common("k")}).whip.k == pytest.approx(
        2 * np.array(UNEVEN.whip.k)
    )
    even = replace(LEMON, whip=replace(LEMON.whip, k=tuple(LEMON.whip.per_node("k").tolist())))
    np.testing.assert_allclose(rows(even, ["whip.k"]), rows(LEMON, ["whip.k"]), atol=1e-12)


def test_what_has_no_such_number_is_refused():
    for model, name in ((LEMON, "profile.length"), (LUMPED, "profile.colour"), (LUMPED, "whip.colour")):
        with pytest.raises(InputError, match=f"parameter: got '{name}'"):
            rows(model, [name])
    straight = replace(LEMON, whip=replace(PROFILED, drag=0.0).lump(9))
    with pytest.raises(InputError, match=r"name whip\.drag in `free`"):
        rows(straight, ["profile.drag"])
    assert rows(straight, ["profile.drag"], free=["whip.drag"]).any()
    with pytest.raises(InputError, match=r"parameter: got 'profile\.length'; allowed: numbers of a whip that is"):
        LEMON.with_parameters({"profile.length": 1.0})
    with pytest.raises(InputError, match=r"whip\.rest_angle: got 0\.1; allowed: a value per node"):
        replace(LEMON, whip=replace(LEMON.whip, rest_angle=(0.0,) * 12)).with_parameters({"whip.rest_angle": 0.1})
