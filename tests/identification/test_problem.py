"""Recordings as blocks of least squares, with a linear toy in place of the predictor: residuals, slopes, priors."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from whiptool.errors import InputError
from whiptool.identification import problem as module
from whiptool.identification.problem import FitOptions, Problem
from whiptool.identification.solver import Ending
from whiptool.identification.variables import Prior, variable

RNG = np.random.default_rng(0)
ROWS, TRUE = 20, {"whip.k": 0.3, "whip.drag": 2e-3, "scale": 1.1}
NAMES = tuple(TRUE)
SHARED = RNG.normal(size=(2, ROWS, 3)) * [3.0, 500.0, 1.0]  # of two recordings' readings by the shared numbers
OWN = RNG.normal(size=(2, ROWS, 3))  # and by their own: a state of two, and a delay
NOISE = RNG.normal(size=(2, ROWS))
SIGMA = RNG.uniform(0.5, 2.0, (2, ROWS)) * 1e-2


class Plant:
    """Two numbers, of which the first may not exceed 10."""

    def __init__(self, **numbers: float) -> None:
        self.numbers = {"whip.k": 0.2, "whip.drag": 1e-3} | numbers

    def values(self) -> dict[str, float]:
        return self.numbers

    def changed(self, changes) -> Plant:
        if changes.get("whip.k", 0) > 10:
            raise InputError("k", changes["whip.k"], "<= 10")
        return Plant(**self.numbers | changes)


class Linear:
    """Readings that are linear in every number."""

    def __init__(self, recordings, plant, *, drive, shared, own, timestep, knots) -> None:
        self.recordings, self.shared, self.own = list(recordings), shared, own
        state = {"start": np.array([0.5, 2.0])} if "start" in own else {}
        self.drives = [SimpleNamespace(unknowns=state, of_start=np.eye(2)) for _ in recordings]
        self.width = 2 * ("start" in own) + len([x for x in own if x != "start"])
        first = np.r_[0.5, 2.0, 0.0] if self.width == 3 else np.zeros(self.width)
        self.start = [first.copy() for _ in recordings]
        truth = np.array(list(TRUE.values()))
        self.measured = [SHARED[i] @ truth + SIGMA[i] * NOISE[i] for i in range(len(self.recordings))]
        self.sigma = [SIGMA[i] for i in range(len(self.recordings))]
        channels = np.stack([np.arange(ROWS) // 2, np.arange(ROWS) % 2, np.zeros(ROWS, int)], axis=1)
        self.channels = [channels for _ in recordings]

    def names(self, i: int) -> list[str]:
        return ["node1", "tip"]

    def own_names(self, i: int) -> list[str]:
        return ["start[0]", "start[1]", "delay"][: self.width]

    def __call__(self, plant, nuisance, own, *, derivatives):
        shared = np.array([plant.values().get(name, nuisance.get(name)) for name in self.shared])
        return [
            SimpleNamespace(
                value=SHARED[i] @ shared + OWN[i][:, : self.width] @ (x - self.start[i]),
                by_shared=SHARED[i],
                by_own=OWN[i][:, : self.width],
                size=np.ones(ROWS),
            )
            for i, x in enumerate(own)
        ]

    def path(self, i, plant, nuisance, own):
        return np.arange(3.0), {"node1": np.zeros((3, 2)), "tip": np.ones((3, 2))}


@pytest.fixture(autouse=True)
def linear(monkeypatch):
    monkeypatch.setattr(module, "Predictor", Linear)


VARIABLES = [variable("whip.k", 0.2), variable("whip.drag", 1e-3), variable("scale", 1.0)]
PRIOR = Prior(("scale", "whip.k"), (1.0, 0.25), np.array([[0.01, 0.002], [0.002, 0.04]]))
Z = np.array([v.z(x) for v, x in zip(VARIABLES, TRUE.values())])


def made(*, per_recording=(), prior=None, loss=None, count=2) -> Problem:
    recordings = [SimpleNamespace(source=f"r{i}", t=np.arange(10.0), view=None) for i in range(count)]
    options = FitOptions(per_recording=per_recording, prior=prior, loss=loss, tolerance=1e-12)
    return Problem(recordings, Plant(), NAMES, VARIABLES, options)


def blocks(p: Problem, z: np.ndarray, own: list[np.ndarray], derivatives: bool = True):
    return p._evaluator(p.predictor)(z, own, derivatives)


def test_numbers_and_nuisance_are_told_apart():
    p = made()
    assert p.values(Z) == pytest.approx(TRUE)
    plant, nuisance = p.split(Z)
    assert nuisance == pytest.approx({"scale": 1.1})
    assert plant.values() == pytest.approx({"whip.k": 0.3, "whip.drag": 2e-3})


def test_residuals_are_whitened_and_own_unknowns_held_loosely():
    """A state's usual size is 1 rad and 30 rad/s around rest, a delay's 0.1 s around its first guess."""
    p = made(per_recording=("start", "delay"), prior=PRIOR)
    own = [np.array([0.7, -3.0, 0.02]), np.array([0.1, 0.2, -0.3])]
    found = blocks(p, Z, own)
    assert len(found) == 3
    for i in range(2):
        moved = OWN[i] @ (own[i] - [0.5, 2.0, 0.0])
        expected = moved / SIGMA[i] - NOISE[i]
        np.testing.assert_allclose(found[i].r[:ROWS], expected, atol=1e-9)
        np.testing.assert_allclose(found[i].r[ROWS:], own[i] / [1.0, 30.0, 0.1])
    off = np.log([1.1 / 1.0, 0.3 / 0.25])  # both are positive: relative
    assert found[2].r @ found[2].r == pytest.approx(off @ np.linalg.solve(PRIOR.covariance, off))
    plain = blocks(p, Z, own, derivatives=False)
    for mine, other in zip(found, plain):
        np.testing.assert_array_equal(mine.r, other.r)


def test_cameras_that_share_a_log_know_it_as_well_together_as_one():
    """Two cameras of one strike: their rows, one below the other, have the squares of the log's own."""
    p = made()
    rng = np.random.default_rng(4)
    rows, mean, x = rng.normal(size=(5, 2)), rng.normal(size=5), rng.normal(size=2)
    drive = SimpleNamespace(unknowns={"joints": np.zeros(2)}, motion=SimpleNamespace(rows=rows, mean=mean))
    p.predictor.drives, p.predictor.start = [drive] * 2, [np.zeros(2)] * 2
    p.predictor.sharing, p.predictor.width = [2, 2], 2
    found = blocks(p, Z, [x] * 2)
    together = np.concatenate([b.r[ROWS:] for b in found])
    assert together @ together == pytest.approx(np.sum((rows @ x - mean) ** 2))
    slopes = np.vstack([b.B[ROWS:] for b in found])
    np.testing.assert_allclose(slopes.T @ slopes, rows.T @ rows)


def test_readings_that_are_not_known_have_no_part():
    """Zero residuals and slopes for them, the others as they are: by hand, from the readings' own equation."""
    p = made(per_recording=("start", "delay"))
    own = [np.array([0.7, -3.0, 0.02]), np.array([0.1, 0.2, -0.3])]
    known = [np.arange(ROWS) % 2.0, np.ones(ROWS)]
    for derivatives in (True, False):
        found = p._evaluator(p.predictor, known)(Z, own, derivatives)
        for i in range(2):
            whole = OWN[i] @ (own[i] - [0.5, 2.0, 0.0]) / SIGMA[i] - NOISE[i]
            np.testing.assert_allclose(found[i].r[:ROWS], np.where(known[i] == 1, whole, 0.0), atol=1e-9)
    found = p._evaluator(p.predictor, known)(Z, own, True)
    np.testing.assert_allclose(found[0].B[1:ROWS:2], OWN[0][1::2] / SIGMA[0][1::2, None])
    assert not found[0].A[:ROWS:2].any()
    assert not found[0].B[:ROWS:2].any()


@pytest.mark.parametrize("per_recording", [(), ("start", "delay")])
def test_slopes_are_those_of_differences(per_recording):
    p = made(per_recording=per_recording, prior=PRIOR)
    own = [x + 0.1 for x in p.predictor.start]
    found = blocks(p, Z, own)
    h = 1e-5
    for j in range(3):
        step = h * np.eye(3)[j]
        ahead, behind = blocks(p, Z + step, own, False), blocks(p, Z - step, own, False)
        for b, x, y in zip(found, ahead, behind):
            np.testing.assert_allclose(b.A[:, j], (x.r - y.r) / (2 * h), rtol=1e-6, atol=1e-5)
    for j in range(len(own[0])):
        step = h * np.eye(len(own[0]))[j]
        ahead, behind = (blocks(p, Z, [x + s * step for x in own], False) for s in (1, -1))
        for i in range(2):
            np.testing.assert_allclose(found[i].B[:, j], (ahead[i].r - behind[i].r) / (2 * h), rtol=1e-6, atol=1e-5)
    assert found[2].B.shape == (2, 0)


def test_what_a_model_may_not_be_has_no_finite_residuals():
    p = made()
    beyond = Z.copy()
    beyond[0] = np.log(11.0)
    assert all(np.isinf(b.r).all() for b in blocks(p, beyond, [np.zeros(0)] * 2))


def test_a_solution_is_where_the_gradient_is_none():
    """Its gradient is none, its cost half the sum of squares; with the shared numbers held it costs more."""
    p = made(per_recording=("start", "delay"), prior=PRIOR)
    solution = p.solve(Z)
    assert solution.status is Ending.CONVERGED
    gradient, total = np.zeros(3), 0.0
    for b in blocks(p, solution.z, solution.own):
        gradient += b.A.T @ b.r
        total += b.r @ b.r / 2
        np.testing.assert_allclose(b.B.T @ b.r, 0, atol=1e-3)
    np.testing.assert_allclose(gradient, 0, atol=1e-2)
    assert solution.cost == pytest.approx(total)
    held = p.solve(Z, fixed=True)
    np.testing.assert_array_equal(held.z, Z)
    assert held.cost > solution.cost
    again = p.refine(held)
    np.testing.assert_allclose(again.z, solution.z, atol=1e-5)
    assert again.evaluations > held.evaluations
    assert again.history[: len(held.history)] == held.history


def test_priors_are_never_robust():
    """A prior that contradicts the readings by many standard errors pulls in full: the loss is for readings alone."""
    sharp = Prior(("scale",), (3.0,), np.array([[1e-8]]))
    solution = made(prior=sharp, loss=1.0).solve(Z)
    assert VARIABLES[2].value(solution.z[2]) == pytest.approx(3.0, abs=0.01)


@pytest.mark.parametrize(("inflated", "widens"), [(0.5, False), (1.45, False), (1.55, True), (4.0, True)])
def test_the_loss_widens_to_the_spread_of_the_residuals(inflated, widens):
    """To 1.345 times the robust spread, `1.4826 median |r|`, where that is 1.5 times as far or more."""
    p = made(loss=1.345)
    spread = 1.4826 * np.median(np.abs(NOISE))
    p.predictor.sigma = [s * spread / inflated for s in p.predictor.sigma]
    own = [np.zeros(0)] * 2
    solution = SimpleNamespace(z=Z, own=own)
    r = np.abs(np.concatenate([b.r for b in blocks(p, Z, own)]))
    assert p.adapt(solution) is widens
    assert p._limit == pytest.approx(1.345 * 1.4826 * np.median(r) if widens else 1.345)
    assert made().adapt(solution) is False


def test_recordings_are_compared_with_their_predictions():
    p = made(per_recording=("start", "delay"), loss=0.8)
    own = [np.array([0.5, 2.0, 0.01]), np.array([0.5, 2.0, 0.0])]
    fits = p.compare(SimpleNamespace(z=Z, own=own))
    for i, found in enumerate(fits):
        expected = OWN[i] @ (own[i] - [0.5, 2.0, 0.0]) - SIGMA[i] * NOISE[i]
        np.testing.assert_allclose(found.residuals, expected, atol=1e-12)
        np.testing.assert_allclose(found.weight, np.minimum(1.0, 0.8 / np.abs(expected / SIGMA[i])))
        assert found.source == f"r{i}"
    assert fits[0].own == {"start[0]": 0.5, "start[1]": 2.0, "delay": 0.01}
    assert fits[0].markers == ("node1", "tip")


def test_options_are_checked():
    for bad in ({"starts": 0}, {"dispersion": 0.99}, {"dispersion": np.nan}, {"pieces": (0.5,)}):
        with pytest.raises(InputError):
            FitOptions(**bad)
    FitOptions(starts=1, dispersion=1.0)
    FitOptions(drive="free", pieces=(0.5,))
