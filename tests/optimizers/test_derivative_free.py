"""Searches without derivatives: what each one does on functions that are known."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import torch
from counted_bowl import Counted
from toy_objectives import BOUNDS, LOWER, UPPER, Bowl, Enough, Recorder

from whiptool.errors import InputError
from whiptool.optimizers.derivative_free import (
    BATCH,
    DIRECT_L,
    RANDOM_BATCHES,
    UPDATES,
    GASettings,
    cmaes_search,
    fitness,
    gain,
    genetic_search,
    learner_search,
    nlopt_names,
    nlopt_search,
    random_search,
)
from whiptool.rl import actor_critic
from whiptool.rl.task import reward


def test_random_strikes_are_uniform_and_need_an_end():
    bowl = Counted(most=4000)
    with pytest.raises(Enough):
        random_search(bowl, seed=2)
    lower, upper = BOUNDS.box
    unit = (np.array(bowl.refined) - lower) / (upper - lower)
    np.testing.assert_allclose(unit.mean(axis=0), 0.5, atol=0.02)
    np.testing.assert_allclose(unit.var(axis=0), 1 / 12, rtol=0.06)
    endless = Counted()
    endless.max_trials = None
    with pytest.raises(InputError, match="max trials"):
        random_search(endless, seed=0)
    timed = Counted(most=3)
    timed.max_trials, timed.max_time = None, 1.0
    with pytest.raises(Enough):
        random_search(timed, seed=0)


@pytest.mark.parametrize("algorithm", [DIRECT_L, "GN_CRS2_LM", "GN_ISRES"])
def test_they_descend_within_the_box(algorithm):
    bowl = Counted(most=1500)
    with pytest.raises(Enough):
        nlopt_search(bowl, seed=3, algorithm=algorithm)
    lower, upper = BOUNDS.box
    tried = np.array(bowl.refined)
    assert ((tried >= lower) & (tried <= upper)).all()
    span = np.linalg.norm(upper - lower)
    assert bowl.miss(tried).min() < 0.03 * span
    if algorithm != "GN_CRS2_LM":  # which begins with a random population
        np.testing.assert_allclose(tried[0], (lower + upper) / 2)
    again = Counted(most=50)
    with pytest.raises(Enough):
        nlopt_search(again, seed=3, algorithm=algorithm)
    np.testing.assert_array_equal(again.refined, tried[:50])


def test_a_converged_search_returns():
    bowl = Counted(most=200_000)
    nlopt_search(bowl, seed=1, algorithm="GN_CRS2_LM")
    assert bowl.miss(np.array(bowl.refined)).min() < 1e-5
    assert all(name.startswith("GN_") for name in nlopt_names())
    assert DIRECT_L in nlopt_names()


class StopsAtOnce(Counted):
    """Ends the search at its fourth strike, and counts the strikes that come all the same."""

    def __init__(self) -> None:
        super().__init__()
        self.asked = 0

    def trial(self, strike):
        self.asked += 1
        if self.asked >= 4:
            raise Enough
        return super().trial(strike)


@pytest.mark.parametrize("algorithm", [DIRECT_L, "GN_CRS2_LM", "GN_ISRES", "GN_ESCH", "GN_AGS"])
def test_nothing_is_tried_after_the_search_was_ended(algorithm):
    """CRS2 fills its first population of 60 points before it looks whether it is to stop."""
    bowl = StopsAtOnce()
    with pytest.raises(Enough):
        nlopt_search(bowl, seed=3, algorithm=algorithm)
    assert bowl.asked == 4


def generations(count: int, miss, *, seed: int = 0, **settings) -> list[np.ndarray]:
    recorder = Recorder(count, miss)
    with pytest.raises(Enough):
        genetic_search(recorder, seed=seed, settings=GASettings(**settings))
    return recorder.seen


def first_gene(x: np.ndarray) -> np.ndarray:
    return x[:, 0]


def flat(x: np.ndarray) -> np.ndarray:
    return np.ones(len(x))


def test_fitness_is_eq_20():
    assert fitness(np.array([0.0, 1.0, 4.0]), 4.0).tolist() == [1.0, 0.75, 0.0]


def test_the_first_generation_is_uniform():
    (first,) = generations(1, flat, population=2000)
    assert first.shape == (2000, 5)
    np.testing.assert_allclose(first.mean(axis=0), 0.5, atol=4 / math.sqrt(12 * 2000))
    np.testing.assert_allclose(first.std(axis=0), 1 / math.sqrt(12), rtol=0.05)


def parents_of(children: np.ndarray, first: np.ndarray) -> list[tuple[int, np.ndarray]]:
    """Of each child that shares a gene with somebody: whom it shares most with, and which genes."""
    found = []
    for child in children:
        same = np.isclose(first, child, atol=1e-12)
        parent = int(same.sum(axis=1).argmax())
        if same[parent].any():
            found.append((parent, same[parent]))
    return found


@pytest.mark.parametrize("tournament", [1, 2, 5])
def test_parents_win_their_tournaments(tournament):
    """The best of k has a mean rank of 1/(k + 1)."""
    first, second = generations(
        2, first_gene, population=400, crossover=0.0, mutation=0.2, tournament=tournament, seed=1
    )
    order = np.argsort(np.argsort(first[:, 0])) / 400
    ranks = [order[parent] for parent, _ in parents_of(second, first)]
    assert len(ranks) > 200
    assert np.mean(ranks) == pytest.approx(1 / (tournament + 1), abs=0.05)


def test_winners_are_the_nearest():
    """Selection alone drives the first gene, which is the miss, down; with the miss turned round, up."""
    down = generations(15, first_gene, population=60)
    up = generations(15, lambda x: 1 - x[:, 0], population=60)
    assert down[-1][:, 0].mean() < 0.15
    assert up[-1][:, 0].mean() > 0.85


def test_crossed_children_keep_their_parents_mean():
    """Simulated binary crossover alone: the mean stays, and a larger index leaves children nearer to parents."""
    spread = {}
    for eta in (2.0, 200.0):
        first, second = generations(2, flat, population=1500, mutation=0.0, crossover=1.0, crossover_eta=eta)
        np.testing.assert_allclose(second.mean(axis=0), first.mean(axis=0), atol=0.03)
        spread[eta] = np.mean([np.abs(first[:, 0] - x).min() for x in second[:300, 0]])
    assert spread[200.0] < spread[2.0]


def test_mutation_changes_as_many_genes_as_told():
    """Without crossover a child differs from its parent in a binomial number of genes."""
    for rate in (0.2, 0.6):
        first, second = generations(2, flat, population=500, crossover=0.0, mutation=rate, mutation_eta=20.0)
        changed = [5 - same.sum() for _, same in parents_of(second, first)]
        kept = (1 - rate) ** 5  # children like their parents are dropped
        gone = rate**5  # and those without a gene of theirs are not recognised
        numbers = np.arange(1, 5)
        shares = np.array([math.comb(5, k) * rate**k * (1 - rate) ** (5 - k) for k in numbers]) / (1 - kept - gone)
        assert np.mean(changed) == pytest.approx((numbers * shares).sum(), rel=0.1)


def test_seeds_and_the_settings():
    same = [generations(3, first_gene, seed=seed) for seed in (0, 0, 1)]
    assert all(np.array_equal(a, b) for a, b in zip(same[0], same[1], strict=True))
    assert not np.array_equal(same[0][0], same[2][0])
    assert [len(x) for x in same[0]] == [20, 20, 20]
    GASettings(population=4, tournament=4)


WRONG = {
    "population": (3, 20.0, True, "20", math.nan, math.inf, -5, 10**9),
    "tournament": (0, 21, 2.0, None, -1),
    "crossover": (1.1, -0.1, "0.9", math.nan, math.inf),
    "mutation": (1.1, -0.1, None, math.nan),
    "crossover_eta": (-1, math.nan, math.inf, "15", 1e9),
    "mutation_eta": (-1, math.nan, math.inf, [], 1e9),
    "d_max": (0, -1.0, math.nan, math.inf, "far", 1e12),
}


@pytest.mark.parametrize("name", WRONG)
def test_settings_that_no_search_can_run_with_are_refused(name):
    for value in WRONG[name]:
        with pytest.raises(InputError, match=name):
            GASettings(**{name: value})


def test_extreme_settings_that_are_allowed_run():
    every = {"crossover_eta": 0, "mutation_eta": 0}, {"crossover_eta": 1000, "mutation_eta": 1000}, {"d_max": 10**6}
    for some in every:
        assert len(generations(3, first_gene, **some)) == 3


def test_children_that_are_their_parents_end_the_search():
    with pytest.raises(InputError, match=r"crossover, mutation: .*at least one > 0"):
        GASettings(crossover=0, mutation=0)
    recorder = Recorder(3, first_gene)
    genetic_search(recorder, seed=0, settings=GASettings(crossover=1e-12, mutation=0))
    assert len(recorder.seen) == 1


MINIMUM = np.array([0.3, 0.6, 0.4, 0.7, 0.55])


def valley(x: np.ndarray) -> np.ndarray:
    """Ten times as steep along the diagonal as across."""
    offset = x - MINIMUM
    along = offset.sum(axis=1)
    return np.sqrt((offset**2).sum(axis=1) + 99 * along**2 / 5)


def search(generations: int, miss, seed: int) -> list[np.ndarray]:
    recorder = Recorder(generations, miss)
    with pytest.raises(Enough):
        cmaes_search(recorder, seed=seed)
    return recorder.seen


def test_it_begins_with_a_random_strike_and_a_generation_about_it():
    begun = [search(2, valley, seed) for seed in range(60)]
    starts = np.array([first[0] for first, _ in begun])
    assert starts.min() >= 0.2
    assert starts.max() <= 0.8
    np.testing.assert_allclose(starts.mean(axis=0), 0.5, atol=4 * 0.173 / np.sqrt(60))
    np.testing.assert_allclose(starts.std(), 0.6 / np.sqrt(12), rtol=0.1)
    offsets = np.concatenate([second - first for first, second in begun])
    assert 0.22 < offsets.std() < 0.33  # 0.3, less what the box cuts off


def test_it_converges_and_begins_again():
    state = repr(np.random.get_state())  # noqa: NPY002
    seen = search(400, valley, 3)
    assert repr(np.random.get_state()) == state  # noqa: NPY002
    best = [valley(x).min() for x in seen]
    assert min(best[:200]) < 1e-6
    middles = np.array([x.mean(axis=0) for x in seen])
    jumps = np.abs(np.diff(middles, axis=0)).max(axis=1)
    restarts = np.flatnonzero((jumps > 0.05) & (np.array(best[:-1]) < 1e-6))
    assert len(restarts) >= 1  # converged, and somewhere else again
    assert all(np.array_equal(a, b) for a, b in zip(search(9, valley, 3), seen, strict=False))
    assert not np.array_equal(search(1, valley, 4)[0], seen[0])


@pytest.mark.parametrize("method", ["cmaes", "ga", "nlopt"])
def test_a_search_and_its_user_draw_from_generators_of_their_own(method):
    """In threads, too: a search that draws from NumPy's global generator would get what others left of it."""
    searches = {
        "cmaes": cmaes_search,
        "ga": genetic_search,
        "nlopt": lambda recorder, seed: nlopt_search(recorder, seed=seed, algorithm="GN_CRS2_LM"),
    }

    def run(miss):
        recorder = Recorder(9 if method != "nlopt" else 60, miss)
        recorder.trial = lambda strike: recorder.batch(strike[None])[0]
        with pytest.raises(Enough):
            searches[method](recorder, seed=5)
        return recorder.seen

    drawn = []

    def miss_of_a_user_who_draws(x):
        drawn.append(np.random.random())  # noqa: NPY002
        return valley(x)

    np.random.seed(7)  # noqa: NPY002
    alone, beside = run(valley), run(miss_of_a_user_who_draws)
    np.random.seed(7)  # noqa: NPY002
    assert drawn == np.random.random(len(drawn)).tolist()  # noqa: NPY002
    with ThreadPoolExecutor(4) as pool:
        for seen in (beside, *pool.map(run, [valley] * 4)):
            assert all(np.array_equal(a, b) for a, b in zip(alone, seen, strict=True))


def test_strikes_are_those_of_the_box_and_nothing_is_printed(capsys):
    (first, _) = search(2, valley, 0)
    assert capsys.readouterr() == ("", "")
    assert ((first >= 0) & (first <= 1)).all()
    assert (UPPER > LOWER).all()


SURE = 0.4  # [m], below which this objective claims a hit: it measures, and its hit radius is larger


class CountedBatches(Bowl):
    def batch(self, strikes):
        if len(self.batches) == 5:
            raise Enough
        found = super().batch(strikes)
        for outcome in found:
            outcome.hit = outcome.cost <= SURE
        return found


@pytest.mark.parametrize("name", ["sac", "ppo"])
def test_what_the_learner_is_shown(name, monkeypatch):
    made = []

    def make(settings, **sizes):
        learner = kind(settings, **sizes)
        made.append(learner)
        learner.shown = []
        learner.learn = lambda new, *, update: learner.shown.append((new, update))
        learner.act = lambda obs: torch.full((len(obs), 5), 1.5) * torch.linspace(-1, 1, len(obs))[:, None]
        return learner

    kind = actor_critic.LEARNERS[name]
    monkeypatch.setitem(actor_critic.LEARNERS, name, make)
    bowl = CountedBatches()
    with pytest.raises(Enough):
        learner_search(bowl, seed=4, learner=name)
    (learner,) = made
    assert (learner.n_obs, learner.n_act, learner.discount) == (1, 5, 0.0)
    if name == "sac":
        assert learner.settings.updates == UPDATES
    lower, upper = BOUNDS.box
    assert [len(x) for x in bowl.batches] == [BATCH] * 5
    assert [update for _, update in learner.shown] == [False] * RANDOM_BATCHES + [True] * (5 - RANDOM_BATCHES)
    for strikes, (new, _) in zip(bowl.batches, learner.shown, strict=True):
        box = (np.clip(new.action.double().numpy(), -1, 1) + 1) / 2
        np.testing.assert_allclose(strikes, lower + box * (upper - lower), rtol=1e-6)
        np.testing.assert_allclose(new.reward, reward(bowl.miss(strikes), bowl.miss(strikes) <= SURE), rtol=1e-6)
        assert new.terminated.tolist() == [1.0] * BATCH
        assert new.obs.tolist() == new.next_obs.tolist() == [[0.0]] * BATCH
    explored = np.concatenate([new.action.numpy() for new, _ in learner.shown[:RANDOM_BATCHES]])
    assert explored.min() < -0.8
    assert explored.max() > 0.8
    np.testing.assert_allclose(bowl.batches[-1][[0, -1]], [lower, upper])  # actions beyond the box are clipped


def test_better_hits_gain_more():
    costs = np.array([-1.8, -0.9, -0.2, 0.0, 0.05, 0.08, 0.5])
    expected = [90.0, 45.0, 10.0, 50.0, 50.0, -0.4, -5.0]
    np.testing.assert_allclose(gain(costs, costs <= 0.06), expected)
