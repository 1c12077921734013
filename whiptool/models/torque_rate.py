"""How fast torques change, as robots judge it: from one millisecond to the next."""

from __future__ import annotations

import numpy as np

PERIOD = 1e-3  # [s] from one torque command to the next, of robots that limit its change (Franka's interface)


def torque_rates(t: np.ndarray, tau: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the rates of change of torques, from each millisecond to the next.

    Args:
        t: Times [s], (T,), increasing.
        tau: Torques of the arm's a joints [N m], (T, a), interpolated linearly.

    Returns:
        Times at the end of each millisecond (S,) [s], and rates (S, a) [N m/s]; S is 0 for a strike shorter than 1 ms.
    """
    at = t[0] + PERIOD * np.arange(int((t[-1] - t[0]) / PERIOD + 1e-9) + 1)
    sampled = np.stack([np.interp(at, t, each) for each in tau.T], axis=1)
    return at[1:], np.diff(sampled, axis=0) / PERIOD
