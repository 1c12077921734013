"""Settings of a strike on the rig: rates, waiting times, limits of the control loop and of its rehearsal."""

from __future__ import annotations

from dataclasses import dataclass

from whiptool.models.numbers import number
from whiptool.models.strike import T_STAY
from whiptool.rig.caps import Caps

LONGEST_DELAY = 0.1  # [s]
SLOWEST, FASTEST = 0.01, 2.0  # [rad/s] of an approach: bounds that make it end, and keep it slower than a strike


@dataclass(frozen=True)
class LoopOptions:
    """Settings of the control loop of a strike.

    Args:
        rate: Cycles per second [Hz].
        t_stay: Time after the movement's end for which the controller stays on [s].
        approach_speed: Largest speed of the reference on the way to the start posture and back [rad/s], 0.01 to 2.
        settle: Waiting time at the start posture [s]. As the whip's hinge has no damping, waiting does not stop a
            swing; the approach should last several periods of the whip (1.6 s for `lemon2024`; see
            `whiptool.dynamics.modes`).
        go_back: Whether to return to the posture at arming before torque goes off.
        caps: Largest stiffness and damping of the strike's controller, see `default_caps`; None: no caps.
        rehearse: Whether to simulate every strike before the arm is armed, and to refuse it if it exceeds the motors'
            limits or is unstable at this rate.
        delay: Delay from a sample to its torque in the rehearsal [s], due to bus and adapter.
        margin: Fraction of the motors' limits that must remain unused.
        stiffness, damping: Natural frequency [rad/s] and damping ratio of the controller that moves the arm before and
            after the strike, see `posture_controller`.
    """

    rate: float = 500.0
    t_stay: float = T_STAY
    approach_speed: float = 0.2
    settle: float = 2.0
    go_back: bool = True
    caps: Caps | None = None
    rehearse: bool = True
    delay: float = 0.001
    margin: float = 0.05
    stiffness: float = 25.0
    damping: float = 0.7

    def __post_init__(self) -> None:
        number("rate", self.rate, low=10, high=10_000)
        number("approach_speed", self.approach_speed, low=SLOWEST, high=FASTEST)
        number("delay", self.delay, low=0, high=LONGEST_DELAY)
        for name in ("t_stay", "settle"):
            number(name, getattr(self, name), low=0, high=600)
        for name in ("stiffness", "damping"):
            number(name, getattr(self, name), low=0, strict=True)
