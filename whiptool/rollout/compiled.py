"""The compiled simulator: batches of strikes with code that CasADi generates, and exact derivatives."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import fields
from typing import NamedTuple

import numpy as np

from whiptool.dynamics.modes import stepped
from whiptool.dynamics.posture import start_derivative, start_posture
from whiptool.dynamics.structure import Columns, Structure, outcome_columns, parameter_directions, row_columns
from whiptool.errors import InputError, expect
from whiptool.impedance.controller import Controller, default_controller
from whiptool.models.hand_space import StrikeSpace
from whiptool.models.numbers import array_of, number, one_of, texts, whole
from whiptool.models.parameters import Model
from whiptool.models.strike import T_STAY, AnyStrike, JointSpace
from whiptool.models.trajectory import Approach, Points, Trajectory, target_points
from whiptool.progress import Progress
from whiptool.rollout.batch import TOLERANCE, Batch, Engine, Resolved, displacements, resolve
from whiptool.rollout.completed import States, complete_trajectory
from whiptool.rollout.engine import RUNGS, find_engine, wanted_rung
from whiptool.rollout.interface import (
    COARSEST,
    FINEST,
    LARGEST_STEP,
    SLOPES,
    SMALLEST_STEP,
    ApproachSlopes,
    Rollout,
    Strikes,
    joined,
    time_grid,
)

TIMESTEP = 2.5e-4  # [s] between the instants of a trajectory whose steps are chosen by their errors
_OF_A_PATH = 1e-2  # tolerance of a step's error along a path, in units of that of the distance
_AT_ONCE = 8192  # strikes packed at once: bounds the memory
_TRAJECTORIES_AT_ONCE = 64


class ChainPath(NamedTuple):
    """Paths of the far ends of all links over one strike.

    Args:
        t: Times, (S,) [s].
        points: Far ends of the links, from the shoulder to the tip, (S, links, d) [m]; NaN after divergence.
        slopes: Derivatives of `points` by m parameters, (S, links, d, m).
    """

    t: np.ndarray
    points: np.ndarray
    slopes: np.ndarray


def _check_one_each(count: int, **given: object) -> None:
    """Refuse models and controllers that are neither none nor a list of one for each strike."""
    for name, some in given.items():
        if some is not None and (not isinstance(some, (list, tuple)) or len(some) not in (0, count)):
            raise InputError(name, some, f"a list of {count}, one for each strike, or none")


class CompiledRollout(Rollout):
    """Simulator with compiled code, for one model and controller, or for many with the same structure.

    Args:
        model: Model of arm and whip.
        controller: Controller of the arm; default: `default_controller`.
        tolerance: Largest integration error of a distance [m]; the steps of each strike are chosen accordingly.
            Default: 1e-4, unless `timestep` is given.
        timestep: Use equal steps of at most this length [s], without an estimate of the error.
        engine: `simd`, `scalar` or `interpreter`; default: the environment variable WHIPTOOL_ENGINE, or the fastest
            engine that works on this machine.
        free: Names of parameters along which derivatives will be taken although their terms are zero in this model.
        threads: Number of threads; default: one per core.
        sag: Deviation of the arm from the postures `q_i` when strikes begin [rad], (B, a) or (a,); None: no deviation.

    Under position control the integrator is the classical Runge-Kutta method, of fourth order, if that is stable;
    otherwise a Rosenbrock-W method, of third order, or at equal steps of second (ROS2).

    Attributes:
        timestep: The largest step [s], or, with a tolerance, the interval between the samples of a trajectory.

    Raises:
        InputError: An argument is out of range, both `tolerance` and `timestep` are given, or the law does not fit the
            arm.
    """

    def __init__(
        self,
        model: Model,
        controller: Controller | None = None,
        *,
        tolerance: float | None = None,
        timestep: float | None = None,
        engine: str | None = None,
        free: Sequence[str] = (),
        threads: int | None = None,
        sag: Callable[[np.ndarray], np.ndarray] | None = None,
    ) -> None:
        expect(Model, model=model)
        controller = default_controller(model) if controller is None else controller
        expect(Controller, controller=controller)
        if engine is not None:
            one_of("engine", engine, RUNGS)
        self.model, self.controller = model, controller
        if tolerance is not None and timestep is not None:
            raise InputError("tolerance and timestep", (tolerance, timestep), "only one of the two")
        if timestep is None:
            self.tolerance = number(
                "tolerance", TOLERANCE if tolerance is None else tolerance, low=FINEST, high=COARSEST
            )
        else:
            self.tolerance = None
        self.timestep = number(
            "timestep", TIMESTEP if timestep is None else timestep, low=SMALLEST_STEP, high=LARGEST_STEP
        )
        self.free = texts("free", free)
        self._sag = sag
        self.structure = stepped(model, controller, free=free, timestep=timestep)
        controller.check_fits(model.arm)
        self._rung, self._threads = engine or wanted_rung(), None if threads is None else whole("threads", threads)
        self.engine: str = self._engine(forward=False).rung

    @property
    def space(self) -> StrikeSpace:
        return self.controller.strike_space(self.model.arm)

    def _engine(self, *, forward: bool) -> Engine:
        return find_engine(self.structure, forward=forward, rung=self._rung)

    def approach(
        self,
        strikes: Strikes,
        target: Points,
        *,
        t_stay: float = T_STAY,
        models: Sequence[Model] | None = None,
        controllers: Sequence[Controller] | None = None,
        progress: bool = False,
    ) -> Approach:
        """Return the closest approaches of any number of strikes, with bounded memory.

        Args:
            strikes: One `Strike` or many, or vectors, (B, 2 a + 1). A strike lasts `D + t_stay` seconds.
            target: A `Target` or a position for all, or one position for each strike, (B, 2) or in space (B, 3) [m].
            t_stay: Time after the movement during which the tip is followed [s].
            models, controllers: One for each strike, if they differ; each within this simulator's structure, and with
                its control period.
            progress: Show a progress bar.

        Raises:
            InputError: Shapes do not match, or a model has terms, or a controller a control period, that this simulator
                does not have.
        """
        strikes = self.vectors(strikes)
        B, a = len(strikes), self.model.arm.n
        _check_one_each(B, models=models, controllers=controllers)
        targets = target_points(target, B, self.model.dimension)
        out, error = np.empty((B, outcome_columns(a, self.model.dimension).width)), np.empty(B)
        bar = Progress(total=B, unit=" strikes", disable=not progress, leave=False)
        for first in range(0, B, _AT_ONCE):
            part = slice(first, first + _AT_ONCE)
            batch = self._batch(
                strikes[part], targets[part], t_stay, models and models[part], controllers and controllers[part]
            )
            found = self._resolved(batch)
            out[part], error[part] = found.out, found.error
            bar.update(len(batch.p))
        bar.close()
        return self._approach(out, error)

    def _resolved(self, batch: Batch) -> Resolved:
        """Roll strikes out as finely as the tolerance asks for, or at the steps that were given."""
        engine, count = self._engine(forward=False), len(batch.p)
        if self.tolerance is None:
            return Resolved(engine(batch, threads=self._threads).out, np.zeros(count), np.zeros(count))

        def roll(which: np.ndarray, tolerances: np.ndarray) -> np.ndarray:
            some = batch.take(which)
            some.tolerance = tolerances
            return engine(some, threads=self._threads).out

        return resolve(roll, count, self.tolerance, outcome_columns(self.model.arm.n, self.model.dimension))

    def _approach(self, out: np.ndarray, error: np.ndarray | None = None) -> Approach:
        """The engine's outcome of each strike, by name, and the estimated error of its distance."""
        columns = outcome_columns(self.model.arm.n, self.model.dimension)
        single = {name: out[:, columns[name]][:, 0] for name in ("distance", "time")}
        several = {
            name: out[:, columns[name]] for name in ("velocity", "tip", "max_joint_speed", "max_torque", "effort")
        }
        positions = np.stack([out[:, columns[name]] for name in ("lowest", "highest")], axis=1)
        diverged = out[:, columns["diverged"]][:, 0] != 0
        estimate = None if self.tolerance is None else error
        return Approach(**single, **several, diverged=diverged, positions=positions, integration_error=estimate)

    def nearest_node(
        self, strikes: Strikes, target: Points, *, nodes: Sequence[int], t_stay: float | np.ndarray = T_STAY
    ) -> Approach:
        """Return the closest approach to the target of the nearest of several nodes of the whip, for each strike.

        Args:
            strikes, target: As in `approach`.
            nodes: Numbers of the nodes, from 0, next to the hand, to N - 1, the tip.
            t_stay: Time after the movement [s], a single value or one for each strike, (B,).

        Returns:
            Position, time and mean velocity over the step of the nearest node at its closest approach.

        Raises:
            InputError: Shapes do not match, or a node does not exist.
        """
        strikes = self.vectors(strikes)
        B, a, d = len(strikes), self.model.arm.n, self.model.dimension
        if not isinstance(nodes, Sequence) or not nodes or not all(i in range(self.model.whip.N) for i in nodes):
            raise InputError("nodes", nodes, f"a list of some of 0 to {self.model.whip.N - 1}")
        targets, stay = target_points(target, B, d), _stays(t_stay, B)
        columns = np.array([d * (a + i) + c for i in nodes for c in range(d)])
        found: list[Approach] = []
        for first in range(0, B, _TRAJECTORIES_AT_ONCE):
            part = slice(first, first + _TRAJECTORIES_AT_ONCE)
            batch = self._batch(strikes[part], targets[part], stay[part])
            batch.columns = columns
            rolled = self._engine(forward=False)(batch, threads=self._threads)
            tips = self._approach(rolled.out)
            for i, (path, h) in enumerate(zip(rolled.observed()[0], batch.h, strict=True)):
                paths = path.reshape(len(path), len(nodes), d).transpose(1, 0, 2)
                found.append(tips.of_paths(i, paths, batch.target[i], h))
        return joined(found, a, d)

    def gradient(
        self, strikes: Strikes, target: Points, *, t_stay: float = T_STAY, names: Sequence[str] | None = None
    ) -> tuple[Approach, np.ndarray]:
        """Return closest approaches and the exact derivatives of the miss distance, by CasADi's forward mode.

        The time of the closest approach has no effect on the derivative (envelope theorem), unless it is the end of the
        strike, which depends on D. The derivatives are those of the adaptive steps; their error is about the tolerance
        per unit of a strike's coordinate, such as 1e-4 m.

        Args:
            strikes, target, t_stay: As in `approach`.
            names: Names of m parameters: of the strike (`q_si` ... `D`), of the model and of the controller
                (`parameters()` of each). Default: those of the strike.

        Returns:
            The approaches, and derivatives [m per unit of the parameter], (B, m).
        """
        near, out, columns = self._forward(strikes, target, t_stay, names)
        return near, out[:, :, columns["slope"]][..., 0]

    def slopes(
        self, strikes: Strikes, target: Points, *, t_stay: float = T_STAY, names: Sequence[str] | None = None
    ) -> tuple[Approach, ApproachSlopes]:
        """Return closest approaches and the exact derivatives of the quantities of `ApproachSlopes`, by forward mode.

        Derivatives of the tip's position and velocity account for a shift of the closest approach within the segment
        between two steps, but not to another segment; for those of the largest torques their instants are fixed.

        Args:
            strikes, target, t_stay, names: As in `gradient`.
        """
        near, out, columns = self._forward(strikes, target, t_stay, names)
        blocks = {name: out[:, :, columns[f"{name}_slope"]].swapaxes(1, 2) for name in SLOPES}
        return near, ApproachSlopes(out[:, :, columns["slope"]][..., 0], **blocks)

    def _forward(
        self, strikes: Strikes, target: Points, t_stay: float, names: Sequence[str] | None
    ) -> tuple[Approach, np.ndarray, Columns]:
        """The approaches, what the engine says along each of m directions, (B, m, width), and its columns."""
        strikes = self.vectors(strikes)
        names = self.space.names if names is None else texts("names", names, least=1)
        B, m = len(strikes), len(names)
        targets = target_points(target, B, self.model.dimension)
        columns = outcome_columns(self.model.arm.n, self.model.dimension)
        out, error = np.empty((B, m, columns.width)), np.empty(B)
        at_once = max(1, _AT_ONCE // m)
        for first in range(0, B, at_once):
            part = slice(first, first + at_once)
            found = self._resolved(self._batch(strikes[part], targets[part], t_stay))
            error[part] = found.error
            batch = self._forward_batch(strikes[part], targets[part], t_stay, names, found.tolerance)
            out[part] = self._engine(forward=True)(batch, threads=self._threads).out.reshape(-1, m, out.shape[2])
        return self._approach(out[:, 0], error), out, columns

    def tip_path(
        self,
        strikes: Strikes,
        *,
        t_stay: float = T_STAY,
        rate: float,
        names: Sequence[str] = (),
        models: Sequence[Model] | None = None,
        controllers: Sequence[Controller] | None = None,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the tip's path at equal intervals, and its exact derivatives.

        Args:
            strikes, t_stay: As in `approach`.
            rate: Sampling rate [1/s].
            names: Names of m parameters, as in `gradient`; must be empty if strikes have different models.
            models, controllers: As in `approach`.

        Returns:
            Times (S,) [s]; positions (B, S, d) [m], d the model's dimension, NaN after a strike's end; derivatives
            (B, S, d, m).
        """
        times, paths, slopes, _ = self._tip_path(strikes, t_stay, rate, names, models, controllers)
        return times, paths, slopes

    def peaks_and_path(self, strikes: Strikes, *, t_stay: float = T_STAY, rate: float) -> tuple[Approach, np.ndarray]:
        """Return the peak values of strikes and the paths of their tips, from one simulation each.

        Args:
            strikes, t_stay: As in `approach`.
            rate: As in `tip_path`.

        Returns:
            The closest approaches to the base; positions (B, S, d) [m], as those of `tip_path`.
        """
        _, paths, _, out = self._tip_path(strikes, t_stay, rate)
        return self._approach(out), paths

    def release_path(
        self, strikes: Strikes, *, t_stay: float = T_STAY, rate: float, names: Sequence[str] = (), by_hand: bool = False
    ) -> tuple[np.ndarray, np.ndarray, Approach]:
        """Return the states from which a thing at the tip, or at the hand, can be released, at equal intervals.

        Args:
            strikes, t_stay: As in `approach`.
            rate, names: As in `tip_path`.
            by_hand: Follow the hand in place of the tip.

        Returns:
            Positions [m], followed by velocities [m/s], (B, S, 2 d), NaN after a strike's end; their exact derivatives
            at fixed times by m parameters, (B, S, 2 d, m); peak values of the strikes, in their closest approaches to
            the base.
        """
        _, paths, slopes, out = self._tip_path(strikes, t_stay, rate, names, moving=True, by_hand=by_hand)
        return paths, slopes, self._approach(out)

    def _tip_path(
        self,
        strikes: Strikes,
        t_stay: float,
        rate: float,
        names: Sequence[str] = (),
        models: Sequence[Model] | None = None,
        controllers: Sequence[Controller] | None = None,
        *,
        moving: bool = False,
        by_hand: bool = False,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return what `tip_path` does, and what the engine says of each strike, (B, width).

        If `moving`, velocities follow the positions, (B, S, 2 d). If `by_hand`, the path is the hand's.
        """
        strikes = self.vectors(strikes)
        number("rate", rate, low=0, strict=True)
        number("t_stay", t_stay, low=0)
        names = texts("names", names)
        _check_one_each(len(strikes), models=models, controllers=controllers)
        if names and (models or controllers):
            raise InputError("names", list(names), "none, because the strikes have different models")
        S = int((strikes[:, -1].max(initial=0.0) + t_stay) * rate + 1e-9) + 1
        B, m, d = len(strikes), len(names), self.model.dimension
        engine, width = self._engine(forward=m > 0), 2 * d if moving else d
        paths, slopes = np.empty((B, S, width)), np.empty((B, S, width, m))
        out = np.empty((B, outcome_columns(self.model.arm.n, d).width))
        at_once = max(1, _AT_ONCE // max(m, 1))
        for first in range(0, B, at_once):
            part = slice(first, first + at_once)
            targets = np.zeros((len(strikes[part]), d))
            if m:
                batch = self._forward_batch(strikes[part], targets, t_stay, names)
            else:
                batch = self._batch(
                    strikes[part], targets, t_stay, models and models[part], controllers and controllers[part]
                )
            batch.rate, batch.samples, batch.moving, batch.by_hand = rate, S, moving, by_hand
            rolled = engine(batch, threads=self._threads)
            assert rolled.path is not None
            out[part] = rolled.out.reshape(len(targets), max(m, 1), -1)[:, 0]
            both = rolled.path.reshape(len(targets), max(m, 1), S, -1)
            paths[part] = both[:, 0, :, :width]
            if m:
                slopes[part] = both[..., width:].transpose(0, 2, 3, 1)
        return np.arange(S) / rate, paths, slopes, out

    def chain_paths(
        self, strikes: Strikes, *, t_stay: float = T_STAY, names: Sequence[str], stride: int = 1
    ) -> Iterator[ChainPath]:
        """Yield the paths of all links' far ends with their exact derivatives, keeping few strikes in memory.

        Args:
            strikes, t_stay: As in `approach`.
            names: Names of m parameters, as in `gradient`.
            stride: Number of steps of at most `timestep` between samples. Since D shifts the sampling times,
                derivatives by D include a part of the velocity.
        """
        strikes, names = self.vectors(strikes), texts("names", names, least=1)
        d = self.model.dimension
        ends = self.model.arm.n + self.model.whip.N
        m, at_once = len(names), max(1, _TRAJECTORIES_AT_ONCE // len(names))
        for first in range(0, len(strikes), at_once):
            some = strikes[first : first + at_once]
            batch = self._forward_batch(some, np.zeros((len(some), d)), t_stay, names)
            batch.columns, batch.stride = np.arange(ends * d), stride
            paths, slopes = self._engine(forward=True)(batch, threads=self._threads).observed()
            for i in range(len(some)):
                path, interval = paths[i * m], float(batch.h[i * m]) * stride
                slope = np.stack(slopes[i * m : (i + 1) * m], axis=-1)
                shape = (len(path), ends, d)
                yield ChainPath(np.arange(len(path)) * interval, path.reshape(shape), slope.reshape(*shape, m))

    def trajectory(self, strike: AnyStrike | np.ndarray, *, t_stay: float = T_STAY) -> Trajectory:
        return next(self.trajectories(self.one_vector(strike), t_stay=t_stay))

    def trajectories(self, strikes: Strikes, *, t_stay: float = T_STAY) -> Iterator[Trajectory]:
        """Yield the whole trajectories of many strikes, keeping few in memory."""
        strikes, n, a = self.vectors(strikes), self.structure.n, self.model.arm.n
        d = self.model.dimension
        columns, outcome = row_columns(n, a, d), outcome_columns(a, d)
        for first in range(0, len(strikes), _TRAJECTORIES_AT_ONCE):
            some = strikes[first : first + _TRAJECTORIES_AT_ONCE]
            batch = self._batch(some, np.zeros((len(some), d)), t_stay)
            batch.with_rows = True
            rolled = self._engine(forward=False)(batch, threads=self._threads)
            assert rolled.rows is not None
            assert rolled.first_row is not None
            for vector, start, out in zip(some, rolled.first_row, rolled.out, strict=True):
                rows = rolled.rows[start : start + int(out[outcome["last_step"]][0]) + 1]
                x, tau, *tip = (rows[:, columns[name]] for name in ("x", "tau", "tip", "velocity"))
                diverged = bool(out[outcome["diverged"]][0])
                states = States(rows[:, 0], x[:, :n], x[:, n:], tau, diverged, (tip[0], tip[1]))
                yield complete_trajectory(self.model, self.controller, self.space.path(vector), states)

    def directions(self, names: Sequence[str]) -> np.ndarray:
        """Return the derivatives of the parameter vector by named parameters, (m, P); see `parameter_directions`.

        Raises:
            InputError: A name is unknown, or this simulator does not have its term (see `free`).
        """
        of_joints = isinstance(self.space, JointSpace)  # else numbers of the hand are not the same for all strikes
        of_strike = {name: i if of_joints else -1 for i, name in enumerate(self.space.names)}
        return parameter_directions(self.structure, self.model, self.controller, texts("names", names), of_strike)

    def _batch(
        self,
        strikes: np.ndarray,
        targets: np.ndarray,
        t_stay: float | np.ndarray,
        models: Sequence[Model] | None = None,
        controllers: Sequence[Controller] | None = None,
    ) -> Batch:
        n, B = self.structure.n, len(strikes)
        period = self.controller.control_period
        h, h_last, steps, hold = time_grid(
            strikes[:, -1] + _stays(t_stay, B), timestep=self.timestep, control_period=period
        )
        x0, numbers = np.zeros((B, 2 * n)), self.space.numbers(strikes)
        if models is None and controllers is None:
            p = self.structure.pack(self.model, self.controller, numbers)
            x0[:, :n] = start_posture(self.model, self._starts(numbers))
        else:
            p = np.empty((B, self.structure.n_parameters))
            pairs = zip(models or [self.model] * B, controllers or [self.controller] * B, strict=True)
            groups: dict[tuple[int, int], tuple[Model, Controller, list[int]]] = {}
            for i, (model, controller) in enumerate(pairs):
                groups.setdefault((id(model), id(controller)), (model, controller, []))[2].append(i)
            for model, controller, which in groups.values():
                self._check_within(model, controller)
                p[which] = self.structure.pack(model, controller, numbers[which])
                x0[which, :n] = start_posture(model, self._starts(numbers[which]))
        batch = Batch(p, x0, np.ascontiguousarray(targets), h, h_last, steps, hold)
        if self.tolerance is not None:
            batch.tolerance = np.full(B, _OF_A_PATH * self.tolerance)
            batch.knot, batch.weight = strikes[:, -1].copy(), displacements(self.model, n)
            batch.period = period or 0.0
        return batch

    def _starts(self, numbers: np.ndarray) -> np.ndarray:
        """Where the arm stands when strikes of such numbers begin, (B, a) [rad]."""
        q_i = numbers[:, : self.model.arm.n]
        return q_i if self._sag is None else q_i + self._sag(q_i)

    def _check_within(self, model: Model, controller: Controller) -> None:
        expect(Model, models=model)
        expect(Controller, controllers=controller)
        needs, has = Structure.of(model, controller), self.structure
        if needs in has and controller.control_period == self.controller.control_period:
            return
        terms = [f.name for f in fields(needs) if getattr(needs, f.name) != getattr(has, f.name)]
        given, allowed = (", ".join(f"{name} {getattr(x, name)}" for name in terms) for x in (needs, has))
        if controller.control_period != self.controller.control_period:
            given, allowed = (f"control_period {x.control_period}" for x in (controller, self.controller))
        fix = "construct the rollout with a model and controller that have all these terms"
        raise InputError("model or controller of a batch", given, f"as this rollout has: {allowed}", fix)

    def _forward_batch(
        self,
        strikes: np.ndarray,
        targets: np.ndarray,
        t_stay: float,
        names: Sequence[str],
        tolerance: np.ndarray | None = None,
    ) -> Batch:
        """Every strike once per direction: strike 0 along all of them, then strike 1, ...; `tolerance` of their steps'
        errors (B,), default: that of paths."""
        m, n = len(names), self.structure.n
        batch = self._batch(strikes, targets, t_stay)
        if self.tolerance is not None and tolerance is not None:
            batch.tolerance = tolerance
        batch = batch.take(np.repeat(np.arange(len(strikes)), m))
        batch.dp = np.tile(self.directions(names), (len(strikes), 1))
        if not isinstance(self.space, JointSpace):
            self._add_slopes(strikes, names, batch.dp.reshape(len(strikes), m, -1))
        batch.dx0 = np.zeros_like(batch.x0)
        batch.dx0[:, :n] = start_derivative(self.model, self.structure, batch.x0[:, :n], batch.p, batch.dp)
        longer = batch.dp[:, self.structure.columns("D").start]  # the strike's duration grows with D
        if self.controller.control_period is None:
            batch.dh = batch.dh_last = longer / batch.steps
        else:
            batch.dh, batch.dh_last = np.zeros(len(longer)), longer.copy()
        return batch

    def _add_slopes(self, strikes: np.ndarray, names: Sequence[str], directions: np.ndarray) -> None:
        """Add the directions of strikes' own numbers to (B, m, P), in place, where each strike has others."""
        of_strike = list(self.space.names)
        own = [(k, of_strike.index(name)) for k, name in enumerate(names) if name in of_strike]
        if own:
            slopes = self.space.slopes(strikes)
            for k, column in own:
                directions[:, k, : slopes.shape[1]] = slopes[:, :, column]


def _stays(t_stay: float | np.ndarray, count: int) -> np.ndarray:
    """Return how long each of so many strikes is watched after its movement ended [s], (count,)."""
    rule = "a finite number >= 0, or one for each strike"
    stays = array_of("t_stay", t_stay, rule)
    if stays.shape not in ((), (count,)) or (stays < 0).any():
        raise InputError("t_stay", t_stay, rule)
    return np.broadcast_to(stays, count)
