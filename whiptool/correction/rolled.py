"""Strikes that begin in any state, with submovements added to their reference, and exact derivatives of their paths."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from whiptool.dynamics.modes import stepped
from whiptool.dynamics.posture import start_posture
from whiptool.dynamics.structure import outcome_columns, parameter_directions, row_columns
from whiptool.errors import InputError
from whiptool.impedance.controller import Controller, default_controller
from whiptool.models.numbers import whole
from whiptool.models.parameters import Model
from whiptool.models.strike import Strike, strike_names
from whiptool.models.trajectory import Trajectory
from whiptool.rollout.batch import Batch
from whiptool.rollout.completed import States, complete_trajectory
from whiptool.rollout.engine import find_engine
from whiptool.rollout.interface import time_grid

INTERVAL = 1e-3  # [s] between the instants of a path
SLOTS = 24  # submovements of a strike
NUMBERS = {"length": "whip.l", "mass": "whip.m", "stiffness": "whip.k"}  # of the whip, that may be off


@dataclass(frozen=True, eq=False)
class Submovements:
    """Minimum-jerk movements that are added to the reference of B strikes (Henis and Flash 1995), K each.

    Args:
        since: When each begins [s], (B, K).
        lasts: How long each lasts [s], (B, K).
        by: How far each moves the joints [rad or m], (B, K, a).
    """

    since: np.ndarray
    lasts: np.ndarray
    by: np.ndarray

    @classmethod
    def none(cls, count: int, joints: int) -> Submovements:
        """Return no submovements of so many strikes."""
        return cls(np.zeros((count, 0)), np.ones((count, 0)), np.zeros((count, 0, joints)))

    def and_(self, other: Submovements) -> Submovements:
        """Return these submovements and others of the same strikes."""
        pairs = zip((self.since, self.lasts, self.by), (other.since, other.lasts, other.by), strict=True)
        return Submovements(*(np.concatenate(both, axis=1) for both in pairs))


@dataclass(frozen=True, eq=False)
class Begun:
    """B strikes from the states in which they are.

    Args:
        strike: Planned strike.
        x0: States, (B, 2 n).
        added: Submovements of each strike.
        lasts: Time that is simulated [s].
        since: Time after the beginning of the strike at which the states are taken [s], (B,) or for all.
        off: Relative errors of the whip's `NUMBERS` in each strike, (B, 3); None: none.
    """

    strike: Strike
    x0: np.ndarray
    added: Submovements
    lasts: float
    since: np.ndarray | float = 0.0
    off: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class Paths:
    """Motion of B strikes at S instants, `INTERVAL` apart, in d dimensions.

    Args:
        tip: The tip [m], (B, S, d).
        arm: Far ends of the arm's a links, the hand last [m], (B, S, a, d).
        miss: Smallest distance of the tip from the target [m], (B,).
    """

    tip: np.ndarray
    arm: np.ndarray
    miss: np.ndarray


@dataclass(frozen=True, eq=False)
class _Corrected:
    """The reference of a strike with submovements (B = 1), as a `StrikePath`."""

    strike: Strike
    added: Submovements

    @property
    def q_i(self) -> tuple[float, ...]:
        return self.strike.q_i

    @property
    def D(self) -> float:
        return self.strike.D

    def reference(self, t: float | np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        found = self.strike.reference(t)
        rest = (0.0,) * len(self.q_i)
        for since, lasts, by in zip(self.added.since[0], self.added.lasts[0], self.added.by[0], strict=True):
            more = Strike(rest, tuple(by.tolist()), float(lasts)).reference(t - since)
            found = found[0] + more[0], found[1] + more[1], found[2] + more[2]
        return found


class AnyStart:
    """Simulates strikes of one arm and controller that begin in any state, with submovements.

    Args:
        model: Model of arm and whip.
        controller: Controller of the joints; default: `default_controller`.
        steps: Steps of the simulation between the instants of paths.

    Raises:
        InputError: The controller controls the hand, or holds its torque for a period.
    """

    def __init__(self, model: Model, controller: Controller | None = None, *, steps: int = 2) -> None:
        controller = default_controller(model) if controller is None else controller
        if controller.hand is not None or controller.control_period is not None:
            rule = "a continuous controller of the joints"
            raise InputError("controller", "one of the hand, or with a control period", rule)
        controller.check_fits(model.arm)
        self.model, self.controller, self.steps = model, controller, whole("steps", steps, low=1)
        self.structure = replace(stepped(model, controller, timestep=INTERVAL / steps), submovements=SLOTS)
        d, a = model.dimension, model.arm.n
        self._observed = np.r_[np.arange(d * a), d * (a + model.whip.N - 1) + np.arange(d)]  # the arm's ends, the tip

    def rest(self, strike: Strike) -> np.ndarray:
        """Return the state in which a strike begins if nothing disturbs it, (2 n,)."""
        q = start_posture(self.model, np.array([strike.q_i]))[0]
        return np.concatenate([q, np.zeros_like(q)])

    def paths(self, begun: Begun, target: np.ndarray) -> Paths:
        """Return the paths of strikes at a target, (d,) [m]."""
        batch = self._batch(begun, target)
        batch.columns, batch.stride = self._observed, self.steps
        rolled = find_engine(self.structure, forward=False, rung=None)(batch)
        distance = outcome_columns(self.model.arm.n, self.model.dimension)["distance"]
        return Paths(*self._split(np.stack(rolled.observed()[0])), rolled.out[:, distance.start])

    def rows(self, begun: Begun, name: str) -> np.ndarray:
        """Return the states (`x`), or the joints' torques (`tau`) [N m], at the instants of paths, (B, S, 2 n or a)."""
        batch = self._batch(begun)
        batch.with_rows = True
        rolled = find_engine(self.structure, forward=False, rung=None)(batch)
        assert rolled.rows is not None
        columns = row_columns(self.structure.n, self.model.arm.n, self.model.dimension)[name]
        return rolled.rows[:, columns].reshape(len(batch.p), -1, columns.stop - columns.start)[:, :: self.steps]

    def trajectory(self, begun: Begun) -> Trajectory:
        """Return the whole trajectory of one strike (B = 1) from its beginning, at the instants of paths."""
        x, tau = self.rows(begun, "x")[0], self.rows(begun, "tau")[0]
        n = self.structure.n
        states = States(INTERVAL * np.arange(len(x)), x[:, :n], x[:, n:], tau)
        off = dict(zip(NUMBERS.values(), () if begun.off is None else begun.off[0], strict=False))
        now = {path: self.model.whip.common(path.removeprefix("whip.")) * (1 + x) for path, x in off.items()}
        return complete_trajectory(
            self.model.with_parameters(now), self.controller, _Corrected(begun.strike, begun.added), states
        )

    def slopes(
        self, begun: Begun, *, dx0: np.ndarray | None = None, dby: np.ndarray, numbers: bool = False
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the exact derivatives of the paths of m strikes, each along its own direction, by forward mode.

        Args:
            begun: The strikes.
            dx0: Directions of the states, (m, 2 n); default: zero.
            dby: Directions of the submovements' sizes, (m, K, a).
            numbers: Whether the last strikes' derivatives are taken along relative errors of `NUMBERS`, one each.

        Returns:
            Derivatives of the tip (m, S, d), and of the arm's ends (m, S, a, d).
        """
        batch = self._batch(begun)
        m = len(batch.p)
        batch.dx0 = np.zeros_like(batch.x0) if dx0 is None else np.ascontiguousarray(dx0)
        batch.dp, batch.dh, batch.dh_last = np.zeros_like(batch.p), np.zeros(m), np.zeros(m)
        block = self.structure.columns("by").start
        batch.dp[:, block : block + dby[0].size] = dby.reshape(m, -1)
        if numbers:
            batch.dp[m - len(NUMBERS) :] = self._numbers
        batch.columns, batch.stride = self._observed, self.steps
        return self._split(np.stack(find_engine(self.structure, forward=True, rung=None)(batch).observed()[1]))

    @cached_property
    def _numbers(self) -> np.ndarray:
        """Changes of the packed parameters by relative errors of `NUMBERS`, which are linear, (3, P)."""
        columns = {name: i for i, name in enumerate(strike_names(self.model.arm))}
        now = np.array([self.model.whip.common(path.removeprefix("whip.")) for path in NUMBERS.values()])
        known = self.structure, self.model, self.controller
        return now[:, None] * parameter_directions(*known, list(NUMBERS.values()), columns)

    def _split(self, seen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        d = self.model.dimension
        return seen[..., -d:], seen[..., :-d].reshape(*seen.shape[:2], -1, d)

    def _batch(self, begun: Begun, target: np.ndarray | None = None) -> Batch:
        B, a, added = len(begun.x0), self.model.arm.n, begun.added
        left = SLOTS - added.since.shape[1]
        if left < 0:
            raise InputError("submovements", added.since.shape[1], f"at most {SLOTS}")
        every = added.and_(Submovements(np.zeros((B, left)), np.ones((B, left)), np.zeros((B, left, a))))
        since = np.broadcast_to(begun.since, B)[:, None]
        numbers = [np.tile(begun.strike.vector, (B, 1)), since, every.since, every.lasts, every.by.reshape(B, -1)]
        p = self.structure.pack(self.model, self.controller, np.hstack(numbers))
        if begun.off is not None:
            p = p + begun.off @ self._numbers
        lasts = np.full(B, INTERVAL * round(begun.lasts / INTERVAL))
        targets = np.zeros((B, self.model.dimension)) if target is None else np.tile(target, (B, 1))
        grid = time_grid(lasts, timestep=INTERVAL / self.steps, control_period=None)
        return Batch(p, np.ascontiguousarray(begun.x0), targets, *grid)
