"""The controllers of an emulated servo's firmware, by operating mode.

Source: https://emanual.robotis.com/docs/en/dxl/x/xm430-w350/, "Position PID Gain(80, 82, 84), Feedforward 1st/2nd
Gains(88, 90)" and "Velocity PI Gain(76, 78)": their structure, the scale factors of the gains, and that Goal PWM and
PWM Limit bound the output of every mode. The manual does not state the following, which are estimates: the period of
the controllers, 1 ms; the conversion beta of the velocity controller, 1; the anti-windup, which holds the integral
while the output is at its bound; the units of the feedforward gains; that mode 5 has the gains of mode 3. With the
factory's gains the first three matter in velocity mode alone.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

from whiptool.rig.dynamixel.control_table import (
    CURRENT_BASED_MODE,
    CURRENT_MODE,
    PWM_MODE,
    VELOCITY_MODE,
    XM430_W350,
)
from whiptool.rig.emulator.motion_profile import VELOCITY, Profile, resting, to_position, to_velocity

if TYPE_CHECKING:
    from whiptool.rig.emulator.memory import Memory

PERIOD = 0.001  # [s]
AMPERE = 2.69e-3  # [A] of one count of a real servo's current
FULL_PWM = XM430_W350["pwm_limit"].high  # the whole supply voltage
REVERSE, TIME_BASED, TORQUE_ON_BY_GOAL = 1, 4, 8  # bits of Drive Mode(10)
_GOALS = struct.Struct("<hh")  # Goal PWM and Goal Current are neighbours
Drive = tuple[float, float, float]  # wanted current [A], lowest and highest voltage [V]
OFF: Drive = (0.0, 0.0, 0.0)


class Controllers:
    """The controllers of one servo, which turn its goals into a current and a voltage.

    Args:
        registers: Registers of the servo.
        fineness: Factor by which the registers' counts are finer than a real servo's.
        ampere: Current per count of Goal Current [A].
    """

    def __init__(self, registers: Memory, *, fineness: int, ampere: float) -> None:
        self._registers, self._fineness, self._ampere = registers, fineness, ampere
        self.rest(0.0)

    # -- goals ---------------------------------------------------------------------------------------------------

    def rest(self, position: float) -> None:
        """Begin at rest, at a position [counts], without a profile and with an empty integral."""
        self.profile: Profile = resting(position)
        self.time = 0.0  # [s] since the profile's begin
        self._integral, self._error = 0.0, 0.0
        self._pwm = 0.0

    def go(self) -> None:
        """Begin a profile to Goal Position or Goal Velocity, from the position and velocity of the current profile.

        The manual says from the present position and velocity; a servo that stands below its goal under a load would
        then sag at every new goal.
        """
        get, f = self._registers.get, self._fineness
        p, v, _ = self.profile.at(self.time)
        acceleration, timed = get("profile_acceleration"), bool(get("drive_mode") & TIME_BASED)
        if get("operating_mode") == VELOCITY_MODE:
            self.profile = to_velocity(v, get("goal_velocity") / f * VELOCITY, acceleration=acceleration, timed=timed)
        else:
            goal, velocity = get("goal_position") / f, get("profile_velocity")
            self.profile = to_position(p, v, goal, velocity=velocity, acceleration=acceleration, timed=timed)
        self.time = 0.0

    @property
    def ongoing(self) -> bool:
        """Whether a profile to Goal Position is in progress."""
        return self._registers.memory[11] != VELOCITY_MODE and self.time < self.profile.duration

    def trajectory(self) -> tuple[float, float]:
        """Return position and velocity of the profile now, in counts of the registers of a real servo."""
        p, v, _ = self.profile.at(self.time)
        return p, v / VELOCITY

    # -- output --------------------------------------------------------------------------------------------------

    def step(self, position: float, velocity: float) -> None:
        """Go on by one period of the controllers.

        Args:
            position: Measured position [counts].
            velocity: Measured velocity [counts of 0.229 rev/min].
        """
        mode = self._registers.memory[11]
        if mode in (CURRENT_MODE, PWM_MODE):
            return
        self.time += PERIOD
        p, v, a = self.profile.at(self.time)
        if mode == VELOCITY_MODE:
            self._pwm = self._pi(v / VELOCITY - velocity)
        else:
            self._pwm = self._pid(p - position, v, a)

    def _pi(self, error: float) -> float:
        """Output of the velocity controller [counts of PWM] for an error in counts of velocity."""
        get = self._registers.get
        return self._bounded(get("velocity_p_gain") / 128 * error, get("velocity_i_gain") / 65_536 * error)

    def _pid(self, error: float, v: float, a: float) -> float:
        """Output of the position controller [counts of PWM; of current in mode 5] for an error [counts], and velocity
        [counts/s] and acceleration [counts/s2] of the profile.
        """
        get = self._registers.get
        rise, self._error = error - self._error, error
        direct = (
            get("position_p_gain") / 128 * error
            + get("position_d_gain") / 16 * rise
            + get("feedforward_1st_gain") / 4 * v * PERIOD
            + get("feedforward_2nd_gain") / 4 * a * PERIOD**2
        )
        return self._bounded(direct, get("position_i_gain") / 65_536 * error)

    def _bounded(self, direct: float, added: float) -> float:
        """The output within its bound; the integral grows only while it is."""
        bound, whole = self._bound(), direct + self._integral + added
        if abs(whole) <= bound or added * whole < 0:
            self._integral += added
        return min(max(whole, -bound), bound)

    def _bound(self) -> float:
        """Largest output: PWM [counts], or current [counts] in current-based position mode."""
        if self._registers.memory[11] == CURRENT_BASED_MODE:
            return abs(self._registers.get("goal_current")) * self._ampere / AMPERE
        return abs(self._registers.get("goal_pwm"))  # which PWM Limit bounds when either is written

    def drive(self, volts: float) -> Drive:
        """Return what the bridge does at a supply of `volts` [V]; positive is the direction of rising counts.

        Current mode is exact: the motor gets Goal Current as far as the voltage gives it.
        """
        mode, per_pwm = self._registers.memory[11], volts / FULL_PWM
        goal_pwm, goal_current = _GOALS.unpack_from(self._registers.memory, 100)
        bound = abs(goal_pwm)
        most = bound * per_pwm
        if mode == CURRENT_MODE:
            return goal_current * self._ampere, -most, most
        if mode == CURRENT_BASED_MODE:
            return self._pwm * AMPERE, -most, most
        pwm = goal_pwm if mode == PWM_MODE else min(max(self._pwm, -bound), bound)
        return 0.0, pwm * per_pwm, pwm * per_pwm
