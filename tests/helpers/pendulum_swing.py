"""The swing of a pendulum that is known."""

from __future__ import annotations

import numpy as np

from whiptool.identification.pendulum import AngleRecording, Pendulum
from whiptool.identification.predict import Predictor


def swing(pendulum: Pendulum, start: np.ndarray, rng: np.random.Generator | None = None) -> AngleRecording:
    """A free swing of 1.5 s, as the model itself predicts it; with a generator, with 1 mrad of noise."""
    t = np.arange(0, 1.5, 0.005)
    empty = AngleRecording(t, np.zeros((len(t), pendulum.n)), start)
    P = Predictor([empty], pendulum, drive="free", shared=["gravity"])
    angles = P(pendulum, {}, P.start, derivatives=False)[0].value.reshape(-1, pendulum.n)
    return AngleRecording(t, angles + (0 if rng is None else 1e-3 * rng.standard_normal(angles.shape)), start)
