"""What comes of a fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from whiptool.identification.plant import Identifiable
from whiptool.identification.solver import Solution, Status
from whiptool.identification.uncertainty import Parameter, Uncertainty


@dataclass(frozen=True)
class RecordingFit:
    """One recording beside its prediction.

    Args:
        source: Where it came from.
        residuals: Predicted minus measured [m] or [rad], (K,).
        measured: (K,).
        sigma: Stated standard errors, (K,).
        weight: From Huber's loss, 1 for what fits, (K,).
        channels: Frame, marker and axis of each residual, (K, 3).
        markers: Names of the markers that `channels` counts.
        own: The recording's own unknowns by name.
        t: Times of the predicted path [s], (S,).
        path: Predicted path of each marker, (S, 2) [m] or (S, 1) [rad], in the recording's frame and clock.
    """

    source: str
    residuals: np.ndarray
    measured: np.ndarray
    sigma: np.ndarray
    weight: np.ndarray
    channels: np.ndarray
    markers: tuple[str, ...]
    own: dict[str, float]
    t: np.ndarray
    path: dict[str, np.ndarray]

    @property
    def rmse(self) -> float:
        """Root mean square of the residuals [m] or [rad]."""
        return float(np.sqrt(np.mean(self.residuals**2)))

    @property
    def chi(self) -> float:
        """The same in units of the stated errors; about 1 if model and errors are right."""
        return float(np.sqrt(np.mean((self.residuals / self.sigma) ** 2)))


@dataclass(frozen=True)
class Run:
    """One start and where it led.

    Args:
        start: First values of the shared free numbers by name.
        values: Last ones.
        solution: Of the last stage; its history holds the convergence.
    """

    start: dict[str, float]
    values: dict[str, float]
    solution: Solution


@dataclass(frozen=True)
class Fit:
    """An identified model.

    Args:
        plant: With the fitted numbers.
        drive: What drove the whip.
        parameters: Each shared free number with its class and interval.
        nuisance: Fitted values of the shared nuisance.
        uncertainty: Covariance, correlations, flat directions.
        recordings: Those that were fitted.
        held_out: Those that were not.
        runs: All starts, the best first.
        wall_time: [s]
    """

    plant: Identifiable
    drive: str
    parameters: tuple[Parameter, ...]
    nuisance: dict[str, float]
    uncertainty: Uncertainty
    recordings: tuple[RecordingFit, ...]
    held_out: tuple[RecordingFit, ...]
    runs: tuple[Run, ...]
    wall_time: float

    def __getitem__(self, name: str) -> Parameter:
        """The parameter of that name."""
        return next(p for p in self.parameters if p.name == name)

    @property
    def status(self) -> Status:
        """How the best run ended."""
        return self.runs[0].solution.status
