"""Mixed models beside closed forms and beside likelihoods in plain NumPy."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from human_data import DATA, needs_people
from scipy.optimize import minimize, minimize_scalar

from papers.human.mixed_models import chosen_mixed, fit_hits, fit_mixed
from papers.human.reading import read_people


def throws_of(people: int, throws: int, *, between: float, seed: int = 0) -> pd.DataFrame:
    """Return balanced throws: half of each person's in each style, over five blocks."""
    rng = np.random.default_rng(seed)
    rows = [
        {"person": p, "style": style, "block": block}
        for p in range(people)
        for style in ("discrete", "rhythmic")
        for block in range(1, 6)
        for _ in range(throws)
    ]
    table = pd.DataFrame(rows)
    own = between * rng.standard_normal(people)
    rhythmic = (table["style"] == "rhythmic").to_numpy(float)
    table["y"] = 3 + own[table["person"]] - 0.5 * rhythmic - 0.1 * table["block"] + rng.standard_normal(len(table))
    return table


def test_balanced_throws_have_a_closed_form():
    """With the same design for all, effects are those of least squares, and variances those of squares' means."""
    table = throws_of(8, 3, between=0.7)
    model = fit_mixed(table, "y", interaction=False)
    rhythmic, block = (table["style"] == "rhythmic").to_numpy(float), table["block"].to_numpy() - 1.0
    X, y = np.column_stack([np.ones(len(table)), rhythmic, block]), table["y"].to_numpy()
    slopes = np.linalg.lstsq(X, y, rcond=None)[0]
    np.testing.assert_allclose([effect.value for effect in model.effects], slopes, rtol=1e-6)
    rest = pd.Series(y - X @ slopes).groupby(table["person"])
    n, k = 30, 8
    inside = float(sum(((rows - rows.mean()) ** 2).sum() for _, rows in rest))
    within = inside / (k * (n - 1))
    outside = n * float((rest.mean() ** 2).sum()) / k
    assert model.within**2 == pytest.approx(within, rel=1e-4)
    assert model.between[0] ** 2 == pytest.approx((outside - within) / n, rel=1e-3)
    assert model.effect("style").low < slopes[1] < model.effect("style").high
    assert model.effect("style x block") is None


def profile_likelihood(y: np.ndarray, X: np.ndarray, person: np.ndarray) -> tuple[float, np.ndarray]:
    """Return the largest log likelihood of a model in which people's means differ, and its effects, by Woodbury."""

    def at(log_ratio: float) -> tuple[float, np.ndarray]:
        ratio, A, b, c, determinant = np.exp(log_ratio), 0.0, 0.0, 0.0, 0.0
        for i in np.unique(person):
            own, rows = y[person == i], X[person == i]
            weight = ratio / (1 + len(own) * ratio)
            A = A + rows.T @ rows - weight * np.outer(rows.sum(axis=0), rows.sum(axis=0))
            b = b + rows.T @ own - weight * rows.sum(axis=0) * own.sum()
            c = c + own @ own - weight * own.sum() ** 2
            determinant += np.log1p(len(own) * ratio)
        effects = np.linalg.solve(A, b)
        variance = (c - b @ effects) / len(y)
        return 0.5 * (len(y) * (np.log(2 * np.pi * variance) + 1) + determinant), effects

    best = minimize_scalar(lambda x: at(x)[0], bounds=(-12, 6), method="bounded", options={"xatol": 1e-9})
    return -best.fun, at(best.x)[1]


def test_unbalanced_throws_beside_a_profile_likelihood():
    table = throws_of(9, 4, between=0.5, seed=3)
    table = table.sample(frac=0.6, random_state=1)
    model = fit_mixed(table, "y", interaction=True)
    rhythmic, block = (table["style"] == "rhythmic").to_numpy(float), table["block"].to_numpy() - 1.0
    X = np.column_stack([np.ones(len(table)), rhythmic, block, rhythmic * block])
    likelihood, effects = profile_likelihood(table["y"].to_numpy(), X, table["person"].to_numpy())
    assert model.log_likelihood == pytest.approx(likelihood, abs=1e-4)
    np.testing.assert_allclose([effect.value for effect in model.effects], effects, atol=1e-4)


def test_a_random_slope_is_chosen_where_people_differ_in_it():
    table = throws_of(10, 4, between=0.5, seed=5)
    own = np.random.default_rng(2).standard_normal(10)
    table["y"] += own[table["person"]] * (table["style"] == "rhythmic")
    assert "style" in chosen_mixed(table, "y").random
    assert chosen_mixed(throws_of(10, 4, between=0.5, seed=5), "y").random == ("mean",)


def likelihood_of(y: np.ndarray, X: np.ndarray, Z: np.ndarray, person: np.ndarray, root: np.ndarray) -> float:
    """Return the log likelihood of random effects with covariance root root^T times the error's, the rest profiled."""
    A, b, c, determinant = 0.0, 0.0, 0.0, 0.0
    for i in np.unique(person):
        own, rows, random = y[person == i], X[person == i], Z[person == i] @ root
        inner = np.eye(random.shape[1]) + random.T @ random
        both = np.column_stack([rows, own])
        solved = both - random @ np.linalg.solve(inner, random.T @ both)
        A, b, c = A + rows.T @ solved[:, :-1], b + rows.T @ solved[:, -1], c + own @ solved[:, -1]
        determinant += np.linalg.slogdet(inner)[1]
    variance = (c - b @ np.linalg.solve(A, b)) / len(y)
    return -0.5 * (len(y) * (np.log(2 * np.pi * variance) + 1) + determinant)


@needs_people
@pytest.mark.parametrize("quantity", ["min_distance", "peak_hand_speed"])
def test_their_models_beside_a_likelihood_in_numpy(quantity):
    """Another optimizer on another expression of the likelihood finds nothing better."""
    throws = read_people(DATA).throws
    model = chosen_mixed(throws, quantity)
    assert set(model.random) == {"mean", "style", "block"}
    y, scale = throws[quantity].to_numpy(), throws[quantity].std()
    rhythmic, block = (throws["style"] == "rhythmic").to_numpy(float), throws["block"].to_numpy() - 1.0
    X = np.column_stack([np.ones(len(y)), rhythmic, block, rhythmic * block])[:, : len(model.effects)]
    Z, person, lower = X[:, :3], throws["person"].to_numpy(), np.tril_indices(3)

    def cost(x: np.ndarray) -> float:
        root = np.zeros((3, 3))
        root[lower] = x
        return -likelihood_of(y / scale, X, Z, person, root)

    start = np.array([1.0, 0.0, 0.5, 0.0, 0.0, 0.1])
    found = minimize(cost, start, method="L-BFGS-B", options={"maxiter": 60})
    assert model.log_likelihood == pytest.approx(-found.fun - len(y) * np.log(scale), abs=0.1)


@needs_people
def test_hits_grow_over_blocks_and_are_rarer_in_the_rhythmic_style():
    effects = {effect.name: effect for effect in fit_hits(read_people(DATA).throws)}
    assert effects["style"].high < 0 < effects["block"].low
