"""Hindsight (Andrychowicz et al. 2017): a strike's tip passes many points and would have hit each of them.

The tip's path says by how much a strike misses any target: relabelled transitions are as true as struck ones.
"""

from __future__ import annotations

import numpy as np

from whiptool.rollout.closest import closest_on_segments
from whiptool.zone import Zone, directions

RATE = 500.0  # [1/s] of the paths: within a millimetre of the tip, save that they may end 2 ms before the strike
NEAR = (0.0, 0.5, 2.0)  # offsets of new targets from the path, in hit radii: hits, edges, near misses


def nearest(paths: np.ndarray, targets: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Miss distance of each path from its target, with the tip's place and sample then.

    Args:
        paths: (B, S, d) [m], NaN after a strike's end.
        targets: (B, d) [m].

    Returns:
        Distances (B,) [m], infinite for a path without two samples; nearest points (B, d); samples before them (B,).
    """
    nearest = closest_on_segments(paths, targets)
    lanes, i = np.arange(len(paths)), nearest.segment
    start, end = paths[lanes, i], paths[lanes, i + 1]
    return nearest.distance, start + nearest.share[:, None] * (end - start), i


def new_targets(paths: np.ndarray, zone: Zone, hit_radius: float, uniform: np.ndarray) -> np.ndarray:
    """For each path a target in the zone: on the path or near it, anywhere if the path does not pass the zone.

    Args:
        paths: (B, S, d) [m].
        zone: Where targets lie.
        hit_radius: [m]
        uniform: Uniform random numbers, (B, 2 d + 2).

    Returns:
        (B, d) [m]
    """
    of_zone, of_path = np.split(uniform, [zone.dimension + 1], axis=1)
    anywhere = zone.place(of_zone)
    inside = zone.contains(paths)
    count = inside.sum(axis=1)
    wanted = (of_path[:, 0] * count).astype(int) + 1  # the wanted-th sample inside
    sample = (np.cumsum(inside, axis=1) >= wanted[:, None]).argmax(axis=1)
    offset = np.array(NEAR)[(of_path[:, 1] * len(NEAR)).astype(int)] * hit_radius
    near = paths[np.arange(len(paths)), sample] + offset[:, None] * directions(of_path[:, 2:])
    return np.where(((count > 0) & zone.contains(near))[:, None], near, anywhere)
