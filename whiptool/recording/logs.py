"""Checks of logs: which time stamps are valid, whether frames and logs overlap, and which column is which joint.

A name of a column is split into words: `/arm1/joint_states/shoulder_pan_joint/position [deg]` is of `shoulder pan`, a
position, in degrees. A column belongs to a joint if both have the same words, or the words of one end with those of the
other, as after a namespace. Names with a number only, such as `actual_q_0`, state only the order.
"""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.models.numbers import float_array

MOST_BAD = 0.05  # share of stamps
NEAR, CROWD = 10, 3  # as many bad stamps among so many rows are a stretch
SLOWEST = 0.25  # [s] between samples; milliseconds and frame numbers are beyond it
FASTEST = 1e-5  # [s]
DOUBTED = 5e-5  # [s], at which no whip is filmed: of a time in s, its unit is taken as ms
LONGEST = 300.0  # [s] of one strike or swing
LONE = 1.0  # [s], and
APART = 100.0  # steps by which a stamp at the end stands alone
QUICKEST = 2e-5  # [s] between samples of any camera or robot; what stands for less counts a smaller unit
HOLE = 0.05  # [s] of a log from which a hole is reported, where it is several samples
SLACK = 0.02  # [s] by which a log may start late or end early without a word
LEAD = 1.0  # [s] before and after: of a log around the frames and the command; of frames, as of a hanging whip


def good_stamps(stamps: np.ndarray, what: str) -> tuple[np.ndarray, list[str]]:
    """Return which time stamps (T,) [s] to keep, (T,), and sentences about the others; `what` names the samples in
    them.

    A sample is dropped if its stamp is NaN, repeated, goes back, or is isolated. Where too many stamps are bad, or
    several in a row, the right stamps cannot be determined, which is an InputError.
    """
    even = len(stamps) < 2 or (np.diff(stamps) > 0).all()
    keep = np.ones(len(stamps), bool) if even else _increasing(stamps)
    _drop_lone_ends(stamps, keep)
    if keep.all():
        return keep, []
    bad = np.flatnonzero(~keep)
    crowds = np.flatnonzero(bad[CROWD - 1 :] - bad[: len(bad) - CROWD + 1] < NEAR)
    if len(bad) > max(1, MOST_BAD * len(stamps)) or len(crowds):
        first, last = (bad[crowds[0]], bad[crowds[-1] + CROWD - 1]) if len(crowds) else (bad[0], bad[-1])
        given = f"{len(bad)} of {len(stamps)} stamps that repeat or go back, samples {first + 1} to {last + 1}"
        fix = "were they written with too few digits? Remove these samples, or say the times (timestamps, fps)"
        raise InputError(what, given, "increasing stamps, each later than the previous stamp", fix)
    rows = ", ".join(f"{i + 1} ({stamps[i]:.6g} s)" for i in bad[:5])
    return keep, [f"{what}: left out {len(bad)} of {len(stamps)} samples, whose stamps cannot be right: {rows}"]


def _increasing(stamps: np.ndarray) -> np.ndarray:
    """Whether each is of the longest increasing row of stamps; of two alike the one nearer to an even clock."""
    tails: list[float] = []  # last stamp of the best row of each length
    ends: list[int] = []  # where it stands
    before = np.full(len(stamps), -1)
    for i, stamp in enumerate(stamps.tolist()):
        if not np.isfinite(stamp):
            continue
        length = bisect_left(tails, stamp)
        before[i] = ends[length - 1] if length else -1
        tails[length : length + 1], ends[length : length + 1] = [stamp], [i]
    keep = np.zeros(len(stamps), bool)
    i = ends[-1] if ends else -1
    while i >= 0:
        keep[i] = True
        i = int(before[i])
    _choose_of_doubles(stamps, keep)
    return keep


def _choose_of_doubles(stamps: np.ndarray, keep: np.ndarray) -> None:
    """Keep that of two neighbours with one stamp which an even clock would have given it."""
    for i in np.flatnonzero(stamps[1:] == stamps[:-1]):
        others = np.flatnonzero(keep)
        others = others[(others != i) & (others != i + 1)]
        around = others[np.argsort(np.abs(others - i - 0.5), kind="stable")[:4]]
        if keep[i] == keep[i + 1] or len(around) < 2:
            continue
        slope, level = np.polyfit(around - i, stamps[around] - stamps[i], 1)
        second = abs(level + slope) < abs(level)
        keep[i], keep[i + 1] = not second, second


def _drop_lone_ends(stamps: np.ndarray, keep: np.ndarray) -> None:
    """Drop a first or last stamp that is far from all others, as a zero before an uptime clock."""
    for inwards in (1, -1):
        kept = np.flatnonzero(keep)
        steps = np.abs(np.diff(stamps[kept]))[::inwards]
        if len(steps) > 2 and steps[0] > max(LONE, APART * np.median(steps)):
            keep[kept[::inwards][0]] = False


def check_pace(name: str, t: np.ndarray, *, longest: float = LONGEST) -> None:
    """Refuse times (T,) [s] whose steps or whose span, `longest` at most, are implausible for a recording of a strike;
    the message names the likely cause."""
    step, span = float(np.median(np.diff(t))), float(t[-1] - t[0])
    unit = "milliseconds"
    for smaller, factor in (("microseconds", 1e6), ("nanoseconds", 1e9)):
        unit = smaller if step / factor >= QUICKEST else unit
    cause = f"are these {unit} or frame numbers? Give seconds, or say the unit in the column's name, as in t [ms]"
    if step < 0.999 * FASTEST:
        cause = "are these seconds, in a column whose name says a smaller unit? Correct the name, as in t [s]"
    if step >= SLOWEST or step < 0.999 * FASTEST:
        raise InputError(name, f"steps of {step:g}", f"steps from {FASTEST:g} s to {SLOWEST:g} s", cause)
    if span > longest:
        cause = f"keep only the part with the strike; or {cause}"
        raise InputError(name, f"a span of {span:g} s in {len(t)} rows", f"at most {longest:g} s", cause)


def increasing_times(name: str, value: object, *, longest: float = LONGEST) -> np.ndarray:
    """Return times (T,) [s] as an array; refuse fewer than two, times that do not increase, or implausible steps."""
    t = float_array(name, value)
    if t.ndim != 1 or len(t) < 2:
        raise InputError(name, f"shape {t.shape}", "at least two times, shape (T,)")
    if not np.isfinite(t).all():
        raise InputError(name, f"NaN at index {int(np.flatnonzero(np.isnan(t))[0])}", "finite times in s")
    steps = np.diff(t)
    if not (steps > 0).all():
        i = int(np.flatnonzero(~(steps > 0))[0])
        raise InputError(f"{name}[{i + 1}]", float(t[i + 1]), f"later than {name}[{i}] = {float(t[i])!r}")
    check_pace(name, t, longest=longest)
    return t


def gaps(name: str, t: np.ndarray, *, least: float = 0.0, steps: float = 1.5) -> list[str]:
    """Return a sentence about gaps in times t (T,) [s], if any: steps above `steps` times the median and above `least`
    [s].
    """
    step = np.diff(t)
    usual = float(np.median(step))
    wide = np.flatnonzero(step > max(steps * usual, least))
    if not len(wide):
        return []
    worst = wide[step[wide].argmax()]
    missing = int(np.round(step[wide] / usual - 1).sum())
    where = f"the longest of {step[worst]:.3g} s from {t[worst]:.3f} to {t[worst + 1]:.3f} s"
    holes = "a hole" if len(wide) == 1 else f"{len(wide)} holes"
    return [f"{name}: {holes} where about {missing} samples are missing, {where}"]


def hurried(name: str, t: np.ndarray) -> list[str]:
    """Return a sentence if times t (T,) [s] follow each other faster than those of a film or a robot."""
    rate = 1 / float(np.median(np.diff(t)))
    fix = "are its times in s, in a column whose name says ms? Correct the unit in the name"
    return [f"{name}: {rate:,.0f} a second, which is doubtful; {fix}"] if rate > 1 / DOUBTED else []


class ClocksApart(InputError):
    """Times of a log and of the frames that do not overlap; `logs` are the logs as arguments of `StrikeRecording`, by
    their own clocks, where a reader has read them."""

    logs: Mapping[str, Any] = MappingProxyType({})

    def renamed(self, name: str, fix: str = "") -> InputError:
        """Return the same error under another name, see `InputError.renamed`."""
        found = ClocksApart(name, self.given, self.allowed, self.fix or fix)
        found.logs = self.logs
        return found


def check_spans(t: np.ndarray, logs: dict[str, np.ndarray], command: tuple[float, float] | None) -> None:
    """Refuse frames (T,) [s] that do not overlap in time with a log (S,) [s], by its name `joints` or `hand`
    (ClocksApart), or with the command, its start and end [s] (InputError); the message names likely errors of the
    clocks."""
    if command is not None and not (t[0] <= command[1] + LEAD and t[-1] >= command[0] - LEAD):
        cause = (
            "does the clock count since the computer was started, or since 1970? Give the time at which the command "
            "began by that clock: key start of the sidecar"
        )
        raise InputError(
            "t", f"frames from {t[0]:.6g} to {t[-1]:.6g} s", f"frames within the strike, 0 to {command[1]:.3g} s", cause
        )
    for name, times in logs.items():
        if times[0] <= t[-1] and times[-1] >= t[0]:
            continue
        cause = f"do the clocks differ? Give when the command began by each: keys start and {name}_start of the sidecar"
        given = f"from {times[0]:.6g} to {times[-1]:.6g} s"
        raise ClocksApart(f"{name}_t", given, f"times of the frames, {t[0]:.6g} to {t[-1]:.6g} s", cause)


def told_of_spans(t: np.ndarray, logs: dict[str, np.ndarray]) -> list[str]:
    """Return sentences about gaps, and about logs that start late or end early; for the arguments see `check_spans`."""
    said = [*gaps("frames", t), *hurried("frames", t)]
    for name, times in logs.items():
        slack = SLACK + float(np.median(np.diff(times)))
        inside = times[(times >= t[0] - slack) & (times <= t[-1] + slack)]
        said += [*gaps(name, inside, least=HOLE, steps=3.0), *hurried(name, inside)] if len(inside) > 1 else []
        if times[0] > t[0] + slack:
            said.append(f"{name}: the log starts late, {times[0] - t[0]:.3f} s after the first frame")
        if times[-1] < t[-1] - slack:
            said.append(f"{name}: the log ends early, {t[-1] - times[-1]:.3f} s before the last frame")
    return said


def of_use(times: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Return a mask (S,) that is true for the samples of a log, at `times` (S,) [s], that are kept: from 1 s before the
    earlier of the command's start (time 0) and the first frame until 1 s after the last; frames are at t (T,) [s]."""
    return (times >= min(t[0], 0.0) - LEAD) & (times <= t[-1] + LEAD)


POSITION, TIME = "position", "time"
WIDEST = 50.0  # [rad], eight turns of a joint
WIDEST_WAY = 4 * np.pi  # [rad] between a joint's ends in one log
_JOINT = {"joint", "jnt", "j"}
_KINDS = {
    POSITION: {"position", "positions", "pos", "q", "angle", "angles"},
    "command": {"target", "desired", "command", "commanded", "reference", "setpoint", "goal", "action"},
    "other": {
        "velocity", "velocities", "vel", "speed", "qd", "dq", "acceleration", "acc", "qdd", "ddq", "effort", "efforts",
        "torque", "torques", "tau", "moment", "force", "current", "voltage", "temperature", "error",
    },
    TIME: {"t", "time", "timestamp", "stamp", "seconds", "secs", "sec"},
}  # fmt: skip
_SAID = {"actual", "measured", "state", "states", "observation"}  # of a position: that it was measured
_ANGLES = {"rad": "rad", "radian": "rad", "radians": "rad", "deg": "deg", "degree": "deg", "degrees": "deg", "°": "deg"}
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}
_TIMES = {unit: unit for unit in SECONDS}
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-zµ]+|\d+|°")
_HAND = {"gripper", "finger", "fingers"}  # of what an arm holds the whip with


@dataclass(frozen=True)
class Column:
    """Information in the name of a column."""

    words: tuple[str, ...]  # words of the name in lower case, without those for quantity and unit
    kind: str  # `position`, `command`, `other` (a speed, a torque, ...), `time`, or empty if not stated
    unit: str  # `rad`, `deg`, or one of `SECONDS`; empty if not stated
    jointed: bool  # whether the name contains the word joint, as `joint_1` does and `q1` does not

    @classmethod
    def of(cls, name: str) -> Column:
        """Return what the name of a log's column says of joint, quantity and unit."""
        found = [word.lower() for word in _WORD.findall(name)]
        kinds = [kind for word in found for kind, words in _KINDS.items() if word in words]
        kind = next((kind for kind in (TIME, "other", "command", POSITION) if kind in kinds), "")
        units = _TIMES if kind == TIME else _ANGLES
        unit = next((units[word] for word in reversed(found[1:]) if word in units), "")
        spent = _JOINT | _SAID | set().union(*_KINDS.values())
        words = [word for i, word in enumerate(found) if word not in spent and not (i and word in units)]
        return cls(tuple(words), kind, unit, bool(_JOINT & set(found)))

    @property
    def number(self) -> int | None:
        """Index from the number or letter of a name without other words: 0 for `actual_q_0`, 1 for `b`; else None."""
        if len(self.words) != 1:
            return None
        word = self.words[0]
        return int(word) if word.isdigit() else ord(word) - ord("a") if re.fullmatch("[a-z]", word) else None

    @property
    def holds(self) -> bool:
        """Whether the column belongs to a gripper, which is not a joint of the arm."""
        return bool(_HAND & set(self.words))


def in_numbers(names: Sequence[str]) -> list[int] | None:
    """Return the indices that sort columns by the numbers in their names: 1, 0 for `q2, q1`; None if a name has no
    number or more than one word, or a number is missing.
    """
    numbers = [number for name in names if (number := Column.of(name).number) is not None]
    if len(numbers) < len(names) or sorted(numbers) not in (list(range(len(names))), list(range(1, len(names) + 1))):
        return None
    return [int(i) for i in np.argsort(numbers)]


def order_of(names: Sequence[str], joints: Sequence[str], *, listed: bool = False) -> list[int]:
    """Return the index of the log's column for each joint of an arm, by their names. If the user `listed` the columns
    in the arm's order, names of other joints are allowed; an error lists the columns."""
    columns, wanted = [Column.of(name) for name in names], [Column.of(joint).words for joint in joints]
    exact = [[i for i, c in enumerate(columns) if c.words == words] for words in wanted]
    taken = {i for found in exact for i in found}
    free = [i for i in range(len(columns)) if i not in taken]
    found = [of or [i for i in free if _ends(columns[i].words, words)] for of, words in zip(exact, wanted, strict=True)]
    if all(len(of) == 1 for of in found) and len({of[0] for of in found}) == len(joints):
        return [of[0] for of in found]
    if not any(found) and len(names) == len(joints):
        order = list(range(len(names))) if listed else in_numbers(names)
        if order is not None:
            return order
    twice = next((joint for joint, of in zip(joints, found, strict=True) if len(of) > 1), None)
    missing = ", ".join(joint for joint, of in zip(joints, found, strict=True) if not of)
    why = (
        f"there are several for {twice}"
        if twice
        else f"no column is for {missing}"
        if missing
        else "one column fits two joints"
    )
    fix = "say which is which in the sidecar: joint_columns = {" + ", ".join(f'{x} = "COLUMN"' for x in joints) + "}"
    raise InputError(
        "joints", ", ".join(names), f"one column for each joint of the arm: {', '.join(joints)}", f"{why}; {fix}"
    )


def _ends(a: tuple[str, ...], b: tuple[str, ...]) -> bool:
    """Whether the words of one name end with those of the other, which are not a number alone."""
    short, long = sorted((a, b), key=len)
    return bool(short) and not all(word.isdigit() for word in short) and long[-len(short) :] == short


def check_angles(q: np.ndarray, names: Sequence[str]) -> None:
    """Refuse a joint log (S, a) whose columns, called `names`, are too large or wide in range for angles in rad."""
    for i, column in enumerate(q.T):
        widest, way = np.abs(column).max(), np.ptp(column)
        if widest <= WIDEST and way <= WIDEST_WAY:
            continue
        name = f"joints_q, column {names[i]}" if i < len(names) else "joints_q"
        given = float(widest) if not widest <= WIDEST else f"a range of {way:.4g}"
        rule = f"finite angles within {WIDEST:g} rad, over a range of at most {WIDEST_WAY:.3g} rad"
        cure = "are these degrees (joint_units), or is it no joint (joint_columns)?"
        raise InputError(name, given, rule, cure)


def read_by_name(names: Sequence[str], order: Sequence[int]) -> list[str]:
    """Return a sentence on the columns that were read as joints, and on those left out; empty if all are in order."""
    if not names or list(order) == list(range(len(names))):
        return []
    aside = [name for i, name in enumerate(names) if i not in order]
    called = ", ".join(names[i] for i in order)
    return [f"joints by name, in the arm's order: {called}" + (f"; left aside: {', '.join(aside)}" if aside else "")]
