"""Whether successive readings of the encoders can be those of moving joints: an encoder may jump, stop or flicker."""

from __future__ import annotations

import numpy as np

from whiptool.rig.dynamixel.control_table import TICKS, Units
from whiptool.rig.stops import SafetyError

COUNT = 1.01 * Units().position  # [rad] by which the reading of an encoder that stands may flicker; rounding aside
RESTS = 1.5 * Units().velocity  # [rad/s], below which a joint rests
TICK = 1e-3  # [s], resolution of the servos' clocks
AVERAGED = 0.1  # [s], time constant of mean torques
SHORT = 0.5  # [N m] that a motor at rest may lack of the torque that it is asked for; a fast one lacks more
ROTOR = 0.005  # [kg m^2], inertia of a servo's rotor and gear at its output, which models of arms leave out
LACKS = 0.7  # [N m] by which torques on a joint at rest may be out of balance: friction, and the whip's changing pull
ROUGH = 9 * Units().velocity  # [rad/s] by which a joint may be slower than its torques say, since their times differ
PULL = 0.02  # [s], time constant of the mean pull on a joint that moves


class Encoders:
    """Finds encoders that fail by comparing successive readings.

    - Jump: a position changes by `jump` more or less than by the velocities of both readings times the step, which the
      servos' clocks tell to 1 ms.
    - Stop: a joint that rests in two readings or more has to be stopped and held by torques, see `Balance`; and its
      motor has no back EMF in two of them.
    - Hold: a position stays within a count while the velocities add up to `jump`, a mean torque beyond gravity's of
      more than `push` acts, or the motor gives 0.5 N m less than it is asked for, as one that turns fast.

    Args:
        joints: Number n of joints.
        jump: Largest difference between a change of position and what the velocities say [rad].
        push: Largest mean torque beyond gravity's on a joint that stands [N m].
    """

    def __init__(self, joints: int, *, jump: float, push: float) -> None:
        self._jump, self._most = jump, push
        self._last: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None  # positions, velocities, clocks
        self._stands = np.full(joints, np.nan)
        self._turned = np.zeros(joints)  # integral of the velocity since it stands there [rad]
        self._means = np.zeros((2, joints))  # mean torques since then, beyond gravity's and short of what is asked for
        self._turns = np.zeros(joints, int)  # successive readings in which it stands while its motor turns
        self._balance = Balance(joints)

    def read(
        self,
        q: np.ndarray,
        v: np.ndarray,
        tick: np.ndarray,
        emf: np.ndarray | float = 0,
        load: np.ndarray | float = 0,
        inertia: np.ndarray | None = None,
    ) -> SafetyError | None:
        """Take the next reading, and return the fault, if any.

        Args:
            q, v: Positions [rad] and velocities [rad/s], (n,).
            tick: The servos' clocks [ms], modulo 32768, (n,).
            emf: Speeds by the back EMF, as in `JointSample` [rad/s], (n,).
            load: Torques beyond gravity's and those of the joints' speeds, and short of what the motors are asked for
                [N m], (2, n).
            inertia: The arm's inertia matrix [kg m^2], (n, n); None: balances are not checked.
        """
        last, self._last = self._last, (q, v, tick)
        moved = ~(np.abs(q - self._stands) <= COUNT)
        self._stands = np.where(moved, q, self._stands)
        if last is None:
            return None
        q_0, v_0, tick_0 = last
        step, mean = ((tick - tick_0) % TICKS) * 1e-3, (v_0 + v) / 2
        off = np.abs(q - q_0 - mean * step)
        beyond = off - self._jump - np.abs(v - v_0) / 2 * step - np.maximum(np.abs(v), np.abs(v_0)) * TICK
        if (beyond > 0).any():
            i = int(beyond.argmax())
            return SafetyError("encoder", f"that of joint {i} jumped by {off[i]:.3f} rad more than it turned")
        self._turned = np.where(moved, 0.0, self._turned + mean * step)
        self._means = np.where(moved, 0.0, load + (self._means - load) * np.exp(-step / AVERAGED))
        push, short = np.abs(self._means)
        held = (np.abs(self._turned) > self._jump) | (push > self._most) | (short > SHORT)
        self._turns = np.where((np.asarray(emf) != 0) & (np.abs(v) < RESTS) & ~moved, self._turns + 1, 0)
        held |= self._turns > 1
        if inertia is not None:
            held |= self._balance.lacks(q, v, v - v_0, np.maximum(step, TICK), np.asarray(load)[0], inertia)
        if held.any():
            return SafetyError("encoder", f"that of joint {int(held.argmax())} stands still while it should turn")
        return None


class Balance:
    """Whether joints that read as resting can rest: torques that nothing balances would turn them.

    Torque beyond gravity's less inertia times acceleration is the pull on a joint: friction's and the whip's. While a
    joint reads as resting, its pull is taken to be the mean of before. What the torques of the readings lack of holding
    the joint is summed, less `LACKS` (a CUSUM test of both signs), from the reading on in which it came to rest.
    An encoder that stops reads as a joint that stopped at once, which takes an impulse that nothing gave, and that
    then resists its motor.

    Args:
        joints: Number n of joints.
    """

    def __init__(self, joints: int) -> None:
        self._pull, self._load, self._change = np.zeros((3, joints))  # [N m]
        self._sums = np.zeros((2, joints))  # impulses that lack since it rests, of both signs [N m s]
        self._rests, self._at = np.zeros(joints, int), np.full(joints, np.nan)  # number of readings, and where [rad]

    def lacks(
        self, q: np.ndarray, v: np.ndarray, dv: np.ndarray, step: np.ndarray, load: np.ndarray, inertia: np.ndarray
    ) -> np.ndarray:
        """Take the next reading: positions, velocities and their changes, step [s], load [N m], each (n,), and inertia
        [kg m^2], (n, n); return whether each joint reads as resting and cannot rest, (n,).
        """
        inertia = inertia + ROTOR * np.eye(len(q))
        pull, change, last = inertia @ dv / step - (self._load + load) / 2, np.abs(load - self._load), self._change
        rests = (np.abs(v) < RESTS) & (np.abs(q - self._at) <= COUNT)
        lack = np.array([pull - self._pull, self._pull - pull]) - LACKS - np.maximum(change, last)  # delays
        self._sums = np.where(rests, np.maximum(0.0, self._sums + lack * step), 0.0)
        self._pull = np.where(rests, self._pull, pull + (self._pull - pull) * np.exp(-step / PULL))
        self._rests, self._at = np.where(rests, self._rests + 1, 0), np.where(rests, self._at, q)
        self._load, self._change = load, change
        return (self._rests > 1) & (self._sums.max(axis=0) > ROUGH * np.diag(inertia))
