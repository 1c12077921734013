"""Generated functions of systems."""

from __future__ import annotations

import casadi as ca
import pytest
from rich_model import CONTROLLERS, everything

from whiptool.dynamics.closed_loop import closed_loop
from whiptool.dynamics.structure import Structure
from whiptool.dynamics.swing import SwingStructure, swing
from whiptool.dynamics.system import along


@pytest.mark.parametrize("forward", [False, True])
@pytest.mark.parametrize("driven", ["by its arm", "by its base"])
def test_no_generated_function_takes_a_power_lane_by_lane(driven, forward):
    """A power of a vector of lanes is a call for each: with one in it, a step took three times as long."""
    if driven == "by its arm":
        system = closed_loop(Structure.of(everything(), CONTROLLERS["oiac"]))
    else:
        system = swing(SwingStructure.of(n=3, moving=True, point_masses=False, used=["dry_friction"]))
    functions = [along(f) if forward else f for f in system.functions.values()]
    used = {f.instruction_id(k) for f in functions for k in range(f.n_instructions())}
    assert used & {ca.OP_SQRT}  # dry friction is in it
    assert not used & {ca.OP_POW, ca.OP_CONSTPOW}
