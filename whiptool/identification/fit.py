"""Fit of the free parameters of a model to recordings, from several starting points."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from whiptool.errors import InputError, expect
from whiptool.identification.beginnings import check_beginnings
from whiptool.identification.forecast import Forecast
from whiptool.identification.inputs import check_controllers, common_controller, full_name
from whiptool.identification.plant import BareArm, Plant
from whiptool.identification.problem import FitOptions, Problem
from whiptool.identification.readings import NEUTRAL
from whiptool.identification.results import Fit, FittedStart, RecordingFit, is_explained, judge_starts
from whiptool.identification.solver import Ending, Solution
from whiptool.identification.time_base import DOUBT, ClockFault
from whiptool.identification.uncertainty import Uncertainty, classify
from whiptool.identification.variables import units, variables_of
from whiptool.models.numbers import texts
from whiptool.models.parameters import Model
from whiptool.process_settings import HeldSetting
from whiptool.recording.smoothing import without_filled
from whiptool.recording.strike_plane import check_one_plane, fit_plane
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.words import counted

__all__ = ["Fit", "FitOptions", "RecordingFit", "best_nodes", "fit", "predict"]

# more threads of BLAS wait for each other most of the time, as the matrices are small
_FEW_THREADS = HeldSetting(lambda: threadpool_limits(1, "blas").restore_original_limits)


def fit(
    recordings: Sequence[StrikeRecording] | StrikeRecording,
    plant: Plant | Model | BareArm,
    free: Sequence[str],
    *,
    held_out: Sequence[StrikeRecording] = (),
    options: FitOptions | None = None,
) -> Fit:
    """Fit parameters of a plant to recordings, by maximum likelihood or, with a prior, by maximum a posteriori.

    Args:
        recordings: One or more recordings to fit.
        plant: Plant whose values are the first starting point; parameters that are not free keep them. For a `Model`
            the controller is that of the recordings.
        free: Names of the parameters to fit, of the plant or nuisance parameters that all recordings share; `k` is
            short for `whip.k`.
        held_out: Recordings to predict only, see `predict`.
        options: See `FitOptions`.

    Raises:
        InputError: A name is unknown or ambiguous, nothing is free, a recording lacks what the drive needs, a commanded
            recording has another controller than the plant, or the first readings show wrong units, axes, joints or
            start times.
    """
    began, options = time.perf_counter(), options or FitOptions()
    if not isinstance(recordings, Sequence):
        recordings = [recordings]
    for recording in (*recordings, *held_out):
        expect(StrikeRecording, recordings=recording)
    free = texts("free", free)
    if not free:
        raise InputError("free parameters", "none", "one or more names", "such as whip.k")
    plant = _as_plant(plant, recordings)
    recordings, held_out = _in_strike_plane(plant, recordings, held_out)
    free = [full_name(name, plant) for name in free]
    if options.check and options.drive == "command" and plant.controller is not None:
        check_controllers([*recordings, *held_out], plant.controller, free=free)
    variables = variables_of(
        {**plant.values(), **NEUTRAL}, free, options.bounds, units(plant.model.arm, plant.controller, free)
    )
    count, left_out = len(recordings), []
    if options.check:
        every, left_out = _without_filled([*recordings, *held_out])
        recordings, held_out = every[:count], every[count:]
    with _FEW_THREADS.held():
        problem = Problem(recordings, plant, free, variables, options)
        remarks = tuple(check_beginnings(problem.predictor, plant)) if options.check else ()
        starts = _starts(problem)
        runs = _solved(problem, starts)
        problem.bar.close()
        smoothed = problem.smoothed(runs[0].solution) if options.check else ()
        fault = _clock_fault(problem, starts[0], runs[0].solution) if options.check and not smoothed else None
        found = _found(problem, runs, held_out, clock_fault=fault, smoothed=smoothed)
        return replace(found, remarks=(*remarks, *left_out), wall_time=time.perf_counter() - began)


def _as_plant(plant: Plant | Model | BareArm, recordings: Sequence[StrikeRecording]) -> Plant:
    """Return a plant; a model has the controller of the recordings."""
    if isinstance(plant, Model):
        return Plant(plant, common_controller(recordings))
    if isinstance(plant, BareArm):
        return Plant(plant)
    if not isinstance(plant, Plant):
        raise InputError("plant", type(plant).__name__, "a Plant or a Model")
    return plant


def _starts(problem: Problem) -> list[np.ndarray]:
    """Return where the fit starts: at the plant as given, then at random points around it."""
    options, variables = problem.options, problem.variables
    known, rng = {**problem.plant.values(), **NEUTRAL}, np.random.default_rng(options.seed)
    starts = [np.array([v.off_bounds(v.z(known[v.name])) for v in variables])]
    spread = np.where([v.log for v in variables], np.log(options.dispersion), 1.0)
    while len(starts) < options.starts:
        drawn = starts[0] + spread * rng.uniform(-1, 1, len(variables))
        starts.append(np.array([v.off_bounds(z) for v, z in zip(variables, drawn, strict=True)]))
    return starts


def _solved(problem: Problem, starts: Sequence[np.ndarray]) -> list[FittedStart]:
    """Return where every start led, the best first."""
    ends = [problem.solve(start) for start in starts]
    pairs = zip(starts, ends, strict=True)
    runs = [FittedStart(problem.values(start), problem.values(end.z), end) for start, end in pairs]
    runs = judge_starts(runs, sum(len(x) for x in problem.predictor.measured))
    best = runs[0].solution
    if best.status is Ending.DIVERGED and problem.refused is not None:
        raise problem.refused
    if best.status is Ending.DIVERGED:
        raise InputError(
            "plant",
            ", ".join(f"{name} = {value:g}" for name, value in runs[0].start.items()),
            f"parameters with which the recordings' strikes can be simulated ({counted(len(runs), 'start')} diverged)",
            "give others, or check the strikes: angles in radians, D in seconds",
        )
    if np.isfinite(best.cost) and (again := _refined(problem, problem.overlooked(best))) is not best:
        runs[0] = FittedStart(runs[0].start, problem.values(again.z), again)
    return runs


def _found(
    problem: Problem,
    runs: Sequence[FittedStart],
    held_out: Sequence[StrikeRecording],
    *,
    clock_fault: ClockFault | None,
    smoothed: tuple[float, ...],
) -> Fit:
    """Return what came of a fit, its best run first."""
    best, options = runs[0].solution, problem.options
    uncertainty, compared = problem.assess(best), problem.compare(best)
    withdrawn = not is_explained(uncertainty, compared, clock_fault, smoothed)
    if options.per_recording and not withdrawn:
        intervals = problem.own_intervals(best, uncertainty)
        compared = [replace(one, intervals=x) for one, x in zip(compared, intervals, strict=True)]
    fitted, nuisance = problem.split(best.z)
    starts = [runs[0].start[name] for name in problem.free]
    return Fit(
        plant=fitted,
        drive=options.drive,
        parameters=tuple(classify(uncertainty, starts, withdrawn=withdrawn)),
        nuisance=nuisance,
        uncertainty=uncertainty,
        recordings=tuple(compared),
        held_out=tuple(_held_out(problem, held_out, best, uncertainty)) if held_out else (),
        runs=tuple(runs),
        wall_time=0.0,
        clock_fault=clock_fault,
        smoothed=smoothed,
    )


def _in_strike_plane(
    plant: Plant, recordings: Sequence[StrikeRecording], held_out: Sequence[StrikeRecording]
) -> tuple[Sequence[StrikeRecording], Sequence[StrikeRecording]]:
    """Return recordings in space projected on the plane in which all of them have to lie, for a model in the plane."""
    if plant.model.dimension != 2:
        return recordings, held_out
    every = [*recordings, *held_out]
    spatial = [r for r in every if r.view is None and r.points.shape[2] == 3]
    upright = {id(r): r.for_model(plant.model) for r in spatial}
    plane = fit_plane(list(upright.values()))
    if plane is None:
        return recordings, held_out
    check_one_plane(list(upright.values()), plane)
    flat = [plane.project(upright[id(r)]) if id(r) in upright else r for r in every]
    return flat[: len(recordings)], flat[len(recordings) :]


def _without_filled(recordings: Sequence[StrikeRecording]) -> tuple[list[StrikeRecording], list[str]]:
    """Return recordings without points that were filled in where a marker was not seen, and remarks on these."""
    found = [(recording, *without_filled(recording)) for recording in recordings]
    remarks = [f"{old.called}: left out, for they are no readings: {said}" for old, _, said in found if said]
    return [new for _, new, _ in found], remarks


def _refined(problem: Problem, solution: Solution) -> Solution:
    """A solution, or the one that follows from it where the loss had to be adapted to the residuals."""
    return problem.refine(solution) if problem.adapt(solution) else solution


def _clock_fault(problem: Problem, first: np.ndarray, solution: Solution) -> ClockFault | None:
    """The fault of a recording's time base, if there is one.

    A fault leads a fit astray, and where it ended less is left of it than there is: in doubt the recordings are fitted
    with their own clocks, from there and from the first start. What that tells goes before what it left.
    """
    doubt = problem.clock_fault(solution, correlated=False)
    if doubt is None or doubt.p_value > DOUBT:
        return None
    faults, wider = [problem.clock_fault(solution)], problem.with_clocks()
    ends = [] if wider is None else [wider.solve(z) for z in (solution.z, first)]
    if wider is not None and np.isfinite((best := min(ends, key=lambda end: end.cost)).cost):
        faults.insert(0, wider.clock_fault(_refined(wider, best)))
    return next((fault for fault in faults if fault is not None and fault.plain), None)


def predict(
    recordings: Sequence[StrikeRecording], plant: Plant, nuisance: Mapping[str, float], options: FitOptions
) -> list[RecordingFit]:
    """Return recordings that were not fitted, with the plant's predictions.

    The drive (command, measured joints or tracked handle) is taken from the recording. If a recording has separate
    unknowns (initial state, a robot's lag, nuisance parameters), they are fitted to the first half of its frames, of a
    pendulum's free swing to the first tenth, and the others are predicted.

    Args:
        recordings: Recordings to predict.
        plant: Identified plant.
        nuisance: Fitted values of the shared nuisance parameters.
        options: Options of the fit.

    Returns:
        Each recording with its residuals, without the readings to which its unknowns were fitted. Those that
            `fit(..., held_out=...)` returns have predictive intervals, too.

    Raises:
        InputError: A recording has no readings left to predict.
    """
    variables = variables_of(nuisance, tuple(nuisance), {}, {})
    with _FEW_THREADS.held():
        problem = Problem(recordings, plant, tuple(nuisance), variables, _predicting(options))
        return _predicted(problem, np.array([v.z(nuisance[v.name]) for v in variables]), None)


def _held_out(
    fitted: Problem, recordings: Sequence[StrikeRecording], best: Solution, uncertainty: Uncertainty
) -> list[RecordingFit]:
    """Return the predictions of held-out recordings with their standard errors."""
    options = _predicting(fitted.options)
    problem = Problem(recordings, fitted.plant, fitted.free, fitted.variables, options)
    return _predicted(problem, best.z, fitted.forecast(best, uncertainty))


def _predicting(options: FitOptions) -> FitOptions:
    """Return the options of a fit that hold for predictions, too."""
    kept = ("drive", "per_recording", "loss", "timestep", "knots")
    return FitOptions(**{name: getattr(options, name) for name in kept})


def _predicted(problem: Problem, z: np.ndarray, forecast: Forecast | None) -> list[RecordingFit]:
    """Return a problem's recordings, each predicted from its first readings."""
    problem.resolve(z)
    known, P = problem.beginnings(), problem.predictor
    if not problem.fits_beginnings and problem.options.drive != "handle":  # the motion begins as the joints alone say
        return problem.compare(Solution(z, P.start, 0.0, Ending.CONVERGED), forecast=forecast)
    for recording, x in zip(P.recordings, known, strict=True):
        if x.all():
            raise InputError("held-out recording", recording.source, "a recording whose last frames also show the whip")
    return problem.compare(problem.solve(z, fixed=True, known=known), known, forecast)


def best_nodes(fits: Mapping[int, Fit]) -> int:
    """Return the number of nodes whose fit predicts the held-out recordings best, of fits by number of nodes."""
    error = {N: float(np.mean([r.chi**2 for r in found.held_out])) for N, found in fits.items()}
    return min(error, key=error.__getitem__)
