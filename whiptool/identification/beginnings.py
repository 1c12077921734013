"""Checks for gross errors of a recording before a fit: units, axes, joints, start time.

The whip hangs from a hand at a known position, so that its first readings are near the model's prediction. If the
readings are far from it, common mistakes are tried, and the mistake that explains the readings several times better is
named.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterator

import numpy as np

from whiptool.errors import InputError
from whiptool.identification.motion import LATEST
from whiptool.identification.plant import Plant
from whiptool.identification.predict import Predictor
from whiptool.identification.readings import PLACED
from whiptool.models.mount import MOUNTS, SURFACES, mounted
from whiptool.models.parameters import AnyArm, Model
from whiptool.recording.readers.sidecar import UNITS
from whiptool.recording.strike_recording import AT_REST, StrikeRecording

GROSS = 0.3  # of the whip's length: farther off than whips are unlike
EXPLAINED = 0.33  # of the distance, at most, that is left where a slip is found
CLEAR = 0.1  # of it that is left where nothing else need be tried
_ALIKE = 0.5  # of the whip's length: what whips may be unlike
_BEGINNING = 0.05  # [s] of first readings
_LONGEST, _EVERY = (
    2.0,
    0.01,
)  # [s] by which a recording may start too late or too early, and steps in which that is tried
_SHORTEST = 0.1  # [s] of those: what is less is found by a fit
_TURNED = 0.3  # [rad] of a joint from where the strike begins
_ROUGH = 0.05  # [s] between knots of a motion that is only tried
_BETTER = 0.25  # of the distance that other slips leave, at most, where a shift, which explains much, is named
_SIDEWAYS = 0.1  # of the whip's length, by which a shift is not only up or down
_LEVEL = 0.5  # of a surface's vector, between that of a wall and of a ceiling
_WRAP = 0.5  # [rad] within which a jump is one of a whole turn
_NEAR = 3.0  # factor between units, within which a whip of another length is as likely where no arm gives the size
_UNITS = {  # factor that mends it
    UNITS[is_] / UNITS[read]: f"they were {is_}, read as {read}" for is_, read in itertools.permutations(UNITS, 2)
}


def check_joints(recording: StrikeRecording, arm: AnyArm) -> None:
    """Refuse a joint log in which an angle jumps by a full turn, or which does not begin at the strike's start posture;
    the error names the common mistake (units, sign, order, start time) that explains it, if any."""
    t, q, name = recording.joints_t, recording.joints_q, f"{recording.called}: joints"
    if t is None or q is None or q.shape[1] != arm.n:
        return
    turning = arm.turns
    steps = np.diff(q, axis=0) * turning
    turns = np.round(steps / (2 * math.pi))
    for row, joint in np.argwhere((turns != 0) & (np.abs(steps - 2 * math.pi * turns) < _WRAP)):
        rule, fix = "angles without jumps of a turn", "the angles were wrapped: unwrap them (numpy.unwrap)"
        given = f"{arm.joints[joint]} jumps by {steps[row, joint]:+.2f} rad at {t[row + 1]:.3f} s"
        raise InputError(name, given, rule, fix)
    if recording.strike is None or len(recording.strike.q_i) != arm.n or not t[0] <= AT_REST:
        return
    q_i, begun = recording.strike.q_i, np.median(q[np.abs(t - max(t[0], 0.0)) <= AT_REST], axis=0)
    off = np.abs(begun - q_i)
    if off.max() <= _TURNED:
        return
    joint = int(off.argmax())
    given = f"{arm.joints[joint]} at {begun[joint]:+.3f} when the strike begins"
    fix = (
        _joints_slip(q, begun, np.array(q_i))
        or "is it the log of another strike, or does the strike begin at another time?"
    )
    raise InputError(name, given, f"the strike's start, {q_i[joint]:+.3f}", fix)


def _joints_slip(q: np.ndarray, begun: np.ndarray, q_i: np.ndarray) -> str:
    """Why joints (a,) are not where a strike starts, (a,), in words; empty: no slip explains it."""

    def fits(x: np.ndarray) -> bool:
        return bool(np.abs(x - q_i).max() <= _TURNED / 3)

    if fits(np.radians(begun)):
        return "they are degrees, read as radians: give them in radians, or say their unit"
    if fits(begun - 2 * math.pi * np.round((begun - q_i) / (2 * math.pi))):
        return "an angle is off by whole turns: take them off"
    if fits(-begun):
        return "all angles have the other sign"
    for i, j in itertools.combinations(range(len(q_i)), 2):
        swapped = begun.copy()
        swapped[[i, j]] = begun[[j, i]]
        if fits(swapped):
            return f"columns {i + 1} and {j + 1} are exchanged: name them, or say joint_columns"
    if np.abs(np.sort(begun) - np.sort(q_i)).max() <= _TURNED / 3:
        return "the columns are in another order: name them, or say joint_columns"
    later = np.flatnonzero(np.abs(q - q_i).max(axis=1) <= _TURNED / 3)
    return "the arm stands there at another time of the log: say joints_start" if len(later) else ""


def check_beginnings(predictor: Predictor, plant: Plant) -> list[str]:
    """Refuse recordings with a common mistake in units, axes, joints or start time, by predictions with the plant's
    values, at which the fit starts, and return remarks on other unusual first readings."""
    if predictor.kind in ("passive", "free"):
        return []
    for recording in predictor.recordings:
        if predictor.kind in ("joints", "command"):
            check_joints(recording, plant.model.arm)
    if {*predictor.shared, *predictor.own} & {*PLACED[plant.model.dimension]}:
        return []  # where the recording lies is sought
    values, said = predictor(plant, {}, predictor.start, derivatives=False), []
    for i, (recording, found) in enumerate(zip(predictor.recordings, values, strict=True)):
        if recording.view is None:
            said += _Beginning(predictor, plant, i, recording, found.value).judged()
    return said


class _Beginning:
    """One recording's readings and those that are predicted."""

    def __init__(self, predictor: Predictor, plant: Plant, i: int, recording: StrikeRecording, foreseen: np.ndarray):
        d = plant.model.dimension
        self._predictor, self._plant, self._i, self._recording = predictor, plant, i, recording
        channels = predictor.channels[i][::d]
        self._frame, self._marker = channels[:, 0], channels[:, 1]
        self._measured, self._foreseen = predictor.measured[i].reshape(-1, d), foreseen.reshape(-1, d)
        self._t = recording.t[self._frame]
        self._limit = GROSS * plant.model.whip.length
        frames = np.unique(self._frame)
        self._early = self._t <= max(self._t.min() + _BEGINNING, recording.t[frames[min(2, len(frames) - 1)]])
        self._half = self._frame <= frames[(len(frames) - 1) // 2]

    def judged(self) -> list[str]:
        """What is odd, in words; an `InputError` if a slip explains it."""
        early, half, whole = (_off(self._measured, self._foreseen, x) for x in (self._early, self._half, slice(None)))
        if max(early, half, whole) <= self._limit:
            return []
        name, given = self._recording.called, f"{max(early, half):.3g} m from where the model is"
        slips = list(self._other_mounts(half))
        if not any(slip.left <= CLEAR for slip in slips):
            slips += [*self._placed(half), *self._other_joints(half), *self._late(whole)]
        best = min(slip.left for slip in slips)
        shift, sure = self._shifted(half)
        shifted = shift.left <= min(CLEAR, _BETTER * best)
        if shifted:
            slips, best = [shift] * sure, shift.left
        for slip in slips:  # simple ones first
            if slip.left <= min(EXPLAINED, 2 * best) and slip.distance <= _ALIKE * self._plant.model.whip.length:
                fix = f"it is as if {slip.words} (that leaves {slip.distance:.2g} m)"
                raise InputError(f"{name}: {slip.what}", given, "readings of the model's whip, on its arm", fix)
        if early <= self._limit:
            return []
        return [
            f"{name}: its first readings are {early:.2f} m from where the model's whip hangs: check the whip's length, "
            "where the base stands, axes, units, and when the strike began" + f"; it is as if {shift.words}" * shifted
        ]

    def _placed(self, before: float) -> Iterator[_Slip]:
        """Wrong units and axes, and a frame that is turned."""
        x, half = self._measured, self._half
        d = x.shape[1]
        least = _NEAR if self._predictor.kind in ("hand", "handle") else 1.0
        scales = [scale for scale in _UNITS if max(scale, 1 / scale) > least]
        left = [_off(scale * x, self._foreseen, half) for scale in scales]
        yield _Slip.of("points", _UNITS[scales[int(np.argmin(left))]], min(left), before)
        turns = [
            (order, signs)
            for order in itertools.permutations(range(d))
            for signs in itertools.product((1, -1), repeat=d)
            if order != tuple(range(d)) or -1 in signs
        ]
        left = [_off(x[:, order] * signs, self._foreseen, half) for order, signs in turns]
        order, signs = turns[int(np.argmin(left))]
        order_of_axes = ", ".join(f"{'-' if s < 0 else ''}{'xyz'[j]}" for s, j in zip(signs, order, strict=True))
        yield _Slip.of("points", f"its axes should be ({order_of_axes}) of those that it has", min(left), before)
        with_values = half & np.isfinite(self._foreseen).all(axis=1)
        U, _, V = np.linalg.svd(self._foreseen[with_values].T @ x[with_values])
        R = U @ np.diag([1.0] * (d - 1) + [np.sign(np.linalg.det(U @ V))]) @ V  # Kabsch
        angle = math.degrees(math.acos(np.clip((np.trace(R) - (d - 2)) / 2, -1, 1)))
        words = f"its frame were turned by {angle:.0f} degrees about the base: turn it back"
        yield _Slip.of("points", words, _off(x @ R.T, self._foreseen, half), before)

    def _shifted(self, before: float) -> tuple[_Slip, bool]:
        """A base that is elsewhere than at the origin, and whether it is no whip of another length, which hangs lower
        or higher.
        """
        x, apart = self._measured, (self._measured - self._foreseen)[self._half]
        if self._predictor.kind in ("hand", "handle") or not (known := np.isfinite(apart).all(axis=1)).any():
            return _Slip.of("points", "", math.inf, before), False
        shift = np.median(apart[known], axis=0) + 0.0
        by = ", ".join(f"{value:.2f}" for value in shift)
        words = f"all of it were shifted by ({by}) m: say origin, in the axes and in the unit of the file"
        sure = np.linalg.norm(shift[:-1]) > _SIDEWAYS * self._plant.model.whip.length
        return _Slip.of("points", words, _off(x - shift, self._foreseen, self._half), before), bool(sure)

    def _other_joints(self, before: float) -> Iterator[_Slip]:
        """A log that drives the whip, with exchanged columns."""
        q, P = self._recording.joints_q, self._predictor
        if P.kind != "joints" or q is None:
            return
        tried = []
        for i, j in itertools.combinations(range(q.shape[1]), 2):
            order = list(range(q.shape[1]))
            order[i], order[j] = j, i
            tried.append((f"columns {i + 1} and {j + 1} of its joints were exchanged", q[:, order]))
        if not tried:
            return
        variants = [dataclasses.replace(self._recording, joints_q=x) for _, x in tried]
        again = Predictor(variants, self._plant, drive=P.kind, shared=(), timestep=P.h, knots=_ROUGH)
        found = again(self._plant, {}, again.start, derivatives=False)
        for (words, _), prediction in zip(tried, found, strict=True):
            left = _off(self._measured, prediction.value.reshape(self._measured.shape), self._half)
            yield _Slip.of("joints", words, left, before)

    def _other_mounts(self, before: float) -> Iterator[_Slip]:
        """A base that is mounted otherwise; whatever drives the whip, it hangs from the arm."""
        model, P = self._plant.model, self._predictor
        if not isinstance(model, Model) or model.dimension == 2 or P.kind not in ("joints", "robot"):
            return
        arm = model.arm.in_space()
        turns: dict[str, str | tuple[float, float, float]] = {name: name for name in SURFACES}
        if arm.surface is not None:  # back to the floor
            turns = {"floor": (0.0, -math.pi / 2, 0.0) if arm.surface[2] > -_LEVEL else MOUNTS["ceiling"]}
        for name, turn in turns.items():
            plant = dataclasses.replace(self._plant, model=dataclasses.replace(model, arm=mounted(arm, turn)))
            again = Predictor([self._recording], plant, drive=P.kind, shared=(), timestep=P.h, knots=_ROUGH)
            (found,) = again(plant, {}, again.start, derivatives=False)
            left = _off(self._measured, found.value.reshape(self._measured.shape), self._half)
            yield _Slip.of("points", f"the arm's base were on the {name}: give --mount {name}", left, before)

    def _late(self, before: float) -> Iterator[_Slip]:
        """A strike that began at another time than the recording's 0."""
        P, i = self._predictor, self._i
        t, paths = P.path(i, self._plant, {}, P.start[i])
        by_marker = np.stack([paths[name] for name in P.names(i)])  # (M, S, d)
        tried = np.arange(-_LONGEST, _LONGEST, _EVERY)
        tried = tried[(tried <= -_SHORTEST) | (tried >= (LATEST if P.kind == "robot" else _SHORTEST))]
        at = [np.clip(np.searchsorted(t, self._t - late), 0, len(t) - 1) for late in tried]
        left = [_off(self._measured, by_marker[self._marker, x], slice(None)) for x in at]
        late, side = tried[int(np.argmin(left))], "after" if tried[int(np.argmin(left))] > 0 else "before"
        yield _Slip.of("t", f"its strike began {abs(late):.2f} s {side} its time 0: say start", min(left), before)


@dataclasses.dataclass(frozen=True)
class _Slip:
    """What may be wrong with a recording: of what, in words, and the distance that it leaves, [m] and relative."""

    what: str
    words: str
    distance: float
    left: float

    @classmethod
    def of(cls, what: str, words: str, distance: float, before: float) -> _Slip:
        return cls(what, words, distance, distance / max(before, 1e-9) if np.isfinite(distance) else math.inf)


def _off(measured: np.ndarray, foreseen: np.ndarray, which: np.ndarray | slice) -> float:
    """Median distance of places (K, d) from the predicted ones [m]; infinite where the model cannot be computed."""
    distance = np.linalg.norm(measured - foreseen, axis=1)[which]
    return float(np.median(np.where(np.isfinite(distance), distance, np.inf)))
