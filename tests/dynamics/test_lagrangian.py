"""Chain dynamics against Lagrange's equations, over random chains."""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lagrangian import lagrangian, lagrangian_dynamics
from random_chains import Case, Key, acceleration, cases, evaluate, examples, numbers, symbols, terms, tolerance, worst

SHORT = st.integers(1, 14)


@cache
def lagrange(key: Key) -> ca.Function:
    s = symbols(key)
    return s.function(*lagrangian_dynamics(s.chain, s.tau, s.q, s.v), *lagrangian(s.chain, s.q, s.v), cse=True)


@examples(100)
@given(cases(SHORT))
def test_agrees_with_lagrange_up_to_14_joints(case: Case):
    """Chains of `numbers` with 1..14 links: accelerations to 1e-9, mass matrix and energies to 1e-12."""
    x, n = numbers(case), case.n
    M, r, T, V = evaluate(lagrange(case.key), x)
    M = M.reshape(n, n)
    assert worst(evaluate(acceleration(case.key), x)[0], np.linalg.solve(M, r)) < 1e-9
    our_M, _, our_T, our_V, *_ = evaluate(terms(case.key), x)
    assert worst(our_M.reshape(n, n), M) < 1e-12
    assert our_T == pytest.approx(T, rel=1e-12)
    assert our_V == pytest.approx(V, rel=1e-12, abs=1e-12)


@examples(8)
@given(cases(st.sampled_from([16, 23, 30]), points=("whip",)))
def test_agrees_with_lagrange_up_to_the_condition_number(case: Case):
    """Chains of `numbers` with 16, 23 and 30 links, two rods then points."""
    x = numbers(case)
    M, r, *_ = evaluate(lagrange(case.key), x)
    assert worst(evaluate(acceleration(case.key), x)[0], np.linalg.solve(M, r)) < tolerance(np.linalg.cond(M))
