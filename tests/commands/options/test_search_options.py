"""How much is tried: bounds of a search, and lengths of a training."""

from __future__ import annotations

import numpy as np
import pytest

from whiptool.commands import cli
from whiptool.commands.options.search_options import CriteriaOptions, SearchOptions, TrainingOptions
from whiptool.errors import InputError
from whiptool.goals.criteria import Robustness
from whiptool.models import ArmLink, ArmParameters, Model, StrikeBounds, default_bounds, preset

LEMON = preset("lemon2024")
FOUR = Model(LEMON.whip, ArmParameters((ArmLink(1.0, 0.3),) * 4))
LOWER, UPPER = (-1.0, 0.0, 0.5, 0.0, 0.5), (-0.5, 1.0, 2.0, 1.0, 1.0)


def test_bounds_are_the_usual_ones_unless_they_are_given():
    usual = default_bounds(LEMON.arm)
    assert SearchOptions().build_bounds(LEMON) == usual
    assert SearchOptions(lower=LOWER, upper=UPPER).build_bounds(LEMON) == StrikeBounds(LOWER, UPPER)
    assert SearchOptions(lower=LOWER).build_bounds(LEMON) == StrikeBounds(LOWER, usual.upper)
    assert SearchOptions(upper=UPPER).build_bounds(LEMON) == StrikeBounds(usual.lower, UPPER)


def test_arms_without_usual_bounds_take_given_ones():
    lower, upper = (0.0,) * 8 + (0.4,), (1.0,) * 8 + (1.5,)
    box = SearchOptions(lower=lower, upper=upper).build_bounds(FOUR).box
    np.testing.assert_array_equal(box, [lower, upper])
    for some in ({}, {"lower": lower}, {"upper": upper}):
        with pytest.raises(InputError, match=r"; give --lower and --upper$"):
            SearchOptions(**some).build_bounds(FOUR)


@pytest.mark.parametrize(
    ("given", "model", "said"),
    [
        ({"lower": (0.0, 0.0)}, LEMON, r"^--lower: got \(0\.0, 0\.0\); allowed: 5 numbers, q_si q_ei q_sf q_ef D$"),
        ({"upper": (0.0,) * 6}, LEMON, r"^--upper: .*5 numbers, q_si q_ei q_sf q_ef D$"),
        ({"lower": LOWER, "upper": UPPER}, FOUR, r"^--lower: .*9 numbers, q_.* D$"),
        ({"lower": UPPER, "upper": LOWER}, LEMON, "bounds.*lower < upper"),
        ({"lower": (-1.0, 0.0, 0.5, 0.0, 2.0)}, LEMON, "bounds.*lower < upper"),  # crosses the usual upper bound
    ],
)
def test_bounds_that_do_not_fit_are_refused(given, model, said):
    with pytest.raises(InputError, match=said):
        SearchOptions(**given).build_bounds(model)


@pytest.mark.parametrize("trials", [0, -1, 2**31])
def test_a_search_has_some_trials(trials):
    SearchOptions(max_trials=1).check()
    with pytest.raises(InputError, match=rf"^--max-trials: got {trials}; allowed: a whole number from 1 to"):
        SearchOptions(max_trials=trials).check()


@pytest.mark.parametrize(
    ("given", "option"),
    [
        ({"episodes": 0}, "--episodes"), ({"episodes": 2**31}, "--episodes"),
        ({"trials": 1}, "--trials"), ({"trials": 1_000_001}, "--trials"),
        ({"hindsight": -1}, "--hindsight"), ({"hindsight": 1001}, "--hindsight"),
        ({"random_episodes": -1}, "--random-episodes"), ({"random_episodes": 500}, "--random-episodes"),
        ({"episodes": 50}, "--random-episodes"),
    ],
)  # fmt: skip
def test_trainings_in_which_nothing_is_learned_are_refused(given, option):
    with pytest.raises(InputError) as caught:
        TrainingOptions(**given).check()
    assert caught.value.name == option


@pytest.mark.parametrize(
    "given",
    [{}, {"trials": 2}, {"trials": 1_000_000}, {"hindsight": 1000}, {"random_episodes": 0}, {"random_episodes": 499},
     {"episodes": 51}, {"episodes": 1, "random_episodes": 0}],
)  # fmt: skip
def test_trainings_in_which_something_is_learned_pass(given):
    TrainingOptions(**given).check()


def test_the_fix_that_is_told_is_one():
    """What the error says to give passes, for any number of episodes that is too small."""
    for episodes in range(1, 51):
        with pytest.raises(InputError) as caught:
            TrainingOptions(episodes=episodes).check()
        words = caught.value.fix.split()
        told = int(words[words.index("--random-episodes") + 1].rstrip(";"))
        TrainingOptions(episodes=episodes, random_episodes=told).check()


@pytest.mark.parametrize("command", ["train", "compare"])
def test_a_training_without_an_episode_to_learn_in_says_what_to_give(command: str, capsys) -> None:
    """Who asks for 20 episodes has not heard of the 50 random ones."""
    assert cli.main_of(command)(["--episodes", "20"]) == 2
    assert capsys.readouterr().err == (
        "whiptool: --random-episodes: got 50; allowed: a whole number from 0 to 19, fewer than --episodes 20: random "
        "episodes come first, and nothing is learned in them; give --random-episodes 4; it is 50 unless given\n"
    )


BOUNDS = default_bounds(preset("lemon2024").arm)


def names(**given) -> list[str]:
    options = CriteriaOptions(**given)
    options.check()
    return [criterion.name for criterion in options.build_criteria(BOUNDS)]


def test_the_miss_alone_is_no_criterion():
    assert names() == names(minimise="miss") == []
    assert not CriteriaOptions().judged
    assert names(minimise="speed") == ["speed"]
    assert names(pareto=("effort", "miss")) == ["effort", "miss"]
    assert CriteriaOptions(pareto=("effort", "miss")).judged


def test_noise_is_one_number_or_one_of_each():
    for given, expected in (((0.02,), [0.02] * 5), ((0.1, 0.2, 0.3, 0.4, 0.05), [0.1, 0.2, 0.3, 0.4, 0.05])):
        (found,) = CriteriaOptions(minimise="robustness", noise=given).build_criteria(BOUNDS)
        assert isinstance(found, Robustness)
        np.testing.assert_array_equal(found.noise, expected)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"pareto": ("effort", "effort")}, "two different criteria"),
        ({"pareto": ("effort", "miss"), "minimise": "speed"}, "only without --pareto"),
        ({"noise": (0.02,)}, "only with --minimise robustness"),
        ({"minimise": "robustness", "noise": (-1.0,)}, "0 or more"),
    ],
)
def test_contradictions_are_refused(given, said):
    with pytest.raises(InputError, match=said):
        CriteriaOptions(**given).check()
