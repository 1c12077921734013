"""How start postures move with the strike and the model, by differences."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from random_space import held

from whiptool.dynamics.posture import start_derivative, start_posture
from whiptool.dynamics.structure import Structure
from whiptool.models.parameters import Model


def check_start_slopes(model: Model, q_i: np.ndarray, names: Sequence[str], *, rtol: float) -> None:
    """Compare the derivatives of the start posture by each joint of the arm (a,), and by numbers of the model, with
    central differences."""
    a = model.arm.n
    controller = held(a)
    structure = Structure.of(model, controller)
    strike = np.r_[q_i, np.ones(a), 0.5][None]
    p, q = structure.pack(model, controller, strike), start_posture(model, q_i[None])
    for k, name in enumerate([*[None] * a, *names]):
        dp, sides, h = np.zeros_like(p), [], 1e-6
        for sign in (1, -1):
            moved, at = model, q_i.copy()
            if name is None:
                at[k] += sign * h
                dp[0, k] = 1
            else:
                moved = model.with_parameters({name: model.parameters()[name] + sign * h})
                dp += sign * (structure.pack(moved, controller, strike) - p) / (2 * h)
            sides.append(start_posture(moved, at[None]))
        ours = start_derivative(model, structure, q, p, dp)
        np.testing.assert_allclose(ours, (sides[0] - sides[1]) / (2 * h), rtol=rtol, atol=1e-7)
