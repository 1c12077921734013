"""Interface of simulators and rigs, and derivatives of closest approaches."""

from __future__ import annotations

import dataclasses
import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, TypeAlias

import numpy as np

from whiptool.errors import InputError
from whiptool.models.hand_space import StrikeSpace
from whiptool.models.parameters import Model
from whiptool.models.strike import T_STAY, AnyStrike, JointSpace, checked_vectors
from whiptool.models.trajectory import Approach, Points, Trajectory, target_points

SMALLEST_STEP, LARGEST_STEP = 1e-6, 0.01  # [s]; strikes need no smaller steps, and are not resolved by larger ones
FINEST, COARSEST = 1e-9, 0.1  # [m], tolerances of a distance's error by integration
MOST_STEPS = 2e6
FASTEST = 1e4  # [rad/s], norm of all joint speeds; faster counts as diverged


def time_grid(
    duration: np.ndarray, *, timestep: float, control_period: float | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    """Return the time steps of B strikes that last `duration` seconds, (B,).

    With a continuous controller all steps of a strike are equal and at most `timestep` [s]. With a control period, each
    period is divided into equal steps, and the last step of the strike may be shorter.

    Raises:
        InputError: The number of steps is too large.

    Returns:
        Length of the steps and of the last step [s], (B,) each; number of steps, (B,); number of steps per control
        period.
    """
    longest = float(np.max(duration, initial=0.0))
    if longest / timestep > MOST_STEPS:
        raise InputError(
            "timestep", timestep, f"at most {MOST_STEPS:.0e} steps a strike", f"this strike lasts {longest:g} s"
        )
    if control_period is None:
        steps = np.ceil(duration / timestep - 1e-9).astype(np.int64)
        h = duration / steps
        return h, h, steps, 1
    hold = math.ceil(control_period / timestep - 1e-9)
    h = np.full(len(duration), control_period / hold)
    steps = np.ceil(duration / h - 1e-9).astype(np.int64)
    return h, duration - (steps - 1) * h, steps, hold


SLOPES = ("tip", "velocity", "effort", "max_torque")  # of which an outcome's columns hold derivatives by name


@dataclass(frozen=True, eq=False)
class ApproachSlopes:
    """Derivatives of an `Approach` of B strikes by m parameters, in d dimensions, for an arm with a joints.

    Args:
        distance: Derivatives of the distance of the tip from the target [m per unit of the parameter], (B, m).
        tip: Derivatives of the tip's position at the closest approach [m per unit], (B, d, m).
        velocity: Derivatives of the tip's velocity there [m/s per unit], (B, d, m).
        effort: Derivatives of each joint's integral of squared torque [N^2 m^2 s per unit], (B, a, m).
        max_torque: Derivatives of each joint's largest torque [N m per unit], (B, a, m).
    """

    distance: np.ndarray
    tip: np.ndarray
    velocity: np.ndarray
    effort: np.ndarray
    max_torque: np.ndarray


Strikes: TypeAlias = AnyStrike | Sequence[AnyStrike] | np.ndarray


class Rollout(ABC):
    """Interface of everything that carries out strikes (simulators and rigs), for searches, learners and planners.

    Args:
        model: Model of arm and whip.
        engine: Name of the engine or rig.
        timestep: Time step of the integrator [s].
        tolerance: Largest integration error of a distance [m], for adaptive steps; else None.
        one_by_one: Whether strikes are costly, as on a rig, and therefore made singly, each only if it is needed.
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
        """Description of the integration accuracy."""
        return f"at {1e3 * self.timestep:g} ms" if self.tolerance is None else f"to {1e3 * self.tolerance:g} mm"

    @property
    def space(self) -> StrikeSpace:
        """Coordinates of the strikes: joint space or hand space."""
        return JointSpace(self.model.arm)

    @property
    def prescribed(self) -> bool:
        """Whether the arm's joints move exactly as commanded (position control)."""
        controller = getattr(self, "controller", None)  # a rig's is its own
        return controller is not None and controller.prescribed

    def farthest_miss(self, place: Sequence[float]) -> float:
        """Return a distance [m] that no miss at a position (d,) exceeds; it serves as a penalty."""
        return self.model.farthest_miss(place)

    def vectors(self, strikes: Strikes) -> np.ndarray:
        """Return strikes as vectors, (B, width of `space`).

        Raises:
            InputError: A vector has a wrong length, a value is not finite, an angle is implausibly large, or a duration
                D is not positive.
        """
        space, joints = self.space, f"an arm of {self.model.arm.n} joints"
        whose = joints if space.kind == "joint" else f"the hand of {joints}"
        vectors = checked_vectors(strikes, space.width, whose)
        space.check_turns("strikes", vectors)
        return vectors

    def one_vector(self, strike: AnyStrike | np.ndarray) -> np.ndarray:
        """Return one strike as a vector.

        Raises:
            InputError: There are several strikes, or as in `vectors`.
        """
        vectors = self.vectors(strike)
        if len(vectors) != 1:
            raise InputError("number of strikes", len(vectors), "1", "for several call trajectories(strikes)")
        return vectors[0]

    @abstractmethod
    def trajectory(self, strike: AnyStrike | np.ndarray, *, t_stay: float = T_STAY) -> Trajectory:
        """Return the trajectory of one strike, of `D + t_stay` seconds.

        Args:
            strike: A `Strike`, in hand space a `HandStrike`, or its vector, (2 a + 1,).
            t_stay: Time after the movement's end that is included [s].

        Raises:
            InputError: The strike is of another arm, or needs too many steps.
        """

    def simulate(self, strike: AnyStrike | np.ndarray, *, t_stay: float = T_STAY) -> Trajectory:
        """Return the trajectory of a strike, as `trajectory` does; the name is that of the command."""
        return self.trajectory(strike, t_stay=t_stay)

    def trajectories(self, strikes: Strikes, *, t_stay: float = T_STAY) -> Iterator[Trajectory]:
        """Yield the trajectories of many strikes, one after the other."""
        for vector in self.vectors(strikes):
            yield self.trajectory(vector, t_stay=t_stay)

    def approach(self, strikes: Strikes, target: Points, *, t_stay: float = T_STAY) -> Approach:
        """Return the closest approaches of any number of strikes.

        Args:
            strikes: One `Strike` or many, or vectors, (B, 2 a + 1).
            target: A `Target` or its coordinates for all strikes, or a position for each, (B, 2) or in space (B, 3)
                [m].
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
        """Return the closest approaches, and the exact derivatives of the miss distances by m parameters, (B, m).

        The arguments are those of `whiptool.rollout.CompiledRollout.gradient`.

        Raises:
            InputError: This simulator has no derivatives.
        """
        raise self._without_derivatives()

    def slopes(
        self, strikes: Strikes, target: Points, *, t_stay: float = T_STAY, names: Sequence[str] | None = None
    ) -> tuple[Approach, ApproachSlopes]:
        """Return the closest approaches, and the exact derivatives of the quantities of `ApproachSlopes`.

        Raises:
            InputError: This simulator has no derivatives.
        """
        raise self._without_derivatives()

    def arrival_gradient(
        self, strikes: Strikes, target: Points, *, t_stay: float = T_STAY
    ) -> tuple[Approach, np.ndarray, np.ndarray]:
        """Return the closest approaches, and the exact derivatives of the tip's position and velocity there by the
        strikes' coordinates.

        Returns:
            The approaches, and the derivatives of position [m per unit of the coordinate] and of the velocity [m/s per
            unit], (B, d, m) each.

        Raises:
            InputError: This simulator has no derivatives.
        """
        near, slopes = self.slopes(strikes, target, t_stay=t_stay)
        return near, slopes.tip, slopes.velocity

    def _without_derivatives(self) -> InputError:
        return InputError("simulator", self.engine, "a simulator with derivatives", "use the compiled simulator")


def joined(approaches: Sequence[Approach], joints: int, dimension: int) -> Approach:
    """Combine the approaches of single strikes into one `Approach`; the list may be empty.

    Args:
        approaches: Approaches of one strike each.
        joints: Number of joints of the arm.
        dimension: Dimension of positions, 2 or 3.
    """
    if not approaches:
        return Approach.none(joints, dimension)
    rows = [[getattr(x, f.name) for x in approaches] for f in dataclasses.fields(Approach)]
    columns: list[Any] = [None if row[0] is None else np.concatenate(row) for row in rows]
    return Approach(*columns)
