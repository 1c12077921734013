"""Directions of a measured motion of the base that readings of the whip can resolve.

A log of joints or of the hand's pose determines its spline's coefficients, c = center + root e, to within an e that is
standard normal. Few directions of e move any reading by a noticeable share of its standard error, and the readings can
only correct those: only those are unknowns of a fit (Cui, Martin, Marzouk, Solonen and Spantini 2014, Inverse Problems
30, 114015). Where the log is nearly exact, no direction does, and its path is taken as it is. What is left out moves
the readings by at most `RESOLVED` standard errors in any direction, so that no stated variance is too small by more
than the square of that.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from whiptool.identification.joint_motion import ResolvedMotion
from whiptool.identification.plant import Plant
from whiptool.identification.predict import Predictor

RESOLVED = 0.1  # standard errors by which a direction has to move the readings, all together
_OVERLOOKED = 0.25  # likewise, of a direction that was left out: derivatives change with the parameters
_PROBES = 8  # random directions by which it is decided whether others have to be looked at
_AT_ONCE = 128  # directions whose derivatives are calculated together


def resolve(
    predictor: Predictor, plant: Plant, nuisance: dict[str, float], own: Sequence[np.ndarray]
) -> list[np.ndarray] | None:
    """Let the measured motions have the unknowns that their recordings' readings can resolve, if random directions show
    that they lack any, and return the recordings' own unknowns, which change with them; None if they lack none."""
    own, motions = list(own), _motions(predictor)
    if not any(motions):
        return None
    rng, probes = np.random.default_rng(0), []
    for motion in motions:
        drawn = rng.standard_normal((0 if motion is None else len(motion.directions), _PROBES)) / np.sqrt(_PROBES)
        probes.append(drawn if motion is None else motion.outside(drawn))
    moved = [np.linalg.norm(x, 2) if x.size else 0.0 for x in _effects(predictor, plant, nuisance, own, probes)]
    limits = [_OVERLOOKED if motion is not None and motion.directions.size else RESOLVED / 2 for motion in motions]
    asked = [np.eye(len(x)) if m > least else x[:, :0] for m, x, least in zip(moved, probes, limits, strict=True)]
    if not any(x.size for x in asked):
        return None
    effects, found = _effects(predictor, plant, nuisance, own, asked), []
    for i, (motion, effect, x) in enumerate(zip(motions, effects, own, strict=True)):
        if motion is None or not effect.shape[1] or not np.isfinite(effect).all():
            found.append(x)
            continue
        _, sizes, directions = np.linalg.svd(effect, full_matrices=False)
        new = ResolvedMotion(motion.log, directions[sizes > RESOLVED].T)
        k = motion.directions.shape[1]
        predictor.set_motion(i, new)
        found.append(np.concatenate([new.directions.T @ motion.whole(x[:k]), x[k:]]))
    return found


def _effects(
    predictor: Predictor,
    plant: Plant,
    nuisance: dict[str, float],
    own: Sequence[np.ndarray],
    directions: Sequence[np.ndarray],
) -> list[np.ndarray]:
    """Return by how many standard errors the K readings of each recording change along directions (C, D) of its
    motion, (K, D)."""
    before, found = _motions(predictor), [[] for _ in directions]
    try:
        for first in range(0, max(x.shape[1] for x in directions), _AT_ONCE):
            at = []
            for i, (motion, x) in enumerate(zip(before, own, strict=True)):
                if motion is None:
                    at.append(x)
                    continue
                k, some = motion.directions.shape[1], directions[i][:, first : first + _AT_ONCE]
                predictor.set_motion(i, ResolvedMotion(motion.log, some, motion.whole(x[:k])))
                at.append(np.concatenate([np.zeros(some.shape[1]), x[k:]]))
            for i, p in enumerate(predictor(plant, nuisance, at, derivatives=True)):
                some = directions[i][:, first : first + _AT_ONCE].shape[1]
                weight = np.sqrt(predictor.sharing[i]) / predictor.sigma[i]  # cameras that share a log: see `Problem`
                found[i].append(p.by_own[:, :some] * weight[:, None])
    finally:
        for i, motion in enumerate(before):
            if motion is not None:
                predictor.set_motion(i, motion)
    return [np.hstack(x) for x in found]


def _motions(predictor: Predictor) -> list[ResolvedMotion | None]:
    """Return the measured motion of each recording; None where the whip is moved otherwise."""
    every = [getattr(drive, "motion", None) for drive in predictor.drives]
    return [motion if isinstance(motion, ResolvedMotion) else None for motion in every]
