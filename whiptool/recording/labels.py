"""Check of marker labels: motion capture may exchange labels, or merge two markers.

The position of every marker is extrapolated from its last two frames. If another assignment of a frame's points to
these positions explains the frame far better than its labels, labels were exchanged. If two markers that were apart
coincide for several frames, they were merged.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from whiptool.recording.strike_recording import StrikeRecording

CLEARER = 0.3  # an exchange leaves less than this share of the distance that the frame's own labels leave
NOISE = 8.0  # standard errors that a frame's own labels leave at least, where one is claimed
REMEMBERED = 4  # frames: a marker that was missing for longer is expected nowhere
TOGETHER = 3.0  # standard errors of the distance between markers that lie on each other
LASTING = 3  # frames in a row that they do


@dataclass(frozen=True)
class Exchange:
    """Labels that were exchanged between one frame and the next."""

    t: float  # of the first frame with the new labels [s]
    markers: tuple[str, ...]  # labels in that frame
    before: tuple[str, ...]  # former labels of these markers, in the same order

    def __str__(self) -> str:
        changes = ", ".join(f"{old} became {new}" for old, new in zip(self.before, self.markers, strict=True))
        return f"{changes} at {self.t:.3f} s"


@dataclass(frozen=True)
class Swallowed:
    """Two labels that were on the same marker for some time."""

    start: float  # first time [s]
    end: float  # last time [s]
    markers: tuple[str, str]  # the two labels

    def __str__(self) -> str:
        return f"{self.markers[0]} and {self.markers[1]} on one place from {self.start:.3f} to {self.end:.3f} s"


@dataclass(frozen=True)
class Labels:
    """Faults of a recording's marker labels, in order of time."""

    exchanges: tuple[Exchange, ...]
    swallowed: tuple[Swallowed, ...]  # pairs of labels that were on the same marker
    order: np.ndarray  # column with each marker at every frame, (T, M): `points[f, order[f, m]]` is marker m

    @property
    def kept(self) -> bool:
        """Whether all labels stayed with their markers."""
        return not self.exchanges and not self.swallowed

    def __str__(self) -> str:
        return "; ".join(map(str, [*self.exchanges, *self.swallowed])) or "all labels stay with their markers"


def check_labels(recording: StrikeRecording) -> Labels:
    """Find where labels were exchanged, and where two labels were on the same marker.

    An exchange of markers that are closer to each other than the deviation of their paths from smooth motion between
    frames cannot be detected. In a camera's image markers may coincide, one behind the other, which is not a fault.
    """
    order, exchanges = _followed(recording)
    swallowed = [] if recording.view is not None else _swallowed(recording, order)
    return Labels(tuple(exchanges), tuple(swallowed), order)


def put_back(recording: StrikeRecording, labels: Labels) -> StrikeRecording:
    """Return the recording with exchanged labels corrected, and without points whose two labels are on one marker."""
    columns_too = ("sigma", "t_points", *(() if recording.depth is None else ("depth", "depth_sigma")))
    columns: dict[str, Any] = {x: np.take_along_axis(getattr(recording, x), labels.order, axis=1) for x in columns_too}
    points = np.take_along_axis(recording.points, labels.order[..., None], axis=1)
    for found in labels.swallowed:
        during = (recording.t >= found.start) & (recording.t <= found.end)
        for name in found.markers:
            points[during, recording.markers.index(name)] = np.nan
    return dataclasses.replace(recording, points=points, **columns)


def _followed(recording: StrikeRecording) -> tuple[np.ndarray, list[Exchange]]:
    """Follow the markers from frame to frame, and return whose column each is in, (T, M), and where that changes."""
    count = len(recording.markers)
    order = np.tile(np.arange(count), (len(recording.t), 1))
    exchanges: list[Exchange] = []
    last: list[list[int]] = [[] for _ in range(count)]  # the last two frames in which each marker was seen
    points, seen, now = recording.points, recording.seen, np.arange(count)
    for f, t in enumerate(recording.t):
        order[f] = now
        known = [m for m in range(count) if len(last[m]) == 2 and f - last[m][0] <= REMEMBERED]
        shown = [m for m in known if seen[f, now[m]]]
        if len(shown) > 1:
            expected = np.array([_carried(recording, order, m, last[m], t) for m in shown])
            here = points[f, now[shown]]
            found = _better(expected, here, recording.sigma[f, now[shown]])
            if found is not None:
                changed = [i for i, j in enumerate(found) if i != j]
                names = recording.markers
                exchanges.append(
                    Exchange(
                        float(t),
                        tuple(names[now[shown[found[i]]]] for i in changed),
                        tuple(names[now[shown[i]]] for i in changed),
                    )
                )
                columns = now[shown][found]
                now = now.copy()
                now[shown] = columns
                order[f] = now
        for m in range(count):
            if seen[f, order[f, m]]:
                last[m] = [*last[m][-1:], f]
    return order, exchanges


def _carried(recording: StrikeRecording, order: np.ndarray, marker: int, frames: Sequence[int], t: float) -> np.ndarray:
    """Return where the last two frames carry a marker at time t [m], (d,)."""
    first, second = (recording.points[f, order[f, marker]] for f in frames)
    before, after = recording.t[list(frames)]
    return second + (second - first) / (after - before) * (t - after)


def _better(expected: np.ndarray, here: np.ndarray, sigma: np.ndarray) -> np.ndarray | None:
    """Return the far better assignment of what is here (m, d) to what was expected (m, d); None without one."""
    squares = ((expected[:, None] - here[None]) ** 2).sum(axis=-1)
    found = linear_sum_assignment(squares)[1]
    changed = found != np.arange(len(found))
    if not changed.any():
        return None
    as_labelled = np.sqrt(np.diag(squares)[changed].sum())
    exchanged = np.sqrt(squares[np.flatnonzero(changed), found[changed]].sum())
    floor = NOISE * np.sqrt((sigma[changed] ** 2).sum())
    return found if as_labelled > floor and exchanged < CLEARER * as_labelled else None


def _swallowed(recording: StrikeRecording, order: np.ndarray) -> list[Swallowed]:
    """Return which pairs lie on each other for some frames, but not always."""
    points = np.take_along_axis(recording.points, order[..., None], axis=1)
    sigma, found = np.take_along_axis(recording.sigma, order, axis=1), []
    for i in range(len(recording.markers)):
        for j in range(i):
            apart = np.linalg.norm(points[:, i] - points[:, j], axis=-1)
            on = apart < TOGETHER * np.hypot(sigma[:, i], sigma[:, j])  # of NaN: false
            both = np.isfinite(apart)
            if on.sum() < LASTING or on[both].mean() > 0.5:  # two labels of one place are meant so
                continue
            edges = np.flatnonzero(np.diff(np.concatenate([[False], on, [False]]).astype(int)))
            for start, end in edges.reshape(-1, 2):
                if end - start >= LASTING:
                    names = recording.markers[j], recording.markers[i]
                    found.append(Swallowed(float(recording.t[start]), float(recording.t[end - 1]), names))
    return sorted(found, key=lambda one: one.start)
