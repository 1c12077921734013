"""Do cameras still stand where they were calibrated? The marker that two of them saw at one time tells.

Two lines of sight to one marker meet; those of a camera that was moved or turned pass each other. What a turn shifts
along the plane of both lines is not seen: a board is better (`board_agreement.agree`), but tracks are always there.
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
    steps, width, best = np.linspace(-1, 1, 21), LATEST, 0.0
    for _ in range(3):
        tried = best + width * steps
        best = float(min(tried, key=lambda delay: apart_at(first, second, delay)[1]))
        width /= 8
    return Disagreement((first.view.name, second.view.name), *apart_at(first, second, best), best)


def apart_at(first: StrikeRecording, second: StrikeRecording, delay: float) -> tuple[float, float]:
    """Return how far lines of sight to the markers that both cameras saw pass each other.

    Args:
        first, second: With views.
        delay: Of the second camera's clock behind the first's [s].

    Returns:
        The median [pixels], and the median over the standard errors; 0 where less than `FEWEST` points were seen.
    """
    tracks = [(CameraTrack(first, name), CameraTrack(second, name)) for name in first.markers if name in second.markers]
    parts = [one.beside(other, delay) for one, other in tracks]
    each = np.concatenate([p for p, _ in parts]) if parts else np.zeros(0)
    sigma = np.concatenate([s for _, s in parts]) if parts else np.ones(0)
    if len(each) < FEWEST:
        return 0.0, 0.0
    return float(np.median(each)), float(np.median(each / sigma)) / _NORMAL


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
