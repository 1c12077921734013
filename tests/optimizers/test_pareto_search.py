"""Fronts whose course has a closed form."""

from __future__ import annotations

import csv
import io

import numpy as np
import pytest
from linear_rollout import BASE, BOUNDS, LEAST, LinearRollout

from whiptool.goals.criteria import Criterion, Effort, Miss, PeakTorque, Speed
from whiptool.goals.target import Target
from whiptool.objective import Objective, Outcome, SearchStopped, Trial
from whiptool.optimizers import run_search
from whiptool.optimizers.pareto_search import FIRST, ParetoFront, dominated_by, oriented, pareto_search, step_down
from whiptool.rollout.interface import Rollout

PLACE = np.array([0.2, -0.1])
AWAY = np.linalg.norm(LEAST[:2] - PLACE)


class WavyRollout(LinearRollout):
    """Effort has a valley every 0.3 along the third and the fourth number; between them are ridges of 0.8."""

    def approach(self, strikes, target, *, t_stay=0.3):
        near = super().approach(strikes, target, t_stay=t_stay)
        assert near.effort is not None
        near.effort[:] += 0.4 * (1 - np.cos(2 * np.pi / 0.3 * (strikes[:, 2:4] - LEAST[2:4])))
        return near

    def slopes(self, strikes, target, *, t_stay=0.3, names=None):
        near, slopes = super().slopes(strikes, target, t_stay=t_stay)
        change = 0.4 * 2 * np.pi / 0.3 * np.sin(2 * np.pi / 0.3 * (strikes[:, 2:4] - LEAST[2:4]))
        slopes.effort[:, [0, 1], [2, 3]] += change
        return near, slopes


def front(
    criteria, *, trials: int = 700, seed: int = 0, rollout: Rollout | None = None
) -> tuple[ParetoFront, Objective]:
    objective = Objective(
        rollout or LinearRollout(),
        Target(tuple(PLACE), 0.3),
        bounds=BOUNDS,
        max_trials=trials,
        check_reach=False,
        criteria=criteria,
    )
    result = run_search(objective, pareto_search, "pareto", seed=seed)
    assert result.n_trials == trials
    return ParetoFront.of(criteria, objective.trials), objective


def test_effort_against_miss_is_a_parabola_without_holes():
    found = front((Effort(), Miss()))[0]
    effort, miss = found.values.T
    np.testing.assert_allclose(effort, (AWAY - miss) ** 2, rtol=2e-2)
    assert (miss.min(), miss.max()) == pytest.approx((0, 0.3), abs=2e-3)
    assert np.abs(np.diff(found.costs, axis=0)).max() < 0.2
    assert len(found.trials) >= 10


def test_speed_against_effort_keeps_more_of_what_is_maximised():
    """Among hits the speed grows with the third and fourth number alone; a quadratic program says at what effort."""
    found = front((Speed(), Effort()))[0]
    speed, effort = found.values.T
    assert (np.diff(speed) < 0).all()
    assert (np.diff(effort) < 0).all()
    x, y = np.meshgrid(np.linspace(-2, 2, 801), np.linspace(-2, 2, 801))
    least = (AWAY - 0.3) ** 2 + (x - LEAST[2]) ** 2 + (y - LEAST[3]) ** 2
    for v, e in found.values:
        assert e == pytest.approx(least[np.hypot(x + 3, y) >= v - 1e-9].min(), rel=0.04, abs=0.02)


def test_the_same_seed_makes_the_same_trials():
    a, b = (front((Effort(), Miss()), trials=150, seed=4)[1].trials for _ in range(2))
    assert [trial.strike for trial in a] == [trial.strike for trial in b]
    assert [trial.strike for trial in a] != [x.strike for x in front((Effort(), Miss()), trials=150, seed=5)[1].trials]


@pytest.mark.parametrize("seed", range(3))
def test_the_end_of_a_front_is_not_in_the_valley_nearest_to_a_random_strike(seed):
    """Of 169 valleys one is the deepest, with (AWAY - 0.3)²; the next ones are 0.09 above it."""
    found = front((Effort(), Miss()), seed=seed, rollout=WavyRollout())[0]
    assert found.values[0, 0] < (AWAY - 0.3) ** 2 + 0.3


def test_starts_that_lead_to_one_hit_end_the_search_for_the_first_end(monkeypatch):
    """On a slope without valleys the first descents agree; none begins beside their ends."""
    beside = []
    monkeypatch.setattr("whiptool.optimizers.pareto_search._nearby", lambda *args: beside.append(args) or 1 / 0)
    front((Effort(), Miss()), trials=300)
    assert not beside


def test_a_front_of_one_hit_does_not_end_the_search(monkeypatch):
    """Improving the ends finds the best hit by both criteria, as it did of a UR5e; `front` asserts all its trials."""

    class Free(LinearRollout):
        free = False

        def approach(self, strikes, target, *, t_stay=0.3):
            near = super().approach(strikes, target, t_stay=t_stay)
            assert near.effort is not None
            near.effort[(near.distance == 0) & self.free] = 0.0
            return near

    rollout = Free()

    def improve(objective: Objective, front: ParetoFront) -> None:
        rollout.free = True
        objective.trial(np.r_[PLACE, LEAST[2:]])

    monkeypatch.setattr("whiptool.optimizers.pareto_search._improve_ends", improve)
    found = front((Effort(), Miss()), trials=400, rollout=rollout)[0]
    np.testing.assert_array_equal(found.values, [[0, 0]])


NAMES = ("q_si", "q_ei", "q_sf", "q_ef", "D")


def trial(number: int, values, *, hit: bool = True) -> Trial:
    pair = (0.0, 0.0)
    outcome = Outcome(0.01, hit, 0.3, pair, (3.0, 4.0), pair, pair, False, values=tuple(values), merit=-1.0)
    return Trial(number, (0.1 * number, 0.0, 0.0, 0.0, 1.0), outcome)


@pytest.mark.parametrize("criteria", [(Effort(), Miss()), (Speed(), Miss()), (Miss(), Speed())])
def test_no_hit_dominates_the_front_and_the_front_dominates_the_rest(criteria):
    rng = np.random.default_rng(1)
    values = np.round(rng.uniform(size=(300, 2)), 2)  # some are equal, and others differ by more than the resolution
    trials = [trial(i + 1, row, hit=i % 5 > 0) for i, row in enumerate(values)]
    front = ParetoFront.of(criteria, trials)
    signs = np.array([-1 if x.largest else 1 for x in criteria])
    costs = {i + 1: signs * values[i] for i in range(300) if i % 5}

    def dominates(a: np.ndarray, b: np.ndarray) -> bool:
        return bool((a <= b).all() and (a < b).any())

    kept = {trial.number for trial in front.trials}
    alone = {tuple(costs[i]) for i in costs if not any(dominates(costs[j], costs[i]) for j in costs)}
    assert {tuple(costs[i]) for i in kept} == alone
    assert len(kept) == len(alone) >= 2
    assert (np.diff(oriented(criteria, front.values)[:, 0]) > 0).all()


def test_gains_that_count_as_nothing_are_left_out_at_both_ends():
    """The first hit gains 5e-4 of the effort's range, the last one as much of the miss's."""
    values = [(0.9995, 3.0), (1.0, 2.0), (1.5, 1.5), (2.0, 1.0), (9.0, 0.999)]
    found = ParetoFront.of((Effort(), Miss()), [trial(i + 1, row) for i, row in enumerate(values)])
    assert [x.number for x in found.trials] == [2, 3, 4]


def test_how_far_a_hit_dominates_is_what_the_front_has_to_be_moved_by():
    front = ParetoFront.of((Effort(), Speed()), [trial(1, (1.0, 10.0)), trial(2, (2.0, 20.0)), trial(3, (5.0, 30.0))])
    given = np.array([[1.0, 10.0], [6.0, 5.0], [4.0, 30.0], [0.6, 10.0], [0.6, 12.0], [4.0, 34.0]])
    np.testing.assert_allclose(
        dominated_by(front.criteria, front.values, given), [0.0, -0.75, 0.25, 0.1, 0.1, 0.25], atol=1e-12
    )
    np.testing.assert_allclose(np.ptp(front.costs, axis=0), 1)


def test_hits_alone_are_on_a_front_and_numbers_that_are_none_are_not():
    trials = [trial(1, (1.0, 2.0)), trial(2, (0.1, 0.1), hit=False), trial(3, (np.inf, 0.1))]
    assert [x.number for x in ParetoFront.of((Effort(), Miss()), trials).trials] == [1]
    empty = ParetoFront.of((Effort(), Miss()), trials[1:2])
    assert empty.values.shape == (0, 2)
    assert empty.table(NAMES)["front"] == []


def test_tables_hold_strikes_and_both_criteria():
    front = ParetoFront.of((Effort(), Speed()), [trial(1, (1.0, 10.0)), trial(2, (2.0, 20.0))])
    table = front.table(NAMES)
    assert [x["maximised"] for x in table["criteria"]] == [False, True]
    assert [(x["trial"], x["effort"], x["speed"]) for x in table["front"]] == [(1, 1.0, 10.0), (2, 2.0, 20.0)]
    assert table["front"][1]["strike"] == dict(zip(NAMES, (0.2, 0, 0, 0, 1.0), strict=True))
    assert table["front"][1]["tip_speed"] == 5
    rows = list(csv.DictReader(io.StringIO(front.csv(NAMES))))
    assert [float(row["q_si"]) for row in rows] == [0.1, 0.2]
    assert [row["effort"] for row in rows] == ["1.0", "2.0"]


START = np.array([-0.6, 0.7, 1.0, -1.0, 1.9])


def stepped(criterion: Criterion, *, rollout: LinearRollout | None = None, **options) -> Objective:
    target = Target(tuple(PLACE), 0.3)
    objective = Objective(
        rollout or LinearRollout(), target, bounds=BOUNDS, criteria=[criterion], check_reach=False, **options
    )
    step_down(objective, START, criterion, steps=100)
    return objective


@pytest.mark.parametrize(
    ("criterion", "expected"),
    [(Speed(), np.hypot(5, 2)), (PeakTorque(), BASE.mean()), (Effort(), (AWAY - 0.3) ** 2)],
)
def test_a_hit_is_nearly_the_best(criterion, expected):
    best = stepped(criterion).best
    assert best is not None
    assert best.outcome.hit
    assert best.outcome.values[0] == pytest.approx(expected, abs=0.15)  # from 4.1, 2.0 and 6.7


def test_no_step_is_longer_than_its_box():
    trials = stepped(Speed()).trials
    lower, upper = BOUNDS.box
    steps = np.abs(np.array([trial.strike for trial in trials[:2]]) - START) / (upper - lower)
    assert steps[0].max() == pytest.approx(0)
    assert steps[1].max() == pytest.approx(FIRST)


def test_strikes_that_diverge_are_left():
    walled = stepped(Effort(), rollout=LinearRollout(wild=0.3))
    assert any(trial.outcome.diverged for trial in walled.trials)
    assert walled.best is not None
    assert walled.best.outcome.hit
    lost = stepped(Effort(), rollout=LinearRollout(wild=-0.7))
    assert len(lost.trials) == 1


def test_a_tip_at_rest_has_no_speed_that_others_could_be_measured_by():
    """As of a strike that is nearest to its target before it begins: steps go on where derivatives lead."""

    class Resting(LinearRollout):
        def approach(self, strikes, target, *, t_stay=0.3):
            near = super().approach(strikes, target, t_stay=t_stay)
            near.velocity[np.isclose(strikes, START).all(axis=1)] = 0.0
            return near

    objective = stepped(Speed(), rollout=Resting())
    assert objective.best is not None
    assert objective.best.outcome.hit


def test_the_budget_ends_the_steps():
    with pytest.raises(SearchStopped, match="trials"):
        stepped(Effort(), max_trials=4)
