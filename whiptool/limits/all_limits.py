"""Combination of limits of motors, joints and distances, by names or defaults, and the order of their checks."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, TypeAlias

import numpy as np

from whiptool.errors import InputError
from whiptool.given_files import number_in
from whiptool.limits.arm_limits import LIMITS, ArmLimits, limits_preset, unlimited
from whiptool.limits.clearance import Clearance
from whiptool.limits.limits import Limits, Smooth
from whiptool.limits.point_speeds import PointSpeeds
from whiptool.models.excess import Excess
from whiptool.models.mount import default_floor
from whiptool.models.numbers import LONGEST, metres
from whiptool.models.parameters import Model
from whiptool.models.strike import AnyStrike, StrikeBounds
from whiptool.models.trajectory import Approach, Trajectory
from whiptool.words import as_named

COMMANDED = "joint"  # what judges a movement that is commanded faster than the joints may go: the joints' limits

_DRAWS = 256  # times as many random strikes are drawn at most as have to keep the limits

Given: TypeAlias = Limits | Sequence[Limits] | None


def default_limits(model: Model, *, prescribed: bool) -> list[Limits]:
    """Return the default limits of a model's strikes.

    For a robot these are the limits of its joints, no contact of arm and whip with the arm, and the floor on which it
    stands, see `default_floor`; a planar or a human arm has none.

    Args:
        model: Model of arm and whip.
        prescribed: Whether joints move exactly as commanded (position control).
    """
    return named_limits({}, model, prescribed=prescribed)


def named_limits(named: Mapping[str, Any], model: Model, *, prescribed: bool) -> list[Limits]:
    """Return the limits that options name.

    `limits` names those of the joints (`arm`, the default if they have any), of a motor, or `none`; `keep_free` is the
    fraction of them that stays unused. `floor` is its height [m], or `none` (default: `default_floor`), `clearance` the
    least distance between arm, whip and floor [m], and with `ignore_collisions` these may touch. `speed_limits` are
    largest speeds of points of the arm, as `elbow=1.5`, in addition to those of the arm.
    """
    name, found = named.get("limits"), []
    if name == "none":
        return found
    keep_free, clearance = named.get("keep_free", 0.0), named.get("clearance", 0.0)
    if name == "arm" or (name is None and ArmLimits.are_in(model.arm)):
        found.append(ArmLimits.of(model.arm, keep_free=keep_free, prescribed=prescribed))
    elif name is not None:
        if model.arm.weightless:
            rule = "arm or none, because the inertia of the arm and thus its torques are unknown"
            raise InputError("limits", name, rule, "write an <inertial> of each link into the file")
        if model.arm.slides:
            rule = f"arm or none, because these joints are prismatic: {', '.join(model.arm.slides)}"
            raise InputError("limits", name, rule)
        found.append(limits_preset(name).keeping_free(keep_free))
    elif keep_free and not (named.get("speed_limits") or getattr(model.arm, "speed_limits", ())):
        raise InputError("keep_free", keep_free, "0 for an arm without limits", "or give the limits of a motor (xm430)")
    speeds = PointSpeeds.of(model.arm, named.get("speed_limits", ()), keep_free=keep_free)
    found += [] if speeds is None else [speeds]
    given = named.get("floor")
    floor = default_floor(model.arm) if given is None else floor_height(given)
    if not named.get("ignore_collisions") and (floor is not None or Clearance.is_of(model)):
        found.append(Clearance(model, floor, clearance))
    elif clearance:
        raise InputError("clearance", clearance, "0 for an arm with neither capsules nor a floor")
    return found


def unchecked_by(limits: Sequence[Limits]) -> tuple[str, ...]:
    """Return what limits leave unchecked of a robot's strike, in words; empty: nothing. The limits of the joints always
    hold for the commanded path.
    """
    distances = [x for x in limits if isinstance(x, Clearance)]
    found = {
        "collisions": any(Clearance.is_of(x.model) for x in distances),
        "floor": any(x.floor is not None for x in distances),
        "torques and speeds of the joints in the simulated strike": any(isinstance(x, ArmLimits) for x in limits),
    }
    lacking = {word for x in limits if isinstance(x, ArmLimits) for word in unlimited(x.joints, [""] * len(x.joints))}
    found |= {f"{word}s of joints that have no limit of it": word not in lacking for word in ("speed", "torque")}
    return tuple(what for what, checked in found.items() if not checked)


def floor_height(given: str | float) -> float | None:
    """Return the height of a floor [m] as it is written, such as `-0.5`; None for `none`."""
    if given == "none":
        return None
    try:
        height = number_in(str(given))
    except ValueError:
        raise InputError("floor", given, "a number [m], or none") from None
    return metres("floor", height, low=-LONGEST, strict=False)


def limits_given(given: Given | Literal["default"], model: Model, *, prescribed: bool) -> Given:
    """Return the given limits as those of a model, or `default_limits` for "default"; `prescribed` joints follow their
    commanded paths exactly (position control).
    """
    if not isinstance(given, str):
        return [x.of_model(model) if isinstance(x, Limits) else x for x in AllLimits(given).members]
    if given != "default":
        rule = "'default', None, or MotorLimits, ArmLimits or Clearance, one or several"
        motor = as_named(given, LIMITS)
        raise InputError("limits", given, rule, f"give limits_preset({motor!r})" if motor in LIMITS else "")
    return default_limits(model, prescribed=prescribed)


def distance_beyond(penalty: float, beyond: np.ndarray | float) -> np.ndarray | float:
    """Return the miss distances [m] that a search counts for strikes that exceed limits by `beyond` >= 0, any shape:
    they increase from `penalty` [m], larger than any miss, towards twice that, and so exceed every real miss.
    """
    return penalty * (2 - 1 / (1 + beyond))


class AllLimits:
    """Combination of several limits, all of which a strike has to keep; if strikes are not in joint space
    (`by_joints`), no limit can be checked without simulation.
    """

    def __init__(self, given: Given, *, by_joints: bool = True) -> None:
        self.members: tuple[Limits, ...] = (
            () if given is None else tuple(given) if isinstance(given, Sequence) else (given,)
        )
        for member in self.members:
            if isinstance(member, type) or not hasattr(member, "violation"):
                rule = "MotorLimits, ArmLimits or Clearance, one or several"
                raise InputError("limits", type(member).__name__, rule)
        self._by_joints = by_joints
        self.commands = tuple(x.command for x in self.members if by_joints and x.command is not None)

    @property
    def smooth(self) -> tuple[Smooth, ...]:
        """Constraints that a search can keep without simulating a strike."""
        return tuple(each for limits in self.members for each in limits.smooth) if self._by_joints else ()

    def kept_beforehand(self, strikes: np.ndarray) -> np.ndarray:
        """Return whether strikes (B, 2 a + 1) keep the constraints in `smooth`, which need no simulation, (B,)."""
        keep = np.ones(len(strikes), bool)
        for smooth in self.smooth:
            keep[keep] = smooth.kept(strikes[keep])
        return keep

    def random_strikes(self, bounds: StrikeBounds, rng: np.random.Generator, count: int) -> np.ndarray:
        """Return random strikes (count, 2 a + 1) in a box that keep the limits that can be checked without simulation.

        If too few are found, the other strikes may break these limits.
        """
        drawn = self.admissible(bounds.sample(rng, count), bounds)
        found = drawn[self.kept_beforehand(drawn)]
        for _ in range(_DRAWS):
            if len(found) >= count:
                break
            drawn = self.admissible(bounds.sample(rng, count), bounds)
            found = np.concatenate([found, drawn[self.kept_beforehand(drawn)]])
        return np.concatenate([found, drawn])[:count]

    def __bool__(self) -> bool:
        return bool(self.members)

    def shortened(self, strikes: np.ndarray) -> np.ndarray:
        """Return strikes (B, 2 a + 1) with end postures moved towards the start so that commanded paths keep their
        limits.
        """
        for command in self.commands:
            strikes = command.shortened(strikes)
        return strikes

    def admissible(self, strikes: np.ndarray, bounds: StrikeBounds) -> np.ndarray:
        """Return strikes (B, m) clipped to a box, and shortened so that commanded paths keep their limits."""
        lower, upper = bounds.box
        return np.clip(self.shortened(np.clip(strikes, lower, upper)), lower, upper)

    def narrowed(self, bounds: StrikeBounds) -> StrikeBounds:
        """Return the part of a box of strikes that is within the position limits."""
        lower, upper = bounds.box
        for limits in self.members:
            if limits.positions is not None and self._by_joints:
                low, high = (np.r_[x, x, end] for x, end in zip(limits.positions, (-np.inf, np.inf), strict=True))
                lower, upper = np.maximum(lower, low), np.minimum(upper, high)
                for i in np.flatnonzero(~(lower < upper)):
                    rule = f"a range that overlaps the position limits, {low[i]:.4g} to {high[i]:.4g}"
                    raise InputError(f"bounds[{i}]", (bounds.lower[i], bounds.upper[i]), rule)
        for limits in self.members:
            if isinstance(limits, Clearance) and self._by_joints:
                limits.check_box(lower, upper)
        return StrikeBounds(tuple(lower), tuple(upper))

    @property
    def floor(self) -> float:
        """Height below which nothing may be [m]; minus infinity without a floor."""
        floors = [x.floor for x in self.members if isinstance(x, Clearance) and x.floor is not None]
        return max(floors, default=-np.inf)

    def violation_of_peaks(self, near: Approach) -> np.ndarray:
        """Return the excess of strikes over the limits by peak values alone, (B,), by which searches rank them, -1
        without limits; peak values show no distances, and so never tell that a strike may be made.
        """
        unlimited = np.full(np.shape(near.diverged), -1.0)
        return np.max([unlimited, *(limits.violation_of_peaks(near) for limits in self.members)], axis=0)

    def judged(
        self,
        strikes: np.ndarray,
        near: Approach,
        trajectory: Callable[[np.ndarray], Trajectory],
        *,
        candidates: Sequence[int] | np.ndarray,
    ) -> tuple[np.ndarray, list[str]]:
        """Return the excess of each strike (B, 2 a + 1) over the limits, (B,), at most 0 within them, and the `judges`
        of the limit that it exceeds most, (B,), without a meaning for strikes within all limits.

        A strike whose peak values exceed a limit is checked along its whole trajectory if peak values do not suffice.
        Distances and speeds of points are checked for the `candidates` alone: indices of all strikes that may be made
        if they keep the limits, such as hits.
        """
        beyond, names = [np.zeros(len(strikes))], [COMMANDED]
        for limits in self.members:
            if self._by_joints and limits.command is not None:
                beyond.append(limits.command.violation(strikes))
                names.append(limits.judges)
            its = limits.violation_of_peaks(near)
            if not limits.by_peaks:
                for i in np.flatnonzero((its > 0) & np.isfinite(its)):
                    its[i] = limits.violation(trajectory(strikes[i]))
            beyond.append(its)
            names.append(limits.judges)
        rows = np.array(beyond)  # (limits, B)
        most, by = rows.max(axis=0), [names[k] for k in rows.argmax(axis=0)]
        for i in candidates if self.of_candidates else ():
            if most[i] <= 0:
                most[i], by[i] = self.judged_whole(trajectory(strikes[i]))
        return most, by

    @property
    def of_candidates(self) -> bool:
        """Whether the whole trajectory has to be checked for strikes that would be hits or the best."""
        return any(limits.of_candidates for limits in self.members)

    def violation(self, trajectory: Trajectory, strike: AnyStrike | None = None) -> float:
        """Return the excess of a strike's whole trajectory over the limits, at most 0 within them; without the
        commanded strike, limits of the command are not checked.
        """
        return self.judged_whole(trajectory, strike)[0]

    def judged_whole(self, trajectory: Trajectory, strike: AnyStrike | None = None) -> tuple[float, str]:
        """Return the excess of a whole strike over the limits, as `violation`, and the limit that it exceeds most, as
        `judged`.
        """
        found = [(0.0, COMMANDED), *((x.violation(trajectory), x.judges) for x in self.members)]
        for x in self.members if strike is not None and self._by_joints else ():
            if x.command is not None:
                assert strike is not None
                found.append((float(x.command.violation(strike.vector[None])[0]), x.judges))
        return max(found, key=lambda one: one[0])

    def explain(self, trajectory: Trajectory, joints: Sequence[str], strike: AnyStrike | None = None) -> str | None:
        """Return a description of the limit that a strike exceeds most; None if it keeps all."""
        found = self.worst(trajectory, joints, strike)
        return None if found is None else str(found)

    def worst(self, trajectory: Trajectory, joints: Sequence[str], strike: AnyStrike | None = None) -> Excess | None:
        """Return what a strike exceeds most, and when; None if it keeps all limits."""
        found: list[tuple[float, Callable[[], Excess]]] = [
            (limits.violation(trajectory), lambda limits=limits: limits.explain(trajectory, joints))
            for limits in self.members
        ]
        if strike is not None:
            vector = strike.vector
            found += [
                (float(c.violation(vector[None])[0]), lambda c=c: c.explain(vector, joints)) for c in self.commands
            ]
        worst, words = max(found, key=lambda x: x[0], default=(0.0, None))
        return None if words is None or worst <= 0 else words()
