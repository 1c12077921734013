"""A simulator of throws: strikes whose thing is released on the way, as a rollout for all searches."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal, get_args

import numpy as np

from whiptool.errors import InputError, expect
from whiptool.impedance.controller import Controller
from whiptool.models.hand_space import StrikeSpace
from whiptool.models.numbers import array_of, number
from whiptool.models.parameters import Model
from whiptool.models.strike import T_STAY, AnyStrike
from whiptool.models.trajectory import Approach, Points, Trajectory, target_points
from whiptool.rollout.compiled import CompiledRollout
from whiptool.rollout.interface import ApproachSlopes, Rollout, Strikes
from whiptool.throws.box import Box
from whiptool.throws.flight import Landing, Thing, fly
from whiptool.throws.passage import Opening
from whiptool.throws.release import FARTHEST, RATE, Release, together

Place = Literal["tip", "hand"]
_SEEN_AFTER = 0.1  # [s] for which a trajectory goes on after the landing
_PERTURBED, _SHARE = 1e-6, 1e-4  # [m, m/s], and share of the drag: of differences of exact first derivatives
MASS, RELEASE = "thing.mass", "release_time"  # parameters of a throw, besides those of the strike and the model


def loaded(model: Model, thing: Thing, place: Place) -> Model:
    """Return a model with the thing's mass and drag at the tip, or with its mass at the hand."""
    whip = model.whip
    if place == "hand":
        return replace(model, whip=replace(whip, hinge_mass=whip.hinge_mass + thing.mass))
    mass, drag = whip.per_node("m"), whip.per_node("drag")
    mass[-1] += thing.mass
    drag[-1] += thing.drag
    held = replace(whip, m=tuple(mass.tolist()), drag=tuple(drag.tolist()) if thing.drag else whip.drag)
    return replace(model, whip=held)


@dataclass(frozen=True, repr=False)
class ThrownTrajectory(Trajectory):
    """Trajectory of a throw: `tip` and `tip_velocity` are those of the thing, which lies in its landing point at last.

    Arm and whip go on as if the thing had stayed, which has no effect on its flight.

    Args:
        landing: Landing of the thing, as its closest approach to the box.
        release_time: Time of the release [s].
    """

    landing: Approach | None = None
    release_time: float = 0.0

    MEETING: ClassVar[str] = "landing that counts as"
    FOLLOWED: ClassVar[str] = "thing"

    def decisive(self, near: Approach) -> float:
        return self.release_time

    def approach(self, target: Points) -> Approach:
        near = super().approach(target)
        if self.landing is None:
            return near
        own = {name: getattr(self.landing, name) for name in ("distance", "time", "velocity", "tip")}
        return replace(near, **own)


class ThrowRollout(Rollout):
    """Simulator of throws: the closest approach of a strike is the landing of the thing that it releases.

    The thing is released where its line of flight is best, at the instant with the smallest miss, or at a given time.
    An `Approach` has the thing's miss as its distance, and velocity and time of its landing. `tip` is the opening's
    centre plus the offset that counts, see `passage`; that of a `trajectory` is the landing point itself.

    Args:
        model: Model of arm and whip, without the thing.
        box: Box to enter; its centre can be replaced in each call, and its other numbers hold for all.
        controller: Controller of the arm; default: `default_controller`.
        thing: The thing.
        place: Where the thing is until its release: `tip` or `hand`.
        release_time: Time of the release [s]; None: the best. Strikes that end before it miss by `FARTHEST`.
        release_noise: Standard deviation of the release time [s]. The miss is then at least the largest of those
            of five releases up to two standard deviations early or late.
        options: Further arguments of `CompiledRollout`, by name.

    Attributes:
        model: The model with the thing's mass.

    Raises:
        InputError: An argument is out of range, or the box does not fit the model.
    """

    def __init__(
        self,
        model: Model,
        box: Box,
        controller: Controller | None = None,
        *,
        thing: Thing | None = None,
        place: Place = "tip",
        release_time: float | None = None,
        release_noise: float = 0.0,
        **options: Any,
    ) -> None:
        expect(Box, box=box)
        expect(Thing, type(None), thing=thing)
        if place not in get_args(Place):
            raise InputError("place of the thing", place, ", ".join(get_args(Place)))
        box.check_fits(model)
        self.box, self.thing, self.place = box, thing or Thing(), place
        self.bare = model
        self.model = loaded(model, self.thing, place)
        self.release_time = None if release_time is None else number("release time", release_time, low=0)
        self.release_noise = number("release noise", release_noise, low=0, high=0.2)
        self.rollout = CompiledRollout(self.model, controller, **options)
        self.longest = 0.0  # D of the strikes that are searched [s]
        with suppress(InputError):  # an arm without default bounds
            self.longest = self.space.bounds.upper[-1]
        self.controller, self.engine = self.rollout.controller, self.rollout.engine
        self.timestep, self.tolerance = self.rollout.timestep, self.rollout.tolerance

    @property
    def space(self) -> StrikeSpace:
        return self.rollout.space

    @property
    def opening(self) -> Opening:
        """Opening of the box when a strike begins."""
        box = self.box
        return Opening(box.vector[None], np.array(box.normal), box.drift, box.hit_radius, self.thing.radius)

    def farthest_miss(self, place: Sequence[float]) -> float:
        return FARTHEST + self.model.farthest_miss(place)

    def approach(self, strikes: Strikes, target: Points, *, t_stay: float = T_STAY) -> Approach:
        release, base, _ = self._released(strikes, target, t_stay, ())
        return self._approach(release, base, self._times(release))

    def release_times(self, strikes: Strikes, target: Points | None = None, *, t_stay: float = T_STAY) -> np.ndarray:
        """Return the time at which each strike releases the thing, (B,) [s].

        Args:
            strikes, target, t_stay: As in `approach`; no target: the box.
        """
        return self._times(self._released(strikes, target or self.box, t_stay, ())[0])

    def landings(
        self, strike: AnyStrike | np.ndarray, times: Sequence[float] | np.ndarray, *, t_stay: float = T_STAY
    ) -> Landing:
        """Return where the thing lands that one strike releases at each of R times [s]."""
        release = self._released(self.one_vector(strike), self.box, t_stay, ())[0]
        asked, end = array_of("release times", times, "finite numbers of seconds"), release.last[0] / RATE
        if asked.ndim != 1 or (asked < 0).any() or (asked > end + 1 / RATE).any():
            raise InputError("release times", asked.tolist(), f"times from 0 to {end:g} s, the end of the strike")
        asked, rows = np.minimum(asked, max(end, 0)), np.zeros(len(asked), int)
        return release.landing(release.at(rows, asked)[0], rows, asked)

    def landing(self, strike: AnyStrike | np.ndarray, *, t_stay: float = T_STAY) -> tuple[bool, Landing | None]:
        """Return whether one strike releases the thing, and its landing at the box; None: the thing is not released, or
        never comes down through the opening's plane.
        """
        times = self.release_times(strike, t_stay=t_stay)
        if self._kept(times)[0]:
            return False, None
        found = self.landings(strike, times, t_stay=t_stay)
        assert found.arrives is not None
        return True, found if found.arrives[0] else None

    def gradient(
        self, strikes: Strikes, target: Points, *, t_stay: float = T_STAY, names: Sequence[str] | None = None
    ) -> tuple[Approach, np.ndarray]:
        names = self.space.names if names is None else names
        release, base, moved = self._released(strikes, target, t_stay, names)
        times = self._times(release)
        return self._approach(release, base, times), self._miss_slopes(release, times, moved, names)[0]

    def slopes(
        self, strikes: Strikes, target: Points, *, t_stay: float = T_STAY, names: Sequence[str] | None = None
    ) -> tuple[Approach, ApproachSlopes]:
        """Return landings, and the exact derivatives of the quantities of `ApproachSlopes`.

        Besides the names of `CompiledRollout.gradient`, `thing.mass` and, if the release time is given, `release_time`
        are parameters. With noise of the release time `tip` and its derivatives lie along the nominal miss and have the
        length of the band's.
        """
        names = self.space.names if names is None else names
        near, by_distance, by_tip, by_velocity = self._arrived(strikes, target, t_stay, names)
        own = [name for name in names if name not in (MASS, RELEASE)]
        whole = self.rollout.slopes(strikes, target, t_stay=t_stay, names=own)[1] if own else None
        torques = []
        for name in ("effort", "max_torque"):
            values = np.full((len(near.distance), self.model.arm.n, len(names)), np.nan)
            if whole is not None:
                values[:, :, [names.index(x) for x in own]] = getattr(whole, name)
            torques.append(values)
        return near, ApproachSlopes(by_distance, by_tip, by_velocity, *torques)

    def arrival_gradient(
        self, strikes: Strikes, target: Points, *, t_stay: float = T_STAY
    ) -> tuple[Approach, np.ndarray, np.ndarray]:
        near, _, by_tip, by_velocity = self._arrived(strikes, target, t_stay, self.space.names)
        return near, by_tip, by_velocity

    def trajectory(self, strike: AnyStrike | np.ndarray, *, t_stay: float = T_STAY) -> ThrownTrajectory:
        """Return the trajectory of a throw, until some time after the landing if that is later than the usual end."""
        vector = self.one_vector(strike)
        release, base, _ = self._released(vector, self.box, t_stay, ())
        at = self._times(release)
        landing = self._approach(release, base, at)
        longest = max(t_stay, float(landing.time[0]) + _SEEN_AFTER - vector[-1])
        path = self.rollout.trajectory(vector, t_stay=t_stay if not np.isfinite(longest) else longest)
        start = release.at(np.zeros(1, int), at)[0]
        place = release.landing(start, np.zeros(1, int), at).place
        there = replace(landing, tip=self.box.at(float(landing.time[0])).vector + place)
        rest = vars(path) | {"release_time": float(at[0]), "landing": there}
        if base.diverged[0] or self._kept(at)[0]:
            return ThrownTrajectory(**rest | {"landing": None})
        down = np.zeros(self.model.dimension)
        down[-1] = -self.model.gravity
        free, over = path.t > at[0], path.t >= landing.time[0]
        flown = fly(start, np.minimum(path.t[free], landing.time[0]) - at[0], down, release.drag)
        tip, velocity = path.tip.copy(), path.tip_velocity.copy()
        tip[free], velocity[free] = flown
        velocity[over] = 0.0
        return ThrownTrajectory(**rest | {"tip": tip, "tip_velocity": velocity})

    def trajectories(self, strikes: Strikes, *, t_stay: float = T_STAY):
        return (self.trajectory(vector, t_stay=t_stay) for vector in self.vectors(strikes))

    def _released(
        self, strikes: Strikes, target: Points, t_stay: float, names: Sequence[str]
    ) -> tuple[Release, Approach, np.ndarray]:
        """Return the releases of strikes, their peak values, and derivatives of their states by named parameters."""
        vectors = self.vectors(strikes)
        centres = target_points(target, len(vectors), self.model.dimension)
        inner = [self._mass_name if name == MASS else name for name in names if name != RELEASE]
        states, slopes, base = self.rollout.release_path(
            vectors, t_stay=t_stay, rate=RATE, names=inner, by_hand=self.place == "hand"
        )
        self.check_release(max(self.longest, float(vectors[:, -1].max(initial=0))), t_stay)
        opening = replace(self.opening, centres=np.array(centres))
        release = Release(states, opening, self.model.gravity, self.thing.drag_per_mass, self.release_noise)
        if RELEASE in names:
            if self.release_time is None:
                raise InputError("name", RELEASE, "a parameter of the strike or model, because the best time is taken")
            slopes = np.insert(slopes, list(names).index(RELEASE), 0.0, axis=3)
        return release, base, slopes

    @property
    def _mass_name(self) -> str:
        return "whip.hinge_mass" if self.place == "hand" else f"whip.m[{self.model.whip.N - 1}]"

    def check_release(self, longest: float, t_stay: float = T_STAY) -> None:
        """Refuse a release time that is after the end of the longest strike of a search.

        Args:
            longest: Largest duration D of the strikes that are searched [s].
            t_stay: Time after them [s].

        Raises:
            InputError: No strike lasts until the release.
        """
        self.longest, end = longest, longest + t_stay
        if self.release_time is not None and self.release_time > end:
            rule = f"from 0 to {end:g} s: the longest D, and {t_stay:g} s after it"
            raise InputError("release time", self.release_time, rule, "the thing would never be released")

    def _times(self, release: Release) -> np.ndarray:
        if self.release_time is None:
            return release.best()
        return np.minimum(self.release_time, np.maximum(release.last, 0) / RATE)

    def _kept(self, times: np.ndarray) -> np.ndarray:
        """Return which strikes end before the given release time, (B,)."""
        return times < (-np.inf if self.release_time is None else self.release_time - 1 / RATE)

    def _approach(self, release: Release, base: Approach, times: np.ndarray) -> Approach:
        rows = np.arange(len(times))
        found = release.landing(release.at(rows, times)[0], rows, times)
        kept = self._kept(times)
        miss = np.where(kept, FARTHEST, np.minimum(release.miss(rows, times), FARTHEST))
        lost = base.diverged | ~np.isfinite(miss)
        shown = kept | bool(release.noise)
        offset = np.where(shown[:, None], self._shown(found.offset, miss), found.offset)
        return replace(
            base,
            distance=np.where(lost, np.inf, miss),
            time=times + found.time,
            velocity=found.velocity,
            tip=release.opening.centres + offset,
            integration_error=None,
        )

    @staticmethod
    def _shown(offset: np.ndarray, miss: np.ndarray) -> np.ndarray:
        """Return offsets (B, d) with the length of the misses (B,)."""
        length = np.linalg.norm(offset, axis=1, keepdims=True)
        return np.divide(offset, length, out=np.eye(1, offset.shape[1]) + 0 * offset, where=length > 0) * miss[:, None]

    def _landing_slopes(
        self, release: Release, rows: np.ndarray, instants: np.ndarray, moved: np.ndarray, names: Sequence[str]
    ) -> tuple[Landing, np.ndarray]:
        """Return landings, and how offset and velocity change with named parameters at fixed times, (R, 2 d, m)."""
        states, rates = release.at(rows, instants)
        found = release.landing(states, rows, instants, slopes=True)
        assert found.slopes is not None
        width = states.shape[1]
        change = np.einsum("rij,rjm->rim", found.slopes[:, :, :width], release.at(rows, instants, moved)[0])
        for k, name in enumerate(names):
            if name == MASS:
                change[:, :, k] -= found.slopes[:, :, width] * release.drag / self.thing.mass
            elif name == RELEASE:
                seen = rates - np.r_[self.box.drift, np.zeros(width // 2)]
                change[:, :, k] = np.einsum("rij,rj->ri", found.slopes[:, :, :width], seen)
        return found, change

    def _miss_slopes(
        self, release: Release, times: np.ndarray, moved: np.ndarray, names: Sequence[str]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the derivatives of misses by m parameters, (B, m), at the best times as at given ones."""
        rows, instants = release.band(np.arange(len(times)), times)
        found, change = self._landing_slopes(release, rows, instants, moved, names)
        d, each = found.offset.shape[1], (len(times), len(release.lags))
        miss, weights = together(np.linalg.norm(found.offset, axis=1).reshape(each))
        halves = np.einsum("rd,rdm->rm", found.offset, change[:, :d]).reshape(*each, -1)
        whole = (weights[..., None] * halves).sum(axis=1)
        slope = np.divide(whole, miss[:, None], out=np.zeros_like(whole), where=miss[:, None] > 0)
        return np.where((miss < FARTHEST)[:, None], slope, 0.0), miss

    def _arrived(
        self, strikes: Strikes, target: Points, t_stay: float, names: Sequence[str]
    ) -> tuple[Approach, np.ndarray, np.ndarray, np.ndarray]:
        """Return landings, and the derivatives of miss (B, m), landing point and velocity (B, d, m)."""
        names = list(names)
        release, base, moved = self._released(strikes, target, t_stay, names)
        times, d = self._times(release), self.model.dimension
        near, rows = self._approach(release, base, times), np.arange(len(times))
        by_miss, _ = self._miss_slopes(release, times, moved, names)
        found, change = self._landing_slopes(release, rows, times, moved, names)
        if self.release_time is None:
            later = self._time_slopes(release, times, moved, names)
            rates = release.at(rows, times)[1] - np.r_[self.box.drift, np.zeros(d)]
            assert found.slopes is not None
            change += np.einsum("rij,rj->ri", found.slopes[:, :, : 2 * d], rates)[:, :, None] * later[:, None, :]
        by_tip = change[:, :d]
        if release.noise:
            unit = self._shown(found.offset, np.ones(len(times)))
            by_tip = unit[:, :, None] * by_miss[:, None, :]
        return near, by_miss, by_tip, change[:, d:]

    def _time_slopes(self, release: Release, times: np.ndarray, moved: np.ndarray, names: Sequence[str]) -> np.ndarray:
        """Return the derivatives of the best times by m parameters, (B, m) [s per unit].

        They follow from the root of the slope (implicit function theorem); its own derivatives are differences of exact
        first derivatives.
        """
        rows, instants = release.band(np.arange(len(times)), times)
        states, rates = release.at(rows, instants)
        dstates, drates = release.at(rows, instants, moved)

        def changed(by: np.ndarray, by_rates: np.ndarray, size: float | np.ndarray, later: float = 0.0) -> np.ndarray:
            both = []
            for sign in (1, -1):
                step = sign * np.repeat(np.broadcast_to(size, len(times)), len(release.lags))[:, None]
                shifted = instants + sign * later
                both.append(release.half_slope_of(states + step * by, rates + step * by_rates, rows, shifted))
            return (both[0] - both[1]) / 2

        size = _PERTURBED / np.maximum(1e-9, np.abs(dstates).reshape(len(times), -1, dstates.shape[2]).max(axis=1))
        by_each = [changed(dstates[..., k], drates[..., k], size[:, k]) / size[:, k] for k in range(dstates.shape[2])]
        if MASS in names and release.drag:  # the flight depends on the mass, too
            more, less = (replace(release, drag=release.drag * (1 + x)) for x in (_SHARE, -_SHARE))
            by_drag = (more.half_slope(times) - less.half_slope(times)) / (2 * _SHARE * release.drag)
            by_each[names.index(MASS)] -= by_drag * release.drag / self.thing.mass
        ahead, behind = (release.half_slope(times + x) for x in (_PERTURBED, -_PERTURBED))
        bend = ((ahead - behind) / (2 * _PERTURBED))[:, None]
        inside = (np.abs(release.half_slope(times)) < 1e-6 * np.abs(bend[:, 0]))[:, None] & (bend > 0)
        slopes = np.stack(by_each, axis=1) if by_each else np.zeros((len(times), 0))
        return np.where(inside, -slopes / np.where(bend == 0, 1, bend), 0.0)
