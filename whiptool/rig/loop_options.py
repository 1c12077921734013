"""Settings of a strike on the rig: rates, waiting times, limits, and caps of stiffness and damping.

A sampled loop is stable only up to some stiffness and damping, and the gains of OIAC grow without bound.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from whiptool.impedance.arm import Arm
from whiptool.impedance.controller import Controller, ControlLoop
from whiptool.impedance.laws import OIAC
from whiptool.models.numbers import number
from whiptool.models.parameters import Model
from whiptool.models.strike import T_STAY, Strike


@dataclass(frozen=True)
class Caps:
    """Largest stiffness and damping of the controller; if either is exceeded, both matrices are scaled down together.

    For constant impedance the limits apply to the matrices' spectral norms. The torque of the adaptive law OIAC is a
    scalar g times `e + beta de` (Eqs. 2, 8-10), with the errors e of position and de of velocity; its effective
    stiffness is g and its effective damping `beta g`.

    Args:
        K: Stiffness [N m/rad].
        B: Damping [N m s/rad].
    """

    K: float
    B: float

    def __post_init__(self) -> None:
        for name in ("K", "B"):
            number(name, getattr(self, name), low=0, strict=True)


def default_caps(model: Model, *, period: float, delay: float = 0.0, rotor_inertia: float = 0.0) -> Caps:
    """Return caps that keep the sampled loop of an arm without whip stable.

    A torque that is held for `period` [s] acts half a period late, plus `delay` [s]; T is the sum. For an inertia I
    under `tau = -B v` delayed by T, the loop is stable if `B T / I < pi / 2`; `B T / I = 1/2` is used, with the
    smallest inertia of the arm in any posture including the motors' `rotor_inertia` [kg m^2]. The stiffness is `B^2 /
    (4 I)`, for which the damping is critical.
    """
    arm, rng = Arm(model), np.random.default_rng(0)
    postures = rng.uniform(-np.pi, np.pi, (200, arm.n))
    smallest = min(float(np.linalg.eigvalsh(arm.inertia(q))[0]) for q in postures) + rotor_inertia
    B = 0.5 * smallest / (0.5 * period + delay)
    return Caps(K=B**2 / (4 * smallest), B=B)


class CappedLoop(ControlLoop):
    """Control loop with stiffness and damping limited by `Caps`."""

    def __init__(self, controller: Controller, arm: Arm, strike: Strike, caps: Caps | None) -> None:
        super().__init__(controller, arm, strike)
        self.caps = caps

    def torque(self, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the capped torque; see `ControlLoop.torque`."""
        if self.caps is None:
            return super().torque(t, q, v)
        q_d, v_d, a_d = self.strike.reference(t)
        e, de = q_d - q, v_d - v
        law = self.controller.law
        K, B = law.gains(e, de)
        tau = K @ e + B @ de
        if isinstance(law, OIAC):
            stiffness = float(np.linalg.norm(tau) / max(float(np.linalg.norm(e + law.beta * de)), 1e-300))
            damping = law.beta * stiffness
        else:
            stiffness, damping = float(np.linalg.norm(K, 2)), float(np.linalg.norm(B, 2))
        scale = min(1.0, self.caps.K / max(stiffness, 1e-300), self.caps.B / max(damping, 1e-300))
        tau = scale * tau + self.arm.gravity_compensation(q, self.controller.compensated)  # Eq. 2
        if self.controller.feedforward:
            tau = tau + self.arm.feedforward(q_d, v_d, a_d)
        return self.controller.clipped(tau)


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
