"""What disturbs a strike: a whip that still swings, a kick, noise of the hand, and numbers of the whip that are off."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from whiptool.correction.rolled import INTERVAL, AnyStart, Begun, Submovements
from whiptool.dynamics.modes import hanging_modes
from whiptool.errors import InputError
from whiptool.models.numbers import number
from whiptool.models.parameters import Model
from whiptool.models.strike import Strike

MODES = 3  # of the swinging whip, in each direction
PULSES = 8  # of the hand's noise in a strike


@dataclass(frozen=True)
class Disturbances:
    """Standard deviations of what disturbs a strike, all independent and normal.

    Args:
        swing: Displacement of the tip in the hanging whip's slowest mode when the strike begins [m]. Faster modes move
            the tip at the same speed, and so less far.
        kick: Change of the tip's velocity by one kick that turns all links of the whip, at a random time [m/s].
        hand: Noise of the joints' reference at the instant of its largest torque [rad or m]; it grows with the torque
            (Harris and Wolpert 1998).
        length, mass, stiffness: Relative errors of these numbers of the whip.

    Raises:
        InputError: A number is negative or not finite.
    """

    swing: float = 0.1
    kick: float = 0.5
    hand: float = 0.01
    length: float = 0.05
    mass: float = 0.05
    stiffness: float = 0.05

    def __post_init__(self) -> None:
        for field in fields(self):
            number(field.name, getattr(self, field.name), low=0)

    def only(self, kind: str) -> Disturbances:
        """Return the disturbances of one kind, the others being zero."""
        if kind not in (names := [field.name for field in fields(self)]):
            raise InputError("kind", kind, ", ".join(names))
        return replace(self, **{name: 0.0 for name in names if name != kind})


def swing_directions(model: Model, strike: Strike) -> np.ndarray:
    """Return the states' changes by swings in each mode, displaced and moving, (2 k, 2 n).

    The slowest mode displaces the tip by one metre, and all modes move it at the speed of that swing.
    """
    count = MODES * (model.dimension - 1)
    modes = hanging_modes(model, count=count, posture=np.array(strike.q_i))
    shapes = modes.shapes / np.linalg.norm(modes.displacements[:, -1], axis=1)[:, None]
    a, n = model.arm.n, model.coordinates
    found = np.zeros((2, count, 2 * n))
    if model.whip.joints == "rod":
        tilts = np.zeros((count, model.whip.N, 3))
        tilts[..., :2] = shapes[:, a:].reshape(count, -1, 2)
        shapes = np.hstack([shapes[:, :a], tilts.reshape(count, -1)])
    found[0, :, :n] = shapes * (modes.frequencies[0] / modes.frequencies)[:, None]
    found[1, :, n:] = shapes * 2 * np.pi * modes.frequencies[0]
    return found.reshape(2 * count, 2 * n)


def kick_directions(model: Model, states: np.ndarray) -> np.ndarray:
    """Return the changes of states (B, 2 n) by kicks along each axis, per m/s of a straight whip's tip, (B, d, 2 n).

    A kick changes the velocity of every link's far end, relative to its near end, by its own part across the link.
    """
    a, n, d = model.arm.n, model.coordinates, model.dimension
    found, size = np.zeros((len(states), d, 2 * n)), 1 / model.whip.length
    if model.whip.joints == "rod":
        rods = states[:, a:n].reshape(len(states), -1, 3)
        across = np.eye(3)[:, None] - np.einsum("bik,bij->bkij", rods, rods)
        found[:, :, n + a :] = size * across.reshape(len(states), 3, -1)
        return found
    if d == 3:
        raise InputError("joints of the whip", model.whip.joints, "hinges in the plane, or rods")
    angles = np.cumsum(states[:, :n], axis=1)[:, a:]  # from straight down, positive towards +x
    turns = size * np.stack([np.cos(angles), np.sin(angles)], axis=1)  # of each link
    found[:, :, n + a :] = np.diff(turns, axis=2, prepend=0.0)
    return found


def moved(model: Model, states: np.ndarray, by: np.ndarray) -> np.ndarray:
    """Return states (B, 2 n) that were changed; rods remain unit vectors, and turn only across themselves."""
    states = states + by
    if model.whip.joints == "rod":
        a, n = model.arm.n, model.coordinates
        rods, rates = (states[:, i : i + n - a].reshape(len(states), -1, 3) for i in (a, n + a))
        rods = rods / np.linalg.norm(rods, axis=2, keepdims=True)
        rates = rates - (rods * rates).sum(axis=2, keepdims=True) * rods
        states[:, a:n], states[:, n + a :] = rods.reshape(len(states), -1), rates.reshape(len(states), -1)
    return states


def pulses(by: np.ndarray, end: float) -> Submovements:
    """Return the submovements of noise of the hand: there and back, one pulse after the other until `end` [s].

    Args:
        by: Sizes of the pulses, (B, PULSES, a) [rad or m].
    """
    lasts = end / PULSES
    since = lasts * np.arange(PULSES)
    there = Submovements(np.tile(since, (len(by), 1)), np.full(by.shape[:2], lasts), by)
    return there.and_(Submovements(there.since + lasts, there.lasts, -by))


def loads(simulator: AnyStart, strike: Strike, end: float) -> np.ndarray:
    """Return the undisturbed torque at each pulse's height as a share of its joint's largest, (PULSES, a)."""
    none = Submovements.none(1, simulator.model.arm.n)
    tau = np.abs(simulator.rows(Begun(strike, simulator.rest(strike)[None], none, end), "tau")[0])
    at = np.round((np.arange(PULSES) + 1) * end / PULSES / INTERVAL).astype(int).clip(max=len(tau) - 1)
    return tau[at] / np.maximum(tau.max(axis=0), 1e-12)
