"""Update of a belief from recordings: maximum a posteriori, covariance, and the reasons why recordings are not used."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from whiptool.adaptation.model_error import ModelError
from whiptool.adaptation.prior import Belief, Learned
from whiptool.errors import InputError
from whiptool.identification.fit import Fit, FitOptions, fit
from whiptool.identification.plant import Plant
from whiptool.identification.predict import Predictor
from whiptool.identification.readings import PLACED
from whiptool.recording.filmed_approach import nearest_frame
from whiptool.recording.labels import check_labels
from whiptool.recording.strike_recording import StrikeRecording

UNMODELLED = 0.003  # [m], error of any model's tip that a better camera does not remove
AFTER = 0.04  # [s] that a recording is used beyond the closest approach
ELSEWHERE = 1.5  # the model's error at the next strike, over that of the strikes that were fitted
SHARE_SEEN = 0.5  # of the frames before that, in which the tip has to be seen
TOO_FAR = 0.06  # [m] RMSE from which a recording is inconsistent with every plausible whip


@dataclass(frozen=True)
class Starts:
    """Thresholds at which the fit of a whip is accepted without another starting point.

    `near` is not used in space. In the plane the RMSE in a wrong local minimum is centimetres, with an incomplete model
    millimetres; in space a bead at a wrong position also costs only millimetres.
    """

    explained: float = 1.0  # RMS residual, in standard errors with model errors, up to which no other start is tried
    near: float = 0.0075  # in the plane also an RMSE [m] up to which no other start is tried
    close: float = 3e-3  # a fit ends with smaller decreases of cost per mean squared residual; 0.08 standard errors
    valley: float = 0.02  # RMSE [m] above which two agreeing starts may have ended in the same wrong local minimum
    same: float = 0.5  # largest difference in cost (a log likelihood) of two fits that count as the same


STARTS = Starts()


BEADS = (0.35, 0.6, 0.85)  # parts of the length where a bead is sought, where what was found explains not all
_HEAVY = 0.1  # of the whip's mass, as it is sought
_FIRST_STEPS = 5  # of a fit, after which the places are compared
IMPLAUSIBLE = 4.0  # standard errors of the prior, root mean square over its numbers: no whip is like this
_OUTLYING = 3.0  # times the RMSE of the other recordings, if more than half of `TOO_FAR`
_UNMOVED = 0.02  # [rad], [m], of a camera that stood where it should
_HORIZONS = (0.5, 0.75)  # of a recording's frames, before all of them
_POSE = {2: ("rotation", "shift_x", "shift_y"), 3: PLACED[3][1:]}  # by dimension
_LEAST = 6  # frames
_OF_MEDIAN = math.sqrt(math.pi / 2)  # its standard error over that of the mean
_SHARPEST = 1e8  # information over the prior's, at most: rounding errors spoil the covariance beyond


def update(
    prior: Belief,
    recordings: Sequence[StrikeRecording],
    *,
    guess: Belief | None = None,
    contacts: Mapping[str, float] | None = None,
    starts: int = 3,
    screened: int = 24,
    seed: int = 0,
) -> Learned:
    """Return the belief after all recordings, fitted by maximum a posteriori from several starting points.

    The first starting point is `guess`, the belief after all recordings but the last; None: the prior. Unless that fit
    explains all frames, the best of `screened` samples of the prior follow, until a fit explains them, two starts
    agree, or `starts` were tried. The covariance is that of the linearised fit; its data are weighted down by the
    variance of the residuals and by their correlation, for model errors persist over many frames. `contacts` are
    planned times of the closest approach [s], by the recording's source.
    """
    began, refused, used = time.perf_counter(), dict[str, str](), list[StrikeRecording]()
    for recording in recordings:
        cut, reason = usable(recording, (contacts or {}).get(recording.source))
        if cut is None:
            refused[recording.source] = reason
        else:
            used.append(cut)
    found = _consistent(prior, guess or prior, used, refused, (starts, screened, seed))
    if found is None:
        return Learned(prior, {}, refused, time.perf_counter() - began)
    redundancy = _redundancy(found)
    belief = _belief(prior, found, used, redundancy)
    rmse = {r.source: r.rmse for r in found.recordings}
    return Learned(belief, rmse, refused, time.perf_counter() - began, redundancy)


def _consistent(
    prior: Belief, guess: Belief, used: list[StrikeRecording], refused: dict[str, str], tries: tuple[int, int, int]
) -> Fit | None:
    """The best fit of the recordings that go together; the others move from `used` to `refused`, with the reason."""
    while used:
        options = FitOptions(
            drive=driven_by(prior.plant, used),
            prior=prior.as_prior(),
            check=False,  # the belief holds a delay, and its model errs
            max_iterations=25,
            tolerance=STARTS.close,
        )
        found = _best(prior, guess, used, options, tries)
        if found is None:
            refused[used.pop().source] = "no plausible whip could be fitted to it"
            continue
        worst = _inconsistent(prior, found, used)
        if worst is None:
            return found
        bad = used.pop(worst)
        refused[bad.source] = _why(prior, bad, found.recordings[worst].rmse, options)
        guess = prior
    return None


def driven_by(plant: Plant, recordings: Sequence[StrikeRecording]) -> str:
    """Return the drive of a fit, a value of `--drive`: `joints` for a position-controlled robot in space whose joints
    were logged, else `command`.

    If a robot lags behind its command, the log of its joints gives the true motion of its hand.
    """
    logged = all(recording.joints_q is not None for recording in recordings)
    robot = plant.controller is not None and plant.controller.prescribed and plant.model.dimension == 3
    return "joints" if robot and logged else "command"


def usable(recording: StrikeRecording, contact: float | None = None) -> tuple[StrikeRecording | None, str]:
    """Return the tip's frames up to shortly after its closest approach to the target and an empty text; or None and the
    reason why the recording cannot be used. If the approach came before its planned time `contact` [s], frames are kept
    until then.

    The standard errors include a model error, so that a precise camera does not drive the fit to implausible
    parameters. At rest this error is the same in all frames, which are therefore replaced by one: their median.
    """
    recording.commanded()
    if "tip" not in recording.markers:
        raise InputError(f"{recording.called}: markers", ", ".join(recording.markers), "tip among them, in lower case")
    if lost := tip_mislabelled(recording):
        return None, lost
    i = recording.markers.index("tip")
    seen, t = recording.seen[:, i], recording.t
    end = recording.strike.D + recording.t_stay
    within, nearest = t <= end, None
    if recording.target is not None and not _at_rest(recording):
        nearest = nearest_frame(recording, recording.target, end=end)
    if nearest is not None:
        within &= t <= max(nearest, -math.inf if contact is None else contact) + AFTER
    lost = 1 - float(np.mean(seen[recording.t <= end])) if (recording.t <= end).any() else 1.0
    if lost > 1 - SHARE_SEEN or (seen & within).sum() < _LEAST:
        return None, f"the tip was lost in {lost:.0%} of the frames"
    others = [m for m in range(len(recording.markers)) if m != i]
    mask = ~(within[:, None] & recording.seen)
    mask[:, others] = True  # the tip alone: other markers are the tracker's own
    cut = dataclasses.replace(recording.without(mask), sigma=np.hypot(recording.sigma, UNMODELLED))
    return _median(cut, recording.sigma) if _at_rest(recording) else cut, ""


def tip_mislabelled(recording: StrikeRecording) -> str:
    """Return a description of an exchange of the tip's label in a motion-capture recording; empty without an exchange.

    Recordings in the plane and those with a single marker are not checked.
    """
    if recording.points.shape[2] == 2 or len(recording.markers) == 1:
        return ""
    labels = check_labels(recording)
    found = [x for x in (*labels.exchanges, *labels.swallowed) if "tip" in x.markers]
    return f"the label of the tip left its marker: {'; '.join(map(str, found))}" if found else ""


def _at_rest(recording: StrikeRecording) -> bool:
    """Whether the strike was none, and the whip hung."""
    return recording.strike is not None and recording.strike.q_i == recording.strike.q_f


def _median(recording: StrikeRecording, noise: np.ndarray) -> StrikeRecording:
    """One frame in place of all; `noise`: standard errors of the frames, (T, M) [m].

    In their middle, when a model's arm has sagged, too; the first, where it was measured how the arm stands.
    """
    seen = np.flatnonzero(recording.seen.any(axis=1))
    points = np.full_like(recording.points, np.nan)
    points[seen[len(seen) // 2 if recording.sag is None else 0]] = np.median(recording.points[seen], axis=0)
    error = _OF_MEDIAN * float(np.nanmean(noise[seen])) / math.sqrt(len(seen))
    sigma = np.full_like(recording.sigma, math.hypot(error, UNMODELLED))
    return dataclasses.replace(recording, points=points, sigma=sigma)


def _best(
    prior: Belief, guess: Belief, recordings: list[StrikeRecording], options: FitOptions, tries: tuple[int, int, int]
) -> Fit | None:
    """The first fit that explains all frames or was found twice, or the best; None where none came to an end.

    `tries`: starts, screened samples and seed, as of `update`.
    """
    starts, screened, seed = tries
    found: list[Fit | None] = []
    for way in (_fit, _beaded, _grown):
        found.append(way(recordings, guess.at(), prior.names, options))
        if _explains(prior, found[-1]) or _again(found):
            return min((f for f in found if f is not None), key=_cost)
    samples = prior.sample(np.random.default_rng([seed, len(recordings)]), screened)
    early = [_until(r, _HORIZONS[0]) for r in recordings]
    predictor = Predictor(early, prior.plant, drive=options.drive, shared=_of_plant(prior))
    scores = [_score(predictor, plant) for plant in samples]
    for i in np.argsort(scores)[: starts - 1]:
        found.append(_grown(recordings, samples[i], prior.names, options))
        if _explains(prior, found[-1]) or _again(found):
            break
    return min((f for f in found if f is not None), key=_cost, default=None)


def _beaded(
    recordings: Sequence[StrikeRecording], plant: Plant, names: Sequence[str], options: FitOptions
) -> Fit | None:
    """A fit from where its first steps lead farthest, of a bead at several places; None where no place is unknown.

    A fit does not move a bead along the whip once it has vanished.
    """
    if "profile.bead_place" not in names:
        return None
    heavy = plant.values()["profile.linear_density"] * plant.values()["profile.length"] * _HEAVY
    placed = [plant.changed({"profile.bead_place": place, "profile.bead_mass": heavy}) for place in BEADS]
    first = dataclasses.replace(options, max_iterations=_FIRST_STEPS, loss=None)
    tried = [f for f in (_fit(recordings, start, names, first) for start in placed) if f is not None]
    best = min(tried, key=_cost, default=None)
    return None if best is None else _fit(recordings, best.plant, names, options)


def _again(found: Sequence[Fit | None]) -> bool:
    """Whether the last is among the best, and another start led there too: no better one is to be expected.

    Not where it is centimetres off: starts that are near to each other can end in one wrong valley.
    """
    if found[-1] is None or max(r.rmse for r in found[-1].recordings) > STARTS.valley:
        return False
    costs = [np.inf if f is None else _cost(f) for f in found]
    return len(costs) > 1 and abs(costs[-1] - min(costs[:-1])) <= STARTS.same


def _cost(found: Fit) -> float:
    return found.runs[0].solution.cost


def _explains(prior: Belief, found: Fit | None) -> bool:
    if found is None or not _plausible(prior, found):
        return False
    near = STARTS.near if prior.plant.model.dimension == 2 else 0.0
    return all(r.chi <= STARTS.explained or r.rmse <= near for r in found.recordings)


def _grown(
    recordings: Sequence[StrikeRecording], plant: Plant, names: Sequence[str], options: FitOptions
) -> Fit | None:
    """A fit of all frames; where the start is far from them, by way of fits of the first frames only.

    Late in a strike the tip depends wildly on the whip, and a fit from afar ends in one of many valleys. Early on it
    does not.
    """
    for share in _HORIZONS:
        found = _fit([_until(r, share) for r in recordings], plant, names, options)
        if found is None:
            return None
        assert isinstance(found.plant, Plant)
        plant = found.plant
    return _fit(recordings, plant, names, options)


def _until(recording: StrikeRecording, share: float) -> StrikeRecording:
    """Its first frames: a share of those in which the tip is seen, and no fewer than are needed."""
    seen = np.flatnonzero(recording.seen.any(axis=1))
    last = seen[max(math.ceil(share * len(seen)), min(_LEAST, len(seen))) - 1]
    late = np.arange(len(recording.t)) > last
    return recording.without(late[:, None] & recording.seen)


def _fit(recordings: Sequence[StrikeRecording], plant: Plant, names: Sequence[str], options: FitOptions) -> Fit | None:
    """A fit, or None where the model leaves what can be computed: nonsense drives it there."""
    try:
        found = fit(recordings, plant, names, options=options)
    except (InputError, np.linalg.LinAlgError):
        return None
    return found if np.isfinite(_cost(found)) else None


def _of_plant(belief: Belief) -> tuple[str, ...]:
    return tuple(name for name in belief.names if name != "delay")


def _score(predictor: Predictor, plant: Plant) -> float:
    """Mean distance between recorded and predicted tip [m]."""
    found = predictor(plant, {}, predictor.start, derivatives=False)
    r = [p.value - y for p, y in zip(found, predictor.measured, strict=True)]
    mean = float(np.mean(np.abs(np.concatenate(r))))
    return mean if np.isfinite(mean) else np.inf


def _inconsistent(prior: Belief, found: Fit, recordings: Sequence[StrikeRecording]) -> int | None:
    """Which recording does not go with the others, or with any plausible whip.

    How well a whip at rest is explained says nothing about how well one that moves should be.
    """
    rmse = np.array([r.rmse for r in found.recordings])
    worst = int(rmse.argmax())
    others = rmse[[i for i, r in enumerate(recordings) if i != worst and not _at_rest(r)]]
    limit = TOO_FAR
    if len(others):
        limit = min(TOO_FAR, max(TOO_FAR / 2, _OUTLYING * float(np.median(others))))
    return None if rmse[worst] <= limit and _plausible(prior, found) else worst


def _plausible(prior: Belief, found: Fit) -> bool:
    """Whether the prior allows what was fitted."""
    off = found.uncertainty.z - prior.z
    return bool(off @ np.linalg.solve(prior.covariance, off) <= IMPLAUSIBLE**2 * len(off))


def _why(prior: Belief, bad: StrikeRecording, rmse: float, options: FitOptions) -> str:
    """What would explain a recording that no whip explains."""
    said, d = (
        f"no plausible whip moves like this ({100 * rmse:.1f} cm RMSE)",
        prior.plant.model.dimension,
    )
    posed = _fit([bad], prior.at(), prior.names, dataclasses.replace(options, per_recording=_POSE[d]))
    if posed is None:
        return said
    own = posed.recordings[0].own
    turns, shift = ([own[x] for x in _POSE[d] if x.startswith(kind)] for kind in ("rotation", "shift"))
    turned = float(np.linalg.norm(turns))
    if posed.recordings[0].rmse > TOO_FAR / 2 or turned > np.pi / 4 or not _plausible(prior, posed):
        return said + ": is the marker that was tracked the tip?"
    if max(turned, float(np.linalg.norm(shift))) < _UNMOVED:
        return said + "; alone it would fit: a whip other than that of the other recordings?"
    by, to = (", ".join(x) for x in ([f"{np.degrees(t):+.1f}" for t in turns], [f"{s:+.3f}" for s in shift]))
    return said + f", unless the camera was turned by {by} deg and moved by ({to}) m"


def _redundancy(found: Fit) -> float:
    """Return how many readings count as one: they correlate, and may scatter by more than their stated errors.

    Less scatter than these is chance, or hides what no residual shows.
    """
    U = found.uncertainty
    correlation = float(np.clip(U.whiteness, 0.0, 0.95))
    return (1 + correlation) / (1 - correlation) * max(U.residual_variance, 1.0)


def _belief(prior: Belief, found: Fit, recordings: Sequence[StrikeRecording], redundancy: float) -> Belief:
    """The fit as a belief: its covariance inflated by what the residuals show.

    A whip at rest shows nothing of how well the model moves.
    """
    U = found.uncertainty
    root = U.directions * U.singular_values[:, None] / U.units
    L = np.linalg.cholesky(prior.covariance)
    # Data against prior along independent directions: what the data determine, in units of the prior's errors
    gained, V = np.linalg.eigh((root @ L).T @ (root @ L) - np.eye(len(L)))
    few = redundancy / U.residual_variance  # by which the fit has already divided
    wide = L @ V / np.sqrt(1 + np.clip(gained / few, 0.0, _SHARPEST))
    covariance = wide @ wide.T
    error = _learned_error(prior.model_error, found, recordings, few)
    return Belief(prior.plant, prior.names, np.array(U.z), covariance, error)


def _learned_error(prior: ModelError, found: Fit, recordings: Sequence[StrikeRecording], few: float) -> ModelError:
    """The model's error after the residuals of whips that moved; `few` readings count as one."""
    moved = [fitted for fitted, r in zip(found.recordings, recordings, strict=True) if not _at_rest(r)]
    if not moved:
        return prior
    sigma, residuals = (np.concatenate([getattr(m, name) for m in moved]) for name in ("sigma", "residuals"))
    noise = sigma**2 - UNMODELLED**2
    unexplained = max(float(np.mean(residuals**2 - noise)), 0.0)
    return prior.updated(ELSEWHERE**2 * unexplained, len(residuals) / few, len(moved))
