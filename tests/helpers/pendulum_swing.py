"""The swing of a pendulum that is known."""

from __future__ import annotations

import numpy as np

from whiptool.identification.plant import BareArm, Plant
from whiptool.identification.predict import Predictor
from whiptool.models.parameters import ArmLink, ArmParameters
from whiptool.recording.strike_recording import StrikeRecording


def pendulum(links: tuple[ArmLink, ...], *numbers) -> Plant:
    """An arm without a whip."""
    return Plant(BareArm(ArmParameters(links), *numbers))


def angles_of(
    t: np.ndarray, angles: np.ndarray, start: np.ndarray | None = None, sigma: float = 1e-3, source: str = ""
) -> StrikeRecording:
    """The recording of the angles (T, links) of a pendulum."""
    markers = tuple(f"link{i + 1}" for i in range(angles.shape[1]))
    return StrikeRecording(t, angles[..., None], markers, sigma, first_state=start, source=source)


def swing(plant: Plant, start: np.ndarray, rng: np.random.Generator | None = None) -> StrikeRecording:
    """A free swing of 1.5 s, as the model itself predicts it; with a generator, with 1 mrad of noise."""
    t, n = np.arange(0, 1.5, 0.005), plant.model.arm.n
    P = Predictor([angles_of(t, np.zeros((len(t), n)), start)], plant, drive="free", shared=["gravity"])
    angles = P(plant, {}, P.start, derivatives=False)[0].value.reshape(-1, n)
    return angles_of(t, angles + (0 if rng is None else 1e-3 * rng.standard_normal(angles.shape)), start)
