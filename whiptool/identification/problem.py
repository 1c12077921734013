"""A fit of recordings as a least-squares problem, and the options of its solution."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from whiptool.errors import InputError
from whiptool.identification.drives import pieces
from whiptool.identification.forecast import Forecast, Readings, calibrated, half_width, own_errors
from whiptool.identification.plant import Plant
from whiptool.identification.predict import Predictor, named_own
from whiptool.identification.readings import NEUTRAL, NUISANCE, SMOOTHING
from whiptool.identification.resolution import resolve
from whiptool.identification.results import RecordingFit, known_part
from whiptool.identification.solver import MAX_ITERATIONS, TOLERANCE, Block, Loss, Solution, huber, solve
from whiptool.identification.time_base import CLOCK, ClockFault, FittedReadings, likeliest_fault
from whiptool.identification.uncertainty import Uncertainty, assess
from whiptool.identification.variables import Prior, Variable
from whiptool.models.numbers import number, whole
from whiptool.progress import Progress
from whiptool.recording.smoothing import is_smooth
from whiptool.recording.strike_recording import StrikeRecording

HUBER = 1.345  # standard errors: 95 % efficient where the errors are normal (Huber 1981)
# usual size of a recording's own unknowns around their first guess: a wide prior that leaves none undetermined
_OWN = {"delay": 0.1, "clock_rate": 0.05, "scale": 0.3, "rotation": 0.5, SMOOTHING: 0.2} | {
    f"rotation_{x}": 0.5 for x in "xyz"
}
_OWN |= {f"shift_{x}": 1.0 for x in "xyz"}
_START = (1.0, 30.0)  # [rad], [rad/s]
_EDGES = np.geomspace(60.0, 1.0, 25)  # [Hz] of a filter at which its search may begin
_SHARE = 0.3  # of the squared residuals that a filter has to explain where one is claimed
_SOON = 3.0  # [s] after which progress is shown
_SLIGHT = 0.02  # standard errors of the residuals below which nothing is left to explain
_GROWING = (0.1, 0.4)  # shares of a passive swing whose readings its first state is sought in, one after the other


@dataclass(frozen=True)
class FitOptions:
    """Options of a fit.

    Args:
        drive: Drive of the whip: `command`; `robot` (the command, followed by a position-controlled arm in space with a
            fitted lag); `joints` (measured joints); `hand` (the hand's measured pose, in space); `handle` (a tracked
            handle); `passive` (nothing: the whip hangs from a fixed point after release); `free` (a pendulum's angles).
        per_recording: Nuisance parameters with a separate value for each recording: names in `NUISANCE`, see
            `whiptool.identification.readings`, `smoothing`, the period [s] of the edge of a zero-lag filter that its
            tracks went through, and `start`, the initial state (always included for `passive` and `free`).
        bounds: Bounds of free parameters, by name.
        prior: Prior of the shared free parameters.
        loss: Residual at which Huber's loss becomes linear, in standard errors; None: least squares.
        starts: Number of starting points; the first is the plant as given.
        dispersion: Largest factor between the other starting points and the first.
        pieces: Lengths [s] of the pieces into which a free swing is cut, one length for each stage of the fit; the last
            stage uses whole recordings. For chaotic swings.
        timestep: Time step [s]; None: see `Predictor`.
        knots: Spacing of the knots of a prescribed motion's spline [s]; None: by cross-validation for joints and hand,
            1.5 frames for a tracked handle.
        seed: Seed of the starting points.
        check: Whether recordings are checked: their controller, their first readings
            (`whiptool.identification.beginnings`), and their times (`whiptool.identification.time_base`).
        progress: Whether a fit that lasts shows how many rollouts it has made.
        max_iterations, tolerance: Stopping criteria, see `whiptool.identification.solver.solve`.
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
    seed: int = 0
    check: bool = True
    progress: bool = False
    max_iterations: int = MAX_ITERATIONS
    tolerance: float = TOLERANCE

    def __post_init__(self) -> None:
        whole("starts", self.starts)
        whole("seed", self.seed, low=0)
        whole("max_iterations", self.max_iterations)
        number("dispersion", self.dispersion, low=1)
        for name in ("loss", "timestep", "knots", "tolerance"):
            if (value := getattr(self, name)) is not None:
                number(name, value, low=0, strict=True)
        if self.pieces and self.drive != "free":
            raise InputError("pieces", self.pieces, "none unless drive is free")


class Problem:
    """The fit of a plant's G free parameters to recordings as a least-squares problem of the solver, of which
    `variables` are these parameters, in the same order; other parameters keep the plant's values."""

    def __init__(
        self,
        recordings: Sequence[StrikeRecording],
        plant: Plant,
        free: Sequence[str],
        variables: list[Variable],
        options: FitOptions,
    ) -> None:
        own = tuple(options.per_recording)
        if options.drive in ("passive", "free") and "start" not in own:
            own = (*own, "start")
        self.plant, self.free, self.variables, self.options = plant, tuple(free), variables, options
        self._own, self._recordings = own, list(recordings)
        self.predictor = self._make(recordings)
        rows = None if options.prior is None else options.prior.rows(variables)
        self._prior = rows
        self._limit = options.loss
        self._judged: Sequence[str] = ()  # clocks of the recordings, which were not requested
        self._resolved = False
        self.refused: InputError | None = None  # why the model could not be evaluated, the last time that it could not
        self.bar = Progress(desc="fit", unit=" rollouts", delay=_SOON, leave=False, disable=not options.progress)

    def _make(self, recordings: Sequence[StrikeRecording]) -> Predictor:
        o = self.options
        return Predictor(
            recordings, self.plant, drive=o.drive, shared=self.free, own=self._own, timestep=o.timestep, knots=o.knots
        )

    def values(self, z: np.ndarray) -> dict[str, float]:
        """Return the shared free parameters by name, for the solver's variables z (G,)."""
        return {v.name: v.value(x) for v, x in zip(self.variables, z, strict=True)}

    def split(self, z: np.ndarray) -> tuple[Plant, dict[str, float]]:
        """Return the plant for the solver's variables z (G,), and the shared nuisance parameters by name."""
        values = self.values(z)
        plant = self.plant.changed({k: v for k, v in values.items() if k not in NUISANCE})
        return plant, {k: v for k, v in values.items() if k in NUISANCE}

    def solve(self, z: np.ndarray, *, fixed: bool = False, known: Sequence[np.ndarray] | None = None) -> Solution:
        """Solve from shared unknowns z (G,): first with pieces of the recordings, if any, then with whole recordings.

        A free initial state is first fitted to the first readings alone, because a path with a wrong start leads the
        fit to a wrong minimum. If `fixed`, only the recordings' own unknowns are fitted; `known` is for each recording
        1 for readings that are fitted and 0 for the others, (K,), by default all 1.
        """
        self.resolve(z)
        if SMOOTHING in self._own:
            self._begin_smoothed(z, known)
        if self.options.drive == "passive":
            own: Sequence[np.ndarray] = self.predictor.start
            for share in _GROWING:
                early = [self.first(i, share) for i in range(len(own))]
                seen = early if known is None else [x * y for x, y in zip(early, known, strict=True)]
                own = self._solve_stage(self.predictor, z, own, fixed=True, known=seen).own
            return self._solve_stage(self.predictor, z, own, fixed=fixed, known=known)
        stages = [self.predictor]
        if self.options.pieces:
            cut = [[p for r in self._recordings for p in pieces(r, length)] for length in self.options.pieces]
            stages = [*map(self._make, cut), *stages]
        solution = None
        for stage in stages:
            solution = self._solve_stage(stage, z, stage.start, fixed=fixed, known=known)
            z = solution.z
        assert solution is not None
        return solution

    def _begin_smoothed(self, z: np.ndarray, known: Sequence[np.ndarray] | None) -> None:
        """Let the filter of each recording begin at the edge that explains it best, with z (G,) for the shared
        unknowns."""
        P, costs = self.predictor, []
        for edge in _EDGES:
            for x, of in zip(P.start, self._at_own(SMOOTHING), strict=True):
                x[of] = 1 / edge
            costs.append([float(b.r @ b.r) for b in self._evaluator(P, known)(z, P.start, False)[: len(P.start)]])
        for x, of, best in zip(P.start, self._at_own(SMOOTHING), np.argmin(costs, axis=0), strict=True):
            x[of] = 1 / _EDGES[best]

    def _at_own(self, name: str) -> list[int]:
        """Return the place of an unknown among each recording's own."""
        return [self.predictor.own_names(i).index(name) for i in range(len(self._recordings))]

    def smoothed(self, solution: Solution) -> tuple[float, ...]:
        """Return the edges [Hz] of the filters that the recordings' tracks seem to have gone through before export;
        none if they have the noise of independent readings, or if a filter explains little of the residuals.
        """
        slight = 2 * solution.cost < _SLIGHT**2 * sum(len(x) for x in self.predictor.measured)
        if slight or SMOOTHING in self._own or not any(map(is_smooth, self._recordings)):
            return ()
        options = replace(self.options, per_recording=(*self.options.per_recording, SMOOTHING))
        wider = Problem(self._recordings, self.plant, self.free, self.variables, options)
        wider._limit = self._limit
        end = wider.solve(solution.z)
        if end.cost > (1 - _SHARE) * solution.cost:
            return ()
        return tuple(1 / abs(float(x[of])) for x, of in zip(end.own, wider._at_own(SMOOTHING), strict=True))

    def resolve(self, z: np.ndarray) -> None:
        """Let measured motions have the unknowns that readings can resolve, once; with z (G,) for the shared ones."""
        if not self._resolved:
            resolve(self.predictor, *self.split(z), self.predictor.start)
            self._resolved = True

    def overlooked(self, solution: Solution) -> Solution:
        """Continue from a solution if the readings there can resolve more of measured motions than they have unknowns,
        and return the new solution."""
        own = resolve(self.predictor, *self.split(solution.z), solution.own)
        return solution if own is None else self.refine(replace(solution, own=own))

    def first(self, i: int, share: float) -> np.ndarray:
        """Return a mask (K,) of recording i's readings: 1 in the first `share` (0 to 1) of its frames, else 0."""
        frame = self.predictor.channels[i][:, 0]
        frames = np.unique(frame)
        return (frame < frames[min(int(np.ceil(share * len(frames))), len(frames) - 1)]).astype(float)

    @property
    def fits_beginnings(self) -> bool:
        """Whether recordings have unknowns that a prediction fits to their first readings."""
        return bool(self._own) or self.options.drive == "robot"

    def beginnings(self) -> list[np.ndarray]:
        """Return for each recording a mask (K,) of the readings to which a prediction fits the recording's own
        unknowns before it predicts the others: the first frames, see `known_part`; all readings of a tracked handle; no
        readings without such unknowns."""
        share = known_part(self.options.drive)[0]
        every = range(len(self._recordings))
        known = [self.first(i, share if self.fits_beginnings else 0.0) for i in every]
        if self.options.drive == "handle":
            known = [np.maximum(x, self.of_marker(i, "handle")) for i, x in zip(every, known, strict=True)]
        return known

    def forecast(self, solution: Solution, uncertainty: Uncertainty) -> Forecast:
        """Return the distribution of the errors of predictions, calibrated with these recordings."""
        return calibrated(self._predicted(solution, self.beginnings()), self._pseudo(solution), uncertainty)

    def _predicted(self, solution: Solution, known: Sequence[np.ndarray]) -> list[Readings]:
        P = self.predictor
        blocks = self._evaluator(P)(solution.z, solution.own, True)
        return [Readings(*x) for x in zip(blocks[: len(known)], known, self._series, self._times, strict=True)]

    def of_marker(self, i: int, marker: str) -> np.ndarray:
        """Return a mask (K,) of recording i's readings: 1 for readings of this marker, else 0."""
        return (self.predictor.channels[i][:, 1] == self.predictor.names(i).index(marker)).astype(float)

    def _solve_stage(
        self,
        stage: Predictor,
        z: np.ndarray,
        own: Sequence[np.ndarray],
        *,
        fixed: bool = False,
        known: Sequence[np.ndarray] | None = None,
    ) -> Solution:
        bounds = (z, z) if fixed else (np.array([getattr(v, x) for v in self.variables]) for x in ("lower", "upper"))
        lower, upper = bounds
        return solve(
            self._evaluator(stage, known),
            z,
            own,
            lower=lower,
            upper=upper,
            loss=Loss(self._limit, [len(x) for x in stage.measured] + ([0] if self._prior else [])),
            max_iterations=self.options.max_iterations,
            tolerance=self.options.tolerance,
        )

    def refine(self, solution: Solution) -> Solution:
        """Continue from a solution with the current limit of Huber's loss, and return the new solution."""
        again = self._solve_stage(self.predictor, solution.z, solution.own)
        again.history = solution.history + again.history
        again.evaluations += solution.evaluations
        return again

    def adapt(self, solution: Solution) -> bool:
        """Widen the limit of Huber's loss to the actual spread of the residuals; return whether this changes it
        noticeably.
        """
        if self.options.loss is None:
            return False
        P = self.predictor
        predictions = P(*self.split(solution.z), solution.own, derivatives=False)
        r = np.concatenate([(p.value - y) / s for p, y, s in zip(predictions, P.measured, P.sigma, strict=True)])
        limit = self.options.loss * max(1.0, 1.4826 * float(np.median(np.abs(r))))
        widened = limit > 1.5 * (self._limit or limit)
        self._limit = limit if widened else self._limit
        return widened

    def _evaluator(self, predictor: Predictor, known: Sequence[np.ndarray] | None = None):
        slopes_of = self.variables
        regular = [self._regular(predictor, i) for i in range(len(predictor.recordings))]

        def evaluate(z: np.ndarray, own: list[np.ndarray], derivatives: bool) -> list[Block]:
            self.bar.update(len(own))
            try:
                plant, nuisance = self.split(z)
                predictions = predictor(plant, nuisance, own, derivatives=derivatives)
            except InputError as error:  # a step beyond what a model may be
                self.refused = error
                return [Block(np.full(1, np.inf), np.zeros((1, len(z))), np.zeros((1, len(x)))) for x in own]
            units = np.array([v.slope(x) for v, x in zip(slopes_of, z, strict=True)])
            blocks = []
            for i, p in enumerate(predictions):
                sigma, mask = predictor.sigma[i], None if known is None else known[i]
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
            if name == "start":
                W = np.diag(1 / np.repeat(_START, len(x) // 2))
                W = W @ drive.of_start
                mean = np.zeros(len(x))
            else:
                # each camera of a strike follows the same log on its own: together they know it as well as it is
                shared = 1 / np.sqrt(predictor.sharing[i])
                W, mean = shared * drive.motion.rows, shared * drive.motion.mean
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

    def assess(self, solution: Solution) -> Uncertainty:
        """Return the uncertainty at a solution."""
        pseudo = self._pseudo(solution)
        prior = None if self._prior is None else self._prior[0]
        values = self.split(solution.z)[0].values()
        return assess(self.variables, solution.z, pseudo, self._series, self._times, prior, values=values)

    def _pseudo(self, solution: Solution) -> list[Block]:
        """Blocks of least squares that err as the fit does."""
        P = self.predictor
        blocks = self._evaluator(P)(solution.z, solution.own, True)[: len(P.recordings)]
        counts = [len(x) for x in P.measured]
        # Huber's estimate errs like least squares with these residuals (Street, Carroll, Ruppert 1988)
        psi = [huber(b.r[:n], self._limit)[1] * b.r[:n] for b, n in zip(blocks, counts, strict=True)]
        inside = np.mean(np.concatenate([x == b.r[:n] for x, b, n in zip(psi, blocks, counts, strict=True)]))
        return [
            Block(np.concatenate([x / inside, b.r[n:]]), b.A, b.B) for x, b, n in zip(psi, blocks, counts, strict=True)
        ]

    @property
    def _series(self) -> list[np.ndarray]:
        """Which series each reading belongs to, of each recording (K,)."""
        return [channel[:, 1] * 8 + channel[:, 2] for channel in self.predictor.channels]

    @property
    def _times(self) -> list[np.ndarray]:
        """Times of the readings [s], of each recording (K,)."""
        return [r.t[channel[:, 0]] for r, channel in zip(self._recordings, self.predictor.channels, strict=True)]

    def clock_fault(self, solution: Solution, *, correlated: bool = True) -> ClockFault | None:
        """Return the most likely fault of a recording's times and its significance; see `likeliest_fault`."""
        P, prior = self.predictor, None
        predictions = P(*self.split(solution.z), solution.own, derivatives=False)
        inside = np.array([not v.bound(z) for v, z in zip(self.variables, solution.z, strict=True)])
        readings = []
        for i, (block, p) in enumerate(zip(self._pseudo(solution), predictions, strict=True)):
            of_all, names, own = Block(block.r, block.A[:, inside], block.B), P.own_names(i), solution.own[i]
            at = {name: names.index(name) for name in self._judged}
            clock = {name: (column, float(own[column] - NEUTRAL[name])) for name, column in at.items()}
            readings.append(FittedReadings(of_all, self._series[i], self._times[i], p.by_time / P.sigma[i], clock))
        if self._prior is not None:
            prior = self._prior[0][:, inside]
        fitted = [name for name in CLOCK if name in (*self.free, *self._own) and name not in self._judged]
        return likeliest_fault(readings, prior, fitted=fitted, correlated=correlated)

    def with_clocks(self) -> Problem | None:
        """Return the problem with a free delay and clock rate for each recording; None if they are free already or
        cannot be fitted.

        For the drive `passive` a delay cannot be distinguished from the initial state; for `free` the encoders have no
        separate clock.
        """
        kinds: Sequence[str] = {"free": (), "passive": ("clock_rate",)}.get(self.options.drive, CLOCK)
        own = [name for name in kinds if name not in (*self.free, *self._own)]
        if not own:
            return None
        options = replace(self.options, per_recording=(*self._own, *own))
        wider = Problem(self._recordings, self.plant, self.free, self.variables, options)
        wider._judged = own
        return wider

    def compare(
        self, solution: Solution, known: Sequence[np.ndarray] | None = None, forecast: Forecast | None = None
    ) -> list[RecordingFit]:
        """Return every recording with its prediction at a solution; readings with `known` = 1 are not among the
        residuals, and the others have standard errors if there is a forecast.
        """
        plant, nuisance = self.split(solution.z)
        P, found = self.predictor, []
        spread: Sequence[np.ndarray | None] = [None] * len(P.recordings)
        if forecast is not None:
            known = [np.zeros(len(x)) for x in P.measured] if known is None else known
            spread = [forecast.standard_errors(x) for x in self._predicted(solution, known)]
        predictions = P(plant, nuisance, solution.own, derivatives=False)
        for i, p in enumerate(predictions):
            judged = np.full(len(p.value), True) if known is None else known[i] == 0
            channels = P.channels[i][judged]
            residuals, frames = (p.value - P.measured[i])[judged], P.channels[i][:, 0]
            first, stated = channels[:, 0].min(), spread[i]
            t, path = P.path(i, plant, nuisance, solution.own[i])
            found.append(
                RecordingFit(
                    source=P.recordings[i].source,
                    residuals=residuals,
                    measured=P.measured[i][judged],
                    sigma=P.sigma[i][judged],
                    weight=huber(residuals / P.sigma[i][judged], self._limit)[1],
                    channels=channels,
                    markers=tuple(path),
                    own=named_own(P.own_names(i), solution.own[i]),
                    t=t,
                    path=path,
                    size=p.size[judged],
                    view=P.recordings[i].view,
                    predicted_from=float(P.recordings[i].t[first]) if first > frames.min() else None,
                    spread=None if stated is None else (stated * P.sigma[i])[judged],
                    freedom=np.inf if forecast is None else forecast.freedom,
                )
            )
        return found

    def own_intervals(self, solution: Solution, uncertainty: Uncertainty) -> list[dict[str, tuple[float, float]]]:
        """Return of each recording the 95 % intervals of the separate unknowns that `per_recording` names."""
        found, P = [], self.predictor
        for i, readings in enumerate(self._predicted(solution, [np.ones(len(y)) for y in P.measured])):
            half = half_width(0.95, uncertainty.freedom) * own_errors(readings, uncertainty)
            ends = zip(P.own_names(i), solution.own[i] - half, solution.own[i] + half, strict=True)
            found.append({name: (float(a), float(b)) for name, a, b in ends if name in self.options.per_recording})
        return found
