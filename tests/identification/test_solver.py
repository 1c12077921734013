"""The solver of many recordings against SciPy on the whole system, and its parts against their definitions."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import least_squares, lsq_linear

from whiptool.identification.solver import Block, Ending, Loss, huber, reduce, solve, weigh

RNG = np.random.default_rng(0)


@pytest.mark.parametrize("limit", [0.5, 1.345])
def test_hubers_loss_is_the_integral_of_its_influence(limit):
    """psi(r) = r within the limit, the limit beyond; the weight is psi(r) / r."""
    r = np.array([-3.0, -limit, -0.3, 0.0, 0.2, limit, 7.0])
    cost, weight = huber(r, limit)
    psi = lambda x: np.clip(x, -limit, limit)  # noqa: E731
    assert cost == pytest.approx(sum(quad(psi, 0, x)[0] for x in r))
    np.testing.assert_allclose(weight[r != 0], psi(r[r != 0]) / r[r != 0])
    assert weight[3] == 1
    assert huber(r, None)[0] == pytest.approx((r**2).sum() / 2)
    np.testing.assert_array_equal(huber(r, None)[1], 1)


def block(rows: int, shared: int, own: int) -> Block:
    return Block(RNG.normal(size=rows), RNG.normal(size=(rows, shared)), RNG.normal(size=(rows, own)))


def test_a_reduced_block_has_the_same_least_squares_without_its_own_unknowns():
    b = block(20, 3, 2)
    head, rest = reduce(b)
    assert head.shape == (2, 2 + 3 + 1)
    assert np.allclose(np.tril(head[:, :2], -1), 0)
    z = RNG.normal(size=3)
    own = np.linalg.lstsq(b.B, -(b.r + b.A @ z), rcond=None)[0]
    least = ((b.r + b.A @ z + b.B @ own) ** 2).sum()
    assert ((rest @ np.r_[z, 1.0]) ** 2).sum() == pytest.approx(least)
    np.testing.assert_allclose(np.linalg.solve(head[:, :2], -(head[:, 2:5] @ z + head[:, 5])), own)
    damped = reduce(b, np.array([2.0, 0.5]))[1]
    D = np.diag([2.0, 0.5])
    own = np.linalg.lstsq(np.vstack([b.B, D]), np.r_[-(b.r + b.A @ z), 0, 0], rcond=None)[0]
    least = ((b.r + b.A @ z + b.B @ own) ** 2).sum() + ((D @ own) ** 2).sum()
    assert ((damped @ np.r_[z, 1.0]) ** 2).sum() == pytest.approx(least)


def test_weights_count_in_the_squares():
    b, w = block(5, 2, 1), np.array([1.0, 4.0, 0.25, 9.0, 0.0])
    found = weigh(b, w)
    for mine, plain in ((found.r, b.r), (found.A, b.A), (found.B, b.B)):
        np.testing.assert_allclose(mine.T @ mine, plain.T @ (w[:, None] * plain if plain.ndim == 2 else w * plain))


T = np.linspace(0, 1, 25)
NOISE = 0.2 * RNG.standard_normal((3, 25)) * (1 + 4 * (T > 0.8))


def decay(z: np.ndarray, own: list[np.ndarray], derivatives: bool) -> list[Block]:
    """`z0 exp(-z1 t) + x_i sin(5 t)` of three recordings, the true numbers 2, 1.5 and -1, 0, 1."""
    e, s = np.exp(-z[1] * T), np.sin(5 * T)
    blocks = []
    for i, x in enumerate(own):
        y = 2 * np.exp(-1.5 * T) + (i - 1) * s + NOISE[i]
        A = np.stack([e, -z[0] * T * e], axis=1) if derivatives else np.zeros((0, 0))
        blocks.append(Block(z[0] * e + x[0] * s - y, A, s[:, None] if derivatives else np.zeros((0, 0))))
    return blocks


def theirs(upper: float, loss: float | None) -> least_squares:
    def flat(u):
        return np.concatenate([b.r for b in decay(u[:2], [u[2:3], u[3:4], u[4:]], False)])

    robust = {} if loss is None else {"loss": "huber", "f_scale": loss}
    bounds = ([0, 0, -9, -9, -9], [10, upper, 9, 9, 9])
    return least_squares(flat, [1, 0.5, 0, 0, 0], bounds=bounds, xtol=1e-14, ftol=1e-14, gtol=1e-14, **robust)


@pytest.mark.parametrize("upper", [9.0, 1.0])
@pytest.mark.parametrize("loss", [None, 0.3])
def test_it_ends_where_scipy_does(upper, loss):
    mine = solve(
        decay, np.array([1.0, 0.5]), [np.zeros(1)] * 3, lower=np.zeros(2), upper=np.array([10.0, upper]),
        loss=Loss(loss),
        tolerance=1e-12,
    )  # fmt: skip
    best = theirs(upper, loss)
    np.testing.assert_allclose(np.r_[mine.z, np.concatenate(mine.own)], best.x, atol=2e-5)
    assert mine.cost == pytest.approx(best.cost, rel=1e-9)
    assert mine.status is Ending.CONVERGED
    costs = [cost for cost, _, _ in mine.history]
    assert costs[-1] == mine.cost
    assert (np.diff(costs) < 0).all()
    assert len(mine.history) - 1 <= mine.evaluations
    assert bool(mine.z[1] == 1.0) is (upper == 1.0)


def test_a_loose_tolerance_stops_sooner():
    tight, loose = (
        solve(
            decay,
            np.array([1.0, 0.5]),
            [np.zeros(1)] * 3,
            lower=np.zeros(2),
            upper=np.full(2, 10.0),
            tolerance=tolerance,
        )
        for tolerance in (1e-10, 1e-2)
    )
    assert loose.evaluations < tight.evaluations
    assert loose.status is Ending.CONVERGED
    # what is left to fall is below the tolerance, per mean squared residual
    assert loose.cost - tight.cost < 3e-2 * 2 * tight.cost / 75


def test_only_the_first_residuals_are_robust():
    """The last ten residuals of each block count in full, however large."""

    def flat(u):
        return np.concatenate([b.r for b in decay(u[:2], [u[2:3], u[3:4], u[4:]], False)])

    def cost(u):
        total = 0.0
        for r in np.split(flat(u), 3):
            total += huber(r[:15], 0.3)[0] + (r[15:] ** 2).sum() / 2
        return total

    mine = solve(
        decay, np.array([1.0, 0.5]), [np.zeros(1)] * 3, lower=np.zeros(2), upper=np.full(2, 10.0),
        loss=Loss(0.3, [15, 15, 15]),
        tolerance=1e-12,
    )  # fmt: skip
    at = np.r_[mine.z, np.concatenate(mine.own)]
    assert mine.cost == pytest.approx(cost(at))
    gradient = [(cost(at + h) - cost(at - h)) / 2e-5 for h in 1e-5 * np.eye(5)]
    np.testing.assert_allclose(gradient, 0, atol=1e-3)


def test_blocks_without_unknowns_of_their_own_may_follow():
    """Such as a prior: here of the first number, 3 +- 0.1."""

    def with_prior(z, own, derivatives):
        return [
            *decay(z, own, derivatives),
            Block(np.array([(z[0] - 3) / 0.1]), np.array([[10.0, 0.0]]), np.zeros((1, 0))),
        ]

    mine = solve(
        with_prior, np.array([1.0, 0.5]), [np.zeros(1)] * 3, lower=np.zeros(2), upper=np.full(2, 10.0), tolerance=1e-12
    )

    def flat(u):
        return np.concatenate([b.r for b in with_prior(u[:2], [u[2:3], u[3:4], u[4:]], False)])

    best = least_squares(flat, [1, 0.5, 0, 0, 0], xtol=1e-14, ftol=1e-14, gtol=1e-14)
    np.testing.assert_allclose(np.r_[mine.z, np.concatenate(mine.own)], best.x, atol=2e-5)


def test_a_linear_problem_takes_few_steps():
    """Damping falls by ten at each: it is gone after a few."""
    rng = np.random.default_rng(0)
    A, b = rng.normal(size=(30, 5)), rng.normal(size=30)
    found = solve(
        lambda z, own, derivatives: [Block(A @ z - b, A, np.zeros((30, 0)))],
        np.zeros(5), [np.zeros(0)], lower=np.full(5, -9.0), upper=np.full(5, 9.0), tolerance=1e-12,
    )  # fmt: skip
    assert found.evaluations <= 5


@pytest.mark.parametrize("seed", range(6))
def test_linear_problems_with_bounds_are_those_of_scipy(seed):
    """Several bounds active at once, on either side."""
    rng = np.random.default_rng(seed)
    A, b = rng.normal(size=(30, 5)), 3 * rng.normal(size=30)
    lower, upper = np.full(5, -0.2), np.full(5, 0.15)
    mine = solve(
        lambda z, own, derivatives: [Block(A @ z - b, A, np.zeros((30, 0)))],
        np.zeros(5), [np.zeros(0)], lower=lower, upper=upper, tolerance=1e-13,
    )  # fmt: skip
    np.testing.assert_allclose(mine.z, lsq_linear(A, b, (lower, upper), tol=1e-14).x, atol=1e-5)


def test_how_a_solution_ends():
    bounds = {"lower": np.zeros(2), "upper": np.full(2, 10.0)}
    start = [np.zeros(1)] * 3
    few = solve(decay, np.array([1.0, 0.5]), start, max_iterations=1, **bounds)
    assert few.status is Ending.STEPS
    assert len(few.history) == 2

    def broken(z, own, derivatives):
        return [Block(np.array([np.inf]), np.zeros((1, 2)), np.zeros((1, 1)))]

    assert solve(broken, np.ones(2), start[:1], **bounds).status is Ending.DIVERGED

    def steep(z, own, derivatives):
        return [Block(np.ones(1), np.array([[1e51, 0.0]]), np.zeros((1, 1)))]

    assert solve(steep, np.ones(2), start[:1], **bounds).status is Ending.DIVERGED

    def wall(z, own, derivatives):  # says that it falls, and does not
        return [Block(np.array([1.0 + np.abs(z - 1).sum()]), np.array([[1.0, 1.0]]), np.zeros((1, 1)))]

    stuck = solve(wall, np.ones(2), start[:1], tolerance=0.0, **bounds)
    assert stuck.status is Ending.STUCK
    np.testing.assert_array_equal(stuck.z, 1)


def test_a_start_beyond_its_bounds_is_brought_inside():
    seen = []

    def watched(z, own, derivatives):
        seen.append(z.copy())
        return decay(z, own, derivatives)

    solve(watched, np.array([-5.0, 99.0]), [np.zeros(1)] * 3, lower=np.zeros(2), upper=np.full(2, 10.0))
    np.testing.assert_array_equal(seen[0], [0.0, 10.0])
    assert all((z >= 0).all() and (z <= 10).all() for z in seen)


def test_damping_follows_nielsen_and_scales_never_shrink():
    """Gains are scripted, at a model of one residual: dampings, steps and evaluations by hand.

    Two attempts are refused and the third gains 0.6 of what is foreseen; then one is refused, and the next gains 0.9.
    """
    slope, asked, script = [2.0], [], [None, None, 0.6, None, 0.9]
    least = 1e-30  # it goes on to the last iteration
    state = {"r": 1.0, "damping": 1e-3, "growth": 2.0}
    dampings, steps = [1e-3], [0.0]

    def evaluate(z, own, derivatives):
        asked.append(derivatives)
        if len(asked) == 1 or (derivatives and asked[-2] is False):  # the start; an accepted point once more
            return [Block(np.array([state["r"]]), np.array([[slope[0]]]), np.zeros((1, 0)))]
        gain, r, damping, A = script.pop(0), state["r"], state["damping"], slope[0]
        step = A * r / (A**2 + damping * 2.0**2)  # the first slope, 2, is the largest
        foreseen = r * A * step - (A * step) ** 2 / 2
        if gain is None:
            state["damping"], state["growth"] = damping * state["growth"], 2 * state["growth"]
            return [Block(np.array([2 * r]), np.array([[A]]), np.zeros((1, 0)))]
        state["damping"], state["growth"] = damping * (1 - (2 * gain - 1) ** 3), 2.0
        dampings.append(state["damping"])
        steps.append(step)
        state["r"], slope[0] = np.sqrt(r**2 - 2 * gain * foreseen), 1.0
        return [Block(np.array([state["r"]]), np.array([[1.0]]), np.zeros((1, 0)))]

    bound = np.array([10.0])
    found = solve(evaluate, np.zeros(1), [], lower=-bound, upper=bound, max_iterations=2, tolerance=least)
    assert not script
    assert asked == [True, True, False, False, True, True, False, True]
    assert found.evaluations == len(asked)
    assert [damping for _, damping, _ in found.history] == pytest.approx(dampings, rel=1e-12)
    assert [step for *_, step in found.history] == pytest.approx(steps, rel=1e-9)


def test_own_unknowns_in_a_flat_valley_do_not_keep_shared_ones_from_settling():
    """A recording's own unknowns creep along a curved valley; what all share is the mean of the readings."""
    readings = np.random.default_rng(0).normal(2.0, 1.0, 40)

    def evaluate(z: np.ndarray, own: list[np.ndarray], derivatives: bool) -> list[Block]:
        u, v, w = own[0]
        r = np.r_[z[0] - readings, 1e3 * (v - u**2), 1e3 * (w - v**2), 1 - u]
        A, B = np.r_[np.ones(40), np.zeros(3)][:, None], np.zeros((43, 3))
        B[40:] = [[-2e3 * u, 1e3, 0], [0, -2e3 * v, 1e3], [-1, 0, 0]]
        return [Block(r, A, B)]

    start, bounds = [np.array([-1.0, 1.0, 1.0])], {"lower": np.array([-9.0]), "upper": np.array([9.0])}
    found = solve(evaluate, np.zeros(1), start, **bounds)
    assert found.status is Ending.SETTLED
    assert found.z[0] == pytest.approx(readings.mean())
    assert found.own[0][0] < 0.9  # far from 1, where the valley is lowest
