"""Which taper and damping explain the cascade: fitted to the discrete style, the rhythmic style being predicted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from papers.human.bullwhip import Bullwhip, Cascade, cascades
from papers.human.reading import STYLES, People
from papers.human.throw_path import INSTANTS, MeanHand, ThrowPath, mean_hand

DISCRETE, RHYTHMIC = STYLES
WHIP_NUMBERS = ("stiffness", "taper", "damping_time", "grip")
# Prior of the fit: whip and hand swing back underneath, then over the head (degrees), from the
# best of 3,000 random paths; taper, stiffness, damping and grip are a leather whip's
_DIRECTION = (-77, -142, -190, -214, -265, -372, -397)
_HANDLE = (0, -55, -83, -111, -144, -215, -247)  # it hangs at first
_WHIP = (0.32, 0.25, 0.15, 0.25)
_WIDTHS = np.array([1.2] * INSTANTS + [0.8] * (INSTANTS - 1) + [1.2, 0.4, 1.0, 0.3])  # [rad]; of logarithms
# how near the model is to come: of speeds by their logarithm, of times, of shapes [m], of angles [rad]
_SPEED, _TIME, _ENDS, _SHAPE, _HANDLE_ANGLE, _AHEAD, _BEND = 0.04, 0.015, 0.3, 0.15, 0.26, 0.35, 1.5
_SHOWN = [0, 2, 4, 6]  # markers of the shape
_LOST = 50.0  # residual of a whip whose simulation diverged
_STEP = 1e-4
_RESAMPLED_STEPS = 8


@dataclass(frozen=True, eq=False)
class Measured:
    """Means over people in one style, markers tip first without the hand; M markers.

    Args:
        hand: Their mean hand.
        peaks, times: Peaks and times of the mean speeds, (M,).
        first, last: Speeds at onset and at the closest approach [m/s], (M,).
        shape: Places when the hand is fastest, from the thong's beginning: forward and up [m], (M, 2).
        way: To the target from there [m], (2,).
        handle: Direction of the handle then [rad].
    """

    hand: MeanHand
    peaks: np.ndarray
    times: np.ndarray
    first: np.ndarray
    last: np.ndarray
    shape: np.ndarray
    way: np.ndarray
    handle: float


def measured(people: People, style: str, who: Sequence[int] | None = None) -> Measured:
    """Return the means over people of a style; some of them, any of them repeatedly, or all.

    The target is at the origin of the published places, x pointing away from it to the thrower and z up.
    """
    by_person = {one.person: one for one in people.of_style(style)}
    who = sorted(by_person) if who is None else who
    ones = [by_person[person] for person in who]
    thrower = people.throws.loc[people.throws["style"] == style, "person"].to_numpy()
    means = {person: np.nanmean(people.shapes[style][thrower == person], axis=0) for person in set(who)}
    x, _, z = np.mean([means[person] for person in who], axis=0)
    places = np.stack([-x, z], axis=1)  # forward, up
    thong, grip = places[9], places[10] - places[11]
    return Measured(
        hand=mean_hand(ones, cyclic=style == RHYTHMIC),
        peaks=np.mean([one.peaks[:-1] for one in ones], axis=0),
        times=np.mean([one.peak_times[:-1] for one in ones], axis=0),
        first=np.mean([one.markers[:-1, 0] for one in ones], axis=0),
        last=np.mean([one.markers[:-1, -1] for one in ones], axis=0),
        shape=places[:10] - thong,
        way=-thong,
        handle=float(np.arctan2(grip[0], -grip[1])),
    )


@dataclass(frozen=True, eq=False)
class Explained:
    """A path and a whip.

    Args:
        path, whip: Path and whip of the throw.
        x: The same as the vector that is fitted.
        cost: Half the sum of squared residuals, of the fit.
    """

    path: ThrowPath
    whip: Bullwhip
    x: np.ndarray
    cost: float

    @property
    def numbers(self) -> dict[str, float]:
        """Return the whip's numbers by name, `WHIP_NUMBERS`."""
        return dict(zip(WHIP_NUMBERS, np.exp(self.x[-4:]).tolist(), strict=True))


def start() -> np.ndarray:
    """Return the first guess: directions (the handle's, except for the first) and logarithms of the whip's numbers."""
    return np.concatenate([np.radians(_DIRECTION), np.radians(_HANDLE[1:]), np.log(_WHIP)])


def unpacked(x: np.ndarray) -> tuple[ThrowPath, Bullwhip]:
    """Return path and whip of a vector."""
    stiffness, taper, damping_time, grip = np.exp(x[-4:]).tolist()
    handle = np.concatenate([[0.0], x[INSTANTS : 2 * INSTANTS - 1]])
    return ThrowPath(x[:INSTANTS], handle, grip), Bullwhip(stiffness, taper, damping_time)


def predicted(x: np.ndarray, hand: MeanHand) -> Cascade | None:
    """Return the cascade that a path and a whip give with a hand's speed."""
    path, whip = unpacked(x)
    return cascades(hand, [path], [whip])[0]


def fit_cascade(
    seen: Measured, *, first: np.ndarray | None = None, uniform: bool = False, steps: int = 40
) -> Explained:
    """Fit path and whip to what was measured in one style.

    Args:
        seen: Means.
        first: Vector to begin at; default: `start()`.
        uniform: The whip does not taper.
        steps: Evaluations of the derivatives at most.
    """
    centre = start()
    free = np.ones(len(centre), bool)
    free[-3] = not uniform
    x = centre.copy() if first is None else first.copy()
    if uniform:
        x[-3] = 0.0

    def whole(some: np.ndarray) -> np.ndarray:
        full = x.copy()
        full[free] = some
        return full

    def slopes(some: np.ndarray) -> np.ndarray:
        shifts = _STEP * np.eye(len(some))
        both = _residuals(seen, [whole(some + d) for d in (*shifts, *-shifts)])
        return ((both[: len(some)] - both[len(some) :]) / (2 * _STEP)).T

    found = least_squares(
        lambda some: _residuals(seen, [whole(some)])[0],
        x[free],
        jac=slopes,
        x_scale=_WIDTHS[free],
        max_nfev=steps,
        ftol=1e-4,
        xtol=1e-5,
    )
    best = whole(found.x)
    return Explained(*unpacked(best), best, float(found.cost))


def resampled(people: People, best: Explained, count: int, *, seed: int = 0) -> dict[str, tuple[float, float]]:
    """Return 95 % intervals of the whip's numbers: people are resampled, with replacement, and the fit is repeated.

    Args:
        people: Everybody.
        best: The fit to all, where each repetition begins.
        count: Count of repetitions.
        seed: Seed of the drawing.
    """
    rng = np.random.default_rng(seed)
    everybody = sorted({one.person for one in people.speeds})
    found = []
    for _ in range(count):
        seen = measured(people, DISCRETE, rng.choice(everybody, len(everybody)).tolist())
        found.append(list(fit_cascade(seen, first=best.x, steps=_RESAMPLED_STEPS).numbers.values()))
    low, high = np.percentile(found, (2.5, 97.5), axis=0)
    return {name: (float(a), float(b)) for name, a, b in zip(WHIP_NUMBERS, low, high, strict=True)}


def _residuals(seen: Measured, vectors: Sequence[np.ndarray]) -> np.ndarray:
    """Return what is left at each vector, (vectors, residuals): of the measurements, of the prior, of bends."""
    paths, whips = zip(*(unpacked(x) for x in vectors), strict=True)
    rows = []
    for x, path, found in zip(vectors, paths, cascades(seen.hand, paths, whips), strict=True):
        misfit = np.full(_MISFITS, _LOST) if found is None else _misfit(seen, path, found)
        known = (x - start()) / _WIDTHS
        bends = [np.diff(angles, 2) / _BEND for angles in (path.direction, path.handle)]
        rows.append(np.concatenate([misfit, known, *bends]))
    return np.array(rows)


def _misfit(seen: Measured, path: ThrowPath, found: Cascade) -> np.ndarray:
    ahead = _turn(path.direction[4] - np.pi / 2)
    return np.concatenate(
        [
            np.log(found.peaks / seen.peaks) / _SPEED,
            (found.times - seen.times) / _TIME,
            np.log(found.speeds[0] / seen.first) / _ENDS,
            np.log(found.speeds[-1] / seen.last) / _ENDS,
            (found.shape - seen.shape)[_SHOWN].ravel() / _SHAPE,
            (found.way - seen.way) / _SHAPE,
            [_turn(path.handle[4] - seen.handle) / _HANDLE_ANGLE, ahead / _AHEAD],
        ]
    )


_MISFITS = 4 * 10 + 2 * len(_SHOWN) + 2 + 2


def _turn(angle: float) -> float:
    """Return an angle between -pi and pi."""
    return float((angle + np.pi) % (2 * np.pi) - np.pi)
