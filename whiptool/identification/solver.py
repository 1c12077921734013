"""Levenberg-Marquardt for many recordings, with shared and separate unknowns, Huber's loss, and bounds.

The Jacobian has the shape of an arrow: the separate unknowns of a recording only affect its readings. Each block is
reduced by an orthogonal factorisation. The computing time is then linear in the number of recordings, and the condition
number is not squared, so that flat directions are found at full precision.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from scipy.linalg import solve_triangular

MAX_ITERATIONS = 300
_SETTLING = 10  # steps over which shared unknowns have to stay, where recordings have their own unknowns
_STILL = 10.0  # times the tolerance: square of the standard errors by which they may move meanwhile, usually 0.01
_FLAT = 5e4  # times the tolerance: by which the cost may fall per mean squared residual, usually one standard error
TOLERANCE = 1e-5  # predicted decrease of the cost per mean squared residual: a step of 0.004 standard errors


# Marquardt's damping: its first value, the smallest, which prevents steps along flat directions, and the largest, below
# which a step has to lower the cost
_FIRST, _LEAST, _MOST = 1e-3, 1e-9, 1e12
_LARGEST = 1e50  # of a derivative: beyond, the path has become unpredictable


class Ending(Enum):
    """Reason why the solver stopped."""

    CONVERGED = "the cost no longer decreases"
    SETTLED = "the shared parameters have converged; those of single recordings still change along a flat direction"
    STEPS = "the largest number of iterations was reached"
    STUCK = "no step lowers the cost"
    DIVERGED = "the model cannot be evaluated at the start"


@dataclass(frozen=True)
class Block:
    """Whitened residuals r (K,) of one recording, and their derivatives: A (K, G) by the unknowns that all recordings
    share, B (K, L) by this recording's own unknowns."""

    r: np.ndarray
    A: np.ndarray
    B: np.ndarray


@dataclass
class Solution:
    """Result of the solver. Its `history` has the cost, the damping and the length of the step in z, at the start and
    after each accepted step."""

    z: np.ndarray  # shared unknowns, (G,)
    own: list[np.ndarray]  # own unknowns of each recording, (L,)
    cost: float  # half the sum of the loss
    status: Ending  # reason why the solver stopped
    history: list[tuple[float, float, float]] = field(default_factory=list)
    evaluations: int = 0  # of the model, with or without derivatives


Evaluate = Callable[[np.ndarray, list[np.ndarray], bool], list[Block]]


def huber(r: np.ndarray, limit: float | None) -> tuple[float, np.ndarray]:
    """Return half the sum of Huber's loss of residuals r (K,), quadratic up to `limit` and linear above, and their
    weights (K,).
    """
    size = np.abs(r)
    if limit is None:
        return float(r @ r) / 2, np.ones_like(r)
    inside = size <= limit
    cost = np.where(inside, r**2 / 2, limit * (size - limit / 2)).sum()
    return float(cost), np.where(inside, 1.0, limit / np.maximum(size, limit))


@dataclass(frozen=True)
class Loss:
    """Loss of the residuals of all blocks. Huber's loss is that of the first `robust` residuals of each block (default:
    all); the others have least squares."""

    limit: float | None = None  # residual at which Huber's loss becomes linear, in standard errors; None: least squares
    robust: Sequence[int] | None = None

    def of(self, blocks: Sequence[Block]) -> tuple[float, list[np.ndarray]]:
        """Return the cost, half the sum of the loss, and the weights of each block's residuals, (K,) each.

        The cost is infinite if a residual or derivative is not finite or too large.
        """
        total, weights = 0.0, []
        for i, block in enumerate(blocks):
            count = len(block.r) if self.robust is None or i >= len(self.robust) else self.robust[i]
            part, w = huber(block.r[:count], self.limit)
            rest = block.r[count:]
            total += part + float(rest @ rest) / 2
            weights.append(np.concatenate([w, np.ones(len(rest))]))
        usable = np.isfinite(total) and all(np.abs(x).max(initial=0) < _LARGEST for b in blocks for x in (b.A, b.B))
        return total if usable else np.inf, weights


def reduce(block: Block, damping: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Reduce the matrix [B A r] of a recording's block to triangular form, which eliminates its own L unknowns, damped
    by the diagonal `damping` (L,). Return the first L rows, (L, L + G + 1), and the remaining rows without the columns
    of these unknowns, (at most G + 1, G + 1)."""
    L = block.B.shape[1]
    rows = np.hstack([block.B, block.A, block.r[:, None]])
    if damping is not None:
        rows = np.vstack([rows, np.hstack([np.diag(damping), np.zeros((L, rows.shape[1] - L))])])
    R = np.asarray(np.linalg.qr(rows, mode="r"))
    return R[:L], R[L:, L:]


def weigh(block: Block, w: np.ndarray) -> Block:
    """Return the block with its squared residuals weighted by w (K,)."""
    s = np.sqrt(w)[:, None]
    return Block(block.r * s[:, 0], block.A * s, block.B * s)


def solve(
    evaluate: Evaluate,
    z: np.ndarray,
    own: Sequence[np.ndarray],
    *,
    lower: np.ndarray,
    upper: np.ndarray,
    loss: Loss = Loss(),
    max_iterations: int = MAX_ITERATIONS,
    tolerance: float = TOLERANCE,
) -> Solution:
    """Minimise the loss of all blocks from a starting point inside the bounds: shared unknowns z (G,), and each
    recording's own unknowns (L,). `evaluate` returns the blocks there, with derivatives or without (A and B are then
    ignored).

    Marquardt's damping is scaled by the norms of the Jacobian's columns; its factor follows Nielsen (1999). A shared
    unknown at a bound is fixed for one step if the cost decreases beyond the bound. The solver stops if the predicted
    decrease of the cost, per mean squared residual, is at most `tolerance`, or if the shared unknowns are constant and
    only those of single recordings change along a flat valley of the cost (`Ending.SETTLED`); `status` says why, also
    if no step was possible.
    """
    search = _Search(evaluate, loss, (lower, upper), tolerance, [len(x) for x in own])
    here = search.point(np.clip(z, lower, upper), [np.array(x, float) for x in own], derivatives=True)
    if not np.isfinite(here.cost):
        return Solution(here.z, here.own, np.inf, Ending.DIVERGED, evaluations=search.evaluations)
    history, steps = [(here.cost, search.damping, 0.0)], [here.z]
    for _ in range(max_iterations):
        there = search.improved(here)
        if isinstance(there, Ending):
            return Solution(here.z, here.own, here.cost, there, history, search.evaluations)
        history.append((there.cost, search.damping, float(np.linalg.norm(there.z - here.z))))
        here = there if there.derivatives else search.point(there.z, there.own, derivatives=True)
        steps.append(here.z)
        if _have_settled(steps, [cost for cost, *_ in history], here, tolerance):
            return Solution(here.z, here.own, here.cost, Ending.SETTLED, history, search.evaluations)
    return Solution(here.z, here.own, here.cost, Ending.STEPS, history, search.evaluations)


@dataclass(frozen=True)
class _Point:
    """The model evaluated at unknowns: its blocks, their cost and weights, and whether derivatives were taken."""

    z: np.ndarray
    own: list[np.ndarray]
    blocks: list[Block]
    cost: float
    weights: list[np.ndarray]
    derivatives: bool


def _have_settled(steps: Sequence[np.ndarray], costs: Sequence[float], here: _Point, tolerance: float) -> bool:
    """Whether the shared unknowns have stayed where they are while the recordings' own moved along a flat valley;
    `steps` and `costs` are the shared unknowns and the cost after each accepted step, `here` is the last of them."""
    moved = np.ptp(steps[-_SETTLING - 1 :], axis=0)
    if len(steps) <= _SETTLING or not moved.any() or not any(len(x) for x in here.own):
        return False
    of_residuals = 2 * here.cost / sum(len(b.r) for b in here.blocks)
    if costs[-_SETTLING - 1] - costs[-1] > _FLAT * tolerance * of_residuals:
        return False
    weighted = [weigh(b, w) for b, w in zip(here.blocks, here.weights, strict=True)]
    G = len(here.z)
    R = np.vstack([reduce(block)[1] for block in weighted])[:, :G]
    variances = np.diag(np.linalg.pinv(R.T @ R)) * of_residuals
    return bool((moved**2 <= _STILL * tolerance * variances).all())


class _Search:
    """What one accepted step leaves to the next: damping and its growth, and the scales of the columns."""

    def __init__(
        self,
        evaluate: Evaluate,
        loss: Loss,
        bounds: tuple[np.ndarray, np.ndarray],
        tolerance: float,
        own_sizes: Sequence[int],
    ) -> None:
        self._evaluate, self._loss, self._tolerance = evaluate, loss, tolerance
        self._lower, self._upper = bounds
        self.damping: float = _FIRST
        self._growth: float = 2.0
        self._scale: np.ndarray = np.zeros(len(self._lower))
        self._own_scale: list[np.ndarray] = [np.zeros(size) for size in own_sizes]
        self.evaluations: int = 0

    def point(self, z: np.ndarray, own: list[np.ndarray], *, derivatives: bool) -> _Point:
        """Evaluate the model."""
        self.evaluations += 1
        blocks = self._evaluate(z, own, derivatives)
        cost, weights = self._loss.of(blocks)
        return _Point(z, own, blocks, cost, weights, derivatives)

    def improved(self, here: _Point) -> _Point | Ending:
        """Return a point of lower cost, or the reason why none was found.

        A first attempt mostly succeeds: its derivatives are taken at once.
        """
        weighted = [weigh(b, w) for b, w in zip(here.blocks, here.weights, strict=True)]
        self._scale_columns(weighted)
        room = self._room(here.z, weighted)
        negligible = self._tolerance * 2 * here.cost / sum(len(b.r) for b in here.blocks)
        first = True
        while self.damping < _MOST:
            try:
                step, own_step = _step(weighted, self.damping, self._scale, self._own_scale, *room)
            except np.linalg.LinAlgError:  # singular to machine precision: more damping mends it
                self._stiffen()
                continue
            trial = np.clip(here.z + step, self._lower, self._upper)
            foreseen = _foreseen(weighted, trial - here.z, own_step)
            if foreseen <= max(negligible, 1e-16 * here.cost):
                return Ending.CONVERGED
            trial_own = [x + d for x, d in zip(here.own, own_step, strict=True)]
            there = self.point(trial, trial_own, derivatives=first)
            first = False
            gain = (here.cost - there.cost) / foreseen
            if gain > 1e-4:
                self._relax(gain)
                return there
            self._stiffen()
        return Ending.STUCK

    def _scale_columns(self, blocks: list[Block]) -> None:
        """Let the scales grow to the norms of the columns."""
        norms = np.sqrt(sum((b.A**2).sum(axis=0) for b in blocks))
        self._scale = np.maximum(self._scale, norms)
        with_own = zip(self._own_scale, blocks, strict=False)  # the last block may have none: a prior
        self._own_scale = [np.maximum(s, np.linalg.norm(b.B, axis=0)) for s, b in with_own]

    def _room(self, z: np.ndarray, blocks: list[Block]) -> tuple[np.ndarray, np.ndarray]:
        """Return the bounds of the step; an unknown at a bound that its gradient pushes against has no room."""
        gradient = np.sum([b.A.T @ b.r for b in blocks], axis=0)
        held = ((z <= self._lower) & (gradient > 0)) | ((z >= self._upper) & (gradient < 0))
        return np.where(held, z, self._lower) - z, np.where(held, z, self._upper) - z

    def _relax(self, gain: float) -> None:
        """Lower the damping after a step that gained this share of the predicted decrease (Nielsen 1999)."""
        self.damping = max(self.damping * max(0.1, 1 - (2 * gain - 1) ** 3), _LEAST)
        self._growth = 2.0

    def _stiffen(self) -> None:
        """Raise the damping, each time in a row by twice the factor."""
        self.damping, self._growth = self.damping * self._growth, self._growth * 2


def _step(
    blocks: Sequence[Block],
    damping: float,
    scale: np.ndarray,
    own_scale: Sequence[np.ndarray],
    lowest: np.ndarray,
    highest: np.ndarray,
) -> tuple[np.ndarray, list[np.ndarray]]:
    """The damped Gauss-Newton step within bounds of the shared step; own unknowns are eliminated first."""
    heads, rows = [], []
    for i, block in enumerate(blocks):
        own = np.sqrt(damping) * own_scale[i] if i < len(own_scale) else np.zeros(0)
        head, rest = reduce(block, np.maximum(own, 1e-150))
        heads.append(head)
        rows.append(rest)
    G = len(scale)
    stacked = np.vstack(rows)
    J = np.vstack([stacked[:, :G], np.diag(np.sqrt(damping) * scale)])
    r = np.concatenate([stacked[:, G], np.zeros(G)])
    step, free = np.zeros(G), lowest < highest
    while free.any():  # what would cross a bound goes to it, and the others are solved for again
        step[free] = np.linalg.lstsq(J[:, free], -(r + J[:, ~free] @ step[~free]), rcond=None)[0]
        crosses = free & ((step < lowest) | (step > highest))
        if not crosses.any():
            break
        step[crosses] = np.clip(step, lowest, highest)[crosses]
        free &= ~crosses
    own_steps = []
    for i in range(len(own_scale)):
        head, L = heads[i], len(own_scale[i])
        right = -(head[:, L : L + G] @ step + head[:, -1])
        own_steps.append(np.asarray(solve_triangular(head[:, :L], right)) if L else np.zeros(0))
    return step, own_steps


def _foreseen(blocks: Sequence[Block], step: np.ndarray, own_steps: Sequence[np.ndarray]) -> float:
    """How far the cost would fall if the model were linear."""
    fall = 0.0
    for i, block in enumerate(blocks):
        change = block.A @ step + (block.B @ own_steps[i] if i < len(own_steps) else 0.0)
        fall -= float(block.r @ change + change @ change / 2)
    return fall
