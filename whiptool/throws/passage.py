"""Passage of a ball through an opening: its size counts along its path, which may come in aslant."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

FLATTEST = math.radians(75.0)  # largest angle between the path at the opening and the opening's normal
LEAST_ROOM = 0.1  # share of the room that an entry along the normal has, which the entry's angle has to leave
_GRID = np.linspace(-math.pi / 2, math.pi / 2, 13)[1:-1]  # phases at which the largest distance is looked for
_NEWTON = 6  # steps from there to the largest distance


@dataclass(frozen=True)
class Opening:
    """The planes of openings towards which R things fly, as they are at release.

    Args:
        centres: Centres of the openings, (R, d) [m].
        normal: Unit vector out of the box, (d,), with an upward component.
        drift: Velocity of the box, (d,) [m/s].
        radius: Radius of the openings, less that of the things [m].
        ball: Radius of the things [m].
    """

    centres: np.ndarray
    normal: np.ndarray
    drift: np.ndarray
    radius: float = 0.0
    ball: float = 0.0


def passage(
    offset: np.ndarray, seen: np.ndarray, opening: Opening, down: np.ndarray, since: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the offsets with which R balls count that cross the plane of an opening, and their derivatives by offset
    and velocity, (R, d), (R, d, d) and (R, d, d).

    While a ball crosses the plane, the plane cuts it in discs. All of it passes if each disc lies within the opening,
    which is the same as a distance of at least its radius between its centre's path and the rim. The length of what
    counts is then at most `opening.radius`; for a point it is the offset itself. An entry that is flatter than
    `FLATTEST`, or leaves less than `LEAST_ROOM`, counts as above the plane.

    Args:
        offset, seen: Crossings relative to the opening's centre [m] and velocities seen from the box [m/s], (R, d).
        opening: Opening.
        down: Acceleration of the path [m/s^2], (d,); drag acts along it.
        since: Time since release, before which there is no path, (R,) [s].
    """
    normal, ball, room = opening.normal, opening.ball, opening.radius
    R, d = offset.shape
    speed = np.maximum(np.linalg.norm(seen, axis=1), 1e-9)
    steep = np.maximum(-(seen @ normal) / speed, 1e-3)  # cosine of the angle from the normal
    by_offset, by_seen = np.tile(np.eye(d), (R, 1, 1)), np.zeros((R, d, d))
    stretch, slant, least, most = np.ones(R), np.zeros(R), math.cos(FLATTEST), (1 - LEAST_ROOM / 2) * room
    if ball:
        farthest, of_offset, of_seen = _farthest(offset, seen, opening, down, since)
        distance = np.linalg.norm(offset, axis=1)
        slant = np.maximum(farthest - distance - ball, 0.0)
        of_offset -= offset / np.maximum(distance, 1e-12)[:, None]
        least = max(least, ball / (ball + (1 - LEAST_ROOM) * room))
        left = room - np.minimum(slant, most)
        stretch = room / left
        grows = np.where(slant < most, stretch / left, 0.0)[:, None, None] * offset[:, :, None]
        by_offset = stretch[:, None, None] * by_offset + grows * of_offset[:, None, :]
        by_seen = grows * of_seen[:, None, :]
    lift = np.where((steep < least) | (slant > most), room * np.maximum(least / steep, 1), 0.0)
    flatter = normal / speed[:, None] + (steep / speed**2)[:, None] * seen
    by_seen += normal[:, None] * (np.where(steep < least, lift, 0.0) / steep)[:, None, None] * flatter[:, None, :]
    return stretch[:, None] * offset + lift[:, None] * normal, by_offset, by_seen


def overlap(
    offset: np.ndarray, seen: np.ndarray, opening: Opening, down: np.ndarray, since: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return by how much R balls that rise through the plane of an opening reach within its rim, (R,) [m], and
    derivatives by offset and velocity, (R, d) each; negative: all of the ball stays outside. Arguments as of `passage`.
    """
    rim = opening.radius + opening.ball
    if not opening.ball:
        distance = np.maximum(np.linalg.norm(offset, axis=1), 1e-12)
        return rim - distance, -offset / distance[:, None], np.zeros_like(seen)
    nearest, of_offset, of_seen = _farthest(offset, seen, opening, down, since, outward=-1)
    return rim + nearest, of_offset, of_seen


def _farthest(
    offset: np.ndarray,
    seen: np.ndarray,
    opening: Opening,
    down: np.ndarray,
    since: np.ndarray,
    outward: int = 1,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return how far balls reach while they cross the plane, (R,) [m], and derivatives by offset and velocity, (R, d).

    It is the largest sum of a disc's radius and its centre's distance, which counts negative if `outward` is -1.
    """
    normal, ball = opening.normal, opening.ball
    along, pull = seen @ normal, float(down @ normal)
    flat, fall = seen - along[:, None] * normal, down - pull * normal
    distance = np.maximum(np.linalg.norm(offset, axis=1), 1e-12)
    into, fast = np.maximum(np.abs(along), 1e-9), np.sqrt(along**2 - 2 * pull * ball)
    rise = along**2 + 2 * pull * ball  # negative: the ball never was wholly above the plane
    last = 2 * ball / (into + fast)
    first = -np.where(rise > 0, 2 * ball / (into + np.sqrt(np.maximum(rise, 0))), (into + fast) / max(-pull, 1e-9))
    first, last = np.where(along > 0, [-last, -first], [first, last])  # a rise is a fall whose time runs backward
    first = np.maximum(first, -since)
    square = [  # of the distance of the disc's centre, a polynomial of t
        distance**2,
        2 * (offset * flat).sum(axis=1),
        (flat**2).sum(axis=1) + offset @ fall,
        flat @ fall,
        np.full(len(offset), fall @ fall / 4),
    ]

    def reach(phase: np.ndarray) -> tuple[np.ndarray, ...]:
        """Time, distance of the disc's centre, height over the plane, radius of the disc, and rates by the phase."""
        shape = (-1,) + (1,) * (phase.ndim - 1)
        c0, c1, c2, c3, c4 = (x.reshape(shape) for x in square)
        middle, half, rate = (x.reshape(shape) for x in ((first + last) / 2, (last - first) / 2, along))
        t, dt, ddt = middle + half * np.sin(phase), half * np.cos(phase), -half * np.sin(phase)
        centre = np.sqrt(np.maximum(c0 + t * (c1 + t * (c2 + t * (c3 + t * c4))), 1e-24))
        height, climb = t * (rate + t * pull / 2), rate + t * pull
        disc = np.sqrt(np.maximum(ball**2 - height**2, 1e-24))
        of_centre = outward * (c1 + t * (2 * c2 + t * (3 * c3 + 4 * t * c4))) / (2 * centre)
        of_disc = -height * climb / disc
        bend = outward * ((2 * c2 + t * (6 * c3 + 12 * t * c4)) / 2 - of_centre**2) / centre
        bend = bend - (climb**2 + height * pull + of_disc**2) / disc
        slope = of_centre + of_disc
        return t, centre, height, disc, slope * dt, bend * dt**2 + slope * ddt

    _, centre, _, disc, *_ = reach(np.tile(_GRID, (len(offset), 1)))
    phase = _GRID[(outward * centre + disc).argmax(axis=1)]
    low, high = phase - (_GRID[1] - _GRID[0]), phase + (_GRID[1] - _GRID[0])
    for _ in range(_NEWTON):
        *_, slope, bend = reach(phase)
        phase = np.clip(phase - np.where(bend < 0, slope / np.where(bend < 0, bend, 1), 0.0), low, high)
    t, centre, height, disc, *_ = reach(phase)
    out = outward * (offset + t[:, None] * flat + (t**2 / 2)[:, None] * fall) / centre[:, None]
    by_seen = t[:, None] * (out - (height / disc)[:, None] * normal)
    return outward * centre + disc, out, by_seen
