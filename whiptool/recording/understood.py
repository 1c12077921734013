"""What is understood of a file before any fit: its format, clock, rate, markers, gaps, axes, units and logs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.given_files import read_toml
from whiptool.recording.finding import ASSUMED, DOUBTFUL, MEASURED, STATED, Finding
from whiptool.recording.gravity import gravity_findings
from whiptool.recording.labels import check_labels
from whiptool.recording.logs import HOLE, ClocksApart, gaps, told_of_spans
from whiptool.recording.readers import READERS, VideoSource, find_format, open_any, split_episode
from whiptool.recording.readers.joint_log import JointLog, Logs
from whiptool.recording.readers.log_keys import LOGS
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.words import counted

UNEVEN = 0.1  # of the usual step: frames or samples whose steps scatter by more are not at one rate
EXACT = 1e-8  # [s] below which stamps are those of an even clock
KNOWN = ("tip", "handle", "shoulder", "elbow")  # markers that a fit predicts, besides node1, node2, ...
NOT_STATED = "the file does not"  # in a note of a reader on what it assumed
_IN_METRES = ("npz",)  # formats of whiptool, whose units and axes are fixed
TABLES = (*_IN_METRES, "csv")  # whose places are taken as they are, unless a sidecar says otherwise


@dataclass(frozen=True, eq=False)
class Understood:
    """A file as it was understood.

    Args:
        path: The file as it was given; `FOLDER#3` is episode 3 of a dataset.
        format: Key of the file's format in `READERS`.
        found: Its tracks, images, or logs of a robot.
        findings: What was understood of it, in the order in which it is shown.
        said: What the sidecar says.
        logs: Logs of tracks, by the frames' clock as it was read, or where that clock is another one, by their own.
        starts: Times of the command's start by the clocks of `joints` and `hand` that were subtracted from them [s].
    """

    path: str
    format: str
    found: StrikeRecording | VideoSource | Logs
    findings: tuple[Finding, ...]
    said: Mapping[str, Any] = field(default_factory=dict)
    logs: Logs | None = None
    starts: Mapping[str, float] = field(default_factory=dict)

    @property
    def table(self) -> dict[str, Any]:
        """What was understood, as plain data."""
        kinds = {StrikeRecording: "tracks", VideoSource: "images", Logs: "logs"}
        return {
            "file": self.path,
            "format": self.format,
            "kind": kinds[type(self.found)],
            "findings": [finding.table for finding in self.findings],
        }


def understand(path: str, **options: Any) -> Understood:
    """Read a file and return what is understood of it.

    Args:
        path: A file or folder of any of `READERS`; `FOLDER#3` is episode 3 of a dataset.
        options: Options of the reader: keys of the sidecar file, whose values they override.

    Raises:
        InputError: The file cannot be read.
    """
    file, episode = split_episode(path)
    form = find_format(file)
    said = {} if form in _IN_METRES else _said(Path(file), episode.get("episode", 0)) | options
    findings = [Finding("format", READERS[form].what, STATED, "by its name and first bytes", numbers={"format": form})]
    apart: Logs | None = None
    try:
        found = open_any(path, **options)
    except ClocksApart as error:
        found = open_any(path, **{**options, "joints": False, "hand": False})  # whose clocks are to be found
        apart = _logs_in(error.logs)
        reason = f"{error.name.rpartition(' ')[2]} {error.given}, and the frames do not overlap"
        findings.append(Finding("clocks", "the logs have another clock than the frames", DOUBTFUL, reason))
    if isinstance(found, StrikeRecording):
        findings += _of_tracks(found, form, said)
    elif isinstance(found, VideoSource):
        findings += _of_images(found)
    else:
        findings += _of_logs(found)
    logs, starts = apart, {}
    if apart is None and isinstance(found, StrikeRecording):
        logs, starts = _logs_in(vars(found)), {what: said.get(f"{what}_start", found.start) for what in LOGS}
    return Understood(path, form, found, tuple(findings), said, logs, starts)


def _logs_in(fields: Mapping[str, Any]) -> Logs | None:
    """The logs in the arguments of a recording; None without any. Of its notes those on a log are that log's."""
    joints = hand = None
    notes = {what: tuple(x for x in fields.get("notes", ()) if x.startswith(f"{what}:")) for what in LOGS}
    if fields.get("joints_t") is not None:
        names, listed = fields.get("joint_names", ()), fields.get("joints_listed", False)
        of_joints = {"names": names, "unit": "rad", "listed": listed, "notes": notes["joints"]}
        joints = JointLog(fields["joints_t"], fields["joints_q"], **of_joints)
    if fields.get("hand_t") is not None:
        hand = JointLog(fields["hand_t"], fields["hand_pose"], notes=notes["hand"])
    return None if joints is None and hand is None else Logs(joints, hand)


def _of_logged(fields: Mapping[str, Any], notes: list[str]) -> Iterator[Finding]:
    """Yield what was understood of the logs in the arguments of a recording; what is said of them is no note then."""
    logs = _logs_in(fields) or Logs()
    if logs.joints is not None:
        yield from _joints(logs.joints)
    if logs.hand is not None:
        yield from _hand(logs.hand)
    notes[:] = [note for note in notes if not note.startswith(tuple(f"{what}:" for what in LOGS))]


def _said(path: Path, episode: int) -> dict[str, Any]:
    """What the sidecar of a file says, of a dataset that of an episode."""
    file = path / "whiptool.toml" if path.is_dir() else path.with_suffix(".toml")
    table = read_toml(file) if file.is_file() else {}
    of_episodes = table.pop("episode", {})
    return table | (of_episodes.get(str(episode), {}) if isinstance(of_episodes, dict) else {})


def _of_tracks(recording: StrikeRecording, form: str, said: dict[str, Any]) -> Iterator[Finding]:
    """Yield what was understood of tracks."""
    notes = list(recording.notes)
    yield _clock(recording.t, _taken(notes, "times"), "start" in said)
    yield rate_of("rate", recording.t, "frames")
    yield _markers(recording)
    yield from _missing(recording)
    yield from _frame(recording, form, said, notes)
    yield from gravity_findings(recording, said.get("units", "m" if form in TABLES else None))
    yield from _labels(recording)
    sigma = recording.sigma[recording.seen]
    unit = "pixels" if recording.view is not None else "rad" if recording.angular else "m"
    measured = f"{np.median(sigma):.2g} {unit} a coordinate"
    own = "sigma" in said or bool(np.ptp(sigma) > 0)
    yield Finding("errors", measured, STATED if own else ASSUMED, "standard error of a point in the median")
    if recording.camera:
        yield Finding("camera", recording.camera)
    if recording.exposure:
        yield Finding("exposure", f"{1e3 * recording.exposure:.3g} ms", numbers={"exposure": recording.exposure})
    yield from _command(recording)
    yield from _logged(recording, notes)
    for note in notes:
        yield Finding("note", note, ASSUMED)


def _taken(notes: list[str], beginning: str) -> str:
    """Take the first note that begins with a word out of the list, and return it; empty without one."""
    found = next((note for note in notes if note.startswith(beginning)), "")
    if found:
        notes.remove(found)
    return found


def _clock(t: np.ndarray, source: str, started: bool) -> Finding:
    zero = "0 is the command's start" if started else "0 is taken as the command's start (key start)"
    value = f"{counted(len(t), 'frame')} from {t[0]:.3f} to {t[-1]:.3f} s"
    reason = "; ".join(x for x in (source, zero) if x)
    return Finding(
        "clock", value, STATED if source else ASSUMED, reason, numbers={"frames": len(t), "start": t[0], "end": t[-1]}
    )


def rate_of(topic: str, t: np.ndarray, what: str) -> Finding:
    """Return the rate of times t (T,) [s]: the inverse of the median step, and how even the steps are.

    Args:
        topic: Topic of the finding.
        t: Times [s], (T,), T > 1.
        what: What has these times, such as `frames`.
    """
    step = np.diff(t)
    usual = float(np.median(step))
    number = np.concatenate([[0.0], np.cumsum(np.maximum(np.round(step / usual), 1.0))])
    line = np.polyfit(number, t, 1) if len(t) > 2 else np.array([usual, t[0]])
    jitter = float(np.std(t - np.polyval(line, number)))
    even = jitter < UNEVEN * usual
    rate = 1 / float(line[0]) if even else 1 / usual
    value = f"{rate:.5g} {what} a second"
    if even:
        value += f", stamps within {1e3 * jitter:.2g} ms of an even clock" if jitter > EXACT else ", evenly stamped"
    else:
        value += f" in the median, uneven: steps from {1e3 * step.min():.3g} to {1e3 * step.max():.3g} ms"
    numbers = {"rate": rate, "jitter": jitter, "even": even}
    return Finding(topic, value, MEASURED, "from the steps between time stamps", numbers=numbers)


def _markers(recording: StrikeRecording) -> Finding:
    """Names of the markers, and in how many frames each was seen."""
    seen = dict(zip(recording.markers, recording.seen.sum(axis=0).tolist(), strict=True))
    count = len(recording.t)
    listed = ", ".join(f"{name} ({'all' if n == count else f'{n} of {count}'} frames)" for name, n in seen.items())
    other = [] if recording.angular else [x for x in seen if x not in KNOWN and not x.removeprefix("node").isdigit()]
    fix = f"a fit does not predict {', '.join(other)}: name the tip tip, and the hand handle (key markers)"
    if recording.joints_alone:
        fix = "these are the arm's joints, computed from its encoders: a fit needs what cameras saw of the whip, too"
    return Finding("markers", listed, STATED, fix=fix * bool(other), numbers={"seen": seen})


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
    reason = _taken(notes, "units:").removeprefix("units: ")
    if "units" in said:
        yield Finding("units", str(said["units"]), STATED, "key units", numbers={"units": said["units"]})
    elif reason or form in (*_IN_METRES, "c3d"):
        how = ASSUMED if NOT_STATED in reason else STATED
        yield Finding("units", "converted to m", how, reason or READERS[form].what)
    else:
        fix = 'say units = "mm" (m, cm, in) in the sidecar if they are not metres'
        yield Finding("units", "m", ASSUMED, "neither file nor sidecar says it", fix, {"units": "m"})
    yield Finding("extent", extent, MEASURED, numbers={"low": low.tolist(), "high": high.tolist()})
    reason = _taken(notes, "axes:").removeprefix("axes: ")
    up = recording.up or {2: "y", 3: "z"}[d]
    if "axes" in said:
        yield Finding("axes", f"the file's {', '.join(map(str, said['axes']))}", STATED, "key axes")
    elif recording.up or form in _IN_METRES:
        how = ASSUMED if NOT_STATED in reason else STATED
        yield Finding("axes", f"{up} is up", how, reason, numbers={"up": up})
    else:
        rest = "x forward, y up" if d == 2 else "x forward, y to the left, z up (for a model in the plane y up)"
        yield Finding("axes", rest, ASSUMED, reason or "neither file nor sidecar says it", numbers={"up": up})
    if "origin" not in said and form not in _IN_METRES:
        where = "the shoulder" if d == 2 else "the arm's base"
        yield Finding("origin", f"{where} is at the file's origin", ASSUMED, fix="say origin in the sidecar otherwise")


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
        yield Finding("strike", f"{counted(len(s.q_i), 'joint')} in {s.D:g} s{ends} rad")
    else:
        fix = "say strike = {q_i, q_f, D} in the sidecar, or fit with --drive joints, hand, handle or passive"
        yield Finding("strike", "unknown", ASSUMED, "no file says what was commanded", fix)
    if recording.controller is not None:
        yield Finding("controller", str(recording.controller["law"]))
    if recording.target is not None:
        yield Finding("target", f"{', '.join(f'{x:.3f}' for x in recording.target)} m")


def _logged(recording: StrikeRecording, notes: list[str]) -> Iterator[Finding]:
    """Yield what was logged in addition to the frames."""
    yield from _of_logged(vars(recording), notes)
    for sentence in told_of_spans(recording.t, recording.logs):
        if not sentence.startswith("frames"):
            yield Finding("gaps", sentence, MEASURED)


def _joints(log: JointLog) -> Iterator[Finding]:
    """Yield what was understood of a log of joints."""
    names = log.names or tuple(f"joint {i + 1}" for i in range(log.q.shape[1]))
    ranges = ", ".join(f"{x} {a:.3f} to {b:.3f}" for x, a, b in zip(names, log.q.min(axis=0), log.q.max(axis=0)))
    unit = log.unit or "(taken as rad)"
    reasons = [note.removeprefix("joints: ") for note in log.notes]
    order = "" if log.names else "; without names, taken in the arm's order"
    guessed = order or not log.unit or any("taken" in x for x in reasons)
    numbers = {"names": list(log.names), "from": log.t[0], "to": log.t[-1]}
    yield Finding(
        "joints", f"{ranges} {unit}{order}", ASSUMED if guessed else STATED, "; ".join(reasons), numbers=numbers
    )
    yield rate_of("joint rate", log.t, "samples of the joints")
    yield from (Finding("gaps", x, MEASURED) for x in gaps("joints", log.t, least=HOLE, steps=3.0))


def _hand(log: JointLog) -> Iterator[Finding]:
    """Yield what was understood of a log of the hand's poses."""
    low, high = log.q[:, :3].min(axis=0), log.q[:, :3].max(axis=0)
    extent = ", ".join(f"{x} from {a:.3f} to {b:.3f} m" for x, a, b in zip("xyz", low, high, strict=True))
    reasons = "; ".join(note.removeprefix("hand: ") for note in log.notes)
    yield Finding("hand", extent, STATED, reasons, numbers={"from": log.t[0], "to": log.t[-1]})
    yield rate_of("hand rate", log.t, "poses of the hand")


def _of_logs(logs: Logs) -> Iterator[Finding]:
    """Yield what was understood of a file of logs."""
    if logs.joints is not None:
        yield from _joints(logs.joints)
    if logs.hand is not None:
        yield from _hand(logs.hand)
    if logs.aside:
        yield Finding("note", f"left aside: {', '.join(logs.aside)}")
    fix = 'name the file in the sidecar of the tracks: joints = "FILE" or hand = "FILE"'
    yield Finding("tracks", "none", STATED, "a log of the robot alone", fix)


def _of_images(film: VideoSource) -> Iterator[Finding]:
    """Yield what was understood of images."""
    notes = list(film.about.get("notes", ()))
    yield _clock(film.times, _taken(notes, "times"), started=True)
    yield rate_of("rate", film.times, "images")
    yield Finding("gaps", "; ".join(gaps("images", film.times)) or "none", MEASURED)
    height, width = film.shape
    yield Finding("images", f"{width} x {height} pixels", MEASURED, numbers={"width": width, "height": height})
    if film.view is not None:
        yield Finding("units", f"pixels of the camera {film.view.name} in space", STATED, "file of cameras")
    elif film.homography is not None:
        yield Finding("units", "metres in the strike plane, from pixels", STATED, "the sidecar's calibration")
    else:
        fix = "calibrate it: homography, known_points, or scale and origin; or camera and cameras"
        yield Finding("units", "unknown: pixels", DOUBTFUL, "no way to metres is stated", fix)
    shutter = f"rolling, {1e3 * film.readout:.3g} ms from the first row to the last" if film.readout else "global"
    yield Finding("shutter", shutter, STATED if film.readout else ASSUMED, numbers={"readout": film.readout})
    yield Finding("exposure", f"{1e3 * film.exposure:.3g} ms", STATED if film.exposure else ASSUMED)
    yield Finding("markers", "not tracked yet", STATED, "identify tracks the tip")
    yield from _of_logged(film.about, notes)
    for note in notes:
        yield Finding("note", note, ASSUMED)
