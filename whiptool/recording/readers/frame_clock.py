"""When frames were taken: by `timestamps`, else by the stamps that their file holds, else by `fps`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from whiptool.errors import InputError
from whiptool.recording.clock import good_stamps
from whiptool.recording.readers.sidecar import STAMPS, Sidecar
from whiptool.recording.readers.table import read_columns, time_column

ROUNDED = 0.6e-3  # [s] by which stamps in whole milliseconds miss an even clock
UNROUNDED = 4e-3  # [s] between frames from which that can be detected
SLOWED = 1.5  # times slower than `fps` from which a film plays in slow motion
SAME = 1e-3  # part by which two rates may differ without a word


@dataclass(frozen=True, eq=False)
class FrameClock:
    """Times of frames.

    Args:
        times: Middle of the first row's exposure of each kept frame [s], (F,), relative to the command's start.
        keep: Which frames are kept, (count,).
        notes: Sentences on the clock that was used and on frames that were left out.
    """

    times: np.ndarray
    keep: np.ndarray
    notes: tuple[str, ...]


def frame_clock(
    side: Sidecar, count: int, *, stamps: np.ndarray | None = None, of: str = "", numbers: np.ndarray | None = None,
    hint: float = 0.0,
) -> FrameClock:  # fmt: skip
    """Return the times of `count` frames.

    Args:
        side: Sidecar with the keys `timestamps` (numbers, or a CSV file), `fps`, `stamp`, `exposure` and `start`.
        count: Number of frames.
        stamps: Time stamps in the file (count,) [s]; None for a file without time stamps.
        of: Source of the stamps, for messages.
        numbers: Numbers of the frames, (count,); default: from 0 on.
        hint: Frame rate in the file [1/s], for messages only, because it does not account for dropped frames.

    Raises:
        InputError: The recording has no time stamps and no frame rate, the number of timestamps differs from that of
            frames, or stamps are implausible.
    """
    if "timestamps" in side.table:
        times, note = _timestamps(side)
        if len(times) != count:
            raise InputError(f"{side.place}timestamps", f"{len(times)} times", f"{count}, one per frame")
    elif stamps is not None:
        times, note = stamps, f"times from {of}" + (", not from fps" if "fps" in side.table else "")
    elif "fps" in side.table:
        fps = side.number("fps", 0.0, low=1.0, high=1e5)
        times, note = (
            (np.arange(count) if numbers is None else numbers) / fps,
            f"times by frame number at {fps:g} a second",
        )
    else:
        hinted = f" (the file itself says {hint:g}; true only if no frame was dropped)" if hint > 0 else ""
        raise InputError(f"{side.place}fps", None, "fps or timestamps" + hinted, "write one into the sidecar .toml")
    keep, bad = good_stamps(times, f"{side.place}times")
    shift = STAMPS[side.word("stamp", STAMPS, "middle")] * side.exposure()
    return FrameClock(times[keep] + shift - side.start, keep, (note, *bad))


def clock_of_rows(side: Sidecar, stamps: np.ndarray, note: str, what: str) -> FrameClock:
    """Return the clock of rows with time stamps (T,) [s], relative to the command's `start`.

    Args:
        side: Sidecar, of which the key `start` is read.
        stamps: Time stamps as in the file.
        note: Where the stamps come from.
        what: Name of the stamps, for messages.
    """
    keep, bad = good_stamps(stamps, what)
    return FrameClock(stamps[keep] - side.start, keep, (note, *bad))


def _timestamps(side: Sidecar) -> tuple[np.ndarray, str]:
    """Times [s] of the key `timestamps`, and where they come from."""
    if not isinstance(side.table["timestamps"], str):
        times = side.array("timestamps", None)
        assert times is not None
        return times, "times from timestamps"
    file = side.file("timestamps")
    assert file is not None
    names, columns = read_columns(file)
    at, unit, note = time_column(names)
    return columns[:, at] * unit, f"{note} of {file.name}"


def stamps_of_film(played: np.ndarray, fps: float | None) -> tuple[np.ndarray | None, str]:
    """Return the times at which a film's images were taken, (F,) [s], or None, and the source of these times.

    Even stamps that were rounded to milliseconds are made even again. If a film plays much more slowly than `fps`, it
    is in slow motion, and its stamps are scaled. Perfectly even stamps may have been invented by the program that wrote
    the file, and are not used without `fps`.

    Args:
        played: Presentation time of each image [s], (F,).
        fps: Frame rate of the images [1/s], if it is given.
    """
    steps = np.diff(played)
    if not len(steps) or not (np.median(steps) > 0):
        return None, ""
    usual = np.median(steps)
    step = float(np.mean(steps[np.abs(steps - usual) < usual / 2]))
    number = np.round((played - played[0]) / step)
    step, first = np.polyfit(number, played, 1)
    even = first + step * number
    rounded = step >= UNROUNDED and bool(np.abs(played - even).max() < ROUNDED)
    if rounded:
        played = even
    if fps is None:
        counted = rounded and bool((np.diff(number) == 1).all())
        return (None, "") if counted else (played, "the film's own stamps")
    slower = fps * step
    if slower >= SLOWED:
        return played / slower, f"the film's own stamps, {slower:.4g} times slower than fps = {fps:g}: slow motion"
    differs = f", {1 / step:.5g} a second" if abs(slower - 1) > SAME else ""
    return played, f"the film's own stamps{differs}"
