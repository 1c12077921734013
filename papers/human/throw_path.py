"""How the hand throws: the measured mean speed along an assumed planar path, and the handle that turns with it.

Paths were not published. The assumption: the hand and the whip stay in the vertical plane of the target; the direction
of the hand's velocity and that of the handle are smooth in time, cubic splines through a few instants of the throw.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from papers.human.reading import Speeds

INSTANTS = 7  # at which the directions are given: see `MeanHand.knots`
CYCLES = 4  # throws of the rhythmic style that are rolled out, of which the last is looked at
_STEP = 1e-3  # [s] of the mean speed
_BLUR = 6.0  # [ms]: the mean over people has kinks where their instants are brought together
_BLEND = 0.05  # [s] over which the speed before the onset goes over into that after it
_BEGIN = {False: 0.05, True: 0.2}  # [s] in which the hand gets going from rest, in a single throw and in cycles


@dataclass(frozen=True, eq=False)
class MeanHand:
    """Mean hand speed of people in one style, their instants brought together before their speeds are averaged.

    Args:
        instants: Means of onset, largest hand speed and closest approach, from the beginning of the throw [s], (3,).
        speed: At equal times from 0 to the last instant [m/s].
        cyclic: Whether throw follows throw.
    """

    instants: np.ndarray
    speed: np.ndarray
    cyclic: bool

    @property
    def knots(self) -> np.ndarray:
        """Return when directions are given [s], (7,): the beginning, the three instants, and halfway between them."""
        onset, peak, end = self.instants
        return np.array([0, onset / 2, onset, (onset + peak) / 2, peak, (peak + end) / 2, end])

    @property
    def spline(self) -> CubicSpline:
        """Return the speed as a function of time, periodic where throw follows throw."""
        t = np.linspace(0, self.instants[-1], len(self.speed))
        return CubicSpline(t, self.speed, bc_type="periodic" if self.cyclic else "not-a-knot")


def mean_hand(ones: Sequence[Speeds], *, cyclic: bool) -> MeanHand:
    """Return the mean hand speed of some people in one style; its largest value is the mean of theirs."""
    own = []
    for one in ones:
        onset = one.hand_t[-1] - one.t[-1]
        own.append([0.0, onset, onset + one.t[one.markers[-1].argmax()], one.hand_t[-1]])
    together = np.mean(own, axis=0)
    t = np.linspace(0, together[-1], round(together[-1] / _STEP) + 1)
    curves = []
    for one, instants in zip(ones, own, strict=True):
        theirs = np.interp(t, together, instants)
        before = np.interp(theirs, one.hand_t, one.hand)
        after = np.interp(theirs - instants[1], one.t, one.markers[-1])
        share = np.clip((theirs - instants[1]) / _BLEND + 0.5, 0, 1)
        curves.append((1 - share) * before + share * after)
    speed = np.mean(curves, axis=0)
    if cyclic:
        smooth = gaussian_filter1d(speed[:-1], _BLUR, mode="wrap")
        smooth = np.append(smooth, smooth[0])
    else:
        smooth = gaussian_filter1d(speed, _BLUR, mode="nearest")
    largest = float(np.mean([one.markers[-1].max() for one in ones]))
    return MeanHand(together[1:], smooth * largest / smooth.max(), cyclic)


@dataclass(frozen=True, eq=False)
class ThrowPath:
    """Directions of the hand's velocity and of the handle at the knots of a throw.

    Args:
        direction, handle: [rad], (7,) each, counted as joint angles are: 0 is down, pi / 2 forward, pi up.
        grip: Distance from the hand to where the thong begins, along the handle [m].
    """

    direction: np.ndarray
    handle: np.ndarray
    grip: float


@dataclass(frozen=True, eq=False)
class ThrownHandle:
    """The thong's beginning at I equally spaced instants.

    Args:
        inputs: As `whiptool.dynamics.swing.Swing` takes them, (I, 7).
        place: [m], (I, 2), from where the hand began.
        hand_speed: [m/s], (I,).
        onset, peak, end: Indices of those instants of the throw that is looked at.
    """

    inputs: np.ndarray
    place: np.ndarray
    hand_speed: np.ndarray
    onset: int
    peak: int
    end: int


def thrown(hand: MeanHand, path: ThrowPath, timestep: float) -> ThrownHandle:
    """Return the motion of the handle's end; a rhythmic throw repeats the path from half of its backswing on.

    Args:
        hand: Speeds.
        path: Directions.
        timestep: Between instants [s]; there are two more instants than steps.
    """
    onset, peak, end = hand.instants
    period = float(end)
    length = CYCLES * period if hand.cyclic else period
    steps = round(length / timestep)
    t = np.minimum(timestep * np.arange(steps + 2), length)
    along = _cyclic if hand.cyclic else _single
    (phi, dphi, _), (theta, omega, alpha) = (
        along(hand.knots, x, t, i) for i, x in enumerate((path.direction, path.handle))
    )
    speed = hand.spline
    v, dv = speed(t % period if hand.cyclic else t), speed(t % period if hand.cyclic else t, 1)
    ramp, rising = _from_rest(t, _BEGIN[hand.cyclic])
    v, dv = v * ramp, dv * ramp + v * rising
    ahead, across = np.stack([np.sin(phi), -np.cos(phi)], 1), np.stack([np.cos(phi), np.sin(phi)], 1)
    out, side = np.stack([np.sin(theta), -np.cos(theta)], 1), np.stack([np.cos(theta), np.sin(theta)], 1)
    hand_velocity = v[:, None] * ahead
    velocity = hand_velocity + path.grip * omega[:, None] * side
    acceleration = dv[:, None] * ahead + (v * dphi)[:, None] * across
    acceleration += path.grip * (alpha[:, None] * side - (omega**2)[:, None] * out)
    moved = np.cumsum((hand_velocity[1:] + hand_velocity[:-1]) / 2, axis=0) * timestep
    place = np.vstack([np.zeros(2), moved]) + path.grip * out
    first = (CYCLES - 1) * period if hand.cyclic else 0.0
    marks = [min(round((first + x) / timestep), steps) for x in (onset, peak, end)]
    return ThrownHandle(np.column_stack([theta, omega, alpha, velocity, acceleration]), place, np.abs(v), *marks)


def _from_rest(t: np.ndarray, duration: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a smooth step from 0 to 1 and its rate [1/s]."""
    x = np.clip(t / duration, 0, 1)
    return x**2 * (3 - 2 * x), np.where(t < duration, 6 * x * (1 - x) / duration, 0.0)


def _single(knots: np.ndarray, angles: np.ndarray, t: np.ndarray, which: int) -> list[np.ndarray]:
    """Return angles at times t and their first two rates; the handle, the second of both, begins at rest."""
    ends: Any = ((1, 0.0), (2, 0.0)) if which else "natural"  # SciPy's types know only words
    spline = CubicSpline(knots, angles, bc_type=ends)
    return [spline(t, nu) for nu in range(3)]


def _cyclic(knots: np.ndarray, angles: np.ndarray, t: np.ndarray, which: int) -> list[np.ndarray]:
    """Return the same of a path that repeats itself: its first angle, of a throw from rest, is left out."""
    period = knots[-1]
    begin, turns = knots[1], round((angles[-1] - angles[1]) / (2 * np.pi))
    rate = 2 * np.pi * turns / period
    times = np.append(knots[1:], begin + period)
    rest = np.append(angles[1:], angles[1] + 2 * np.pi * turns) - rate * (times - begin)
    rest[-1] = rest[0]
    spline = CubicSpline(times, rest, bc_type="periodic")
    phase = (t - begin) % period + begin
    return [spline(phase) + rate * (t - begin), spline(phase, 1) + rate, spline(phase, 2)]
