"""The objective of searches and learners: it simulates strikes, returns outcomes, and counts every trial."""

from __future__ import annotations

import math
import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from whiptool.errors import NOTHING, InputError, WhiptoolError, expect
from whiptool.goals.criteria import Criterion, StrikesAtGoal
from whiptool.goals.target import Target, as_target, usual_target
from whiptool.limits.all_limits import AllLimits, distance_beyond, limits_given
from whiptool.limits.clearance import Clearance
from whiptool.limits.limits import Limits, Smooth
from whiptool.models.hand_space import numbers_of
from whiptool.models.numbers import ArrayLike, NoArray, array_of, number, whole
from whiptool.models.strike import T_STAY, AnyStrike, StrikeBounds
from whiptool.models.trajectory import Approach, Trajectory
from whiptool.rollout.interface import Rollout, time_grid
from whiptool.words import counted

UNREACHABLE = "posture"  # what refuses a strike of the hand that no joints can make
RIG = "rig"  # a rig refused the strike before anything moved
_WHY_LOST = {
    "joint": "beyond the joints' limits",
    "motor": "beyond the motors' limits",
    "clearance": "would collide",
    UNREACHABLE: "beyond the arm's reach",
    RIG: "refused by the rig",
}


@dataclass(frozen=True)
class Arrival:
    """Arrival of the tip at a target that requires a direction or a speed.

    Args:
        angle: Angle between the tip's velocity and the required direction [rad], see `Target`; None: no direction is
            required.
        speed: Speed along the required direction [m/s]; without direction the tip's speed.
        cost: Cost that searches minimise instead of the miss distance [m], see `Goals.residuals`.
    """

    angle: float | None
    speed: float
    cost: float


@dataclass(frozen=True)
class Outcome(ArrayLike):
    """Outcome of one strike. `float(outcome)` is its `cost`, so `scipy.optimize.minimize(objective, strike)` works.

    Args:
        miss_distance: Closest approach of the tip to the target [m]; a penalty if the strike diverged or was refused by
            the limits.
        hit: Whether the strike hits the target in distance, direction and speed; for a measured distance, whether the
            hit probability is at least `CLAIMED`.
        time: Time of the closest approach [s].
        tip: Position of the tip at the closest approach, (x, y) or (x, y, z) [m].
        tip_velocity: Velocity of the tip at the closest approach [m/s].
        max_joint_speed: Largest speed of each arm joint [rad/s].
        max_torque: Largest torque of each arm joint [N m]; NaN for an arm of unknown inertia.
        diverged: Whether the simulation diverged.
        miss_error: Standard error of a measured miss distance [m]; None for a computed one.
        arrival: Direction and speed of the tip's arrival; None if the target requires neither, or the strike diverged
            or was refused.
        values: Values of the objective's criteria in their units; empty for a strike that diverged or was refused.
        merit: Negative number that searches minimise for a hit that is ranked by a criterion; None for other strikes.
        refused: The limit that the strike exceeds: `joint`, `motor`, `clearance`, `posture` (a strike in hand space is
            infeasible), or `rig` (a rig refused the strike before anything moved). None if it keeps all limits, or
            diverged.
        unseen: Whether the strike was made on a rig whose camera did not see the tip.
    """

    miss_distance: float
    hit: bool
    time: float
    tip: tuple[float, ...]
    tip_velocity: tuple[float, ...]
    max_joint_speed: tuple[float, ...]
    max_torque: tuple[float, ...]
    diverged: bool
    miss_error: float | None = None
    arrival: Arrival | None = None
    values: tuple[float, ...] = ()
    merit: float | None = None
    refused: str | None = None
    unseen: bool = False

    def _as_array(self) -> np.ndarray:
        return np.array(self.cost)

    def __float__(self) -> float:
        return self.cost

    @property
    def lost(self) -> bool:
        """Whether there is no true miss distance: the strike diverged, was refused, or was not seen."""
        return self.diverged or self.refused is not None or self.unseen

    @property
    def known_miss(self) -> float | None:
        """The miss distance [m]; None if there is no true miss distance, so that `miss_distance` is a penalty."""
        return None if self.lost else self.miss_distance

    @property
    def status(self) -> str:
        """Return the outcome in one word: `hit`, `miss`, `refused`, `unseen` or `diverged`."""
        if self.refused is not None:
            return "refused"
        if self.unseen:
            return "unseen"
        if self.diverged:
            return "diverged"
        return "hit" if self.hit else "miss"

    @property
    def cost(self) -> float:
        """Cost that searches minimise [m]: the miss distance, combined with the errors of direction and speed if the
        target requires them.

        For a hit that is ranked by a criterion it is the merit, so that any hit is better than any miss.
        """
        if self.merit is not None:
            return self.merit
        return self.miss_distance if self.arrival is None else self.arrival.cost

    @property
    def tip_speed(self) -> float:
        """Speed of the tip at the closest approach [m/s]."""
        return math.hypot(*self.tip_velocity)

    @property
    def hit_time(self) -> float | None:
        """Time of the closest approach [s] if the strike hits, else None."""
        return self.time if self.hit else None


@dataclass(frozen=True)
class Trial(NoArray, instead="its strike or outcome"):
    """One strike of a search, as a vector, with its outcome; `number` counts the search's strikes from 1."""

    number: int
    strike: tuple[float, ...]
    outcome: Outcome


def why_lost(trials: Sequence[Trial]) -> dict[str, int]:
    """Return how many trials have no miss distance, by reason: `diverged`, `would collide` and so on."""
    lost = [trial.outcome for trial in trials if trial.outcome.lost]
    return dict(Counter(_why_lost(outcome) for outcome in lost))


def _why_lost(outcome: Outcome) -> str:
    if outcome.refused is None:
        return "not seen" if outcome.unseen else "diverged"
    return _WHY_LOST.get(outcome.refused, f"refused: {outcome.refused}")


def _told(outcome: Outcome) -> str:
    return outcome.status if outcome.lost else f"{outcome.status}, {outcome.miss_distance:.4f} m"


class SearchStopped(WhiptoolError):
    """Raised by the objective when a search has to end; `reason` is `hit`, `trials` or `time`."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


class Objective:
    """Miss distance of strikes at one target, for one simulated arm and whip.

    Args:
        rollout: Simulator of a model and controller.
        target: Point and hit radius, or (x, y) or (x, y, z) [m] alone; None: `usual_target` of the model.
        t_stay: Time after the movement during which the tip is followed [s].
        bounds: Box in which strikes are searched; default: those of the rollout's space, see `default_bounds`.
        max_trials: Largest number of trials; None: no limit.
        max_time: No trial starts later than this time after the construction of the objective [s]; None: no limit.
        stop_at_hit: Whether to end the search with the first hit.
        check_reach: Whether to refuse a target out of reach; a target that does not fit the model is always refused.
        limits: One or several limits, such as `ArmLimits` and `Clearance`. A strike that exceeds them is refused: it is
            not a hit, and its miss distance is larger than any true miss distance and grows with the excess. Infeasible
            strikes in hand space are refused as well. The bounds are reduced to the position limits. Default: the
            limits of the model's arm (`whiptool.limits.all_limits.default_limits`), for a robot those of its joints,
            its collision shapes and the floor on which it stands; None: no limits.
        criteria: Criteria of hits; searches minimise the first of them among hits. Without criteria they minimise the
            cost.

    Attributes:
        trials: All trials in order.
        best: The trial with the smallest cost so far, which is the miss distance for targets without direction and
            speed.

    Raises:
        InputError: The target cannot be reached, a number is out of range, or a criterion needs torques, which are
            unknown for an arm of unknown inertia.
    """

    def __init__(
        self,
        rollout: Rollout,
        target: Target | Sequence[float] | np.ndarray | None = None,
        *,
        t_stay: float = T_STAY,
        bounds: StrikeBounds | None = None,
        max_trials: int | None = None,
        max_time: float | None = None,
        stop_at_hit: bool = False,
        check_reach: bool = True,
        limits: Limits | Sequence[Limits] | Literal["default"] | None = "default",
        criteria: Sequence[Criterion] = (),
    ) -> None:
        expect(Rollout, rollout=rollout)
        expect(StrikeBounds, type(None), bounds=bounds)
        expect(bool, stop_at_hit=stop_at_hit, check_reach=check_reach)
        self.rollout = rollout
        self.target = usual_target(rollout.model) if target is None else as_target(target)
        check = self.target.check_reach if check_reach else self.target.check_fits
        check(rollout.model)
        self.space = rollout.space
        given = limits_given(limits, rollout.model, prescribed=rollout.prescribed)
        self.limits = AllLimits(given, by_joints=self.space.kind == "joint")
        self.bounds = bounds or self.space.bounds
        if len(self.bounds.lower) != self.space.width:
            raise InputError("bounds", self.bounds.lower, f"lower and upper, each {numbers_of(self.space)}")
        self.space.check_turns("bounds", np.stack(self.bounds.box))
        self.bounds = self.limits.narrowed(self.bounds)
        expect(Sequence, criteria=criteria)
        for criterion in criteria:
            expect(Criterion, criteria=criterion)
            if criterion.of_torques and rollout.model.arm.weightless:
                rule = "miss, speed or robustness, because the inertia of the arm and thus its torques are unknown"
                raise InputError("criterion", criterion.name, rule, "write an <inertial> of each link into the file")
        self.criteria = tuple(criteria)
        self.t_stay = number("t_stay", t_stay, low=0)
        longest = np.array([self.bounds.upper[-1] + self.t_stay])
        time_grid(longest, timestep=rollout.timestep, control_period=None)  # refuses what would never end
        self.max_trials = None if max_trials is None else whole("max trials", max_trials)
        self.max_time = None if max_time is None else number("max time", max_time, low=0, strict=True)
        self.stop_at_hit = stop_at_hit
        self.trials: list[Trial] = []
        self.best: Trial | None = None
        self._last: StrikesAtGoal | None = None  # what was rolled out last
        self._recorded: list[Trial] = []
        self._on_trial: Callable[[Trial], None] | None = None
        self._one_by_one = threading.RLock()  # threads' trials are numbered and logged one after the other
        self._start = time.monotonic()
        # farther than any real miss can be; a strike beyond the limits has between one and two of it
        self.goals = self.target.goals
        self.penalty = math.hypot(rollout.farthest_miss(self.target.position), self.goals.largest_cost)

    def __repr__(self) -> str:
        best = "" if self.best is None else f", best: {_told(self.best.outcome)}"
        return f"Objective({self.rollout!r}, {self.target!r}, {counted(len(self.trials), 'trial')}{best})"

    def record(self, recorded: Sequence[Trial], on_trial: Callable[[Trial], None]) -> None:
        """Connect the trials with a log.

        Args:
            recorded: Trials of an earlier run; the first calls must repeat them, and get their outcomes without
                simulation.
            on_trial: Called with every trial, in order.
        """
        self._recorded, self._on_trial = list(recorded), on_trial

    @property
    def n_diverged(self) -> int:
        """Number of trials that diverged."""
        return sum(trial.outcome.diverged for trial in self.trials)

    @property
    def n_refused(self) -> int:
        """Number of trials that exceeded the limits, or that a rig refused."""
        return sum(trial.outcome.refused is not None for trial in self.trials)

    @property
    def n_unseen(self) -> int:
        """Number of trials on a rig whose camera did not see the tip."""
        return sum(trial.outcome.unseen for trial in self.trials)

    @property
    def smooth(self) -> tuple[Smooth, ...]:
        """Differentiable constraints that searches can keep without simulating a strike."""
        return self.limits.smooth

    def admissible(self, strikes: np.ndarray) -> np.ndarray:
        """Return strikes (B, 2 n + 1) for a search, shortened so that the commanded path keeps the joints' limits.

        The strikes stay within the bounds. The limits may still be exceeded, because the motion of the joints depends
        on the whip and the controller; this is judged with the outcome.
        """
        strikes = self._array(strikes)
        return self.limits.admissible(strikes, self.bounds) if self.limits.commands else strikes

    def random_strikes(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Return random strikes (count, 2 n + 1) within the bounds that keep the limits that can be checked without
        simulation.
        """
        return self.limits.random_strikes(self.bounds, rng, count)

    def __call__(self, strike: AnyStrike | np.ndarray | Sequence[float]) -> Outcome:
        """Return the outcome of one strike, a `Strike` or its vector, (2 n + 1,).

        A hit is an outcome like any other, also with `stop_at_hit`; `trial` is what searches call.

        Raises:
            SearchStopped: The budget was used up before this strike.
        """
        with self._one_by_one:
            try:
                return self.trial(strike)
            except SearchStopped as stop:
                if stop.reason != "hit":
                    raise
                return self.trials[-1].outcome

    def trial(self, strike: AnyStrike | np.ndarray | Sequence[float]) -> Outcome:
        """Return the outcome of one strike of a search.

        Raises:
            SearchStopped: The budget was used up before this strike, or this strike was the hit to stop at.
        """
        return self.batch(np.atleast_2d(self._array(strike)))[0]

    def batch(self, strikes: np.ndarray) -> list[Outcome]:
        """Return the outcomes of strike vectors (B, 2 n + 1), each of which counts as a trial.

        Raises:
            SearchStopped: The budget was used up within the batch (trials up to its end are counted), or a strike was
                the hit to stop at (all trials of the batch are counted; with a simulator that is `one_by_one` only
                those up to the hit).
        """
        strikes = np.array(self._array(strikes), ndmin=2)  # a copy: optimizers reuse their buffers
        width = self.space.width
        if strikes.ndim != 2 or strikes.shape[1] != width or not np.isfinite(strikes).all():
            wrong = strikes[~np.isfinite(strikes).all(axis=-1)] if strikes.shape[1:] == (width,) else strikes
            first = next(iter(wrong.tolist()), NOTHING)
            raise InputError("strikes", first, f"strikes of {numbers_of(self.space)}, all of them finite")
        with self._one_by_one:
            return self._batch(strikes)

    def _array(self, strikes: AnyStrike | np.ndarray | Sequence[float]) -> np.ndarray:
        return array_of("strikes", strikes, f"a Strike, or vectors of {self.space.width} finite numbers each")

    def _batch(self, strikes: np.ndarray) -> list[Outcome]:
        """Outcomes of strikes that are well formed; see `batch`."""
        if self.max_time is not None and time.monotonic() - self._start > self.max_time:
            raise SearchStopped("time")
        room = len(strikes) if self.max_trials is None else self.max_trials - len(self.trials)
        if room <= 0:
            raise SearchStopped("trials")
        admitted = strikes[:room]
        together = 1 if self.rollout.one_by_one else len(admitted)
        outcomes: list[Outcome] = []
        for first in range(0, len(admitted), together):
            outcomes += self._counted(admitted[first : first + together])
        if len(admitted) < len(strikes):
            raise SearchStopped("trials")
        return outcomes

    def _counted(self, strikes: np.ndarray) -> list[Outcome]:
        """Outcomes of strikes, each a trial; those that an earlier run recorded are not rolled out again.

        Raises:
            SearchStopped: One of them was the hit to stop at.
        """
        outcomes = self._replay(strikes)
        fresh = strikes[len(outcomes) :]
        if len(fresh):
            outcomes += self._roll(fresh)
        for vector, outcome in zip(strikes, outcomes, strict=True):
            trial = Trial(len(self.trials) + 1, tuple(map(float, vector)), outcome)
            self.trials.append(trial)
            if self.best is None or outcome.cost < self.best.outcome.cost:
                self.best = trial
            if self._on_trial is not None:
                self._on_trial(trial)
        if self.stop_at_hit and any(outcome.hit for outcome in outcomes):
            raise SearchStopped("hit")
        return outcomes

    def gradient(self, strike: np.ndarray | Sequence[float]) -> tuple[Outcome, np.ndarray]:
        """Return the outcome of one strike vector, which counts as a trial, and the exact derivatives of its cost.

        Returns:
            The outcome, and d cost / d strike, (2 n + 1,) [m/rad, m/s]; zeros if the strike diverged or was refused.
            For a trial from a log the derivatives are computed again.

        Raises:
            InputError: The simulator has no derivatives.
            SearchStopped: As in `__call__`.
        """
        vector = np.array(self._array(strike))
        outcome = self.trial(vector)
        if outcome.miss_distance >= self.penalty:
            return outcome, np.zeros_like(vector)
        place = np.array(self.target.position)
        if self.goals.only_points:
            return outcome, self.rollout.gradient(vector[None], place, t_stay=self.t_stay)[1][0]
        near, dtip, dvelocity = self.rollout.arrival_gradient(vector[None], place, t_stay=self.t_stay)
        left = self.goals.residuals(near.tip, near.velocity)[0]
        slopes = self.goals.residual_slopes(near.velocity, dtip, dvelocity)[0]
        return outcome, left @ slopes / max(float(np.linalg.norm(left)), np.finfo(float).tiny)

    def _replay(self, strikes: np.ndarray) -> list[Outcome]:
        """Outcomes of those of these strikes that an earlier run recorded."""
        done = len(self.trials)
        known = self._recorded[done : done + len(strikes)]
        for vector, trial in zip(strikes, known, strict=False):
            if tuple(map(float, vector)) != trial.strike:
                raise WhiptoolError(
                    f"trial {trial.number} of the resumed run was {trial.strike}, the search now asks for "
                    f"{tuple(map(float, vector))}: the run was made by other code; start a new one"
                )
        return [trial.outcome for trial in known]

    def struck(self, strike: np.ndarray | Sequence[float]) -> tuple[Outcome, StrikesAtGoal]:
        """Return the outcome of one strike vector, which counts as a trial, with the quantities whose derivatives the
        criteria use.

        Raises:
            SearchStopped: As in `__call__`.
        """
        vector = np.array(self._array(strike))
        outcome, struck = self.trial(vector), self._last
        if struck is None or not np.array_equal(struck.strikes, vector[None]):  # it was refused, or is in a log
            struck = StrikesAtGoal(self.rollout, vector[None], self.goals, self.t_stay)
        return outcome, struck

    def _roll(self, strikes: np.ndarray) -> list[Outcome]:
        """Outcomes of strikes; those that the arm cannot make are refused without a rollout."""
        outside = self.space.beyond(strikes)
        made = iter(self._rolled(strikes[outside <= 0]) if (outside <= 0).any() else [])
        return [next(made) if x <= 0 else self._not_made(float(x)) for x in outside]

    def _not_made(self, beyond: float) -> Outcome:
        a, d = self.rollout.model.arm.n, self.rollout.model.dimension
        distance, nowhere, nothing = float(distance_beyond(self.penalty, beyond)), (math.nan,) * d, (math.nan,) * a
        return Outcome(distance, False, math.nan, nowhere, nowhere, nothing, nothing, False, refused=UNREACHABLE)

    def _rolled(self, strikes: np.ndarray) -> list[Outcome]:
        self._last = struck = StrikesAtGoal(self.rollout, strikes, self.goals, self.t_stay)
        near = struck.near
        beyond, by = self.limits.judged(strikes, near, self._trajectory, candidates=())
        values = [criterion.values(struck) for criterion in self.criteria]
        judged = np.array(values).T if values else np.empty((len(strikes), 0))
        outcomes = [self._outcome(near, i, float(beyond[i]), by[i], judged[i]) for i in range(len(strikes))]
        return self._candidates_judged(strikes, near, outcomes, judged) if self.limits.of_candidates else outcomes

    def _candidates_judged(
        self, strikes: np.ndarray, near: Approach, outcomes: list[Outcome], judged: np.ndarray
    ) -> list[Outcome]:
        """The same outcomes, but those that would be hits or the best are refused where the whole strike has to be.

        The nearest are looked at first: once one is within, what is farther cannot be the best.
        """
        lowest = math.inf if self.best is None else self.best.outcome.cost
        for i in np.argsort([outcome.cost for outcome in outcomes], kind="stable"):
            within = outcomes[i].miss_distance < self.penalty
            if within and (outcomes[i].hit or outcomes[i].cost < lowest):
                beyond, by = self.limits.judged_whole(self._trajectory(strikes[i]))
                outcomes[i] = self._outcome(near, int(i), beyond, by, judged[i])
            lowest = min(lowest, outcomes[i].cost)
        return outcomes

    def clear(self, strike: np.ndarray) -> bool:
        """Whether a strike (2 n + 1,) is collision-free by the limits' `Clearance`; this does not count as a trial."""
        judges = [limits for limits in self.limits.members if isinstance(limits, Clearance)]
        if not judges:
            return True
        made = self.space.beyond(strike[None])[0] <= 0
        return bool(made) and all(limits.violation(self._trajectory(strike)) <= 0 for limits in judges)

    def _trajectory(self, strike: np.ndarray) -> Trajectory:
        return self.rollout.trajectory(self.space.strike(strike), t_stay=self.t_stay)

    def judge(self, trajectory: Trajectory, strike: AnyStrike | None = None) -> Outcome:
        """Return the outcome of an existing trajectory; it does not count as a trial.

        Args:
            trajectory: Trajectory of the strike.
            strike: The commanded strike; None: limits of the command are not checked.
        """
        expect(Trajectory, trajectory=trajectory)
        beyond, by = self.limits.judged_whole(trajectory, strike)
        return self._outcome(trajectory.approach(np.array(self.target.position)), 0, beyond, by)

    def _hits(self, near: Approach, i: int) -> bool:
        one = slice(i, i + 1)
        error = None if near.error is None else near.error[one]
        return bool(self.goals.hit(near.farthest[one], near.velocity[one], error)[0])

    def _outcome(
        self, near: Approach, i: int, beyond: float, by: str, values: Sequence[float] | np.ndarray = ()
    ) -> Outcome:
        """The outcome of strike i, which is so far beyond the limits that are named by what judges them."""
        by_rig = "" if near.lost is None else str(near.lost[i])  # its strikes do not diverge
        diverged = not by_rig and (bool(near.diverged[i]) or not np.isfinite(near.distance[i]))
        refused = RIG if by_rig == "refused" else by if beyond > 0 and not diverged else None
        lost = diverged or beyond > 0 or bool(by_rig)
        distance = float(distance_beyond(self.penalty, beyond) if lost else near.distance[i])
        error = None if lost or near.error is None else float(near.error[i])
        arrival = None if lost or self.goals.only_points else self._arrival(near, i)
        hit = not lost and self._hits(near, i)
        found = () if lost else tuple(map(float, values))
        unknown = len(self.rollout.model.arm.weightless) > 0
        merit = self.criteria[0].cost(found[0], self.target.hit_radius) if hit and found else None
        return Outcome(
            miss_distance=distance,
            hit=hit,
            time=float(near.time[i]),
            tip=tuple(map(float, near.tip[i])),
            tip_velocity=tuple(map(float, near.velocity[i])),
            max_joint_speed=tuple(map(float, near.max_joint_speed[i])),
            max_torque=tuple(math.nan if unknown else float(torque) for torque in near.max_torque[i]),
            diverged=diverged,
            miss_error=error,
            arrival=arrival,
            values=found,
            merit=merit,
            refused=refused,
            unseen=by_rig == "unseen",
        )

    def _arrival(self, near: Approach, i: int) -> Arrival:
        velocity = near.velocity[i : i + 1]
        angle = None if self.goals.directions is None else float(self.goals.angle(velocity)[0])
        cost = float(self.goals.cost(near.distance[i : i + 1], velocity)[0])
        return Arrival(angle, float(self.goals.arrival_speed(velocity)[0]), cost)
