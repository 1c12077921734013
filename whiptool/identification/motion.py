"""The prescribed motion of the whip's base: a smooth spline through a tracked handle, or through measured joints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.interpolate import BSpline

from whiptool.dynamics.swing import BASE, hand_motion
from whiptool.errors import InputError
from whiptool.identification.servo_lag import ServoLag
from whiptool.models.spatial_arm import SpatialArm
from whiptool.models.strike import Strike

_HOLE = 0.04  # [s] between samples, and four times the usual; the motion in a longer gap is unknown
_MOVED = 0.02  # [rad], [m] over a hole, or in so many seconds: less is not a motion
_SHORT = 0.05  # [s] in which speed is judged
_AT_REST = 0.1  # [s] that a log may end before the last reading, if the arm stands


def check_covers(name: str, t: np.ndarray, q: np.ndarray, first: float, last: float) -> None:
    """Refuse a log of joints or of a hand, samples q (S, a) [rad or m] at times t (S,) [s], that has a gap while the
    arm moves, or does not cover the time from the first to the last reading to predict [s]."""
    usual = max(_HOLE, 4 * float(np.median(np.diff(t))))
    gaps, moved = np.diff(t), np.abs(np.diff(q, axis=0)).max(axis=1)
    for i in np.flatnonzero((gaps > usual) & (moved > _MOVED) & (t[1:] > first) & (t[:-1] < last)):
        given = f"a hole of {gaps[i]:.3g} s from {t[i]:.3f} s, in which a joint moved by {moved[i]:.2g}"
        raise InputError(
            name, given, "no gap while the arm moves", "keep only the part before the gap, or record it again"
        )
    rule, fix = (
        "a log that begins at rest and lasts to the last reading",
        "keep only the part of the recording that the log covers, or record it again",
    )
    if t[0] > first + usual and _moves(q, t <= t[0] + _SHORT):
        raise InputError(name, f"a start at {t[0]:.3f} s, with the arm moving; readings from {first:.3f} s", rule, fix)
    early = last - t[-1]
    if early > _AT_REST or (early > usual and _moves(q, t >= t[-1] - _SHORT)):
        raise InputError(name, f"an end at {t[-1]:.3f} s; readings to {last:.3f} s", rule, fix)


def _moves(q: np.ndarray, which: np.ndarray) -> bool:
    """Whether a joint moves in a short span, by more than a log's noise."""
    return bool(np.ptp(q[which], axis=0).max(initial=0.0) > _MOVED)


DEGREE = 5  # accelerations are then twice differentiable
SHORTEST = 0.02  # [s] between knots
SAMPLES_A_KNOT = (1.0, 1.5, 2.0, 3.0)
HANDLE_JERK, JOINT_JERK = 3e3, 1e4  # [m/s^3], [rad/s^3]: usual size, a weak prior that bridges gaps
REST = 1e-3  # [m/s], [rad/s]: usual speed of what is at rest
LARGEST = 6e9  # [bytes] of a motion's derivatives


class SmoothSpline:
    """A regression spline of d quantities, with a normal prior of standard deviation `jerk` [unit of the quantity /
    s^3] on the third derivative. If they begin at rest, the prior standard deviation of their initial rates is `REST`.

    It has knots every `knots` [s] from `start` to `end` [s], `size` basis functions, and `size d` coefficients c. The
    rows `prior` (rows, size) are those of each quantity, `penalty` (rows d, size d) those of all: `penalty @ c` is
    standard normal.
    """

    def __init__(self, *, start: float, end: float, knots: float, jerk: float, d: int, at_rest: bool = False) -> None:
        pieces = max(1, int(np.ceil((end - start) / knots)))
        inner = np.linspace(start, end, pieces + 1)
        space = inner[1] - inner[0]
        outer = space * np.arange(1, DEGREE + 1)
        self._knots = np.concatenate([start - outer[::-1], inner, end + outer])
        self.size, self.d = len(self._knots) - DEGREE - 1, d
        self._basis = BSpline(self._knots, np.eye(self.size), DEGREE)
        middles = (inner[1:] + inner[:-1]) / 2
        # noise of this size, independent from knot to knot
        rows = self.basis(middles, 3) / jerk
        if at_rest:
            rows = np.vstack([rows, self.basis(inner[:1], 1) / REST])
        self.prior = rows
        self.penalty = np.kron(rows, np.eye(d))

    def basis(self, t: np.ndarray, derivative: int = 0) -> np.ndarray:
        """Return the values of the basis functions, or of a derivative of them, at times t (T,) [s]: (T, size).

        Coefficient j of quantity i is entry j d + i of the coefficient vector.
        """
        return self._basis(t, nu=derivative)

    def fit(self, t: np.ndarray, values: np.ndarray, sigma: np.ndarray) -> np.ndarray:
        """Return the coefficients (size d,) fitted to values (T, d) with standard errors sigma (T,) or (T, d); NaN is
        ignored.
        """
        seen = ~np.isnan(values).any(axis=1)
        weight = np.broadcast_to(1 / (sigma if sigma.ndim == 2 else sigma[:, None]), values.shape)[seen]
        basis, none = self.basis(t[seen]), np.zeros(len(self.prior))
        found = [
            np.linalg.lstsq(np.vstack([basis * w[:, None], self.prior]), np.concatenate([x * w, none]), rcond=None)[0]
            for x, w in zip(values[seen].T, weight.T, strict=True)
        ]
        return np.stack(found, axis=1).ravel()


def check_size(instants: np.ndarray, knots: float, d: int, width: int) -> None:
    """Refuse a motion whose derivatives by its coefficients would not fit into memory, before they are made."""
    span = float(instants[-1] - instants[0])
    needed = 8 * len(instants) * (span / knots + DEGREE) * d * width  # [bytes]
    if needed > LARGEST:
        most = span * (LARGEST / needed) ** 0.5
        rule = f"about {most:.2g} s at most, for which the fit needs {LARGEST / 1e9:g} GB of memory"
        given = f"{span:.4g} s, a knot every {knots:.3g} s: {needed / 1e9:.3g} GB"
        raise InputError("recording", given, rule, "keep only the part with the strike")


def spacing(t: np.ndarray, samples: float) -> float:
    return max(SHORTEST, samples * float(np.median(np.diff(np.sort(t)))))


def cross_validated(t: np.ndarray, values: np.ndarray, noise: np.ndarray, *, jerk: float, at_rest: bool) -> float:
    """Return the spacing of knots [s] of a `SmoothSpline` that predicts left-out samples best: values (S, d) at times t
    (S,) [s], with the standard error `noise` of each quantity, (d,).

    Generalised cross-validation (Craven and Wahba 1979) chooses among multiples of the sampling interval: abrupt motion
    needs one knot per sample, smooth motion with noisy samples fewer.
    """
    spacings = list(dict.fromkeys(spacing(t, samples) for samples in SAMPLES_A_KNOT))
    if len(spacings) == 1 or len(t) <= DEGREE + 1:
        return spacings[0]

    def error(knots: float) -> float:
        spline = SmoothSpline(start=t[0], end=t[-1], knots=knots, jerk=jerk, d=1, at_rest=at_rest)
        basis, squares, freedom = spline.basis(t), 0.0, 0.0
        for y, sigma in zip(values.T, noise, strict=True):
            rows = np.vstack([basis / sigma, spline.penalty])
            U, s, _ = np.linalg.svd(rows, full_matrices=False)
            U = U[: len(t), s > 1e-10 * s[0]]
            left = y / sigma - U @ (U.T @ y) / sigma
            squares, freedom = squares + float(left @ left), freedom + float((U**2).sum())
        return squares / (1 - min(freedom / values.size, 1 - 1e-6)) ** 2

    return min(spacings, key=error)


@dataclass(frozen=True)
class Moved:
    """Prescribed motion of the whip's base at I instants, and its derivatives by the C coefficients of a `BaseMotion`.
    The inputs are position, velocity and acceleration of the base as the equations of motion take them, see
    `whiptool.dynamics.swing`."""

    inputs: np.ndarray  # (I, 7), in space (I, 21)
    d_inputs: np.ndarray  # (C, I, 7) or (C, I, 21)
    place: np.ndarray  # position of the base [m], (I, d), d = 2 in the plane and 3 in space
    d_place: np.ndarray  # (C, I, d)
    q_i: np.ndarray  # positions of the arm's joints at the first instant [rad], (a,)
    d_q_i: np.ndarray  # (C, a)


class BaseMotion(Protocol):
    """A prescribed motion of the base whose C coefficients are fitted, because its measurement has errors, too.

    The tip amplifies errors of the base about a hundredfold, which a fixed motion would ignore. The prior of the
    coefficients c from all data but the markers is that `rows @ c - mean` is standard normal.
    """

    start: np.ndarray  # coefficients that fit the measurement best, (C,)
    rows: np.ndarray
    mean: np.ndarray

    def at(self, c: np.ndarray) -> Moved:
        """Return the motion of the whip's base, with derivatives, for coefficients c (C,)."""
        ...


class StillMotion:
    """A base at rest at a place (2,) [m], with no coefficients; the positions of the arm's joints are zero."""

    def __init__(self, place: np.ndarray, instants: int, *, joints: int) -> None:
        self.start = self.mean = np.zeros(0)
        self.rows = np.zeros((0, 0))
        none, places = np.zeros((0, instants, 2)), np.tile(place, (instants, 1))
        d_inputs, d_q_i = np.zeros((0, instants, BASE)), np.zeros((0, joints))
        self._moved = Moved(np.zeros((instants, BASE)), d_inputs, places, none, np.zeros(joints), d_q_i)

    def at(self, c: np.ndarray) -> Moved:
        """Return the rest of the base; c is empty, (0,)."""
        return self._moved


class HandleMotion:
    """Motion of the whip's base, without rotation, along a spline through the tracked path of the handle: points (T, 2)
    [m] with standard errors sigma (T,) [m] at times t (T,) [s], NaN where it was not seen.

    The handle's measured positions are residuals of the fit like those of the whip's markers. The prior contains only
    the typical size of the jerk and, if requested, the start at rest. The spline's knots are `knots` [s] apart, by
    default 1.5 frames; the motion is computed at I equally spaced instants [s], and the positions of the arm's joints
    are zero.
    """

    def __init__(
        self,
        t: np.ndarray,
        points: np.ndarray,
        sigma: np.ndarray,
        instants: np.ndarray,
        *,
        joints: int,
        knots: float | None = None,
        at_rest: bool = False,
    ) -> None:
        knots = knots or spacing(t, 1.5)
        check_size(instants, knots, 2, BASE + 2)
        spline = SmoothSpline(start=instants[0], end=instants[-1], knots=knots, jerk=HANDLE_JERK, d=2, at_rest=at_rest)
        self.start = spline.fit(t, points, sigma)
        self.rows, self.mean = spline.penalty, np.zeros(len(spline.penalty))
        self._bases = p, v, a = tuple(spline.basis(instants, i) for i in range(3))
        I = len(instants)
        self._d_inputs, self._d_place = np.zeros((2 * spline.size, I, 7)), np.zeros((2 * spline.size, I, 2))
        for axis in range(2):
            self._d_inputs[axis::2, :, 3 + axis] = v.T
            self._d_inputs[axis::2, :, 5 + axis] = a.T
            self._d_place[axis::2, :, axis] = p.T
        self._still = np.zeros(joints), np.zeros((2 * spline.size, joints))  # the frame of the base does not turn

    def at(self, c: np.ndarray) -> Moved:
        """Return the motion of the whip's base for coefficients c (C,): two for each basis function of the spline."""
        p, v, a = (basis @ c.reshape(-1, 2) for basis in self._bases)
        inputs = np.hstack([np.zeros((len(v), 3)), v, a])
        return Moved(inputs, self._d_inputs, p, self._d_place, *self._still)


# Lag [s], its shape and delay [s] a priori, and their standard errors: industrial arms lag by 5 to 100 ms, a critically
# damped servo has a shape of 1/4, and a UR's commands have an effect after 4 to 6 ms.
USUAL, SPREAD = np.array([0.02, 0.25, 0.004]), np.array([0.05, 0.25, 0.004])
LATEST = float(USUAL[0] + 3 * SPREAD[0])  # [s] by which a robot may be behind its command
_LEAST = np.array([1e-5, 1e-6, 0.0])
_DIFFERENCE = 1e-4  # of the standard errors a priori, for derivatives


class LaggedReference:
    """Motion of the whip's base at I instants [s], not below 0, with the hand of an arm in space whose joints follow a
    strike's reference as a `ServoLag` says.

    The coefficients are the lag [s], the shape, which is `1 / (stiffness lag^2)` (0 for a lag of first order), and the
    delay [s].
    """

    def __init__(self, strike: Strike, arm: SpatialArm, instants: np.ndarray) -> None:
        self._strike, self._arm, self._t = strike, arm, instants
        self.start = USUAL.copy()
        self.rows, self.mean = np.diag(1 / SPREAD), USUAL / SPREAD

    def at(self, c: np.ndarray) -> Moved:
        """Return the motion of the whip's base for coefficients c (3,), whose signs are ignored."""
        span = np.subtract(self._strike.q_f, self._strike.q_i)
        joints = self._share(c)[..., None] * span  # (3, I, a)
        steps = np.diag(_DIFFERENCE * SPREAD)
        by_c = np.stack([(self._share(c + step) - self._share(c - step)) / (2 * step.sum()) for step in steps])
        found = hand_motion(self._arm, joints[0] + self._strike.q_i, joints[1], joints[2])
        moved = np.einsum("ioka,cki,a->cio", found.by_joints, by_c, span, optimize=True)  # (3, I, 24)
        width = found.inputs.shape[1]
        d_inputs, d_q_i = np.ascontiguousarray(moved[..., :width]), np.zeros((3, self._arm.n))
        return Moved(found.inputs, d_inputs, found.place, moved[..., width:], np.array(self._strike.q_i), d_q_i)

    def _share(self, c: np.ndarray) -> np.ndarray:
        """How far of its way a joint is, and its first and second rates, (3, I)."""
        lag, shape, delay = np.maximum(np.abs(c), _LEAST)
        return ServoLag(lag, 1 / (shape * lag**2), delay).behind(self._t, self._strike.D)
