"""Whether successive readings of the encoders can be those of moving joints: an encoder may jump, stop or flicker."""

from __future__ import annotations

from collections import deque

import numpy as np

from whiptool.rig.dynamixel.control_table import TICKS, Units
from whiptool.rig.stops import SafetyError

COUNT = 1.01 * Units().position  # [rad] by which the reading of an encoder that stands may flicker; rounding aside
MOVES = 25.5 * Units().velocity  # [rad/s]: a joint that moves so fast does not stop within a cycle, and stay
RESTS = 1.5 * Units().velocity  # [rad/s], below which a joint rests
TICK = 1e-3  # [s], resolution of the servos' clocks
AVERAGED = 0.1  # [s], time constant of mean torques
SHORT = 0.5  # [N m] that a motor at rest may lack of the torque that it is asked for; a fast one lacks more


class Encoders:
    """Finds encoders that fail by comparing successive readings.

    - Jump: a position changes by `jump` more or less than by the velocities of both readings times the step, which the
      servos' clocks tell to 1 ms.
    - Stop: a joint that moved in two readings in one direction faster than 0.6 rad/s, or in one twice as fast, rests in
      the next two, its position within a count.
    - Hold: a position stays within a count while the velocities add up to `jump`, a mean torque beyond gravity's of
      more than `push` acts, or the motor gives 0.5 N m less than it is asked for, as one that turns fast. Only
      this distinguishes an encoder that stops while its joint is slow from a joint at rest.

    Args:
        joints: Number n of joints.
        jump: Largest difference between a change of position and what the velocities say [rad].
        push: Largest mean torque beyond gravity's on a joint that stands [N m].
    """

    def __init__(self, joints: int, *, jump: float, push: float) -> None:
        self._jump, self._most = jump, push
        self._last: deque[tuple[np.ndarray, np.ndarray, np.ndarray]] = deque(maxlen=4)  # positions, velocities, clocks
        self._stands = np.full(joints, np.nan)
        self._turned = np.zeros(joints)  # integral of the velocity since it stands there [rad]
        self._means = np.zeros((2, joints))  # mean torques since then, beyond gravity's and short of what is asked for

    def read(self, q: np.ndarray, v: np.ndarray, tick: np.ndarray, load: np.ndarray | float = 0) -> SafetyError | None:
        """Take the next reading, and return the fault, if any.

        Args:
            q, v: Positions [rad] and velocities [rad/s], (n,).
            tick: The servos' clocks [ms], modulo 32768, (n,).
            load: Torques beyond gravity's, and short of what the motors are asked for [N m], (2, n).
        """
        self._last.append((q, v, tick))
        moved = ~(np.abs(q - self._stands) <= COUNT)
        self._stands = np.where(moved, q, self._stands)
        if len(self._last) < 2:
            return None
        q_0, v_0, tick_0 = self._last[-2]
        step, mean = ((tick - tick_0) % TICKS) * 1e-3, (v_0 + v) / 2
        off = np.abs(q - q_0 - mean * step)
        beyond = off - self._jump - np.abs(v - v_0) / 2 * step - np.maximum(np.abs(v), np.abs(v_0)) * TICK
        if (beyond > 0).any():
            i = int(beyond.argmax())
            return SafetyError("encoder", f"that of joint {i} jumped by {off[i]:.3f} rad more than it turned")
        self._turned = np.where(moved, 0.0, self._turned + mean * step)
        self._means = np.where(moved, 0.0, load + (self._means - load) * np.exp(-step / AVERAGED))
        push, short = np.abs(self._means)
        held = (np.abs(self._turned) > self._jump) | (push > self._most) | (short > SHORT) | self._stopped()
        if held.any():
            return SafetyError("encoder", f"that of joint {int(held.argmax())} stands still while it turns")
        return None

    def _stopped(self) -> np.ndarray:
        """Whether each joint moved in two readings and rests in the next two."""
        if len(self._last) < 4:
            return np.zeros(len(self._stands), bool)
        q, v, _ = map(np.array, zip(*self._last, strict=True))  # (4, n)
        moved = (v[0] * v[1] > 0) & (np.abs(v[:2]) > MOVES).all(axis=0) | (np.abs(v[1]) > 2 * MOVES)
        return moved & (np.abs(v[2:]) < RESTS).all(axis=0) & (np.abs(np.diff(q[1:], axis=0)) <= COUNT).all(axis=0)
