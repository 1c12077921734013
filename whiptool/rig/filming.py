"""Filming during the control loop: a separate thread reads frames, and those of the strike are kept."""

from __future__ import annotations

import dataclasses
import threading
import time

from whiptool.errors import WhiptoolError
from whiptool.rig.stops import SafetyError
from whiptool.vision.source import Frame, FrameSource

LOST = 0.5  # [s] without a frame: the camera is lost


class Filming:
    """Reads frames from a camera in a thread, from its construction until `end`.

    Frames have times of the camera's clock. The smallest difference between arrival and capture over all frames is
    taken as the offset of the clocks. The remaining error is the shortest transmission delay, some milliseconds, which
    identification can fit (`delay`).

    Args:
        source: The camera, which is opened here and closed by `end`.
        keep_before: Time before the strike from which frames are kept, for the tracker's background [s].

    Attributes:
        lost: Reason why the camera failed before the end of the strike; empty: it did not fail.
    """

    def __init__(self, source: FrameSource, *, keep_before: float = 0.5) -> None:
        self._source, self._keep_before = source, keep_before
        self._frames: list[tuple[float, Frame]] = []  # arrival by the monotonic clock [s]
        self._striking, self._over, self._offset = False, threading.Event(), float("inf")
        self._first, self._latest = threading.Event(), -float("inf")
        self._error: BaseException | None = None
        self.lost = ""
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
                self._latest = now
                self._first.set()
                if not self._striking:
                    while self._frames and self._frames[0][0] < now - self._keep_before:
                        self._frames.pop(0)
        except BaseException as error:  # raised again where the filming ends
            self._error = error
            self._first.set()

    def wait(self, timeout: float = 5.0) -> None:
        """Wait for the first frame.

        Raises:
            WhiptoolError: No frame came within `timeout` [s].
        """
        self._first.wait(timeout)
        if self._error is not None or not self._frames:
            why = f"no frame in {timeout:g} s" if self._error is None else f"{self._error}"
            raise WhiptoolError(f"the camera gives no frames ({why}); the arm has not moved: check cable and --camera")

    def during(self, striking: bool) -> None:
        """Record whether the strike is in progress; frames after it are not kept. The control loop calls this; it
        returns quickly.

        Raises:
            SafetyError: The strike begins, and the camera no longer delivers frames.
        """
        begins, ends = striking and not self._striking, self._striking and not striking
        if (begins or ends) and not self._over.is_set():
            silent = time.monotonic() - self._latest
            if self._error is not None or silent > LOST:
                self.lost = f"{self._error}" if self._error is not None else f"it gave no frame for {silent:.2f} s"
            if begins and self.lost:
                raise SafetyError("camera", self.lost)
        if ends:
            self._over.set()
        self._striking = self._striking or striking

    def end(self) -> list[Frame]:
        """Stop filming, and return the frames with their times on the monotonic clock.

        If the camera failed, the frames up to then are returned, and `lost` states the reason.
        """
        if self._striking:
            self.during(False)
        self._over.set()
        self._thread.join(5.0)
        self._source.close()
        return [dataclasses.replace(f, t=f.t + self._offset, clock="monotonic") for _, f in self._frames]

    def __enter__(self) -> Filming:
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join(5.0)
        self._source.close()
