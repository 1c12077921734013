"""Levenberg-Marquardt for many recordings: unknowns that all share, unknowns of each alone, Huber's loss, bounds.

The Jacobian has the shape of an arrow: a recording's own unknowns touch its readings only. Each block is reduced by an
orthogonal factorisation, so that the cost grows with the number of recordings and not with its cube, and that nothing
is squared: a flat direction stays visible at the accuracy of the numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from scipy.linalg import solve_triangular

MAX_ITERATIONS = 60
TOLERANCE = 1e-5  # foreseen fall of the cost per mean squared residual: a step of 0.004 standard errors


@dataclass(frozen=True)
class Damping:
    """Marquardt's damping.

    Args:
        start: Where it begins.
        least: Keeps flat directions still.
        most: No step lowers the cost beyond.
    """

    start: float = 1e-3
    least: float = 1e-9
    most: float = 1e12


_DAMPING = Damping()
_LARGEST = 1e50  # of a derivative: beyond, the path has become unpredictable


class Status(Enum):
    """How a solution ended."""

    CONVERGED = "the cost falls no more"
    STEPS = "the largest number of iterations was reached"
    STUCK = "no step lowers the cost"
    DIVERGED = "the model cannot be evaluated at the start"


@dataclass(frozen=True)
class Block:
    """Whitened residuals of one recording and their derivatives by shared (K, G) and own (K, L) unknowns."""

    r: np.ndarray
    A: np.ndarray
    B: np.ndarray


@dataclass
class Solution:
    """Where the solver ended.

    Args:
        z: Shared unknowns, (G,).
        own: Of each recording.
        cost: Half the sum of Huber's loss.
        status: Why it ended.
        history: Of each accepted step: cost, damping, length of the step in z.
        evaluations: Of the model, with or without derivatives.
    """

    z: np.ndarray
    own: list[np.ndarray]
    cost: float
    status: Status
    history: list[tuple[float, float, float]] = field(default_factory=list)
    evaluations: int = 0


Evaluate = Callable[[np.ndarray, list[np.ndarray], bool], list[Block]]


def huber(r: np.ndarray, limit: float | None) -> tuple[float, np.ndarray]:
    """Half the sum of the loss, and the weight of each residual: quadratic to `limit`, linear beyond (Huber 1964)."""
    size = np.abs(r)
    if limit is None:
        return float(r @ r) / 2, np.ones_like(r)
    inside = size <= limit
    cost = np.where(inside, r**2 / 2, limit * (size - limit / 2)).sum()
    return float(cost), np.where(inside, 1.0, limit / np.maximum(size, limit))


@dataclass(frozen=True)
class Loss:
    """What is minimised, of the residuals of all blocks.

    Args:
        limit: Where Huber's loss turns linear, in standard errors; None: least squares.
        robust: How many residuals of each block it is for, the first ones; default: all.
    """

    limit: float | None = None
    robust: Sequence[int] | None = None

    def of(self, blocks: Sequence[Block]) -> tuple[float, list[np.ndarray]]:
        """Return the cost, infinite where it or a derivative is beyond all bounds, and the weights of each block."""
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
    """The block's rows [B A r] in triangular form: the first L rows, for its own unknowns, and the rest without them.

    Returns:
        (L, L + G + 1) and (G + 1 or fewer, G + 1).
    """
    L = block.B.shape[1]
    rows = np.hstack([block.B, block.A, block.r[:, None]])
    if damping is not None:
        rows = np.vstack([rows, np.hstack([np.diag(damping), np.zeros((L, rows.shape[1] - L))])])
    R = np.asarray(np.linalg.qr(rows, mode="r"))
    return R[:L], R[L:, L:]


def weigh(block: Block, w: np.ndarray) -> Block:
    """The block with its residuals weighted by w (K,) in the squares."""
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
    """Minimise the loss of all blocks from a start inside the bounds.

    Marquardt's damping scales with the columns; the factor follows Nielsen (1999). A shared unknown at a bound that
    its gradient pushes against is held for one step.

    Args:
        evaluate: Blocks at (z, own), with derivatives or without (A and B are then ignored).
        z, own: Start.
        lower, upper: Bounds of z, (G,).
        loss: What is minimised.
        max_iterations: At most.
        tolerance: It ends where the cost would fall by no more than this, per mean squared residual.
    """
    z, own = np.clip(z, lower, upper), [np.array(x, float) for x in own]
    evaluations = 1
    blocks = evaluate(z, own, True)
    cost, weights = loss.of(blocks)
    if not np.isfinite(cost):
        return Solution(z, own, np.inf, Status.DIVERGED, evaluations=evaluations)
    damping, growth, history = _DAMPING.start, 2.0, [(cost, _DAMPING.start, 0.0)]
    scale = np.zeros(len(z))
    own_scale = [np.zeros(len(x)) for x in own]
    for _ in range(max_iterations):
        weighted = [weigh(b, w) for b, w in zip(blocks, weights, strict=True)]
        scale = np.maximum(scale, np.sqrt(sum((b.A**2).sum(axis=0) for b in weighted)))
        own_scale = [np.maximum(s, np.linalg.norm(b.B, axis=0)) for s, b in zip(own_scale, weighted, strict=False)]
        gradient = np.sum([b.A.T @ b.r for b in weighted], axis=0)
        held = ((z <= lower) & (gradient > 0)) | ((z >= upper) & (gradient < 0))
        negligible = tolerance * 2 * cost / sum(len(b.r) for b in blocks)
        accepted, ready, attempt = False, False, 0
        trial, trial_own, new_blocks, new_cost, new_weights = z, own, blocks, cost, weights
        while damping < _DAMPING.most:
            room = np.where(held, z, lower) - z, np.where(held, z, upper) - z
            try:
                step, own_step = _step(weighted, damping, scale, own_scale, *room)
            except np.linalg.LinAlgError:  # singular to machine precision: more damping mends it
                damping, growth = damping * growth, growth * 2
                continue
            trial = np.clip(z + step, lower, upper)
            trial_own = [x + d for x, d in zip(own, own_step, strict=True)]
            foreseen = _foreseen(weighted, trial - z, own_step)
            if foreseen <= max(negligible, 1e-16 * cost):
                return Solution(z, own, cost, Status.CONVERGED, history, evaluations)
            evaluations += 1
            ready = attempt == 0  # a first attempt mostly succeeds: take its derivatives at once
            new_blocks = evaluate(trial, trial_own, ready)
            new_cost, new_weights = loss.of(new_blocks)
            attempt += 1
            gain = (cost - new_cost) / foreseen
            if gain > 1e-4:
                damping = max(damping * max(0.1, 1 - (2 * gain - 1) ** 3), _DAMPING.least)
                growth, accepted = 2.0, True
                break
            damping, growth = damping * growth, growth * 2
        if not accepted:
            return Solution(z, own, cost, Status.STUCK, history, evaluations)
        history.append((new_cost, damping, float(np.linalg.norm(trial - z))))
        z, own = trial, trial_own
        if not ready:
            evaluations += 1
            new_blocks = evaluate(z, own, True)
            new_cost, new_weights = loss.of(new_blocks)
        blocks, cost, weights = new_blocks, new_cost, new_weights
    return Solution(z, own, cost, Status.STEPS, history, evaluations)


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
        own_steps.append(solve_triangular(head[:, :L], right) if L else np.zeros(0))
    return step, own_steps


def _foreseen(blocks: Sequence[Block], step: np.ndarray, own_steps: Sequence[np.ndarray]) -> float:
    """How far the cost would fall if the model were linear."""
    fall = 0.0
    for i, block in enumerate(blocks):
        change = block.A @ step + (block.B @ own_steps[i] if i < len(own_steps) else 0.0)
        fall -= float(block.r @ change + change @ change / 2)
    return fall
