"""Do cameras still stand where they were calibrated? The marker that two of them saw at one time tells.

Two lines of sight to one marker meet; those of a camera that was moved or turned pass each other. What a turn shifts
along the plane of both lines is not seen: a board is better (`space_calibration.agree`), but tracks are always there.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from whiptool.recording.strike_recording import StrikeRecording
from whiptool.vision.camera_track import CameraTrack

LATEST = 0.1  # [s] between two cameras' clocks
FEWEST = 10  # points that say whether two cameras agree
APART = 1.0  # [pixels] of lines of sight that do not meet: calibrations leave less
CLEARLY = 4.0  # standard errors likewise
CAP = 5.0  # standard errors that a sight counts as at most: a marker may be lost
_NORMAL = 0.6745  # median of the size of a standard normal number


@dataclass(frozen=True)
class Disagreement:
    """Two cameras whose lines of sight to the same markers do not meet.

    Args:
        cameras: Names of the cameras.
        apart: Median distance between the two lines of sight in an image [pixels].
        errors: Median distance in units of the stated errors.
        delay: Difference of the clocks, second camera minus first, at which they agree best [s].
    """

    cameras: tuple[str, str]
    apart: float
    errors: float
    delay: float

    def __str__(self) -> str:
        return f"{self.cameras[0]} and {self.cameras[1]} by {self.apart:.1f} pixels"


def disagreements(recordings: Sequence[StrikeRecording]) -> list[Disagreement]:
    """Return the pairs of cameras that disagree on the positions of markers.

    Args:
        recordings: Recordings of any strikes; those without a view are ignored. Those with the same joint log are of
            one strike; without joint logs, the k-th recordings of a command by each camera are taken as of one strike.
    """
    found = []
    for strike in _by_strike([r for r in recordings if r.view is not None]):
        for pair in combinations(strike, 2):
            disagreement = compare(*pair)
            if disagreement.apart > APART and disagreement.errors > CLEARLY:
                found.append(disagreement)
    return found


def moved(found: Iterable[Disagreement]) -> str | None:
    """Return the only camera that is part of all disagreements; None if there is not exactly one."""
    sets = [set(one.cameras) for one in found]
    common = set.intersection(*sets) if sets else set()
    return common.pop() if len(common) == 1 else None


def compare(first: StrikeRecording, second: StrikeRecording) -> Disagreement:
    """Return the disagreement of two cameras on the same markers, at the best delay between their clocks.

    The delay minimises the squared distances, each limited to `CAP` standard errors; it is 0 unless another is
    significantly better. Delays with which less than half of the points overlap are not tried.
    """
    assert first.view is not None
    assert second.view is not None
    names = first.view.name, second.view.name
    at_once, width, best = _Sights(first, second, 0.0), LATEST, 0.0
    tried, costs = {0.0: at_once}, dict[float, float]()
    for _ in range(4):
        for delay in best + width * np.linspace(-1, 1, 41):
            tried[float(delay)] = _Sights(first, second, float(delay))
        fewest = max(FEWEST, max(sights.count for sights in tried.values()) / 2)
        costs = {delay: sights.cost for delay, sights in tried.items() if sights.count >= fewest}
        if not costs:
            return Disagreement(names, 0.0, 0.0, 0.0)
        best, width = min(costs, key=lambda delay: costs[delay]), width / 20
    if 0.0 in costs and at_once.count * (costs[0.0] - costs[best]) < CLEARLY**2:
        best = 0.0
    return Disagreement(names, tried[best].apart, tried[best].errors, best)


class _Sights:
    """The lines of sight of two cameras to the markers that both saw, at a delay [s]."""

    def __init__(self, first: StrikeRecording, second: StrikeRecording, delay: float) -> None:
        shared = [name for name in first.markers if name in second.markers]
        tracks = [(CameraTrack(first, name), CameraTrack(second, name)) for name in shared]
        parts = [(*one.beside(other, delay), one.error(other)) for one, other in tracks]
        self._apart = np.concatenate([np.zeros(0), *(apart for apart, _, _ in parts)])
        self._errors = np.concatenate([np.zeros(0), *(apart / sigma for apart, sigma, _ in parts)])
        self._steady = np.concatenate([np.zeros(0), *(apart / error for apart, _, error in parts)])

    @property
    def count(self) -> int:
        """Number of points that both saw."""
        return len(self._apart)

    @property
    def cost(self) -> float:
        """Mean square of how far they pass each other, in standard errors of the pixels alone, each at most `CAP`.

        Errors of what lies between frames are left out: they would favour delays that lie between frames.
        """
        return float(np.mean(np.minimum(self._steady, CAP) ** 2))

    @property
    def apart(self) -> float:
        """Median of how far they pass each other [pixels]."""
        return float(np.median(self._apart))

    @property
    def errors(self) -> float:
        """The same in standard errors."""
        return float(np.median(self._errors)) / _NORMAL


def _by_strike(recordings: Sequence[StrikeRecording]) -> list[list[StrikeRecording]]:
    """Return the recordings of each strike that several cameras saw."""
    groups: dict[tuple, list[StrikeRecording]] = {}
    counted: dict[tuple, int] = {}
    for recording in recordings:
        assert recording.view is not None
        name = recording.view.name
        vector = None if recording.strike is None else recording.strike.vector
        of = vector if recording.joints_q is None else recording.joints_q
        key = None if of is None else of.tobytes()
        number = 0 if recording.joints_q is not None else counted.get((key, name), 0)
        counted[key, name] = number + 1
        groups.setdefault((key, number), []).append(recording)
    return [group for group in groups.values() if len(group) > 1]
