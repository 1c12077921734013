"""The whip alone against the whole model."""

from __future__ import annotations

import numpy as np
import pytest
from films import film

from whiptool.identification.plant import Plant
from whiptool.identification.predict import Predictor
from whiptool.impedance import Controller
from whiptool.models import preset
from whiptool.models.strike import default_bounds

LEMON, CONTROLLER = preset("lemon2024"), Controller()
STRIKES = default_bounds(LEMON.arm).sample(np.random.default_rng(0), 8)


@pytest.mark.parametrize("drive", ["joints", "handle"])
def test_the_whip_alone_follows_the_whole_model(drive):
    """Arm, controller and whip together, and the whip on the hand's motion, are two derivations of one path."""
    recording = film(LEMON, STRIKES[0], markers=("tip", "handle", "node5"), rate=400.0)
    P = Predictor([recording], Plant(LEMON), drive=drive, shared=["whip.k"], timestep=2.5e-4)
    error = (P(Plant(LEMON), {}, P.start, derivatives=False)[0].value - recording.points.ravel()).reshape(-1, 3, 2)
    assert np.abs(error[:, 0]).max() < 1e-3
    assert np.abs(error[:, 1]).max() < 2e-5
