"""A strike map, which returns a strike for any goal of a region without a search.

The entries nearest to a goal are corrected to first order, a network ranks these candidates, and simulation refines
them.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from whiptool.errors import InputError
from whiptool.extras import optional
from whiptool.goals.arrival_rule import GoalRegion
from whiptool.goals.goals import Goals
from whiptool.goals.target import Target, as_target
from whiptool.models.strike import Strike
from whiptool.progress import Progress
from whiptool.strike_map.answers import Answers, Front
from whiptool.strike_map.striker import Refined, Striker, correct, finished, refine

INSTANT = 0.02  # [s]: by it changes of the instant are measured, as those of a strike are by the box's widths
SHORTLIST = 64  # answers nearest to a goal that are corrected
_CHANGE = 0.2  # in widths, that counts as much against a candidate as a miss of a hit radius


@dataclass(frozen=True, eq=False)
class Candidates:
    """C strikes that may hit one goal, sorted by the score `doubt`, the best first."""

    strikes: np.ndarray  # strike vectors, (C, m)
    slopes: np.ndarray  # derivatives of the goal's residuals at the entries they come from, (C, r, m)
    change: np.ndarray  # from those entries: coordinates over their bounds' width, time over `INSTANT`, (C, m + 1)
    left: np.ndarray  # remaining residual to first order, in units of the hit radius, (C,)

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
    """Return candidates for a single goal: the `shortlist` nearest map entries, rotated from the front to the goal's
    direction and each corrected to first order.
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
    """Return f features of each candidate for one goal, (C, f): the goal, the strike, its change from the map entry,
    its score `doubt`, and its remaining residual.
    """
    angle = -front.angles(goal.positions)
    ahead, count = front.goals(goal, angle), len(candidates.strikes)
    strikes = front.strikes(candidates.strikes, np.repeat(angle, count))
    of_goal = [ahead.positions / striker.rollout.model.reach]
    of_goal += [] if ahead.directions is None else [ahead.directions]
    parts = [np.repeat(np.hstack(of_goal), count, axis=0), 2 * (strikes - striker.lower) / striker.widths - 1]
    parts += [np.tanh(candidates.change), np.log(candidates.doubt + 1e-3)[:, None], np.tanh(candidates.left)[:, None]]
    return np.hstack(parts)


HIDDEN = (256, 256)
_EPOCHS, _BATCH, _RATE, _DECAY = 40, 512, 1e-3, 1e-4
_HELD_OUT = 10  # every so many goals are held out


@dataclass(frozen=True, eq=False)
class Gate:
    """A trained ranking network (gate) that predicts which candidates hit: a multilayer perceptron, evaluated with
    NumPy.
    """

    weights: tuple[np.ndarray, ...]  # of each layer, (in, out), in single precision
    biases: tuple[np.ndarray, ...]  # of each layer, (out,), in single precision
    mean: np.ndarray  # of the features that it was trained on, (f,)
    scale: np.ndarray  # of these features, (f,)

    def odds(self, seen: np.ndarray) -> np.ndarray:
        """Return the log odds that candidates hit, (C,), from their features (C, f)."""
        x = _scaled(seen, self.mean, self.scale)
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            x = np.maximum(x @ weight + bias, 0.0)
        return (x @ self.weights[-1] + self.biases[-1])[:, 0].astype(float)

    @classmethod
    def trained(cls, seen: np.ndarray, hit: np.ndarray, *, seed: int, progress: bool = False) -> Gate:
        """Return a network trained by logistic regression on features (N, f) and on whether candidates hit, (N,)."""
        torch = optional("torch", "the gate of a strike map")
        from whiptool.rl.networks import Layers

        generator = torch.Generator().manual_seed(seed)
        mean, scale = seen.mean(axis=0), seen.std(axis=0) + 1e-6
        layers = Layers([seen.shape[1], *HIDDEN, 1], generator)
        x, y = torch.as_tensor(_scaled(seen, mean, scale)), torch.as_tensor(hit, dtype=torch.float32)
        optimizer = torch.optim.AdamW(layers.parameters(), lr=_RATE, weight_decay=_DECAY)
        steps = _EPOCHS * -(-len(x) // _BATCH)
        schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
        for _ in Progress(range(_EPOCHS), desc="gate", disable=not progress, leave=False):
            for rows in torch.randperm(len(x), generator=generator).split(_BATCH):
                loss = torch.nn.functional.binary_cross_entropy_with_logits(layers(x[rows])[0, :, 0], y[rows])
                optimizer.zero_grad()
                loss.backward()
                optimizer.step()
                schedule.step()
        weights, biases = (
            tuple(part.detach().numpy().squeeze(axis) for part in parts)
            for parts, axis in ((layers.weights, 0), (layers.biases, (0, 1)))
        )
        return cls(weights, biases, mean, scale)


def _scaled(seen: np.ndarray, mean: np.ndarray, scale: np.ndarray) -> np.ndarray:
    return ((seen - mean) / scale).astype(np.float32)


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
            raise InputError("target", asked.position, f"a target in the map's region, {zone}")
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
        """Return candidates for a single goal, the best first."""
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
        """Return for each of B goals the best candidate that keeps all limits in simulation, (B, m); if none of the
        best `tried` does, the best one.
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
        """Return strikes for B goals, each refined from one candidate after the other, at most `tried`, until it hits
        within `TOLERANCE`.
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
