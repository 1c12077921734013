"""A strike map: the strike for any goal of a region, without a search."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np

from whiptool.errors import InputError
from whiptool.goals.arrival_rule import GoalRegion
from whiptool.goals.goals import Goals
from whiptool.goals.target import Target, as_target
from whiptool.models.strike import Strike
from whiptool.strike_map.answers import Answers
from whiptool.strike_map.candidates import Candidates, candidates, features
from whiptool.strike_map.corrections import Refined, finished, refine
from whiptool.strike_map.gate import Gate
from whiptool.strike_map.striker import Striker
from whiptool.strike_map.turning import Front

TRIED = 8  # candidates that are looked at at most, of a strike in one shot
REFINED = 32  # candidates that are refined at most, one after the other: few goals need more than one


class StrikeMap:
    """A strike map: entries (strikes with derivatives), and a network that ranks the candidates for a goal.

    Args:
        striker: Simulator of strikes.
        region: Region of the goals that the map was built for.
        answers: Entries of the map, rotated about the vertical to the front.
        gate: Ranking network; None: candidates are ranked by `Candidates.doubt`.
    """

    def __init__(self, striker: Striker, region: GoalRegion, answers: Answers, gate: Gate | None = None) -> None:
        self.striker, self.region, self.answers, self.gate = striker, region, answers, gate
        self.front = Front(striker.rollout.model)

    def __repr__(self) -> str:
        chosen = "without a gate" if self.gate is None else "with a gate"
        return f"StrikeMap({self.striker.rollout.model.name}, {len(self.answers)} answers, {chosen})"

    def goal(self, target: Target | Sequence[float]) -> Goals:
        """Return the goal of a target in the map's region; any direction and speed are allowed.

        Raises:
            InputError: The target is outside the map's region.
        """
        asked, zone = as_target(target), self.region.zone
        if len(asked.position) != zone.dimension:
            raise InputError("target", asked.position, f"{zone.dimension} coordinates, as the model has")
        if not zone.contains(np.array(asked.position)):
            raise InputError("target", asked.position, f"one of the map's region, {zone}")
        return asked.goals

    def strike(self, target: Target | Sequence[float], *, refined: bool = True) -> Strike:
        """Return the strike for a target; warns if it misses or exceeds the limits.

        Args:
            target: Target in the map's region; its hit radius may differ from the map's.
            refined: Whether the strike is refined by simulation; otherwise simulation only checks the limits.

        Raises:
            InputError: The target lies outside the map's region.
        """
        goal = self.goal(target)
        if refined:
            found = self.refined(goal)
            strike, good = found.strikes[0], bool(found.struck.hit[0])
        else:
            strike = self.kept(goal)[0]
            good = bool(self.striker.keep(strike[None])[0])
        if not good:
            what = "hits within the limits" if refined else "keeps the limits"
            warnings.warn(f"none of the map's strikes {what} at {as_target(target)}", stacklevel=2)
        return Strike.from_vector(strike)

    def candidates(self, goal: Goals) -> Candidates:
        """Return candidates for one goal (B = 1), the best first."""
        found = candidates(self.striker, self.answers, self.front, goal)
        unlike_trained = (goal.directions is None) == self.region.rule.directed
        if self.gate is None or unlike_trained:
            return found
        odds = self.gate.odds(features(self.striker, self.front, goal, found))
        return found.take(np.argsort(-odds, kind="stable"))

    def strikes(self, goals: Goals) -> np.ndarray:
        """Return one strike for each goal, (B, m), without simulation."""
        return self._taken(self._candidates(goals, 1), 0)

    def kept(self, goals: Goals, *, tried: int = TRIED) -> np.ndarray:
        """Return for each goal the best candidate that keeps all limits in simulation, (B, m).

        Args:
            goals: B goals.
            tried: Largest number of candidates to check for each goal; if none keeps the limits, the best one is
                returned.
        """
        found = self._candidates(goals, tried)
        chosen = self._taken(found, 0)
        left = np.arange(len(found))
        for turn in range(tried):
            left = left[[len(found[i].strikes) > turn for i in left]]
            strikes = self._taken([found[i] for i in left], turn)
            keep = self.striker.keep(strikes)
            chosen[left[keep]] = strikes[keep]
            left = left[~keep]
        return chosen

    def refined(self, goals: Goals, *, tried: int = REFINED) -> Refined:
        """Return strikes refined from one candidate after the other until they hit within `TOLERANCE`.

        Args:
            goals: B goals.
            tried: Largest number of candidates to refine for each goal.
        """
        found = self._candidates(goals, tried)
        best = self._refined(goals, found, np.arange(len(found)), 0)
        for turn in range(1, tried):
            enough = finished(best.struck) if turn < TRIED else best.struck.hit
            left = [i for i in np.flatnonzero(~enough) if len(found[i].strikes) > turn]
            if not left:
                break
            rows = np.array(left)
            best = best.improved(rows, self._refined(goals, found, rows, turn))
        return best

    def _candidates(self, goals: Goals, count: int) -> list[Candidates]:
        """Return the best candidates for each goal."""
        return [self.candidates(goals.rows(np.array([i]))).take(slice(count)) for i in range(len(goals.positions))]

    def _refined(self, goals: Goals, found: Sequence[Candidates], rows: np.ndarray, turn: int) -> Refined:
        """Return what refinement makes of each goal's candidate whose turn it is."""
        starts = self._taken([found[i] for i in rows], turn)
        slopes = np.array([found[i].slopes[turn] for i in rows])
        return refine(self.striker, goals.rows(rows), starts, slopes)

    def _taken(self, found: Sequence[Candidates], turn: int) -> np.ndarray:
        """Return of each goal's candidates the one whose turn it is, (B, m), also of no goals."""
        return np.array([each.strikes[turn] for each in found]).reshape(-1, len(self.striker.lower))
