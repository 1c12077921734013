"""What is understood of a robot's logs before any fit: joints, the hand, and rates of any times."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from whiptool.recording.finding import ASSUMED, DOUBTFUL, MEASURED, STATED, Finding
from whiptool.recording.logs import HOLE, gaps, hurried
from whiptool.recording.readers.joint_log import JointLog, Logs
from whiptool.recording.readers.log_keys import LOGS

UNEVEN = 0.1  # of the usual step: frames or samples whose steps scatter by more are not at one rate
EXACT = 1e-8  # [s] below which stamps are those of an even clock


def rate_of(topic: str, t: np.ndarray, what: str) -> Finding:
    """Return the rate of times t (T,) [s], T > 1: the inverse of the median step, and how even the steps are; `what`
    has these times, such as `frames`."""
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
    doubt = "".join(hurried(what, t)).partition("; ")[2]
    certainty = DOUBTFUL if doubt else MEASURED
    return Finding(topic, value, certainty, "from the steps between time stamps", doubt, numbers)


def logs_in(fields: Mapping[str, Any]) -> Logs | None:
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


def of_logged(fields: Mapping[str, Any], notes: list[str]) -> Iterator[Finding]:
    """Yield what was understood of the logs in the arguments of a recording; what is said of them is no note then."""
    logs = logs_in(fields) or Logs()
    if logs.joints is not None:
        yield from _joints(logs.joints)
    if logs.hand is not None:
        yield from _hand(logs.hand)
    notes[:] = [note for note in notes if not note.startswith(tuple(f"{what}:" for what in LOGS))]


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
    certainty = ASSUMED if "taken as" in reasons else STATED
    yield Finding("hand", extent, certainty, reasons, numbers={"from": log.t[0], "to": log.t[-1]})
    yield rate_of("hand rate", log.t, "poses of the hand")


def of_logs(logs: Logs, fix: str) -> Iterator[Finding]:
    """Yield what was understood of a file of logs; `fix` says how it becomes one with tracks."""
    if logs.joints is not None:
        yield from _joints(logs.joints)
    if logs.hand is not None:
        yield from _hand(logs.hand)
    if logs.aside:
        yield Finding("note", f"left aside: {', '.join(logs.aside)}")
    yield Finding("tracks", "none", STATED, "a log of the robot alone", fix)
