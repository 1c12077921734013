"""How a strike is run: rates, waits, limits of the control loop and of its rehearsal."""

from __future__ import annotations

from dataclasses import dataclass

from whiptool.models.parameters import number
from whiptool.models.strike import T_STAY
from whiptool.rig.caps import Caps

LONGEST_DELAY = 0.1  # [s]
SLOWEST, FASTEST = 0.01, 2.0  # [rad/s] of an approach: bounds that make it end, and keep it slower than a strike


@dataclass(frozen=True)
class LoopOptions:
    """How a strike is run.

    Args:
        rate: Cycles per second [Hz].
        t_stay: The controller stays on after the movement ended [s].
        approach_speed: Largest speed of the reference on the way to the start posture and back [rad/s], 0.01 to 2.
        settle: Wait at the start posture [s]. The whip's hinge has no damping, so that no waiting ends a swing: what
            keeps the whip still is an approach that lasts several of its periods (1.6 s for `lemon2024`; see
            `whiptool.dynamics.modes`).
        go_back: Return to where the arm was armed, before torque goes off.
        caps: Largest stiffness and damping of the strike's controller; `default_caps` gives some.
        rehearse: Play every strike through in simulation before the arm is armed, and refuse what is beyond the motors
            or unstable at this rate.
        delay: Delay from a sample to its torque [s] in the rehearsal: that of the line and the adapter.
        margin: Part of the motors' speed-torque line that is kept free.
        stiffness, damping: Natural frequency [rad/s] and damping ratio of the posture controller that moves the arm
            before and after the strike; its matrices are the arm's inertia times these.
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
