"""Corrections of a strike on its way: minimum-jerk submovements whose gains are computed before it begins.

A submovement begins at rest and ends at rest, as the strike does, so that position, velocity and acceleration of the
reference stay continuous whenever it begins; people's corrections of reaching movements have this form (Henis and
Flash 1995, Biol. Cybern., doi:10.1007/s004220050143). One number a joint says all about it, and its largest velocity
and acceleration are closed forms.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from whiptool.correction.disturbances import Disturbances
from whiptool.correction.linear import Estimate, Estimator, LinearStrike, Sensing, across
from whiptool.correction.rolled import INTERVAL, AnyStart, Begun, Paths, Submovements
from whiptool.errors import InputError, expect
from whiptool.impedance.controller import Controller
from whiptool.models.numbers import number, whole
from whiptool.models.parameters import Model
from whiptool.models.spatial_arm import JointLimits
from whiptool.models.strike import Strike

USUAL, MOST = 5, 8  # corrections of a strike
SIZE = 0.1  # [rad or m] of corrections for which the linear model is judged
SHORTEST = 0.15  # [s] of a submovement
_AROUND = 0.1  # [s] about the planned hit in which the closest approach is looked for
_COST = 0.02  # [m] of miss that one radian of each joint has to be worth
_SHARES = (0.0, 0.25, 0.5, 1.0)  # of corrections, the best of which is made
_PASSES = 3  # of finding the closest approach and the correction there
_FIRST, _LATER = 4, 2  # passes of the first estimate of a strike, and of those that begin from it


@dataclass(frozen=True, eq=False)
class Decision:
    """What is known beforehand of one instant at which a strike may be corrected.

    Args:
        at, lasts: When the correction begins, and how long it lasts [s].
        estimator: The estimate at that instant.
        tip: Derivatives of the tip by the correction, (S, d, a).
        doubt: Error of the linear miss by a correction of each joint as large as `SIZE`, per size [m/rad or m/m], (a,).
        change: Derivatives of position, velocity, acceleration of the reference and of the torque by the correction,
            (S, 4 a, a).
    """

    at: float
    lasts: float
    estimator: Estimator
    tip: np.ndarray
    doubt: np.ndarray
    change: np.ndarray


Policy = Callable[[int, Estimate, np.ndarray], np.ndarray]


class Corrector:
    """Corrections of one planned strike, with gains that are computed beforehand.

    Args:
        linear: The planned strike, linearised.
        sensing: What is measured, and how late; default: `Sensing()`.
        start: Share of the time until the hit after which the strike may be corrected, 0 to 0.95.
        count: Number of corrections, which follow each other faster towards the hit.

    Raises:
        InputError: A number is out of range.
    """

    def __init__(
        self, linear: LinearStrike, *, sensing: Sensing | None = None, start: float = 0.2, count: int = USUAL
    ) -> None:
        expect(LinearStrike, linear=linear)
        self.linear, self.sensing, self.simulator = linear, sensing or Sensing(), linear.simulator
        count = whole("count", count, low=1, high=MOST)
        start = number("start", start, low=0, high=0.95)
        strike, hit_at = linear.strike, linear.hit_at
        left = (1 - start) * hit_at * (1 - np.arange(count) / count) ** 2
        times = INTERVAL * np.round((hit_at - left) / INTERVAL)
        around = round(_AROUND / INTERVAL)
        hit, end = round(hit_at / INTERVAL), len(linear.states)
        self.window = slice(max(hit - around, 0), min(hit + around, end))
        self._low, self._high, self._now = self._bounds(strike)
        self.decisions = [self._decision(float(at), max(strike.D - at, SHORTEST)) for at in times]

    def _bounds(self, strike: Strike) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Lowest and highest position, velocity, acceleration and torque (4 a,), and the strike's own (S, 4 a)."""
        t = INTERVAL * np.arange(len(self.linear.states))
        begun = Begun(strike, self.linear.states[:1], self.linear.none, self.linear.lasts)
        tau = self.simulator.rows(begun, "tau")[0]
        arm, a = self.simulator.model.arm, self.simulator.model.arm.n
        limits = getattr(arm, "joint_limits", None) or (JointLimits(),) * a
        low, high = np.array([x.position for x in limits]).T
        largest = [[getattr(x, name) for x in limits] for name in ("fastest", "acceleration", "torque")]
        most = np.ravel(largest)
        now = np.hstack([*strike.reference(t), tau])
        # a strike that is beyond a limit itself is not taken farther
        return np.minimum(np.r_[low, -most], now.min(axis=0)), np.maximum(np.r_[high, most], now.max(axis=0)), now

    def _decision(self, at: float, lasts: float) -> Decision:
        a, linear = self.simulator.model.arm.n, self.linear
        t = INTERVAL * np.arange(len(linear.states))
        share = np.stack(Strike((0.0,), (1.0,), lasts).reference(t - at))[..., 0]  # (3, S)
        change = np.zeros((len(t), 4, a, a))
        change[:, :3] = share.T[:, :, None, None] * np.eye(a)
        sizes = np.concatenate([-np.eye(a), np.eye(a)])[:, None] * SIZE
        added = Submovements(np.full((2 * a, 1), at), np.full((2 * a, 1), lasts), sizes)
        begun = Begun(linear.strike, np.tile(linear.states[0], (2 * a, 1)), added, linear.lasts)
        ends = self.simulator.rows(begun, "tau").reshape(2, a, len(t), a)
        change[:, 3] = ((ends[1] - ends[0]) / (2 * SIZE)).transpose(1, 2, 0)
        hit = round(linear.hit_at / INTERVAL)
        tips = self.simulator.paths(begun, linear.target).tip[:, hit] - (linear.planned.tip - linear.offset[0])[0, hit]
        bent = tips.reshape(2, a, -1).mean(axis=0) @ linear.across.T  # of second order
        doubt = np.linalg.norm(bent, axis=1) / SIZE
        estimator, slopes = Estimator(linear, self.sensing, at), linear.of_submovements(at, lasts)
        return Decision(at, lasts, estimator, slopes, doubt, change.reshape(len(t), 4 * a, a))

    def added(self, sizes: np.ndarray) -> Submovements:
        """Return the first corrections as submovements, from their sizes (B, k, a)."""
        B, k = sizes.shape[:2]
        times = np.array([[x.at, x.lasts] for x in self.decisions[:k]]).reshape(k, 2)
        return Submovements(np.tile(times[:, 0], (B, 1)), np.tile(times[:, 1], (B, 1)), sizes)

    def estimate(
        self, k: int, tip: np.ndarray, arm: np.ndarray, sizes: np.ndarray, z: np.ndarray | None = None
    ) -> Estimate:
        """Return the estimates of what disturbs B strikes at decision k, which begin from those of the decision before.

        Args:
            k: Number of the decision, from 0.
            tip: Filmed tips at all instants of a path (B, S, d) [m], of which only those that are at hand are read.
            arm: Ends of the arm's links by the joint log, (B, S, a, d) [m].
            sizes: Corrections that were made before, (B, k, a) [rad or m].
            z: Means of the estimate before, (B, m); None: none.
        """
        first = np.zeros((len(tip), self.linear.tip.shape[2])) if z is None else z
        lasts, passes = (self.window.stop - 1) * INTERVAL, _FIRST if z is None else _LATER
        arm = arm.reshape(*arm.shape[:2], -1)
        return self.decisions[k].estimator.estimate(tip, arm, self.added(sizes), first, lasts, passes)

    def correction(self, k: int, estimate: Estimate, sizes: np.ndarray) -> np.ndarray:
        """Return the correction of each strike at decision k that cancels the part of its predicted miss that is known,
        (B, a) [rad or m], within the joints' limits, or as much of it as brings the estimated strike nearest.

        Args:
            k: Number of the decision.
            estimate: See `estimate`.
            sizes: Corrections that were made before, (B, k, a).
        """
        path, by = estimate.tip[:, self.window], np.zeros((len(sizes), len(self.decisions) - k, sizes.shape[2]))
        effects = np.stack([x.tip[self.window] for x in self.decisions[k:]], axis=2)
        for _ in range(_PASSES):
            by = self.solved(k, path + np.einsum("wdja,bja->bwd", effects, by), effects, by, estimate)
        return self.tried(k, by, estimate, sizes)

    def solved(self, k: int, path: np.ndarray, effects: np.ndarray, by: np.ndarray, estimate: Estimate) -> np.ndarray:
        """Return this and later corrections that cancel the known part of a predicted miss, by least squares.

        What corrections do to the miss is linear only while they are small: their `doubt` counts as a miss, and what
        another correction does better is left to it.

        Args:
            k: Number of the decision.
            path: Predicted tips at the instants of `window` with the corrections `by`, (B, W, d) [m].
            effects: Derivatives of these tips by the corrections, (W, d, J, a), or (B, W, d, J, a).
            by: Corrections of decisions k to the last, (B, J, a) [rad or m].
            estimate: By which the tips were predicted.

        Returns:
            Corrections, (B, J, a).
        """
        B, J, a = by.shape
        rows, target = np.arange(B), self.linear.target
        nearest = np.linalg.norm(path - target, axis=2).argmin(axis=1)
        sideways = across(path, nearest)  # (B, d - 1, d)
        there = np.broadcast_to(effects, (*path.shape, J, a))[rows, nearest]  # (B, d, J, a)
        away = path[rows, nearest] - target - np.einsum("bdja,bja->bd", there, by)
        miss = np.einsum("bcd,bd->bc", sideways, away)
        spread = sideways @ estimate.slopes[:, self.window][rows, nearest]
        unknown = np.einsum("bcm,bmn,bcn->b", spread, estimate.covariance, spread) * np.maximum(estimate.doubt, 1)
        known = np.maximum(1 - unknown / np.maximum((miss**2).sum(axis=1), 1e-12), 0)
        slope = (sideways @ there.reshape(B, -1, J * a)).transpose(0, 2, 1)
        cost = np.concatenate([x.doubt for x in self.decisions[k:]])
        inner = slope @ slope.transpose(0, 2, 1) + np.diag(cost**2 + _COST**2)
        return -np.linalg.solve(inner, slope @ (known[:, None] * miss)[..., None]).reshape(B, J, a)

    def tried(self, k: int, by: np.ndarray, estimate: Estimate, sizes: np.ndarray) -> np.ndarray:
        """Return the correction of decision k, (B, a), within the limits, and as large a share of it as simulated best.

        Args:
            k, estimate, sizes: As in `correction`.
            by: Corrections of decisions k to the last, (B, J, a) [rad or m]; shares of them are simulated.
        """
        B, window, count = len(by), self.window, len(_SHARES)
        by = np.concatenate([by[:, :1] * self.allowed(k, by[:, 0], sizes)[:, None, None], by[:, 1:]], axis=1)
        every = np.concatenate([np.concatenate([sizes, share * by], axis=1) for share in _SHARES])
        z, lasts = np.concatenate([estimate.z] * count), (window.stop - 1) * INTERVAL
        tips = self.linear.paths(z, self.added(every), lasts).tip[:, window]
        nearest = np.linalg.norm(tips - self.linear.target, axis=2).min(axis=1).reshape(count, B)
        best = np.where(np.isfinite(nearest), nearest, np.inf).argmin(axis=0)  # what diverges is not finite
        return np.array(_SHARES)[best, None] * by[:, 0]

    def allowed(self, k: int, by: np.ndarray, sizes: np.ndarray) -> np.ndarray:
        """Largest share of corrections (B, a) within the limits, (B,), at most 1."""
        now = np.repeat(self._now[None], len(by), axis=0)
        for i in range(k):
            now += np.einsum("sja,ba->bsj", self.decisions[i].change, sizes[:, i])
        step = np.einsum("sja,ba->bsj", self.decisions[k].change, by)
        room = np.where(step > 0, self._high - now, now - self._low)
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.where(np.abs(step) > 1e-12, np.maximum(room, 0) / np.abs(step), np.inf)
        return np.minimum(share.min(axis=(1, 2)), 1.0)

    def struck(
        self,
        truth: Callable[[Submovements], Paths],
        noise: tuple[np.ndarray, np.ndarray],
        policy: Policy | None = None,
    ) -> tuple[Paths, Submovements]:
        """Strike with corrections: at each decision, what was measured until then decides.

        Args:
            truth: Returns the true paths of B strikes with submovements that are added to them.
            noise: Noise of the filmed tips (B, S, d) and of the arm's ends (B, S, a, d) [m].
            policy: Returns the corrections (B, a) of a decision, with the arguments of `correction`, the default.

        Returns:
            The true paths, and the corrections.
        """
        a, B = self.simulator.model.arm.n, len(noise[0])
        sizes = np.zeros((B, 0, a))
        paths, z = truth(self.added(sizes)), None
        for k in range(len(self.decisions)):
            estimate = self.estimate(k, paths.tip + noise[0], paths.arm + noise[1], sizes, z)
            by, z = (policy or self.correction)(k, estimate, sizes), estimate.z
            if not np.isfinite(by).all():
                raise InputError("correction", "not finite", "finite numbers", "the simulated strike diverged")
            sizes = np.concatenate([sizes, by[:, None]], axis=1)
            paths = truth(self.added(sizes))
        return paths, self.added(sizes)


def correct(
    model: Model,
    strike: Strike,
    target: object,
    *,
    controller: Controller | None = None,
    expected: Disturbances | None = None,
    sensing: Sensing | None = None,
    start: float = 0.2,
) -> Corrector:
    """Return the corrections of a planned strike, with all gains; see `LinearStrike` and `Corrector` for the arguments.

    Nothing is sent to a robot: corrections are for simulations.

    Raises:
        InputError: A number is out of range, or the controller does not control the joints.
    """
    return Corrector(LinearStrike(AnyStart(model, controller), strike, target, expected), sensing=sensing, start=start)
