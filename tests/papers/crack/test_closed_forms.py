"""Closed forms of chains and loops, by other derivations: eigenvalues, ordinary differential equations, quadrature."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import eigh
from scipy.special import roots_laguerre

from papers.crack.closed_forms import (
    FALL_RATIO,
    folded_speed,
    folded_time,
    hanging_frequencies,
    loop_speed,
    loop_time,
    lumped_frequencies,
    moving_mass,
)


@pytest.mark.parametrize("nodes", [1, 2, 7, 30])
def test_a_lumped_chain_has_the_frequencies_of_its_tensions(nodes):
    """Masses on massless links: the stiffness across is tension over length, the tension what hangs below."""
    length, gravity = 1.7, 9.81
    tension = gravity * np.arange(nodes, 0, -1) / nodes
    K = np.diag(tension) + np.diag(np.append(tension[1:], 0)) - np.diag(tension[1:], 1) - np.diag(tension[1:], -1)
    squares = eigh(K * nodes / length, np.eye(nodes) / nodes, eigvals_only=True)
    np.testing.assert_allclose(lumped_frequencies(nodes, length, gravity, nodes), np.sqrt(squares), rtol=1e-9)
    zeros = roots_laguerre(nodes)[0]
    np.testing.assert_allclose(squares, gravity * nodes / length * zeros, rtol=1e-9)


def test_many_lumped_masses_are_a_chain():
    """Their frequencies err by 1 / (4 N)."""
    error = 1 - lumped_frequencies(200, 1.0, 9.81, 3) / hanging_frequencies(1.0, 9.81, 3)
    np.testing.assert_allclose(error, 1 / 800, rtol=0.02)


def test_a_folded_chain_falls_as_its_equation_of_motion_has_it():
    """Lagrange's equation of `L = M (L - y) y'^2 / (4 L) + M g (L^2 + 2 L y - y^2) / (4 L)`, integrated."""
    length, g = 1.3, 9.81

    def rates(t, x):
        y, v = x
        return [v, (g * (length - y) + v**2 / 2) / (length - y)]

    seen = solve_ivp(rates, (0, 0.4), [0, 0], rtol=1e-10, atol=1e-12, t_eval=[0.2, 0.4])
    np.testing.assert_allclose(seen.y[1], folded_speed(seen.y[0], length, g), rtol=1e-7)
    np.testing.assert_allclose([folded_time(y, length, g) for y in seen.y[0]], seen.t, rtol=1e-6)
    assert folded_time(length, length, g) / np.sqrt(2 * length / g) == pytest.approx(FALL_RATIO, abs=5e-5)


@pytest.mark.parametrize("taper", [1.0, 0.3, 1.7])
def test_a_loop_hands_its_momentum_to_the_hand(taper):
    """The moving part is pulled by the tension `mu v^2 / 4` at the loop, which travels with v / 2."""
    start, length, speed = 0.2, 1.6, 8.0

    def rates(t, x):
        place, v = x
        density = taper ** (2 * place / length)
        return [v / 2, density * v**2 / 4 / (length * moving_mass(place / length, taper))]

    until = loop_time(0.8, start, taper, length, speed)
    seen = solve_ivp(rates, (0, until), [start * length, speed], rtol=1e-10)
    assert seen.y[0, -1] == pytest.approx(0.8 * length, rel=1e-6)
    assert seen.y[1, -1] == pytest.approx(speed * loop_speed(0.8, start, taper), rel=1e-6)
