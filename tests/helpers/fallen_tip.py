"""A strike on a rig, made up by hand: what its cycles hold, and a tip that falls straight past a target."""

from __future__ import annotations

import numpy as np

from whiptool.recording.strike_recording import StrikeRecording
from whiptool.rig.cyclelog import Cycles, Flag, Phase
from whiptool.rig.struck import Run, Struck


def cycles(*, phases: tuple[Phase, ...] = (Phase.APPROACH, Phase.STRIKE)) -> Cycles:
    """100 cycles a phase at 500 Hz; in the 30th of the strike the elbow turns at 2 rad/s and carries 1 A."""
    n = 100 * len(phases)
    t = 0.002 * np.arange(n)
    two, one = np.zeros((n, 2)), np.zeros(n)
    phase = np.repeat([int(p) for p in phases], 100)
    v, current, flags = two.copy(), two + 0.01, np.zeros(n, int)
    stamp = t.copy()
    if Phase.STRIKE in phases:
        at = 100 * phases.index(Phase.STRIKE) + 30
        v[at, 1], current[at, 1] = 2.0, 1.0
        flags[at + 10] = Flag.SATURATED
        flags[at + 20] = Flag.MISSED
        current[at + 20] = v[at + 20] = np.nan
        stamp[at + 5 :] += 0.003
    voltage, temperature = two + 12.0, two + 31.0
    voltage[3], voltage[-1, 0] = 5.0, 10.5  # the first before the strike
    return Cycles(
        t=t, stamp=stamp, late=one + 2.5e-4, q=two, v=v, current=current, goal_current=current, tau=two,
        q_d=two + np.deg2rad(3.0), voltage=voltage, temperature=temperature, flags=flags, phase=phase, state=flags,
    )  # fmt: skip


def struck(markers: tuple[str, ...] = ("tip",)) -> Struck:
    """The tip falls past the target, 2 cm beside it, 200 frames a second; the arm stands at (0.3, -0.6) rad."""
    t = np.arange(0.0, 0.2, 0.005)
    path = np.stack([np.full_like(t, 0.92), 0.3 - 3.0 * t], axis=1)[:, None]
    recording = StrikeRecording(
        t=t, points=path, markers=markers, sigma=np.full((len(t), 1), 1e-3), camera="points",
        joints_t=np.array([0.0, 0.2]), joints_q=np.array([[0.3, -0.6], [0.3, -0.6]]),
    )  # fmt: skip
    return Struck(Run(cycles(), None, True, 1, 0, "torque is off"), recording)
