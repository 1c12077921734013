"""Do cameras still stand where they were calibrated? The marker that two of them saw at one time tells.

Two lines of sight to one marker meet; those of a camera that was moved or turned pass each other. What a turn shifts
along the plane of both lines is not seen: a board is better (`board_agreement.agree`), but tracks are always there.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.interpolate import PchipInterpolator

from whiptool.recording.strike_recording import StrikeRecording
from whiptool.vision.triangulation import triangulate

LATEST = 0.1  # [s] between two cameras' clocks
GAP = 2.5  # frames without a marker over which its track is not drawn on
FEWEST = 10  # points that say whether two cameras agree
APART = 1.0  # [pixels] of lines of sight that pass each other: calibrations leave less
CLEARLY = 4.0  # standard errors likewise
_NORMAL = 0.6745  # median of the size of a standard normal number


@dataclass(frozen=True)
class Disagreement:
    """Two cameras whose lines of sight to the same markers pass each other.

    Args:
        cameras: Their names.
        apart: How far a line of sight is from the other's in an image, in the median [pixels].
        errors: The same over what the recordings state.
        delay: Of the second camera's clock behind the first's at which they agree best [s].
    """

    cameras: tuple[str, str]
    apart: float
    errors: float
    delay: float

    def __str__(self) -> str:
        return f"{self.cameras[0]} and {self.cameras[1]} by {self.apart:.1f} pixels"


def disagreements(recordings: Sequence[StrikeRecording]) -> list[Disagreement]:
    """Return the pairs of cameras that do not agree about where the markers of strikes were.

    Args:
        recordings: Of any strikes, with views or without. Those with one joint log are of one strike; without joint
            logs, each camera's first of a command is of the same strike as the other cameras' first, and so on.
    """
    found = []
    for strike in _by_strike([r for r in recordings if r.view is not None]):
        for pair in combinations(strike, 2):
            disagreement = compare(*pair)
            if disagreement.apart > APART and disagreement.errors > CLEARLY:
                found.append(disagreement)
    return found


def moved(found: Iterable[Disagreement]) -> str | None:
    """Return the only camera that is part of all disagreements; None where two or none could be."""
    sets = [set(one.cameras) for one in found]
    common = set.intersection(*sets) if sets else set()
    return common.pop() if len(common) == 1 else None


def compare(first: StrikeRecording, second: StrikeRecording) -> Disagreement:
    """Return how far two cameras' lines of sight to the same markers pass each other, at the best delay of a clock."""
    assert first.view is not None
    assert second.view is not None
    tracks = [(_Track(first, name), _Track(second, name)) for name in first.markers if name in second.markers]
    names = first.view.name, second.view.name

    def apart(delay: float) -> tuple[float, float]:
        """Median distance of lines of sight [pixels], and the same over its standard error; 0 where little was seen."""
        parts = [one.beside(other, delay) for one, other in tracks]
        each = np.concatenate([p for p, _ in parts]) if parts else np.zeros(0)
        sigma = np.concatenate([s for _, s in parts]) if parts else np.ones(0)
        if len(each) < FEWEST:
            return 0.0, 0.0
        return float(np.median(each)), float(np.median(each / sigma)) / _NORMAL

    steps, width, best = np.linspace(-1, 1, 21), LATEST, 0.0
    for _ in range(3):
        tried = best + width * steps
        best = float(min(tried, key=lambda delay: apart(delay)[1]))
        width /= 8
    return Disagreement(names, *apart(best), best)


def _by_strike(recordings: Sequence[StrikeRecording]) -> list[list[StrikeRecording]]:
    """Return the recordings of each strike that several cameras saw."""
    groups: dict[tuple, list[StrikeRecording]] = {}
    counted: dict[tuple, int] = {}
    for recording in recordings:
        assert recording.view is not None
        name = recording.view.name
        of = recording.joints_q if recording.joints_q is not None else recording.strike and recording.strike.vector
        key = None if of is None else of.tobytes()
        number = 0 if recording.joints_q is not None else counted.get((key, name), 0)
        counted[key, name] = number + 1
        groups.setdefault((key, number), []).append(recording)
    return [group for group in groups.values() if len(group) > 1]


class _Track:
    """One marker's way through one camera's images, at any time between its frames."""

    def __init__(self, recording: StrikeRecording, marker: str) -> None:
        assert recording.view is not None
        m = recording.markers.index(marker)
        seen = recording.seen[:, m]
        self.camera, self.t = recording.view, recording.t_points[seen, m]
        self.pixels, self.sigma = recording.points[seen, m], recording.sigma[seen, m]
        self.gap = GAP * float(np.median(np.diff(recording.t)))

    def at(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pixels (T, 2) at times (T,), NaN where it was not followed, and their standard errors (T,)."""
        unseen = np.full((len(t), 2), np.nan), np.full(len(t), np.nan)
        if len(self.t) < 4:
            return unseen
        after = np.clip(np.searchsorted(self.t, t), 1, len(self.t) - 1)
        inside = (t >= self.t[0]) & (t <= self.t[-1]) & (self.t[after] - self.t[after - 1] < self.gap)
        smooth = PchipInterpolator(self.t, self.pixels)(t)
        straight = np.stack([np.interp(t, self.t, x) for x in self.pixels.T], axis=1)
        between = np.linalg.norm(smooth - straight, axis=1)  # what a curve between two frames may be wrong by
        pixels = np.where(inside[:, None], smooth, np.nan)
        return pixels, np.hypot(np.interp(t, self.t, self.sigma), between)

    def beside(self, other: _Track, delay: float) -> tuple[np.ndarray, np.ndarray]:
        """Return how far the lines of sight of both are from meeting [pixels], and standard errors, (P,) each."""
        seen, sigma = other.at(self.t + delay)
        found = triangulate([self.camera, other.camera], np.stack([self.pixels, seen]))
        apart = np.sqrt(2) * found.residual  # the two miss the point between them by half of it each, in squares
        known = np.isfinite(apart) & np.isfinite(sigma)
        return apart[known], np.sqrt((self.sigma[known] ** 2 + sigma[known] ** 2) / 2)
