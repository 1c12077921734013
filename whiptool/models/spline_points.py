"""Few points of a sampled movement through which the quintic splines of a robot's controller repeat all of it."""

from __future__ import annotations

import numpy as np

POSITION, ACCELERATION = 1e-6, 1e-3  # [rad, rad/s^2; m for prismatic joints] by which the splines may be off a sample


def spline_points(
    t: np.ndarray,
    q: np.ndarray,
    v: np.ndarray,
    a: np.ndarray,
    *,
    position: float = POSITION,
    acceleration: float = ACCELERATION,
) -> np.ndarray:
    """Return the indices of samples, increasing from 0 to T - 1, such that quintic splines between them meet all
    samples.

    Between two points a controller such as ROS 2's `joint_trajectory_controller` follows the polynomial of degree five
    with the positions, velocities and accelerations of both. A strike along its minimum-jerk path (Eq. 1) is such a
    polynomial, and so are a rest and the phases of a movement of `path_between`.

    Samples are at times t (T,) [s]; q, v and a are (T, n) each. `position` and `acceleration` are the largest
    deviations from a sample [rad, rad/s^2; m for prismatic joints].
    """
    found = [0]
    while found[-1] < len(t) - 1:
        i, step = found[-1], 1
        while i + 2 * step < len(t) and _meets(t, q, v, a, slice(i, i + 2 * step + 1), position, acceleration):
            step *= 2
        low, high = i + step, min(i + 2 * step, len(t) - 1)  # the farthest end that is known to do, and of those left
        while low < high:
            middle = (low + high + 1) // 2
            if _meets(t, q, v, a, slice(i, middle + 1), position, acceleration):
                low = middle
            else:
                high = middle - 1
        found.append(low)
    return np.array(found)


def _meets(
    t: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray, part: slice, position: float, acceleration: float
) -> bool:
    """Whether the spline from the first to the last sample of a part meets those between."""
    t, q, v, a = t[part], q[part], v[part], a[part]
    T = t[-1] - t[0]
    s = ((t - t[0]) / T)[:, None]
    d = q[-1] - q[0] - T * v[0] - T**2 / 2 * a[0]
    e, f = T * (v[-1] - v[0]) - T**2 * a[0], T**2 * (a[-1] - a[0])
    c3, c4, c5 = 10 * d - 4 * e + f / 2, -15 * d + 7 * e - f, 6 * d - 3 * e + f / 2
    here = q[0] + T * v[0] * s + T**2 / 2 * a[0] * s**2 + c3 * s**3 + c4 * s**4 + c5 * s**5
    turning = a[0] + (6 * c3 * s + 12 * c4 * s**2 + 20 * c5 * s**3) / T**2
    return bool((np.abs(here - q) <= position).all() and (np.abs(turning - a) <= acceleration).all())
