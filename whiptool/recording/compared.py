"""Clocks and frames of records of one motion, compared: tracks with logs of a robot, and with other tracks."""

from __future__ import annotations

import dataclasses
import math
import pathlib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from whiptool.errors import InputError
from whiptool.models.kinematics import arm_poses
from whiptool.models.parameters import AnyArm
from whiptool.recording.alignment import LEVER_PRIOR, RATE_PRIOR, WINDOW, Alignment, Path, align, speeds
from whiptool.recording.finding import ASSUMED, DOUBTFUL, MEASURED, Finding
from whiptool.recording.logs import order_of
from whiptool.recording.readers import split_episode
from whiptool.recording.readers.joint_log import JointLog, Logs
from whiptool.recording.readers.log_keys import LOGS
from whiptool.recording.readers.sidecar import UNITS
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.recording.track_findings import TABLES
from whiptool.recording.understood import Understood

SURE = 3.0  # standard errors from which a difference is one
CLOCK_OFF = 1e-3  # [s] of an offset that matters
TURNED = math.radians(1.0)  # of axes that are not where they were assumed
SHIFTED = 5e-3  # [m] of an origin, likewise
NEAR = math.radians(20.0)  # within which axes are exchanged, and not turned
CLEARER = 0.5  # of the distance that is left, from which another reading of the joints explains it better
MOVING = 0.1  # of the hand's largest speed, from which tip and hand have begun to move
WHIP_LAG = 0.08  # [s] after the hand at which the tip of a whip begins to move, in the median of simulated strikes
LAG_ERROR = 0.3  # [s] by which that lag may be wrong, in 99 % of these


def compared(files: Sequence[Understood], arm: AnyArm | None = None) -> list[Understood]:
    """Return the files of one strike or swing with findings on how their clocks and frames lie to each other.

    Tracks are compared with the logs of their sidecar, with every file of logs, and with the first tracks of the same
    marker. Logs of joints are compared only if the arm whose joints they are is given.
    """
    found = []
    tracks = [one for one in files if isinstance(one.found, StrikeRecording)]
    alone = [one for one in files if isinstance(one.found, Logs)]
    for one in files:
        more: list[Finding] = []
        if isinstance(one.found, StrikeRecording) and not one.found.angular and one.found.view is None:
            own = [] if one.logs is None else [(one, one.logs, one.starts)]
            for other, logs, starts in [*own, *((x, x.found, {}) for x in alone if isinstance(x.found, Logs))]:
                if not _named(one, other.path):
                    more += _with_logs(one, "" if other is one else other.path, logs, starts, arm)
            if tracks and one is not tracks[0]:
                more += _with_tracks(one, tracks[0])
        found.append(dataclasses.replace(one, findings=(*one.findings, *more)))
    return found


def _named(one: Understood, file: str) -> bool:
    """Whether the sidecar of tracks names a file, with which they are compared anyway."""
    place = pathlib.Path(split_episode(one.path)[0])
    folder = place if place.is_dir() else place.parent
    named = [one.said[key] for key in LOGS if key in one.said]
    return any(folder / str(name) == pathlib.Path(file) for name in named)


def marker_path(recording: StrikeRecording, name: str) -> Path:
    """Return the path of a marker where it was seen."""
    seen = recording.seen[:, recording.markers.index(name)]
    m = recording.markers.index(name)
    t, places = recording.t_points[seen, m], recording.points[seen, m]
    order = np.argsort(t)
    return Path(t[order], places[order])


def hand_path(log: JointLog) -> Path:
    """Return the path of the hand from its poses."""
    return Path(log.t, log.q[:, :3], Rotation.from_quat(log.q[:, 3:]).as_matrix())


def joint_path(log: JointLog, arm: AnyArm, *, vertical: bool = False) -> Path:
    """Return the path of the hand from the arm's joints, in the base's axes; with `vertical` from their angles against
    the vertical."""
    if not log.names and log.q.shape[1] != arm.n:
        raise InputError("joints", f"{log.q.shape[1]} columns", f"{arm.n}, as the arm has joints")
    order = order_of(log.names, arm.joints, listed=log.listed) if log.names else list(range(arm.n))
    q = np.deg2rad(log.q) if log.unit == "deg" else log.q
    q = np.diff(q[:, order], axis=1, prepend=0.0) if vertical else q[:, order]
    origins, rotations = arm_poses(arm.in_space(), q)
    return Path(log.t, origins[:, -1], rotations[:, -1])


def _with_logs(
    one: Understood, file: str, logs: Logs, starts: Mapping[str, float], arm: AnyArm | None
) -> Iterator[Finding]:
    """Yield how a recording's clock and frame lie to those of logs, which are its own or in another file."""
    assert isinstance(one.found, StrikeRecording)
    if logs.joints is not None and arm is None:
        fix = "give --model, the arm whose joints they are, to compare clock and frame with the tracks"
        yield Finding("offset", f"joints of {file or one.path}: not compared", ASSUMED, fix=fix)
    paths: dict[str, Path] = {}
    if logs.hand is not None:
        paths["hand"] = hand_path(logs.hand)
    if logs.joints is not None and arm is not None:
        try:
            paths["joints"] = joint_path(logs.joints, arm)
        except InputError as error:
            yield Finding("offset", f"joints of {file or one.path}: not compared", DOUBTFUL, str(error))
    for what, path in paths.items():
        called = f"{what} of {file}" if file else what
        key = f"{what}_start"
        start = starts.get(what, 0.0)
        if "handle" not in one.found.markers:
            yield from _by_beginning(one.found, path, called, key, start)
            continue
        handle = marker_path(one.found.upright("z"), "handle")
        found = align(handle, path)
        if what == "joints" and arm is not None and (apart := _against_vertical(handle, found, logs.joints, arm)):
            fix = "write each angle less that of the joint before it into the log, and compare again"
            yield Finding("joints", f"{called}: each is logged against the vertical", DOUBTFUL, apart, fix)
            continue
        if found is None:
            reason = "the speeds of the marker handle and of the hand do not agree at any offset"
            fix = "are these records of one motion, and is handle the hand?"
            yield Finding("offset", f"{called}: no common motion", DOUBTFUL, reason, fix)
            continue
        yield from _clock(found, called, key, start)
        yield from _frame(found, called, one, np.array(path.places))


def _against_vertical(handle: Path, found: Alignment | None, log: JointLog | None, arm: AnyArm) -> str:
    """Return why the joints of an arm in the plane are logged against the vertical, as far as the hand's path tells;
    empty if they are not."""
    if log is None or arm.dimension != 2 or arm.n < 2:
        return ""
    other = align(handle, joint_path(log, arm, vertical=True))
    if other is None or (found is not None and other.rms > CLEARER * found.rms):
        return ""
    apart = "do not agree at any offset" if found is None else f"{1e3 * found.rms:.2g} mm apart as they are"
    return f"with differences the paths of handle and hand are {1e3 * other.rms:.2g} mm apart; {apart}"


def _clock(found: Alignment, called: str, key: str, start: float) -> Iterator[Finding]:
    """Yield offset and rate of a log's clock."""
    reason = f"by the paths of the marker handle and of the hand, {1e3 * found.rms:.2g} mm apart, over "
    reason += f"{found.span[1] - found.span[0]:.2f} s; correlation of their speeds {found.correlation:.3f}"
    yield _offset(found.offset, found.errors["offset"], called, reason, f"say {key} = ", start)
    error = found.errors["rate"]
    value = f"1 s of the {called} is {found.rate:.5f} +- {error:.1g} s of the frames"
    if error > 0.5 * RATE_PRIOR:
        yield Finding("clock rate", f"{value}: too short to tell", ASSUMED, f"prior 1 +- {RATE_PRIOR:g}")
        return
    wrong = abs(found.rate - 1) > SURE * error
    fix = "mend the rate of the frames (59.94 for 60?), or fit with --per-recording clock_rate" if wrong else ""
    numbers = {"rate": found.rate, "error": error}
    certainty = DOUBTFUL if wrong else MEASURED
    yield Finding("clock rate", value, certainty, f"prior 1 +- {RATE_PRIOR:g}", fix, numbers)


def _offset(offset: float, error: float, called: str, reason: str, fix: str, start: float) -> Finding:
    """An offset of two clocks; `fix` goes on with the time of the log at the command's start."""
    wrong = abs(offset) > max(SURE * error, CLOCK_OFF)
    value = f"{called}: {offset:.4f} +- {error:.1g} s have to be added to its time for that of the frames"
    advice = f"{fix}{start - offset:.6f} in the sidecar" if wrong else ""
    numbers = {"offset": offset, "error": error, "start": start - offset}
    return Finding("offset", value, DOUBTFUL if wrong else MEASURED, reason, advice, numbers)


def _frame(found: Alignment, called: str, one: Understood, places: np.ndarray) -> Iterator[Finding]:
    """Yield scale, axes and origin of the tracks in the frame of the hand."""
    scale, error = found.scale, found.errors["scale"]
    unit = min(UNITS, key=lambda name: abs(math.log(scale * UNITS[name])))
    right = unit == "m"  # the places are in metres now, from whichever unit was taken
    off = abs(scale * UNITS[unit] - 1)
    value = f"places of the tracks are {scale:.4g} +- {error:.1g} times those of the {called}"
    plain = one.format in TABLES and "units" not in one.said
    fix = f'say units = "{unit}" in the sidecar' if plain else "another unit was taken than the file has: change units"
    fix = "" if right else fix
    certain = MEASURED if right and off < max(0.02, SURE * error) else DOUBTFUL
    yield Finding("scale", value, certain, "", fix, {"scale": scale, "error": error, "units": unit})
    line = np.linalg.svd(places - places.mean(axis=0), compute_uv=False)
    if len(found.shift) == 2 or line[1] < 0.02 * line[0]:
        return  # a plane, or a straight line: its axes are not determined
    yield from _axes(found, called, one)


def _axes(found: Alignment, called: str, one: Understood) -> Iterator[Finding]:
    """Yield which axes of the tracks are the base's, and where its origin is."""
    R = found.rotation.T  # rows: the base's axes in those of the tracks
    nearest = np.zeros((3, 3))
    for i, row in enumerate(R):
        j = int(np.abs(row).argmax())
        nearest[i, j] = np.sign(row[j])
    proper = np.linalg.det(nearest) > 0.5
    left = float(np.linalg.norm(Rotation.from_matrix(R @ nearest.T).as_rotvec())) if proper else math.inf
    whole = float(np.linalg.norm(Rotation.from_matrix(R).as_rotvec()))
    error = found.errors["rotation"]
    names = [("-" if row.min() < 0 else "") + "xyz"[int(np.abs(row).argmax())] for row in nearest]
    own = one.format in TABLES  # other readers turn and convert what the file has
    numbers: dict[str, Any] = {"rotation": R.tolist(), "error": error}
    reason = f"by the same paths; +- {math.degrees(error):.1g} deg"
    if whole <= max(SURE * error, TURNED):
        value = f"those of the base, within {math.degrees(whole):.2f} deg"
        yield Finding("frame", value, MEASURED, reason, numbers=numbers)
    elif left < NEAR and not np.array_equal(nearest, np.eye(3)):
        value = f"{', '.join(names)} are the base's x, y, z, within {math.degrees(left):.1f} deg"
        listed = ", ".join(f'"{name}"' for name in names)
        fix = f"say axes = [{listed}] in the sidecar, for a model in space"
        if not own or "axes" in one.said:
            fix = "change axes or up in the sidecar"
        yield Finding("frame", value, DOUBTFUL, reason, fix, numbers | {"axes": names})
    else:
        value = f"turned by {math.degrees(whole):.1f} deg against those of the base"
        fix = "turn the tracks, or fit with --per-recording rotation_x rotation_y rotation_z"
        yield Finding("frame", value, DOUBTFUL, reason, fix, numbers)
    error = max(found.errors["shift"], 1e-6)
    off = float(np.linalg.norm(found.shift))
    place = ", ".join(f"{x:.3f}" for x in found.shift)
    value = f"the base of the {called} is at {place} m in the tracks' axes, +- {error:.1g} m"
    wrong = off > max(SURE * error, SHIFTED)
    fix = ""
    if wrong:
        unit = UNITS[str(one.said.get("units", "m"))]
        listed = ", ".join(f"{(x / unit):.4g}" for x in found.shift)
        plain = own and not {"axes", "origin"} & set(one.said)
        fix = f"say origin = [{listed}] in the sidecar" if plain else "change origin in the sidecar, in the file's axes"
    reason = f"where the marker may be up to {LEVER_PRIOR:g} m from the hand"
    numbers = {"origin": found.shift.tolist(), "error": error}
    yield Finding("origin", value, DOUBTFUL if wrong else MEASURED, reason, fix, numbers)


def _by_beginning(recording: StrikeRecording, path: Path, called: str, key: str, start: float) -> Iterator[Finding]:
    """Yield a rough offset, from when the tip and the hand begin to move."""
    if "tip" not in recording.markers:
        return
    paths = [(x, speeds(x, float(np.median(np.diff(x.t))))) for x in (marker_path(recording, "tip"), path)]
    least = MOVING * paths[1][1].max(initial=0.0)
    begun = [_begins(x, speed, least) for x, speed in paths]
    if begun[0] is None or begun[1] is None:
        yield Finding("offset", f"{called}: unknown", ASSUMED, "no marker handle, and not at rest at the start")
        return
    offset = begun[0] - begun[1] - WHIP_LAG
    wrong = abs(offset) > LAG_ERROR
    value = f"{called}: {offset:.2f} s, within {LAG_ERROR:g} s, have to be added to its time"
    reason = "from when tip and hand begin to move; the tip follows the hand. A marker handle tells it to a millisecond"
    fix = f"say {key} = {start - offset:.2f} in the sidecar, and fit with --per-recording delay" if wrong else ""
    numbers = {"offset": offset, "error": LAG_ERROR, "start": start - offset}
    yield Finding("offset", value, DOUBTFUL if wrong else MEASURED, reason, fix, numbers)


def _begins(path: Path, speed: np.ndarray, least: float) -> float | None:
    """When the speed of a path is first above a least one [s]; None if it is from the start, or never."""
    dt = float(np.median(np.diff(path.t)))
    moving = np.flatnonzero(speed > least)
    return float(path.t[0] + dt * moving[0]) if len(moving) and moving[0] >= WINDOW // 2 else None


def _with_tracks(one: Understood, other: Understood) -> Iterator[Finding]:
    """Yield how the clock of tracks lies to that of other tracks of the same marker, as of two systems of cameras."""
    a, b = one.found, other.found
    assert isinstance(a, StrikeRecording)
    assert isinstance(b, StrikeRecording)
    common = [name for name in ("tip", "handle", *a.markers) if name in a.markers and name in b.markers]
    if not common or b.view is not None or b.angular or a.points.shape[2] != b.points.shape[2]:
        return
    found = align(marker_path(b, common[0]), marker_path(a, common[0]))
    if found is None:
        return
    reason = f"by the path of {common[0]}, {1e3 * found.rms:.2g} mm apart; correlation {found.correlation:.3f}"
    called = f"frames of {one.path} to {other.path}"
    said = float(one.said.get("start", 0.0))
    yield _offset(found.offset, found.errors["offset"], called, reason, "say start = ", said)
    error = found.errors["rate"]
    if error < 0.5 * RATE_PRIOR:
        wrong = abs(found.rate - 1) > SURE * error
        value = f"1 s of {one.path} is {found.rate:.5f} +- {error:.1g} s of {other.path}"
        yield Finding("clock rate", value, DOUBTFUL if wrong else MEASURED, f"prior 1 +- {RATE_PRIOR:g}")
