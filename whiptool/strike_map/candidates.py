"""Candidates: what the nearest answers make of a goal, to first order."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from whiptool.goals.goals import Goals
from whiptool.strike_map.answers import Answers
from whiptool.strike_map.corrections import correct
from whiptool.strike_map.striker import Striker
from whiptool.strike_map.turning import Front

INSTANT = 0.02  # [s]: by it changes of the instant are measured, as those of a strike are by the box's widths
SHORTLIST = 64  # answers nearest to a goal that are corrected
_CHANGE = 0.2  # in widths, that counts as much against a candidate as a miss of a hit radius


@dataclass(frozen=True, eq=False)
class Candidates:
    """C strikes that may hit one goal, sorted by the score `doubt`, the best first.

    Args:
        strikes: Strike vectors, (C, m).
        slopes: Derivatives of the goal's residuals at the map entries from which they were computed, (C, r, m).
        change: Difference from these entries, (C, m + 1): of the m coordinates relative to the width of their bounds,
            then of the time of contact relative to `INSTANT`, 0.02 s.
        left: Remaining residual to first order, in units of the hit radius, (C,).
    """

    strikes: np.ndarray
    slopes: np.ndarray
    change: np.ndarray
    left: np.ndarray

    @property
    def doubt(self) -> np.ndarray:
        """Score of each candidate, the smaller the better: distance from its map entry plus remaining residual,
        (C,)."""
        return np.linalg.norm(self.change, axis=1) / _CHANGE + self.left

    def take(self, which: np.ndarray | slice) -> Candidates:
        """Return a selection of the candidates."""
        return Candidates(*(getattr(self, f.name)[which] for f in fields(self)))


def candidates(
    striker: Striker, answers: Answers, front: Front, goal: Goals, *, shortlist: int = SHORTLIST
) -> Candidates:
    """Return candidates for one goal (B = 1): the nearest map entries, each corrected to first order.

    Args:
        striker: Simulator of strikes, for their box.
        answers: Map entries, rotated to the front.
        front: Rotates goals to the front, and strikes back.
        goal: The goal, not rotated.
        shortlist: Number of entries that are corrected.
    """
    angle = front.angles(goal.positions)
    nearest = answers.take(answers.shortlist(front.goals(goal, -angle), shortlist))
    near = front.answers(nearest, np.repeat(angle, len(nearest)))
    residuals = goal.residuals(near.tips, near.velocities)
    slopes = goal.residual_slopes(near.velocities, near.tip_slopes, near.velocity_slopes)
    any_instant = np.full((len(near), 1), np.inf)
    room = (
        np.hstack([striker.lower - near.strikes, -any_instant]),
        np.hstack([striker.upper - near.strikes, any_instant]),
    )
    widths = np.append(striker.widths, INSTANT)
    change, left = correct(residuals, slopes, room, widths)
    corrected = striker.admissible(near.strikes + change[:, :-1])
    of_strikes = slopes[:, :, :-1] + slopes[:, :, -1:] * _instants(near)[:, None, :]
    found = Candidates(corrected, of_strikes, change / widths, left / goal.hit_radius)
    return found.take(np.argsort(found.doubt, kind="stable"))


def _instants(answers: Answers) -> np.ndarray:
    """Return by how much strikes shift the instant at which the tip is closest to a place that it hits, (K, m)."""
    v, by_strike = answers.velocities, answers.tip_slopes[:, :, :-1]
    return -np.einsum("kd,kdm->km", v, by_strike) / np.einsum("kd,kd->k", v, v)[:, None]


def features(striker: Striker, front: Front, goal: Goals, candidates: Candidates) -> np.ndarray:
    """Return the features of each candidate for one goal, (C, f): goal, strike, change, and residual."""
    angle = -front.angles(goal.positions)
    ahead, count = front.goals(goal, angle), len(candidates.strikes)
    strikes = front.strikes(candidates.strikes, np.repeat(angle, count))
    of_goal = [ahead.positions / striker.rollout.model.reach]
    of_goal += [] if ahead.directions is None else [ahead.directions]
    parts = [np.repeat(np.hstack(of_goal), count, axis=0), 2 * (strikes - striker.lower) / striker.widths - 1]
    parts += [np.tanh(candidates.change), np.log(candidates.doubt + 1e-3)[:, None], np.tanh(candidates.left)[:, None]]
    return np.hstack(parts)
