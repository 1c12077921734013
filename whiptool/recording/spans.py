"""Whether the parts of a recording are of one time: frames, joint log, the hand's poses, and the command."""

from __future__ import annotations

import numpy as np

from whiptool.errors import InputError
from whiptool.recording.clock import gaps

HOLE = 0.05  # [s] of a log from which a hole is reported, where it is several samples
SLACK = 0.02  # [s] by which a log may start late or end early without a word
LEAD = (
    1.0  # [s] before and after: of a log around the frames and the command; of frames, as of a hanging whip, around it
)


def check_spans(t: np.ndarray, logs: dict[str, np.ndarray], command: tuple[float, float] | None) -> None:
    """Refuse parts that have no time in common.

    Args:
        t: Times of the frames (T,) [s].
        logs: Times of what was logged in addition, by what it is called where its start is given (`joints`, `hand`).
        command: Start and end of the strike, if it is known [s].

    Raises:
        InputError: They have none; the message names what clocks do.
    """
    if command is not None and not (t[0] <= command[1] + LEAD and t[-1] >= command[0] - LEAD):
        cause = "does the clock count since the computer was started, or since 1970? Say when the command began: start"
        raise InputError(
            "t", f"frames from {t[0]:.6g} to {t[-1]:.6g} s", f"frames within the strike, 0 to {command[1]:.3g} s", cause
        )
    for name, times in logs.items():
        if times[0] <= t[-1] and times[-1] >= t[0]:
            continue
        cause = f"do their clocks differ? Say when the command began by each: start and {name}_start"
        given = f"from {times[0]:.6g} to {times[-1]:.6g} s"
        raise InputError(f"{name}_t", given, f"times of the frames, {t[0]:.6g} to {t[-1]:.6g} s", cause)


def told_of_spans(t: np.ndarray, logs: dict[str, np.ndarray]) -> list[str]:
    """Return sentences about holes, and about logs that start late or end early; arguments as of `check_spans`."""
    said = gaps("frames", t)
    for name, times in logs.items():
        slack = SLACK + float(np.median(np.diff(times)))
        inside = times[(times >= t[0] - slack) & (times <= t[-1] + slack)]
        said += gaps(name, inside, least=HOLE, steps=3.0) if len(inside) > 1 else []
        if times[0] > t[0] + slack:
            said.append(f"{name}: the log starts late, {times[0] - t[0]:.3f} s after the first frame")
        if times[-1] < t[-1] - slack:
            said.append(f"{name}: the log ends early, {t[-1] - times[-1]:.3f} s before the last frame")
    return said


def of_use(times: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Which samples of a log lie near the frames or the command's start, (S,)."""
    return (times >= min(t[0], 0.0) - LEAD) & (times <= t[-1] + LEAD)
