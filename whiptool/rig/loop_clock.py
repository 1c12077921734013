"""Clocks of the control loop: the machine's, or one that advances with the loop's steps."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """Source of the control loop's time."""

    def now(self) -> float:
        """Time [s] since a fixed instant; it never decreases."""
        ...

    def sleep_until(self, t: float) -> None:
        """Wait until time t [s]; return immediately if it is past."""
        ...


class WallClock:
    """The system's monotonic clock. To reduce jitter, `sleep_until` sleeps until `spin` [s] before the deadline and
    then busy-waits.
    """

    def __init__(self, spin: float = 2e-4) -> None:
        self.spin = spin

    def now(self) -> float:
        """Return the time of this clock [s]; see `Clock`."""
        return time.monotonic()

    def sleep_until(self, t: float) -> None:
        """Sleep until a time of this clock [s]; see `Clock`."""
        left = t - time.monotonic()
        if left > self.spin:
            time.sleep(left - self.spin)
        while time.monotonic() < t:
            pass


class StepClock:
    """Time that advances only in `sleep_until`, for the twin in lock step, which is driven by the loop's writes."""

    def __init__(self) -> None:
        self._t = 0.0

    def now(self) -> float:
        """Return the time of this clock [s]; see `Clock`."""
        return self._t

    def sleep_until(self, t: float) -> None:
        """Sleep until a time of this clock [s]; see `Clock`."""
        self._t = max(self._t, t)
