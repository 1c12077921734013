"""Filming while the control loop runs: a thread of its own takes frames; what the strike shows is kept."""

from __future__ import annotations

import dataclasses
import threading
import time

from whiptool.vision.source import Frame, FrameSource


class Filming:
    """Reads a camera from now on until `end`.

    Frames carry the camera's own clock. They arrive late by a delay that is never below the shortest one: the smallest
    difference between arrival and capture over all frames is taken as the clocks' offset, so that what remains is
    the shortest delay of the line, some milliseconds; identification can fit it (`delay`).

    Args:
        source: The camera; opened here, closed by `end`.
        keep_before: Frames of this long before the strike are kept, for the tracker's background [s].
    """

    def __init__(self, source: FrameSource, *, keep_before: float = 0.5) -> None:
        self._source, self._keep_before = source, keep_before
        self._frames: list[tuple[float, Frame]] = []  # arrival by the monotonic clock [s]
        self._striking, self._over, self._offset = False, threading.Event(), float("inf")
        self._error: BaseException | None = None
        source.open()
        self._thread = threading.Thread(target=self._read, name="camera", daemon=True)
        self._thread.start()

    def _read(self) -> None:
        try:
            while not self._over.is_set():
                frame = self._source.read(0.5)
                if frame is None:
                    continue
                now = time.monotonic()
                self._offset = min(self._offset, now - frame.t)
                self._frames.append((now, frame))
                if not self._striking:
                    while self._frames and self._frames[0][0] < now - self._keep_before:
                        self._frames.pop(0)
        except BaseException as error:  # told to whoever ends the filming
            self._error = error

    def during(self, striking: bool) -> None:
        """Say whether the strike is on; what is filmed after it is not kept. Quick: the control loop calls it."""
        if self._striking and not striking:
            self._over.set()
        self._striking = self._striking or striking

    def end(self) -> list[Frame]:
        """Stop filming, and return the frames with their times on the monotonic clock.

        Raises:
            Exception: Whatever the camera raised meanwhile.
        """
        self._over.set()
        self._thread.join(5.0)
        self._source.close()
        if self._error is not None:
            raise self._error
        return [dataclasses.replace(f, t=f.t + self._offset, clock="monotonic") for _, f in self._frames]
