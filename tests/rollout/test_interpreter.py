"""CasADi's interpreter and the compiled code agree."""

from __future__ import annotations

import numpy as np
import pytest
from rich_model import COMPUTED, CONTROLLERS, LEMON, everything

from whiptool.models.strike import default_bounds
from whiptool.rollout import CompiledRollout

TARGET = np.array([1.3, 0.0])
STRIKES = default_bounds(LEMON.arm).sample(np.random.default_rng(5), 40)


@pytest.mark.parametrize("controller", CONTROLLERS.values(), ids=CONTROLLERS)
@pytest.mark.parametrize("model", [LEMON, everything()], ids=["lemon2024", "everything"])
def test_interpreter_and_compiled_code_agree(model, controller):
    native, slow = (
        CompiledRollout(model, controller, timestep=2.5e-4, engine=name) for name in ("scalar", "interpreter")
    )
    assert (native.engine, slow.engine) == ("scalar", "interpreter")
    a, b = (r.approach(STRIKES[:4], TARGET, t_stay=0.3) for r in (native, slow))
    for name in COMPUTED:
        np.testing.assert_allclose(getattr(a, name), getattr(b, name), rtol=1e-8, atol=1e-9)
