"""A rig that only says what was seen."""

from __future__ import annotations

import numpy as np

from whiptool.rig.stops import StrikeRefused


class Pretend:
    """A rig whose tip is seen on a straight line past a point that the strike decides."""

    def __init__(self, refuse: bool = False) -> None:
        self.calls, self.refuse = 0, refuse

    def strike(self, strike, *, folder=None):
        self.calls += 1
        if self.refuse:
            raise StrikeRefused("strike", "x", "y")
        return self

    def judged(self, target):
        from whiptool.recording.filmed_approach import Judgement, Nearest

        return Judgement(0.5 / self.calls, 0.004, 1.0, Nearest(0.7, (1.0, 0.5), (3.0, 4.0)))

    def approach(self, target):
        from whiptool.models.trajectory import Approach

        two = np.zeros((1, 2))
        return Approach(np.array([0.5 / self.calls]), np.zeros(1), two, two, two, two, np.zeros(1, bool))
