"""Results of a fit."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from scipy.special import gammaincinv

from whiptool.errors import InputError
from whiptool.identification.forecast import half_width
from whiptool.identification.plant import Plant
from whiptool.identification.solver import Ending, Solution
from whiptool.identification.time_base import ClockFault
from whiptool.identification.uncertainty import MISFIT, Parameter, Uncertainty
from whiptool.identification.variables import names_of, with_unit
from whiptool.models.numbers import NoArray, number
from whiptool.models.parameters import Model
from whiptool.recording.camera import Camera

DEPTH_AXIS = 2  # of a view's readings: after u and v
_FAR = 0.999  # level of the region around the best end that another start's end has to lie in


def known_part(drive: str) -> tuple[float, str]:
    """Return the share of a predicted recording's frames, the first ones, to which its own unknowns are fitted, and its
    name: a pendulum's free swing is long, and chaotic afterwards."""
    return (0.1, "first tenth") if drive == "free" else (0.5, "first half")


@dataclass(frozen=True)
class RecordingFit:
    """One recording and its prediction.

    Args:
        source: File of the recording.
        residuals: Predicted minus measured readings, (K,): [m], [rad], or for a camera in space [pixels] and, for
            depth, its inverse [1/m].
        measured: Measured readings in the same units, (K,).
        sigma: Stated standard errors of the readings, (K,).
        weight: Weights of Huber's loss, 1 for small residuals, (K,).
        channels: Frame, marker and axis of each residual, (K, 3); for a camera in space axis 2 is depth.
        markers: Names of the markers to which `channels` refers.
        own: The recording's own unknowns by name.
        intervals: 95 % intervals of those that `per_recording` names; empty if it was not fitted, or the fit withdrawn.
        t: Times of the predicted path [s], (S,).
        path: Predicted path of each marker in the recording's frame and clock, (S, d) [m], (S, 2) [pixels] or (S, 1)
            [rad]; depth [m], if measured, is a third column after the pixels.
        predicted_from: Time [s] from which it was predicted; earlier readings were used to fit its own unknowns and are
            not among the residuals. None: all readings were fitted, or all were predicted.
        size: For a camera in space, the smallest displacement of a point that changes the reading by one unit
            [m/pixel], for depth [m^2], (K,); else None.
        view: Camera of a recording in pixels; else None.
        spread: Standard errors of the residuals as a prediction states them, before the readings are seen, (K,): those
            of parameters, first state and readings; None for a fitted recording.
        freedom: Degrees of freedom of their Student's t distribution.
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
    predicted_from: float | None = None
    size: np.ndarray | None = None
    view: Camera | None = None
    spread: np.ndarray | None = None
    freedom: float = math.inf
    intervals: dict[str, tuple[float, float]] = field(default_factory=dict)

    def half_widths(self, level: float) -> np.ndarray:
        """Return half the widths of the predictive intervals of the readings at a level such as 0.9, in their units,
        (K,); an `InputError` if the recording was fitted, so that nothing was predicted."""
        number("level", level, low=0, high=1, strict=True)
        if self.spread is None:
            raise InputError("recording", self.source, "a held-out recording, whose readings were predicted")
        return half_width(level, self.freedom) * self.spread

    def half_width(self, level: float) -> float:
        """Return the root mean square of `half_widths` as lengths [m] or angles [rad], without those of depth."""
        return root_mean_square([replace(self, residuals=self.half_widths(level))]) or 0.0

    def coverage(self, level: float) -> float:
        """Return the share of the readings that lie within their predictive intervals of this level."""
        return float(np.mean(np.abs(self.residuals) <= self.half_widths(level)))

    @property
    def deep(self) -> np.ndarray:
        """Whether each residual is one of depth, (K,)."""
        return (self.channels[:, 2] == DEPTH_AXIS) & (self.view is not None)

    @property
    def angular(self) -> bool:
        """Whether angles of links were read."""
        return any(path.shape[1] == 1 for path in self.path.values())

    @property
    def errors(self) -> np.ndarray:
        """Residuals as lengths [m] or angles [rad], (K,).

        Pixels are converted to the smallest displacement across the line of sight, inverse depth to the error along the
        optical axis, negative if predicted too far.
        """
        return self.residuals if self.view is None or self.size is None else self.residuals * self.size

    @property
    def rmse(self) -> float:
        """Root mean square of the errors [m] or [rad], without those of depth."""
        return root_mean_square([self]) or 0.0

    @property
    def pixels(self) -> float | None:
        """Root mean square of the residuals in pixels; None if the recording is not from a camera in space."""
        return root_mean_square([self], "pixels")

    @property
    def depth(self) -> float | None:
        """Root mean square of the errors of depth [m]; None if none was measured."""
        return root_mean_square([self], "depth")

    @property
    def chi(self) -> float:
        """Root mean square of the residuals in units of their stated errors; about 1 if model and errors are right."""
        return float(np.sqrt(np.mean((self.residuals / self.sigma) ** 2)))


def root_mean_square(
    found: Sequence[RecordingFit], of: Literal["places", "pixels", "depth"] = "places"
) -> float | None:
    """Return a root mean square over several recordings, per coordinate: of errors without those of depth [m] or [rad],
    of residuals of cameras in space [pixels], or of errors of depth [m]; None without such residuals."""
    parts = {
        "places": [r.errors[~r.deep] for r in found],
        "pixels": [r.residuals[~r.deep] for r in found if r.view is not None],
        "depth": [r.errors[r.deep] for r in found if r.deep.any()],
    }[of]
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2))) if parts else None


@dataclass(frozen=True)
class FittedStart:
    """One starting point and the solution from it."""

    start: dict[str, float]  # starting values of the shared free parameters by name
    values: dict[str, float]  # final values
    solution: Solution  # of the last stage, with the history of its convergence
    over_best: float = 1.0  # ratio of its cost to that of the best run
    failed: bool = False  # whether its cost is so high that its values are outside the best run's confidence region

    @property
    def outcome(self) -> str:
        """Description of how the run ended."""
        if self.failed:
            return f"failed: it ended at {self.over_best:.3g} times the cost of the best start"
        return self.solution.status.value


def judge_starts(runs: Sequence[FittedStart], readings: int) -> list[FittedStart]:
    """Return runs of the same loss sorted by cost, with `over_best`, their cost over the least cost, and `failed` set.

    A run has failed if a likelihood ratio test rejects that it ended in the minimum of the best run. Under that
    hypothesis twice the difference of the two costs, over the residual variance of the best run, has a chi-squared
    distribution with as many degrees of freedom as there are unknowns. That variance is computed with the number of
    `readings`.
    """
    ordered = sorted(runs, key=lambda run: run.solution.cost)
    best = ordered[0].solution.cost
    if not np.isfinite(best) or best <= 0:
        return ordered
    quantile = 2 * gammaincinv(len(ordered[0].values) / 2, _FAR)  # of chi-squared
    far = 1 + float(quantile) / readings
    over = [run.solution.cost / best for run in ordered]
    return [dataclasses.replace(run, over_best=x, failed=x > far) for run, x in zip(ordered, over, strict=True)]


def misfit_of(recordings: Sequence[RecordingFit]) -> float:
    """Return the root mean square of recordings' residuals in units of their stated errors; NaN without residuals."""
    return math.sqrt(sum(found.chi**2 for found in recordings) / len(recordings)) if recordings else math.nan


def is_explained(
    uncertainty: Uncertainty,
    recordings: Sequence[RecordingFit],
    clock_fault: ClockFault | None,
    smoothed: Sequence[float] = (),
) -> bool:
    """Whether a model explains the readings, no recording's times are wrong and no tracks were smoothed; otherwise the
    fit's intervals are not valid.

    The RMS residual has to be at most 3 standard errors (`MISFIT`), both with all readings and with Huber's weights.
    """
    too_far = misfit_of(recordings) > MISFIT or uncertainty.residual_variance > MISFIT**2
    return clock_fault is None and not smoothed and not too_far


@dataclass(frozen=True)
class Fit(NoArray, instead="its parameters"):
    """An identified model.

    Args:
        plant: Plant with the fitted parameters.
        drive: Drive of the whip.
        parameters: Shared free parameters, each with its class and interval.
        nuisance: Fitted values of the shared nuisance parameters.
        uncertainty: Covariance, correlations, flat directions.
        recordings: Fitted recordings.
        held_out: Held-out recordings.
        runs: All starts, the best first.
        wall_time: Wall time [s].
        clock_fault: Fault of a recording's times, if the residuals show one.
        remarks: Remarks about unusual first readings of the recordings, and about points that were left out.
        smoothed: Edges [Hz] of the filters through which the recordings' tracks seem to have gone; empty if none has.
    """

    plant: Plant
    drive: str
    parameters: tuple[Parameter, ...]
    nuisance: dict[str, float]
    uncertainty: Uncertainty
    recordings: tuple[RecordingFit, ...]
    held_out: tuple[RecordingFit, ...]
    runs: tuple[FittedStart, ...]
    wall_time: float
    clock_fault: ClockFault | None = None
    remarks: tuple[str, ...] = ()
    smoothed: tuple[float, ...] = ()

    def __getitem__(self, name: str) -> Parameter:
        """Return the parameter of that name; `k` will do for `whip.k`.

        Raises:
            KeyError: It was not free, or the name stands for several that were.
        """
        by_name = {parameter.name: parameter for parameter in self.parameters}
        found = names_of(name, by_name)
        if len(found) != 1:
            raise KeyError(f"{name}; free were {', '.join(found or by_name)}")
        return by_name[found[0]]

    def __repr__(self) -> str:
        bounds = self.at_bounds
        found = [
            with_unit(p.value, p.unit, 4) + (f" (its {bounds[p.name]} bound)" if p.name in bounds else "")
            for p in self.parameters
        ]
        numbers = ", ".join(f"{p.name} = {value}" for p, value in zip(self.parameters, found, strict=True))
        count = f"{len(self.recordings)} recording{'s' * (len(self.recordings) != 1)}"
        unexplained = "" if self.explains else f", model does not fit: misfit {self.misfit:.1f}"
        if self.smoothed:
            unexplained = ", withdrawn: the tracks were smoothed before export"
        elif self.clock_fault is not None:
            unexplained = f", withdrawn: the times of {self.recordings[self.clock_fault.recording].source} are off"
        ended = self.status.value if self.converged else f"NOT CONVERGED: {self.status.value}"
        return f"Fit({numbers}; {ended}; {count}{unexplained})"

    @property
    def model(self) -> Model:
        """The model with the fitted parameters."""
        return self.plant.model

    @property
    def misfit(self) -> float:
        """Root mean square of the fitted recordings' residuals in standard errors; about 1 if the model fits."""
        return misfit_of(self.recordings)

    @property
    def explains(self) -> bool:
        """Whether the model explains the recordings, with their times and no smoothing; otherwise all classes are
        withdrawn."""
        return is_explained(self.uncertainty, self.recordings, self.clock_fault, self.smoothed)

    @property
    def at_bounds(self) -> dict[str, str]:
        """The free parameters that ended at a bound, by name: `lower` or `upper`."""
        U = self.uncertainty
        ends = {v.name: v.bound(float(z)) for v, z in zip(U.variables, U.z, strict=True)}
        return {name: end for name, end in ends.items() if end}

    @property
    def failed(self) -> tuple[FittedStart, ...]:
        """The runs whose cost ended far above that of the best run."""
        return tuple(run for run in self.runs if run.failed)

    @property
    def status(self) -> Ending:
        """Description of how the best run ended."""
        return self.runs[0].solution.status

    @property
    def converged(self) -> bool:
        """Whether the best run found a minimum in the shared parameters; otherwise values and intervals are not
        reliable."""
        return self.status in (Ending.CONVERGED, Ending.SETTLED)
