"""Fit the free numbers of a model to recordings, from several starts, and say what came of it."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from whiptool.errors import InputError
from whiptool.identification.pendulum import AngleRecording
from whiptool.identification.plant import Identifiable, Plant
from whiptool.identification.predict import NEUTRAL, NUISANCE, Predictor, Recording
from whiptool.identification.recording import StrikeRecording
from whiptool.identification.solver import Block, Solution, Status, huber, solve
from whiptool.identification.uncertainty import Parameter, Uncertainty, assess, classify
from whiptool.identification.variables import Prior, Variable, variables_of

HUBER = 1.345  # standard errors: 95 % efficient where the errors are normal (Huber 1981)
# usual size of a recording's own unknowns around their first guess: a wide prior that leaves none undetermined
_OWN = {"delay": 0.1, "scale": 0.3, "rotation": 0.5, "shift_x": 1.0, "shift_y": 1.0}
_START = (1.0, 30.0)  # [rad], [rad/s]


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


@dataclass(frozen=True)
class Options:
    """How to fit.

    Args:
        drive: What drives the whip: `command`, `joints`, `handle`, `free`.
        per_recording: Nuisance that each recording has its own value of: of `delay`, `scale`, `rotation`, `shift_x`,
            `shift_y`; `start`, the state at the start (always, in free swing).
        bounds: Of free numbers, by name.
        prior: On shared free numbers.
        loss: Where Huber's loss turns linear, in standard errors; None: least squares.
        starts: How many; the first is the plant as given.
        dispersion: The others are drawn within this factor of it.
        pieces: Lengths of the pieces that a free swing is cut into, one stage after the other [s]; the recordings as
            they are come last. For swings that forget their start.
        timestep: Of the integrator [s].
        knots: Spacing of the spline of a prescribed motion [s].
        replicates: Of the bootstrap.
        seed: Of starts and bootstrap.
    """

    drive: str = "command"
    per_recording: tuple[str, ...] = ()
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    prior: Prior | None = None
    loss: float | None = HUBER
    starts: int = 1
    dispersion: float = 3.0
    pieces: tuple[float, ...] = ()
    timestep: float | None = None
    knots: float | None = None
    replicates: int = 400
    seed: int = 0
    max_iterations: int = 60

    def __post_init__(self) -> None:
        if self.starts < 1:
            raise InputError("starts", self.starts, "a whole number >= 1")
        if not self.dispersion >= 1:
            raise InputError("dispersion", self.dispersion, "a factor >= 1")
        if self.pieces and self.drive != "free":
            raise InputError("pieces", self.pieces, "none, but for free swing")


def fit(
    recordings: Sequence[Recording],
    plant: Identifiable,
    free: Sequence[str],
    *,
    held_out: Sequence[Recording] = (),
    options: Options | None = None,
) -> Fit:
    """Fit free numbers of a plant to recordings, by maximum likelihood or, with a prior, a posteriori.

    Args:
        recordings: To fit.
        plant: Where the first start begins; what is not free stays as it is.
        free: Names of numbers of the plant, or of nuisance that all recordings share.
        held_out: Recordings to predict only. Of their own unknowns only those are fitted that have to be (nuisance,
            the motion of a tracked handle, from the handle alone); a free swing begins at its first sample.
        options: See `Options`.

    Raises:
        InputError: A name is unknown, nothing is free, or a recording lacks what the drive needs.
    """
    began, options = time.perf_counter(), options or Options()
    if not free:
        raise InputError("free parameters", "none", "one or more names", "such as whip.k")
    known = {**plant.values(), **NEUTRAL}
    for name in free:
        if name not in known:
            raise InputError("free parameter", name, "one of " + ", ".join(known))
    variables = variables_of(known, free, options.bounds)
    problem = _Problem(recordings, plant, free, variables, options)
    rng = np.random.default_rng(options.seed)
    first = np.array([v.off_bounds(v.z(known[v.name])) for v in variables])
    runs = []
    for i in range(options.starts):
        start = first
        if i:
            drawn = rng.uniform(-1, 1, len(first))
            spread = np.where([v.log for v in variables], np.log(options.dispersion), 1.0)
            start = np.array([v.off_bounds(z) for v, z in zip(variables, first + spread * drawn, strict=True)])
        solution = problem.solve(start)
        runs.append(Run(problem.values(start), problem.values(solution.z), solution))
    runs.sort(key=lambda run: run.solution.cost)
    if np.isfinite(runs[0].solution.cost) and problem.adapt(runs[0].solution):
        again = problem.refine(runs[0].solution)
        runs[0] = Run(runs[0].start, problem.values(again.z), again)
    best = runs[0].solution
    if best.status is Status.DIVERGED:
        raise InputError(
            "starts",
            [run.start for run in runs],
            "one from which the model can be rolled out",
            "start from other values",
        )
    uncertainty = problem.assess(best, rng)
    fitted, nuisance = problem.split(best.z)
    return Fit(
        plant=fitted,
        drive=options.drive,
        parameters=tuple(classify(uncertainty, [runs[0].start[name] for name in free])),
        nuisance=nuisance,
        uncertainty=uncertainty,
        recordings=tuple(problem.compare(best)),
        held_out=tuple(predict(held_out, fitted, nuisance, options)) if held_out else (),
        runs=tuple(runs),
        wall_time=time.perf_counter() - began,
    )


def predict(
    recordings: Sequence[Recording], plant: Identifiable, nuisance: Mapping[str, float], options: Options
) -> list[RecordingFit]:
    """Recordings that were not fitted beside what the plant predicts of them.

    Args:
        recordings: To predict.
        plant: As identified.
        nuisance: Shared, as fitted.
        options: Those of the fit.
    """
    own = tuple(name for name in options.per_recording if name != "start")
    changed = Options(
        drive=options.drive, per_recording=own, loss=options.loss, timestep=options.timestep, knots=options.knots
    )
    problem = _Problem(
        recordings, plant, tuple(nuisance), variables_of(nuisance, tuple(nuisance), {}), changed, starting=False
    )
    z = np.array([v.z(nuisance[v.name]) for v in problem.variables])
    only = "handle" if options.drive == "handle" and not own else None
    start = problem.predictor.start
    if not any(len(x) for x in start):
        return problem.compare(Solution(z, start, 0.0, Status.CONVERGED))
    return problem.compare(problem.solve(z, fixed=True, only=only))


def choose_nodes(
    recordings: Sequence[StrikeRecording],
    plant: Plant,
    free: Sequence[str],
    nodes: Sequence[int],
    *,
    held_out: Sequence[StrikeRecording],
    options: Options | None = None,
) -> tuple[int, dict[int, Fit]]:
    """The number of nodes that predicts held-out recordings best, and the fits with each number.

    Args:
        recordings, plant, free, held_out, options: As for `fit`; the plant's whip is cut anew for each number.
        nodes: Numbers of nodes to try.

    Raises:
        InputError: There is nothing held out to judge by, or nothing to try.
    """
    if not held_out or not nodes:
        raise InputError(
            "nodes", (list(nodes), f"{len(held_out)} held out"), "one or more numbers, and recordings held out"
        )
    fits = {N: fit(recordings, plant.with_nodes(N), free, held_out=held_out, options=options) for N in nodes}
    return best_nodes(fits), fits


def best_nodes(fits: Mapping[int, Fit]) -> int:
    """The number of nodes, of several fits, that predicts the held-out recordings best."""
    error = {N: float(np.mean([r.chi**2 for r in found.held_out])) for N, found in fits.items()}
    return min(error, key=error.__getitem__)


class _Problem:
    """Recordings, plant and variables as the solver's blocks."""

    def __init__(
        self,
        recordings: Sequence[Recording],
        plant: Identifiable,
        free: Sequence[str],
        variables: list[Variable],
        options: Options,
        *,
        starting: bool = True,
    ) -> None:
        own = tuple(options.per_recording)
        if options.drive == "free" and starting and "start" not in own:
            own = (*own, "start")
        self.plant, self.free, self.variables, self.options = plant, tuple(free), variables, options
        self._own, self._recordings = own, list(recordings)
        self.predictor = self._make(recordings)
        rows = None if options.prior is None else options.prior.rows(variables)
        self._prior = rows
        self._limit = options.loss

    def _make(self, recordings: Sequence[Recording]) -> Predictor:
        o = self.options
        return Predictor(
            recordings, self.plant, drive=o.drive, shared=self.free, own=self._own, timestep=o.timestep, knots=o.knots
        )

    def values(self, z: np.ndarray) -> dict[str, float]:
        """The shared free numbers by name."""
        return {v.name: v.value(x) for v, x in zip(self.variables, z, strict=True)}

    def split(self, z: np.ndarray) -> tuple[Identifiable, dict[str, float]]:
        """The plant with these numbers, and the shared nuisance."""
        values = self.values(z)
        plant = self.plant.changed({k: v for k, v in values.items() if k not in NUISANCE})
        return plant, {k: v for k, v in values.items() if k in NUISANCE}

    def solve(self, z: np.ndarray, *, fixed: bool = False, only: str | None = None) -> Solution:
        """From this start: pieces first, if any, then the whole recordings; with `fixed`, own unknowns only."""
        stages = [self.predictor]
        if self.options.pieces:
            swings = [r for r in self._recordings if isinstance(r, AngleRecording)]
            stages = [self._make([p for r in swings for p in r.cut(length)]) for length in self.options.pieces] + stages
        solution = None
        for stage in stages:
            solution = self._solve_stage(stage, z, stage.start, fixed=fixed, only=only)
            z = solution.z
        assert solution is not None
        return solution

    def _solve_stage(
        self,
        stage: Predictor,
        z: np.ndarray,
        own: Sequence[np.ndarray],
        *,
        fixed: bool = False,
        only: str | None = None,
    ) -> Solution:
        bounds = (z, z) if fixed else (np.array([getattr(v, x) for v in self.variables]) for x in ("lower", "upper"))
        lower, upper = bounds
        return solve(
            self._evaluator(stage, only),
            z,
            own,
            lower=lower,
            upper=upper,
            loss=self._limit,
            robust=[len(x) for x in stage.measured] + ([0] if self._prior else []),
            max_iterations=self.options.max_iterations,
        )

    def refine(self, solution: Solution) -> Solution:
        """On from a solution, with the present limit of the loss."""
        again = self._solve_stage(self.predictor, solution.z, solution.own)
        again.history = solution.history + again.history
        again.evaluations += solution.evaluations
        return again

    def adapt(self, solution: Solution) -> bool:
        """Widen Huber's limit to the spread that the residuals really have; whether that matters."""
        if self.options.loss is None:
            return False
        P = self.predictor
        predictions = P(*self.split(solution.z), solution.own, derivatives=False)
        r = np.concatenate([(p.value - y) / s for p, y, s in zip(predictions, P.measured, P.sigma, strict=True)])
        limit = self.options.loss * max(1.0, 1.4826 * float(np.median(np.abs(r))))
        widened = limit > 1.5 * (self._limit or limit)
        self._limit = limit if widened else self._limit
        return widened

    def _evaluator(self, predictor: Predictor, only: str | None = None):
        slopes_of = self.variables
        regular = [self._regular(predictor, i) for i in range(len(predictor.recordings))]
        shown = [
            None if only is None else _of_marker(r, predictor, i, only) for i, r in enumerate(predictor.recordings)
        ]

        def evaluate(z: np.ndarray, own: list[np.ndarray], derivatives: bool) -> list[Block]:
            try:
                plant, nuisance = self.split(z)
            except InputError:  # a step beyond what a model may be
                return [Block(np.full(1, np.inf), np.zeros((1, len(z))), np.zeros((1, len(x)))) for x in own]
            units = np.array([v.slope(x) for v, x in zip(slopes_of, z, strict=True)])
            blocks = []
            for i, p in enumerate(predictor(plant, nuisance, own, derivatives=derivatives)):
                sigma, mask = predictor.sigma[i], shown[i]
                r = (p.value - predictor.measured[i]) / sigma
                W, mean = regular[i]
                A = B = np.zeros((0, 0))
                if derivatives:
                    A, B = p.by_shared * units / sigma[:, None], p.by_own / sigma[:, None]
                    if mask is not None:
                        A, B = A * mask[:, None], B * mask[:, None]
                    A, B = np.vstack([A, np.zeros((len(W), A.shape[1]))]), np.vstack([B, W])
                if mask is not None:
                    r = r * mask
                blocks.append(Block(np.concatenate([r, W @ own[i] - mean]), A, B))
            if self._prior is not None:
                W, mean = self._prior
                blocks.append(Block(W @ (z - mean), W, np.zeros((len(W), 0))))
            return blocks

        return evaluate

    def _regular(self, predictor: Predictor, i: int) -> tuple[np.ndarray, np.ndarray]:
        """Rows that regularise recording i's own unknowns x: `W x - mean` is standard normal."""
        drive, first = predictor.drives[i], predictor.start[i]
        rows, means, at = [], [], 0
        for name, x in drive.unknowns.items():
            if name == "motion":
                motion = drive.motion  # type: ignore[attr-defined]
                W, mean = motion.rows, motion.mean
            else:
                W = np.diag(1 / np.repeat(_START, len(x) // 2))
                mean = np.zeros(len(x))
            rows.append(np.pad(W, ((0, 0), (at, len(first) - at - len(x)))))
            means.append(mean)
            at += len(x)
        for name in (x for x in self._own if x != "start"):
            rows.append(np.eye(1, len(first), at) / _OWN[name])
            means.append(rows[-1] @ first)
            at += 1
        if not rows:
            return np.zeros((0, len(first))), np.zeros(0)
        return np.vstack(rows), np.concatenate(means)

    def assess(self, solution: Solution, rng: np.random.Generator) -> Uncertainty:
        """Uncertainty at a solution."""
        P = self.predictor
        blocks = self._evaluator(P)(solution.z, solution.own, True)[: len(P.recordings)]
        counts = [len(x) for x in P.measured]
        # Huber's estimate errs like least squares with these residuals (Street, Carroll, Ruppert 1988)
        psi = [huber(b.r[:n], self._limit)[1] * b.r[:n] for b, n in zip(blocks, counts, strict=True)]
        inside = np.mean(np.concatenate([x == b.r[:n] for x, b, n in zip(psi, blocks, counts, strict=True)]))
        pseudo = [
            Block(np.concatenate([x / inside, b.r[n:]]), b.A, b.B) for x, b, n in zip(psi, blocks, counts, strict=True)
        ]
        series = [channel[:, 1] * 8 + channel[:, 2] for channel in P.channels]
        times = [r.t[channel[:, 0]] for r, channel in zip(P.recordings, P.channels, strict=True)]
        prior = None if self._prior is None else self._prior[0]
        return assess(
            self.variables, solution.z, pseudo, series, times, prior, rng=rng, replicates=self.options.replicates
        )

    def compare(self, solution: Solution) -> list[RecordingFit]:
        """Every recording beside its prediction."""
        plant, nuisance = self.split(solution.z)
        P, found = self.predictor, []
        predictions = P(plant, nuisance, solution.own, derivatives=False)
        for i, p in enumerate(predictions):
            residuals = p.value - P.measured[i]
            t, path = P.path(i, plant, nuisance, solution.own[i])
            found.append(
                RecordingFit(
                    source=P.recordings[i].source,
                    residuals=residuals,
                    measured=P.measured[i],
                    sigma=P.sigma[i],
                    weight=huber(residuals / P.sigma[i], self._limit)[1],
                    channels=P.channels[i],
                    markers=tuple(path),
                    own=dict(zip(P.own_names(i), map(float, solution.own[i]), strict=True)),
                    t=t,
                    path=path,
                )
            )
        return found


def _of_marker(recording: Recording, predictor: Predictor, i: int, marker: str) -> np.ndarray:
    """1 for the readings of one marker, 0 for the others."""
    assert isinstance(recording, StrikeRecording)
    return (predictor.channels[i][:, 1] == predictor.names(i).index(marker)).astype(float)
