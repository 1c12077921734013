"""What is understood of tracks before any fit: clock, markers, gaps, units, axes, labels and command."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.models.strike import refuse_far
from whiptool.recording.finding import ASSUMED, DOUBTFUL, MEASURED, STATED, Finding
from whiptool.recording.gravity import gravity_findings
from whiptool.recording.labels import check_labels
from whiptool.recording.log_findings import of_logged, rate_of
from whiptool.recording.logs import gaps, told_of_spans
from whiptool.recording.readers import READERS
from whiptool.recording.readers.sidecar import UNITS
from whiptool.recording.smoothing import smoothing_findings
from whiptool.recording.strike_recording import PARTS, StrikeRecording
from whiptool.words import counted

NOT_STATED = "the file does not"  # in a note of a reader on what it assumed
NEAR = 0.01  # [m] from a laboratory's origin, within which no base is measured that is not on it
IN_METRES = ("npz",)  # formats of whiptool, whose units and axes are fixed
TABLES = (*IN_METRES, "csv")  # whose places are taken as they are, unless a sidecar says otherwise


def of_tracks(recording: StrikeRecording, form: str, said: dict[str, Any]) -> Iterator[Finding]:
    """Yield what was understood of tracks."""
    notes = list(recording.notes)
    yield clock_of(recording.t, taken(notes, "times"), "start" in said)
    yield rate_of("rate", recording.t, "frames")
    yield _markers(recording)
    yield from _missing(recording)
    yield from _frame(recording, form, said, notes)
    yield from gravity_findings(recording, said.get("units", "m" if form in TABLES else None))
    yield from _labels(recording)
    sigma = recording.sigma[recording.seen]
    unit = "pixels" if recording.view is not None else "rad" if recording.angular else "m"
    measured = f"{np.median(sigma):.2g} {unit} a coordinate"
    guess = taken(notes, "errors:").removeprefix("errors: ")
    own = not guess and ("sigma" in said or bool(np.ptp(sigma) > 0))
    reason = guess or "standard error of a point in the median"
    yield Finding("errors", measured, STATED if own else ASSUMED, reason)
    yield from smoothing_findings(recording)
    if recording.camera:
        yield Finding("camera", recording.camera)
    if recording.exposure:
        yield Finding("exposure", f"{1e3 * recording.exposure:.3g} ms", numbers={"exposure": recording.exposure})
    yield from _command(recording)
    yield from _logged(recording, notes)
    for note in notes:
        yield Finding("note", note, ASSUMED)


def taken(notes: list[str], beginning: str) -> str:
    """Take the first note that begins with a word out of the list, and return it; empty without one."""
    found = next((note for note in notes if note.startswith(beginning)), "")
    if found:
        notes.remove(found)
    return found


def clock_of(t: np.ndarray, source: str, started: bool) -> Finding:
    zero = "0 is the command's start" if started else "0 is taken as the command's start (key start)"
    value = f"{counted(len(t), 'frame')} from {t[0]:.3f} to {t[-1]:.3f} s"
    reason = "; ".join(x for x in (source, zero) if x)
    return Finding(
        "clock", value, STATED if source else ASSUMED, reason, numbers={"frames": len(t), "start": t[0], "end": t[-1]}
    )


def _markers(recording: StrikeRecording) -> Finding:
    """Names of the markers, and in how many frames each was seen."""
    seen = dict(zip(recording.markers, recording.seen.sum(axis=0).tolist(), strict=True))
    count = len(recording.t)
    listed = ", ".join(f"{name} ({'all' if n == count else f'{n} of {count}'} frames)" for name, n in seen.items())
    other = [] if recording.angular else [x for x in seen if not PARTS.fullmatch(x)]
    named = "tip" in seen and ("handle" in seen or recording.hand_t is not None)
    reason = f"a fit does not predict {', '.join(other)}" * bool(other)
    fix = f"{reason}: name the tip tip, and the hand handle (key markers)" * (bool(other) and not named)
    if other and recording.joints_alone:
        fix = "these are the arm's joints, computed from its encoders: a fit needs what cameras saw of the whip, too"
    return Finding("markers", listed, STATED, "" if fix else reason, fix, {"seen": seen})


def _missing(recording: StrikeRecording) -> Iterator[Finding]:
    """Yield gaps between frames, and of each marker."""
    between = gaps("frames", recording.t)
    longest = {}
    for name, seen in zip(recording.markers, recording.seen.T, strict=True):
        there = np.flatnonzero(seen)
        if len(there) and not seen.all():
            steps = np.diff(recording.t[there], prepend=recording.t[0], append=recording.t[-1])
            longest[name] = float(steps.max())
    said = [*between, *(f"{name} is missing for up to {span:.3f} s" for name, span in longest.items())]
    yield Finding("gaps", "; ".join(said) or "none", MEASURED, numbers={"longest": longest})


def _frame(recording: StrikeRecording, form: str, said: dict[str, Any], notes: list[str]) -> Iterator[Finding]:
    """Yield units, axes and extent of the coordinates."""
    if recording.angular:
        yield Finding("units", f"{said.get('angle_units', 'rad')}, angles of links against the vertical")
        return
    if recording.view is not None:
        yield Finding("units", f"pixels of the camera {recording.view.name}", STATED, "file of cameras")
        return
    d = recording.points.shape[2]
    low, high = np.nanmin(recording.points, axis=(0, 1)), np.nanmax(recording.points, axis=(0, 1))
    extent = ", ".join(f"{x} from {a:.3f} to {b:.3f} m" for x, a, b in zip("xyz", low, high, strict=False))
    reason = taken(notes, "units:").removeprefix("units: ")
    if "units" in said and reason:
        fix = "one of the two is wrong: correct units in the sidecar, or leave it out"
        yield Finding("units", str(said["units"]), DOUBTFUL, reason, fix, {"units": said["units"]})
    elif "units" in said:
        yield Finding("units", str(said["units"]), STATED, "key units", numbers={"units": said["units"]})
    elif reason or form in (*IN_METRES, "c3d"):
        how = ASSUMED if NOT_STATED in reason else STATED
        yield Finding("units", "converted to m", how, reason or READERS[form].what)
    else:
        fix = 'say units = "mm" (m, cm, in) in the sidecar if they are not metres'
        yield Finding("units", "m", ASSUMED, "neither file nor sidecar says it", fix, {"units": "m"})
    taken_as = re.match(r"taken as (\w+)", reason)
    unit = "pixels" if "scale" in said else said.get("units", taken_as[1] if taken_as else "m")
    yield Finding("extent", extent, MEASURED, numbers={"low": low.tolist(), "high": high.tolist()})
    reason = taken(notes, "axes:").removeprefix("axes: ")
    up = recording.up or {2: "y", 3: "z"}[d]
    if "axes" in said:
        yield Finding("axes", f"the file's {', '.join(map(str, said['axes']))}", STATED, "key axes")
    elif recording.up or form in IN_METRES:
        how = ASSUMED if NOT_STATED in reason else STATED
        in_file, _, why = reason.partition(" is up, ")
        value = f"{up} is up" + f", in the file {in_file}" * bool(why and in_file != up)
        yield Finding("axes", value, how, why or reason, numbers={"up": up})
    else:
        rest = "x forward, y up" if d == 2 else "x forward, y to the left, z up (for a model in the plane y up)"
        yield Finding("axes", rest, ASSUMED, reason or "neither file nor sidecar says it", numbers={"up": up})
    if form not in IN_METRES:
        yield _origin(said, unit, "the shoulder" if d == 2 else "the arm's base")


def _origin(said: dict[str, Any], unit: str, what: str) -> Finding:
    """Where the shoulder or the arm's base, `what`, is in the file's axes and unit."""
    if "origin" not in said:
        return Finding("origin", f"{what} is at the file's origin", ASSUMED, fix="say origin in the sidecar otherwise")
    given = np.array(said["origin"], float)
    reason = f"key origin, in {unit}, in the file's axes"
    if unit not in UNITS:
        return Finding("origin", f"{what} is at {', '.join(f'{x:g}' for x in given)} {unit}", STATED, reason)
    metres = given * UNITS[unit]
    value = f"{what} is at {', '.join(f'{x:.4g}' for x in metres)} m"
    if unit == "m" or not 0 < np.abs(metres).max() < NEAR:
        return Finding("origin", value, STATED, reason, numbers={"origin": metres.tolist()})
    in_unit = ", ".join(f"{x:g}" for x in np.round(given / UNITS[unit], 6))
    fix = f"origin is in the file's unit, {unit}; if it was measured in m, say origin = [{in_unit}]"
    return Finding("origin", value, DOUBTFUL, reason, fix, {"origin": metres.tolist()})


def _labels(recording: StrikeRecording) -> Iterator[Finding]:
    """Yield faults of the markers' labels."""
    if recording.angular or len(recording.markers) < 2:
        return
    found = check_labels(recording)
    fix = "" if found.kept else "correct them at their source, or fit with --mend-labels"
    yield Finding("labels", str(found), MEASURED if found.kept else DOUBTFUL, "by the markers' paths", fix)


def _command(recording: StrikeRecording) -> Iterator[Finding]:
    """Yield what was commanded."""
    if (s := recording.strike) is not None:
        ends = "".join(f"; {name} {', '.join(f'{x:.3f}' for x in q)}" for name, q in (("from", s.q_i), ("to", s.q_f)))
        value = f"{counted(len(s.q_i), 'joint')} in {s.D:g} s{ends} rad"
        try:
            refuse_far(
                "strike", np.array([s.q_i, s.q_f]), [True] * len(s.q_i), [f"joint {k + 1}" for k in range(len(s.q_i))]
            )
            yield Finding("strike", value)
        except InputError as error:
            yield Finding("strike", value, DOUBTFUL, f"{error.given}; allowed: {error.allowed}", error.fix)
    else:
        fix = "say strike = {q_i, q_f, D} in the sidecar, or fit with --drive joints, hand, handle or passive"
        yield Finding("strike", "unknown", ASSUMED, "no file says what was commanded", fix)
    if recording.controller is not None:
        yield Finding("controller", str(recording.controller["law"]))
    if recording.target is not None:
        yield Finding("target", f"{', '.join(f'{x:.3f}' for x in recording.target)} m")


def _logged(recording: StrikeRecording, notes: list[str]) -> Iterator[Finding]:
    """Yield what was logged in addition to the frames."""
    yield from of_logged(vars(recording), notes)
    for sentence in told_of_spans(recording.t, recording.logs):
        if not sentence.startswith("frames"):
            yield Finding("gaps", sentence, MEASURED)
