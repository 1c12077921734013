"""Filming beside the loop."""

from __future__ import annotations

import threading

import numpy as np
import pytest
from processes import HANG

from whiptool.recording.camera import camera_preset
from whiptool.rig.filming import Filming
from whiptool.vision.source import Frame

pytest.importorskip("dynamixel_sdk")
pytest.importorskip("cv2")


class Ticking:
    """A camera, 200 frames a second by a clock of its own; what it films comes 3 to 5 ms later. It is the time, too."""

    def __init__(self, begin: int, end: int) -> None:
        self.settings, self.n, self.closed = camera_preset("d435-infrared"), 0, False
        self.begin, self.end, self.over = begin, end, threading.Event()

    def open(self) -> None:
        self.told = threading.Event()

    def monotonic(self) -> float:
        """The loop's clock, as the last frame comes."""
        return 50.0 + 0.005 * self.n + 0.003 + 0.001 * (self.n % 3)

    def read(self, timeout: float) -> Frame | None:
        self.told.wait()
        self.n += 1
        if self.n == self.begin:
            self.filming.during(True)
        if self.n == self.end:
            self.filming.during(False)
            self.over.set()
        t = 1000.0 + 0.005 * self.n
        return Frame(np.zeros((480, 848), np.uint8), t=t, clock="camera", sequence=self.n, settings=self.settings)

    def close(self) -> None:
        self.closed = True


def test_filming_keeps_the_strike_on_the_loops_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    camera = Ticking(begin=60, end=100)
    monkeypatch.setattr("whiptool.rig.filming.time", camera)
    filming = Filming(camera, keep_before=0.05)
    filming.during(False)
    camera.filming = filming
    camera.told.set()
    assert camera.over.wait(HANG)
    frames = filming.end()
    assert camera.closed
    assert frames[-1].sequence == 100  # the frame under way, and none after it
    assert frames[0].sequence in (49, 50)  # 50 ms before
    numbers = np.array([frame.sequence for frame in frames])
    assert (np.diff(numbers) == 1).all()
    # by the loop's clock, late by the shortest delay
    np.testing.assert_allclose([frame.t for frame in frames], 50.003 + 0.005 * numbers, atol=1e-9)
