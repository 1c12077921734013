"""Predicted readings of recordings, with their exact derivatives by every unknown."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from whiptool.errors import InputError
from whiptool.identification.drives import ORIGIN, Drive, DriveOptions, Shot, make_drive, unknown_markers
from whiptool.identification.motion import BaseMotion
from whiptool.identification.plant import BareArm, Plant, slopes
from whiptool.identification.readings import NEUTRAL, NUISANCE, NUISANCE_IN, SMOOTHING, Reading, placed
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.rollout.batch import OF_A_STEP, TOLERANCE, Batch
from whiptool.rollout.engine import find_engine, wanted_rung

_INTERVAL = 1e-3  # [s] between samples of a path
_NOISE_OVER_ERROR = 10.0  # standard errors of readings over integration errors, at least
LAG = ("lag", "lag_shape", "lag_delay")  # [s], [-], [s]: see `LaggedReference`


@dataclass(frozen=True)
class Prediction:
    """Predicted values of a recording's K readings that are not missing; derivatives are empty if not requested."""

    value: np.ndarray  # (K,): [m], [rad], or for a camera in space [pixels] and, for depth, its inverse [1/m]
    by_shared: np.ndarray  # derivatives by the G shared unknowns, (K, G)
    by_own: np.ndarray  # derivatives by this recording's own unknowns, (K, L)
    size: np.ndarray  # least displacement of a point that changes it by 1 unit [m/pixel], depth: [m^2]; positions: 1
    by_time: np.ndarray  # derivative by the time of each reading, (K,)


class Predictor:
    """Predicts the readings of recordings that have the same kind of drive; a call returns one `Prediction` for each.

    Args:
        recordings: Recordings to predict.
        plant: Plant of which some parameters vary; its structure is fixed.
        drive: Drive of the whip: `command`, `robot`, `joints`, `hand`, `handle`, `passive`, `free`.
        shared: Names of free parameters that are the same for all recordings: of the plant, or in `NUISANCE`.
        own: Names in `NUISANCE` of parameters that are free for each recording separately; also `start`, its initial
            state, and `smoothing`, the filter of its tracks.
        timestep: Time step [s]; None: 1 ms, or for the drive `command` chosen by the integration error.
        knots: Spacing of the knots of a prescribed motion's spline [s]; None: see `DriveOptions`.

    Attributes:
        start: Initial guess of each recording's own unknowns, (L,).
        measured, sigma: Each recording's readings that are not missing, and their standard errors, (K,).
        channels: Frame, marker and axis of these readings, (K, 3).

    Raises:
        InputError: A name is unknown or given twice, or a recording lacks data that the drive needs.
    """

    def __init__(
        self,
        recordings: Sequence[StrikeRecording],
        plant: Plant,
        *,
        drive: str,
        shared: Sequence[str],
        own: Sequence[str] = (),
        timestep: float | None = None,
        knots: float | None = None,
    ) -> None:
        if not recordings:
            raise InputError("recordings", "none", "one or more")
        self.recordings, self.kind = [_as_modelled(recording, plant) for recording in recordings], drive
        self.shared, self.own = tuple(shared), tuple(own)
        nuisance = NUISANCE_IN[plant.model.dimension]
        known = [*plant.values(), *nuisance]
        for name in self.shared:
            if name not in known:
                raise InputError("free parameter", name, "one of " + ", ".join(known))
        for name in self.own:
            if name not in (of_recordings := (*nuisance, *(SMOOTHING,) * bool(nuisance), "start")):
                raise InputError("free per recording", name, "one of " + ", ".join(of_recordings))
        named = [*self.shared, *self.own]
        if len(set(named)) < len(named):
            raise InputError("free parameters", named, "different names, each shared or per recording")
        if drive == "passive" and "delay" in named:
            rule = "names other than delay, which is not distinguishable from the free first state of a passive swing"
            raise InputError("free parameters", named, rule)
        self._of_plant = [name for name in self.shared if name not in NUISANCE]
        self._adaptive = timestep is None and drive == "command"
        self.h = _interval(plant) if timestep is None else timestep
        self.stride = max(1, round(_INTERVAL / self.h))
        how = DriveOptions(drive, self._of_plant, self.h, "start" in self.own, knots)
        self.drives = [make_drive(recording, plant, how) for recording in self.recordings]
        self._own_nuisance = [name for name in self.own if name != "start"]
        self.start = [self._first(d) for d in self.drives]
        self._read = [_readings(r, d) for r, d in zip(self.recordings, self.drives, strict=True)]
        self.measured = [read.measured for read in self._read]
        self.sigma = [read.sigma for read in self._read]
        self.channels = [read.channels for read in self._read]
        self.sharing = [_sharing(r, self.recordings) for r in self.recordings]
        finest = min(
            (float(x.min()) for x, r in zip(self.sigma, self._read, strict=True) if len(x) and not r.view), default=0.0
        )
        self._of_a_step = OF_A_STEP * max(1.0, finest / _NOISE_OVER_ERROR / TOLERANCE)
        self._links = sorted({i for read in self._read for i in read.links if i >= 0})

    def _first(self, drive: Drive) -> np.ndarray:
        return np.concatenate([*drive.unknowns.values(), [NEUTRAL.get(name, 0.0) for name in self._own_nuisance]])

    def set_motion(self, i: int, motion: BaseMotion) -> None:
        """Let the base in recording i move otherwise, with other unknowns."""
        self.drives[i].motion, self.drives[i].unknowns["motion"] = motion, motion.start
        self.start[i] = self._first(self.drives[i])

    def names(self, i: int) -> list[str]:
        """Return the names of the markers of recording i that are predicted."""
        return self._read[i].names

    def own_names(self, i: int) -> list[str]:
        """Return the names of recording i's own unknowns, in order."""
        unknowns = self.drives[i].unknowns.items()
        named = [LAG[j] if name == "lag" else f"{name}[{j}]" for name, x in unknowns for j in range(len(x))]
        return named + self._own_nuisance

    def __call__(
        self, plant: Plant, nuisance: dict[str, float], own: Sequence[np.ndarray], *, derivatives: bool
    ) -> list[Prediction]:
        """Predictions of all recordings, for a plant with the free parameters set, the shared nuisance by name, and the
        unknowns of each recording as `start` orders them; with derivatives by all unknowns, if requested."""
        rates = slopes(plant, self._of_plant) if derivatives else []
        counts = [sum(len(x) for x in d.unknowns.values()) for d in self.drives]
        packed = {d.packed_like: d for d in self.drives}
        packed = {like: d.pack(plant, rates) for like, d in packed.items()}
        shots = [d.shot(plant, packed[d.packed_like], x[:k]) for d, x, k in zip(self.drives, own, counts, strict=True)]
        paths = self._roll(shots, derivatives=derivatives)
        found = []
        for i, (path, dpath) in enumerate(paths):
            given = NEUTRAL | nuisance | dict(zip(self._own_nuisance, own[i][counts[i] :], strict=True))
            value, by_path, by_nuisance, size = self._read[i].read(
                path, dpath, given, start=self.drives[i].start, interval=self.h * self.stride
            )
            if not derivatives:
                none = np.zeros((len(value), 0))
                found.append(Prediction(value, none, none, size, -by_nuisance["delay"]))
                continue
            m = len(self._of_plant)
            column = dict(zip(self._of_plant, by_path[:m], strict=True)) | by_nuisance
            by_shared = np.reshape([column[name] for name in self.shared], (len(self.shared), len(value))).T
            own_rows = [by_nuisance[name] for name in self._own_nuisance]
            by_own = np.vstack([by_path[m:], np.reshape(own_rows, (len(own_rows), len(value)))]).T
            found.append(Prediction(value, by_shared, by_own, size, -by_nuisance["delay"]))
        return found

    def many(self, i: int, plants: Sequence[Plant], delays: Sequence[float]) -> np.ndarray:
        """Return the K predicted readings of recording i for each of many plants and clock delays [s], (plants, K); NaN
        after a simulation diverges.
        """
        d, read = self.drives[i], self._read[i]
        own = self.start[i][: sum(len(x) for x in d.unknowns.values())]
        shots = [d.shot(plant, d.pack(plant, []), own) for plant in plants]
        paths = self._roll(shots, derivatives=False, which=[i] * len(shots)) if shots else []
        values = np.empty((len(shots), len(self.measured[i])))
        for row, (path, dpath), delay in zip(values, paths, delays, strict=True):
            row[:] = read.read(path, dpath, NEUTRAL | {"delay": delay}, start=d.start, interval=self.h * self.stride)[0]
        return values

    def path(
        self, i: int, plant: Plant, nuisance: dict[str, float], own: np.ndarray
    ) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Return the predicted paths of recording i in its own clock and frame: times (S,) [s], and positions by
        marker.

        Positions are (S, d) [m]; for a pendulum angles by link, (S, 1) [rad]; for a camera in space pixels, (S, 2),
        with depth [m] in a third column if it was measured.
        """
        d, read = self.drives[i], self._read[i]
        k = sum(len(x) for x in d.unknowns.values())
        y, _ = self._roll([d.shot(plant, d.pack(plant, []), own[:k])], derivatives=False, which=[i])[0]
        given = NEUTRAL | nuisance | dict(zip(self._own_nuisance, own[k:], strict=True))
        t = given["clock_rate"] * (d.start + self.h * self.stride * np.arange(len(y))) + given["delay"]
        y = placed(y, given) if read.width > 1 else y
        if read.view is not None:
            y = np.dstack([read.view.project(y), read.view.depth(y)])[..., : read.axes]
        return t, {name: y[:, j] for j, name in enumerate(read.names)}

    def _roll(
        self, shots: Sequence[Shot], *, derivatives: bool, which: Sequence[int] | None = None
    ) -> list[tuple[np.ndarray, np.ndarray]]:
        """Paths of what is measured of each recording, (S, quantities, width), and their derivatives (D, S, ...)."""
        which = range(len(shots)) if which is None else which
        drives: list[Drive] = [self.drives[i] for i in which]
        structure, width = drives[0].structure, self._read[0].width
        columns = [width * i + c for i in self._links for c in range(width)]
        if width == 1:  # angles stand behind the links' ends, of pendulums in the plane
            columns = [2 * structure.n + i for i in self._links]
        D = [max(len(s.dp), 1) if derivatives else 1 for s in shots]
        lanes = np.repeat(np.arange(len(shots)), D)
        steps = np.array([d.steps for d in drives])[lanes]
        h = np.full(len(lanes), self.h)
        batch = Batch(
            p=np.array([s.p for s in shots])[lanes],
            x0=np.array([s.x0 for s in shots])[lanes],
            target=np.zeros((len(lanes), max(width, 2))),
            h=h,
            h_last=h,
            steps=steps,
            hold=drives[0].hold,
            columns=np.array(columns, int),
            stride=self.stride,
        )
        if self._adaptive:
            batch.tolerance, batch.knot = (
                np.full(len(lanes), self._of_a_step),
                np.array([d.ends for d in drives])[lanes],
            )
            batch.weight, batch.period = drives[0].displacements, drives[0].period or 0.0
        if derivatives:
            batch.dp, batch.dx0 = np.zeros_like(batch.p), np.zeros_like(batch.x0)
            batch.dh = batch.dh_last = np.zeros_like(h)
            for s, first in zip(shots, np.cumsum([0, *D]), strict=False):
                batch.dp[first : first + len(s.dp)], batch.dx0[first : first + len(s.dp)] = s.dp, s.dx0
        if inputs := [s.u for s in shots if s.u is not None]:
            batch.u = np.concatenate(inputs)
            batch.u_row = np.cumsum([0, *(len(u) for u in inputs[:-1])])[lanes]
            if derivatives:
                moving = [s.moving for s in shots if s.moving is not None]
                batch.du = np.concatenate([x.reshape(-1, x.shape[-1]) for x in moving])
                batch.du_row, row = np.full(len(lanes), -1), 0
                for s, x, first in zip(shots, moving, np.cumsum([0, *D]), strict=False):
                    each = np.arange(len(x))
                    batch.du_row[first + s.first + each] = row + x.shape[1] * each
                    row += x.shape[0] * x.shape[1]
        y, dy = find_engine(structure, forward=derivatives, rung=wanted_rung())(batch).observed()
        found, lane = [], 0
        for s, i, count in zip(shots, which, D, strict=True):
            read, some = self._read[i], range(len(s.dp) if derivatives else 0)
            none = [None] * len(some)
            placed_by = none if s.dplace is None else s.dplace
            zeros_by = none if s.dzero is None else s.dzero
            moved = [
                self._lay_out(dy[lane + k], place, zero, read)
                for k, place, zero in zip(some, placed_by, zeros_by, strict=False)
            ]
            found.append((self._lay_out(y[lane], s.place, s.zero, read), np.array(moved)))
            lane += count
        return found

    def _lay_out(self, y: np.ndarray, place: np.ndarray | None, zero: np.ndarray | None, read: Reading) -> np.ndarray:
        """Rolled columns (S, columns) as the recording's markers, (S, markers, width)."""
        laid = np.zeros((len(y), len(read.links), read.width))
        by_link = y.reshape(len(y), -1, read.width)
        for j, link in enumerate(read.links):
            if link >= 0:
                laid[:, j] = by_link[:, self._links.index(link)]
            if link != ORIGIN and place is not None:
                laid[:, j] += place[: len(y) * self.stride : self.stride]
            if zero is not None:
                laid[:, j] += zero[link]
        return laid


def _interval(plant: Plant) -> float:
    """Return the time between the samples of a path, a whole fraction of the period that a torque is held for [s]."""
    period = None if plant.controller is None else plant.controller.control_period
    return _INTERVAL if period is None else period / math.ceil(period / _INTERVAL - 1e-9)


def _as_modelled(recording: StrikeRecording, plant: Plant) -> StrikeRecording:
    """A recording with joints and axes as the plant's model has them; angles of links are as they are."""
    return recording if isinstance(plant.model, BareArm) else recording.for_model(plant.model)


def _sharing(recording: StrikeRecording, recordings: Sequence[StrikeRecording]) -> int:
    """Return how many recordings have the log of this one: those of several cameras that saw one strike."""
    if (log := _log(recording)) is None:
        return 1
    return sum(other is not None and np.array_equal(log, other) for other in map(_log, recordings))


def _log(recording: StrikeRecording) -> np.ndarray | None:
    """Return what was measured of the arm or hand; None where nothing was."""
    return recording.joints_q if recording.hand_pose is None else recording.hand_pose


def _readings(recording: StrikeRecording, drive: Drive) -> Reading:
    links = {name: drive.link_of(name) for name in recording.markers}
    known = {name: link for name, link in links.items() if link is not None}
    if not set(known) - {"shoulder", "handle"}:
        raise unknown_markers(recording)
    which = [recording.markers.index(name) for name in known]
    d = 1 if recording.angular else drive.structure.dimension
    if recording.view is not None and d == 2:
        raise InputError(f"{recording.called}: points", "a camera's pixels", "positions, for a model in the plane")
    points, t = recording.points[:, which, :d], recording.t_points[:, which]
    sigma = np.repeat(recording.sigma[:, which, None], points.shape[2], axis=2)
    if recording.depth is not None:
        depth = recording.depth[:, which]
        points, sigma = np.dstack([points, 1 / depth]), np.dstack([sigma, recording.depth_sigma[:, which] / depth**2])
    return Reading(list(known), list(known.values()), t, points, sigma, recording.exposure, recording.view)


def named_own(names: Sequence[str], own: np.ndarray) -> dict[str, float]:
    """Return a recording's own unknowns (L,) by name; those of a robot's lag without their signs, which have no
    meaning."""
    return {name: abs(float(x)) if name in LAG else float(x) for name, x in zip(names, own, strict=True)}
