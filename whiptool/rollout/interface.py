"""What every rollout of strikes does, be it compiled, the reference, or a rig."""

from __future__ import annotations

import dataclasses
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from typing import Any, ClassVar, TypeAlias

import numpy as np

from whiptool.errors import InputError
from whiptool.models.closest import Points, target_points
from whiptool.models.hand_space import StrikeSpace
from whiptool.models.joint_space import AnyStrike, JointSpace, checked_vectors
from whiptool.models.parameters import Model
from whiptool.models.strike import T_STAY
from whiptool.models.trajectory import Approach, Trajectory
from whiptool.rollout.slopes import ApproachSlopes

Strikes: TypeAlias = AnyStrike | Sequence[AnyStrike] | np.ndarray


class Rollout(ABC):
    """Strikes in, what the tip did out. Whoever has one, has any: search, learner, planner.

    Args:
        model: Whip, arm and gravity.
        engine: Name of the engine or rig.
        timestep: Timestep of the integrator [s].
        tolerance: Largest error of a distance by integration [m], where steps are chosen by their errors; else None.
        one_by_one: Whether each strike costs more than time, so that none is asked for that may not be needed.
    """

    model: Model
    engine: str
    timestep: float
    tolerance: float | None = None
    one_by_one: ClassVar[bool] = False

    def __repr__(self) -> str:
        controller = getattr(self, "controller", None)  # a rig's is its own
        law = "" if controller is None else f"{type(controller.law).__name__}, "
        return f"{type(self).__name__}({self.model.name}, {law}{self.accuracy}, {self.engine})"

    @property
    def accuracy(self) -> str:
        """How finely it integrates, in words."""
        return f"at {1e3 * self.timestep:g} ms" if self.tolerance is None else f"to {1e3 * self.tolerance:g} mm"

    @property
    def space(self) -> StrikeSpace:
        """What describes its strikes: the joints, or the hand."""
        return JointSpace(self.model.arm)

    @property
    def prescribed(self) -> bool:
        """Whether the arm's joints move exactly as commanded, as under position control."""
        controller = getattr(self, "controller", None)  # a rig's is its own
        return controller is not None and controller.prescribed

    def vectors(self, strikes: Strikes) -> np.ndarray:
        """Return strikes as vectors, (B, width of `space`).

        Raises:
            InputError: They are of another space, a value is not finite, an angle is farther than any arm turns, or a
                duration D is not positive.
        """
        space, joints = self.space, f"an arm of {self.model.arm.n} joints"
        whose = joints if space.kind == "joint" else f"the hand of {joints}"
        vectors = checked_vectors(strikes, space.width, whose)
        space.check_turns("strikes", vectors)
        return vectors

    def one_vector(self, strike: AnyStrike | np.ndarray) -> np.ndarray:
        """Return one strike as a vector.

        Raises:
            InputError: They are several, or see `vectors`.
        """
        vectors = self.vectors(strike)
        if len(vectors) != 1:
            raise InputError("strikes", len(vectors), "one", "of several, take trajectories(strikes)")
        return vectors[0]

    @abstractmethod
    def trajectory(self, strike: AnyStrike | np.ndarray, *, t_stay: float = T_STAY) -> Trajectory:
        """Return the whole of one strike of `D + t_stay` seconds.

        Args:
            strike: A `Strike`, in hand space a `HandStrike`, or its vector, (2 a + 1,).
            t_stay: How long the strike is watched after the movement ended [s].

        Raises:
            InputError: The strike is of another arm, or needs too many steps.
        """

    def simulate(self, strike: AnyStrike | np.ndarray, *, t_stay: float = T_STAY) -> Trajectory:
        """Return the same as `trajectory`, under the name of the command."""
        return self.trajectory(strike, t_stay=t_stay)

    def trajectories(self, strikes: Strikes, *, t_stay: float = T_STAY) -> Iterator[Trajectory]:
        """Return the whole of many strikes, one after the other."""
        for vector in self.vectors(strikes):
            yield self.trajectory(vector, t_stay=t_stay)

    def approach(self, strikes: Strikes, target: Points, *, t_stay: float = T_STAY) -> Approach:
        """Return the closest approaches of any number of strikes.

        Args:
            strikes: One `Strike` or many, or vectors, (B, 2 a + 1).
            target: A `Target` or its coordinates for all, or one place each, (B, 2) or in space (B, 3) [m].
            t_stay: Time after the movement during which the tip is followed [s].

        Raises:
            InputError: Shapes do not match.
        """
        vectors = self.vectors(strikes)
        paths = self.trajectories(vectors, t_stay=t_stay)
        points = target_points(target, len(vectors), self.model.dimension)
        found = [path.approach(point) for path, point in zip(paths, points, strict=True)]
        return joined(found, self.model.arm.n, self.model.dimension)

    def gradient(
        self, strikes: Strikes, target: Points, *, t_stay: float = T_STAY, names: Sequence[str] | None = None
    ) -> tuple[Approach, np.ndarray]:
        """Return the closest approaches, and the exact derivatives of the miss distances, (B, m).

        Raises:
            InputError: This rollout has none.
        """
        raise self._without_derivatives()

    def slopes(
        self, strikes: Strikes, target: Points, *, t_stay: float = T_STAY, names: Sequence[str] | None = None
    ) -> tuple[Approach, ApproachSlopes]:
        """Return the closest approaches, and the exact derivatives of all that they tell.

        Raises:
            InputError: This rollout has none.
        """
        raise self._without_derivatives()

    def arrival_gradient(
        self, strikes: Strikes, target: Points, *, t_stay: float = T_STAY, names: Sequence[str] | None = None
    ) -> tuple[Approach, np.ndarray, np.ndarray]:
        """Return the closest approaches, and the exact derivatives of the tip's place and velocity there.

        Returns:
            The approaches, and the derivatives of the place [m per unit of the parameter] and of the velocity
            [m/s per unit], (B, d, m) each.

        Raises:
            InputError: This rollout has none.
        """
        near, slopes = self.slopes(strikes, target, t_stay=t_stay, names=names)
        return near, slopes.tip, slopes.velocity

    def _without_derivatives(self) -> InputError:
        return InputError("simulator", self.engine, "one with derivatives", "use the compiled simulator")


def joined(approaches: Sequence[Approach], joints: int, dimension: int) -> Approach:
    """Return approaches of single strikes as one of them all, also of none.

    Args:
        approaches: Approaches of one strike each.
        joints: Joints of the arm.
        dimension: Dimension of the places, 2 or 3.
    """
    if not approaches:
        return Approach.none(joints, dimension)
    rows = [[getattr(x, f.name) for x in approaches] for f in dataclasses.fields(Approach)]
    columns: list[Any] = [None if row[0] is None else np.concatenate(row) for row in rows]
    return Approach(*columns)
