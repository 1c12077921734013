"""The motor of an emulated servo, and when the servo protects it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from whiptool.errors import InputError
from whiptool.limits.arm_limits import XM430
from whiptool.models.numbers import number
from whiptool.rig.dynamixel.control_table import RATED_VOLTAGE


@dataclass(frozen=True)
class Motor:
    """Parameters of a motor, all at the output shaft; the default values are those of the XM430-W350 at 12 V.

    The manual gives stall torque, stall current and no-load speed. They fix the winding's resistance `V / i_stall`,
    the back EMF `V / w_0`, and, since an ideal gear would give as many N m/A as V s/rad, the gear's efficiency 0.72.

    Args:
        voltage: Supply voltage [V].
        resistance: Resistance of the winding [ohm].
        back_emf: Back EMF per speed [V s/rad], equal to the torque constant [N m/A] with an ideal gear.
        efficiency: Efficiency of the gear.
        viscous_friction: Viscous friction [N m s/rad].
        dry_friction: Dry friction torque at speeds far above `friction_velocity` [N m].
        friction_velocity: Speed below which dry friction is smoothed [rad/s]; the torque is `-dry_friction v / sqrt(v^2
            + friction_velocity^2)`.
        inertia: Inertia of rotor and gear [kg m^2].

    Raises:
        InputError: A value is not finite, or out of range.
    """

    voltage: float = RATED_VOLTAGE
    resistance: float = RATED_VOLTAGE / XM430.stall_current
    back_emf: float = RATED_VOLTAGE / XM430.no_load_speed
    efficiency: float = XM430.stall_torque / XM430.stall_current / (RATED_VOLTAGE / XM430.no_load_speed)
    viscous_friction: float = 0.0
    dry_friction: float = 0.0
    friction_velocity: float = 0.05
    inertia: float = 0.0

    def __post_init__(self) -> None:
        for name in ("voltage", "resistance", "back_emf", "efficiency", "friction_velocity"):
            object.__setattr__(self, name, number(name, getattr(self, name), low=0, strict=True))
        for name in ("viscous_friction", "dry_friction", "inertia"):
            object.__setattr__(self, name, number(name, getattr(self, name), low=0))
        if self.efficiency > 1:
            raise InputError("efficiency", self.efficiency, "a number > 0 and <= 1")

    @property
    def torque_constant(self) -> float:
        """Torque at the output per current [N m/A]."""
        return self.efficiency * self.back_emf

    def current(self, goal: float, speed: float, low: float | None = None, high: float | None = None) -> float:
        """Return the current [A] for a goal [A] at a speed of the output [rad/s], as far as a voltage from `low` to
        `high` [V] gives it; default: the supply voltage in both directions. With `low` equal to `high`, this is the
        current at that voltage.
        """
        if low is None or high is None:
            low, high = -self.voltage, self.voltage
        emf = self.back_emf * speed
        return min(max(goal, (low - emf) / self.resistance), (high - emf) / self.resistance)

    def torque(self, current: float, speed: float) -> float:
        """Return the torque at the output [N m] for a current [A] at a speed [rad/s], less friction."""
        friction = self.viscous_friction * speed
        if self.dry_friction:
            friction += self.dry_friction * speed / math.sqrt(speed * speed + self.friction_velocity**2)
        return self.torque_constant * current - friction


# What a worn-in servo is like: friction of a tenth of the stall torque and less, a rotor of about 0.01 kg m^2 (the
# inertia that models of arms with this servo use). Estimates, not the maker's figures: identify your own.
HARDWARE = Motor(viscous_friction=0.03, dry_friction=0.08, inertia=0.008)


@dataclass(frozen=True)
class Protection:
    """Thresholds at which a servo shuts itself down; they are estimates, as the manual states only the errors.

    Args:
        overload_current: Current above which a servo is overloaded [A].
        overload_time: Duration of an overload after which it shuts down [s].
        ambient: Temperature of a servo at rest [deg C].
        heating: Steady temperature rise per power dissipated in the winding [K/W].
        warming_time: Time constant of the temperature [s].
    """

    overload_current: float = 1.9
    overload_time: float = 2.0
    ambient: float = 30.0
    heating: float = 4.0
    warming_time: float = 200.0
