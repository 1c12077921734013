"""Interface of the drivers of robot arms, which follow commanded joint positions by their own controllers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType
from typing import ClassVar, Self

import numpy as np

from whiptool.identification.servo_lag import ServoLag
from whiptool.models.joint_trajectory import JointTrajectory
from whiptool.models.numbers import number
from whiptool.models.parameters import Model
from whiptool.models.spatial_arm import JointLimits
from whiptool.rig.stops import SafetyError

RECOVER = "python -m whiptool.robot recover --robot"  # ADDRESS
IN_LOCKSTEP = "00000000000"  # serial number of an emulated controller whose time waits for commands; no robot has it
START = 0.01  # [rad] by which the first sample of a trajectory may differ from the measured posture


@dataclass(frozen=True, eq=False)
class Sample:
    """State of a robot in one cycle of its controller.

    Args:
        t: Time of the measurement since the trajectory's first sample [s], by the robot's clock.
        q, v: Measured positions [rad] and velocities [rad/s], (n,) each.
        q_d: Commanded positions [rad], (n,).
        tau: Measured joint torques [N m], (n,); None where the robot does not report torques.
        target: Positions [rad], (n,), at which the controller aims in this cycle, which differ from the commanded ones
            where it smooths them; None where it does not report them.
        current: Measured motor currents [A], (n,); None where the robot does not report them.
    """

    t: float
    q: np.ndarray
    v: np.ndarray
    q_d: np.ndarray
    tau: np.ndarray | None = None
    target: np.ndarray | None = None
    current: np.ndarray | None = None


@dataclass(frozen=True)
class Payload:
    """What a robot's flange carries, in the flange's axes: stick and whip.

    Args:
        mass: Mass [kg].
        center: Center of mass [m].
        inertia: Moments of inertia about the center of mass, xx, yy, zz, xy, xz, yz [kg m^2].
    """

    mass: float
    center: tuple[float, float, float]
    inertia: tuple[float, float, float, float, float, float]

    def __post_init__(self) -> None:
        number("mass", self.mass, low=0)


Record = Callable[[Sample], None]
Stop = Callable[[], str | None]


class Robot(ABC):
    """A robot arm of n joints that follows commanded joint positions.

    A driver is a context manager: entering connects, leaving stops every motion and disconnects. It never moves the
    arm except in `follow`, and it never tries again after a fault.

    Attributes:
        n: Number of joints.
        rate: Commanded positions per second [1/s] that the controller takes.
        limits: Limits of the joints that the robot's controller enforces, (n,).
        leads: Whether the driver's commands can lead by the lag of the joints.
        lag: Lag of the joints by which commands lead; None: unknown, they do not lead.
    """

    n: int
    rate: float
    limits: tuple[JointLimits, ...]
    leads: ClassVar[bool] = False
    lag: ServoLag | None = None

    @abstractmethod
    def connect(self) -> None:
        """Connect to the controller; nothing moves.

        Raises:
            InputError: The controller cannot be reached, or is not ready for motion; the message says what to do.
        """

    @abstractmethod
    def disconnect(self) -> None:
        """Stop every motion, and disconnect. It may be called more than once, and after a lost connection."""

    @abstractmethod
    def posture(self) -> np.ndarray:
        """Return the measured joint positions [rad], (n,).

        Raises:
            SafetyError: The connection is lost.
        """

    @abstractmethod
    def set_payload(self, payload: Payload) -> None:
        """State what the flange carries, for the controller's gravity compensation and collision detection.

        Raises:
            InputError: The robot does not accept the payload.
        """

    @abstractmethod
    def follow(self, trajectory: JointTrajectory, record: Record, stop: Stop) -> None:
        """Carry out a trajectory, and return when the arm rests at its end.

        Args:
            trajectory: Positions at the robot's rate, beginning and ending at rest.
            record: Called with the state of every cycle, also of the one that a fault ends.
            stop: Called in every cycle; if it returns a reason, the arm is brought to rest within its limits, and
                SafetyError of the kind `signal` is raised.

        Raises:
            SafetyError: The motion ended early, by `stop`, by a fault of the robot, or by a lost connection; the arm
                does not move any more. `kind` is `start` if the arm was not at the trajectory's first sample, so that
                nothing moved.
        """

    @abstractmethod
    def recover(self) -> None:
        """Acknowledge a fault, after a person has removed its cause; nothing moves.

        Raises:
            SafetyError: The fault persists, or only a person at the robot can acknowledge it.
        """

    def __enter__(self) -> Self:
        self.connect()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.disconnect()

    def check_start(self, trajectory: JointTrajectory) -> None:
        """Refuse a trajectory that does not begin at the measured posture.

        Raises:
            SafetyError: A joint is farther than 0.01 rad from the trajectory's first sample.
        """
        off = np.abs(self.posture() - trajectory.q[0])
        if off.max() > START:
            j = int(off.argmax())
            raise SafetyError(
                "start", f"{trajectory.joints[j]} is {off[j]:.3f} rad from the trajectory's first sample; nothing moved"
            )


def payload_of(model: Model) -> Payload:
    """Return what a model's arm carries beyond its flange: the stick, and the whip as a point at the stick's end.

    The flange's z points along the stick, and its x is that of the hand.

    Args:
        model: Model of an arm in space; its stick is the one of `SpatialArm.stick`.
    """
    length, stick = model.arm.in_space().stick
    whip = model.whip.mass
    mass = stick + whip
    center = (stick * length / 2 + whip * length) / mass
    inertia = stick * length**2 / 12 + stick * (length / 2 - center) ** 2 + whip * (length - center) ** 2
    return Payload(mass, (0.0, 0.0, center), (inertia, inertia, 0.0, 0.0, 0.0, 0.0))
