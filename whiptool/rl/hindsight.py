"""Hindsight (Andrychowicz et al. 2017): a strike's tip passes many points and would have hit each of them.

The tip's path says by how much a strike misses any target: relabelled transitions are as true as struck ones.
"""

from __future__ import annotations

import numpy as np

from whiptool.zone import Zone

RATE = 500.0  # [1/s] of the paths: within a millimetre of the tip, save that they may end 2 ms before the strike
NEAR = (0.0, 0.5, 2.0)  # offsets of new targets from the path, in hit radii: hits, edges, near misses


def nearest(paths: np.ndarray, targets: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Miss distance of each path from its target, with the tip's place and sample then.

    Args:
        paths: (B, S, 2) [m], NaN after a strike's end.
        targets: (B, 2) [m].

    Returns:
        Distances (B,) [m], infinite for a path without two samples; nearest points (B, 2); samples before them (B,).
    """
    start, step = paths[:, :-1], np.diff(paths, axis=1)
    to_target = targets[:, None] - start
    length2 = (step**2).sum(axis=2)
    s = np.clip((to_target * step).sum(axis=2) / np.where(length2 > 0, length2, 1), 0, 1)
    points = start + s[..., None] * step
    distance = np.hypot(*np.moveaxis(points - targets[:, None], 2, 0))
    distance[np.isnan(distance)] = np.inf
    i = distance.argmin(axis=1)
    lanes = np.arange(len(paths))
    return distance[lanes, i], points[lanes, i], i


def new_targets(paths: np.ndarray, zone: Zone, hit_radius: float, uniform: np.ndarray) -> np.ndarray:
    """For each path a target in the zone: on the path or near it, anywhere if the path does not pass the zone.

    Args:
        paths: (B, S, 2) [m].
        zone: Where targets lie.
        hit_radius: [m]
        uniform: Uniform random numbers, (B, 6).

    Returns:
        (B, 2) [m]
    """
    anywhere = zone.place(uniform[:, :3])
    inside = zone.contains(paths)
    count = inside.sum(axis=1)
    wanted = (uniform[:, 3] * count).astype(int) + 1  # the wanted-th sample inside
    sample = (np.cumsum(inside, axis=1) >= wanted[:, None]).argmax(axis=1)
    offset = np.array(NEAR)[(uniform[:, 4] * len(NEAR)).astype(int)] * hit_radius
    angle = 2 * np.pi * uniform[:, 5]
    near = paths[np.arange(len(paths)), sample] + offset[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.where(((count > 0) & zone.contains(near))[:, None], near, anywhere)
