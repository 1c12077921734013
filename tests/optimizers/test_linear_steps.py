"""Short steps to a hit, where the best one has a closed form."""

from __future__ import annotations

import numpy as np
import pytest
from linear_rollout import BASE, BOUNDS, LEAST, LinearRollout

from whiptool.goals.criteria import Criterion, Effort, PeakTorque, Speed
from whiptool.goals.target import Target
from whiptool.objective import Objective, SearchStopped
from whiptool.optimizers.linear_steps import FIRST, step_down

START = np.array([-0.6, 0.7, 1.0, -1.0, 1.9])
PLACE = np.array([0.2, -0.1])
AWAY = np.linalg.norm(LEAST[:2] - PLACE)


def stepped(criterion: Criterion, *, rollout: LinearRollout | None = None, **options) -> Objective:
    target = Target(tuple(PLACE), 0.3)
    objective = Objective(
        rollout or LinearRollout(), target, bounds=BOUNDS, criteria=[criterion], check_reach=False, **options
    )
    step_down(objective, START, criterion, steps=100)
    return objective


@pytest.mark.parametrize(
    ("criterion", "expected"), [(Speed(), np.hypot(5, 2)), (PeakTorque(), BASE.mean()), (Effort(), (AWAY - 0.3) ** 2)]
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
