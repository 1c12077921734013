"""Degrees of freedom of a fit whose recordings have more unknowns of their own than readings."""

from __future__ import annotations

import numpy as np
import pytest

from whiptool.identification.solver import Block
from whiptool.identification.uncertainty import assess
from whiptool.identification.variables import variable


@pytest.mark.parametrize("readings", [40, 400])
def test_readings_that_unknowns_take_up_are_those_of_the_hat_matrix(readings):
    """A hand's motion has hundreds of coefficients, which a log knows; a camera has some hundred readings of them."""
    rng, unknowns = np.random.default_rng(0), 120
    A, B, log = (rng.standard_normal(shape) for shape in ((readings, 1), (readings, unknowns), (unknowns, unknowns)))
    rows = np.vstack([B, 30 * log])
    taken_up = np.trace(np.linalg.pinv(rows)[:, :readings] @ B)  # of the smoother from readings to fitted readings
    r = rng.standard_normal(readings + unknowns)
    block = Block(r, np.vstack([A, np.zeros((unknowns, 1))]), rows)
    at = [np.zeros(readings, int)], [np.arange(readings) / 60]
    found = assess([variable("whip.k", 1.0)], np.zeros(1), [block], *at, None)
    freedom = readings - 1 - taken_up
    assert freedom < readings - 1
    assert found.residual_variance == pytest.approx(r[:readings] @ r[:readings] / freedom)
