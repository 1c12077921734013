"""Verdicts on Fig. 6 follow the data."""

from __future__ import annotations

import numpy as np
import pytest
from claims import verdicts

from papers.lemon2024 import fig6
from whiptool.comparison import Series
from whiptool.rl.task import OBSERVATIONS
from whiptool.viz import report
from whiptool.viz.report import verdict_over


def series(method: str, mean: float, *, observation: str = "") -> Series:
    """A method that needs about `mean` trials at each of 300 targets."""
    trials = np.maximum(1, np.round(np.random.default_rng(0).normal(mean, 0.1 * mean, (3, 300)))).astype(int)
    convention = "mean-first" if observation else ""
    return Series(method, observation, convention, 0.06, trials, np.ones_like(trials, bool), 0.0, 0, 0.0)


def standings(**means: float) -> dict:
    learners = ("sac", "td3", "ddpg", "ppo")
    return {
        "goal": fig6.Standings([series(m, x, observation="goal" * (m in learners)) for m, x in means.items()], "goal")
    }


def test_the_papers_own_ranking_is_reproduced():
    """Data like the paper's Fig. 6: every claim holds."""
    like = standings(directl=100, ga=120, sac=8, td3=50, ddpg=55, ppo=150, random=200)
    assert verdicts(fig6.claims(like)) == [report.REPRODUCED] * 6


def test_what_the_paper_says_stands_beside_what_was_found():
    """The column of the paper is the same whatever is found, and no observation is named like it."""
    table = fig6._printed(standings(directl=100, ga=120, sac=8, td3=50, ddpg=55, ppo=150, random=200))
    assert table.rows[0] == ["", "the paper", "here, observation goal"]
    assert [row[0] for row in table.rows[1:]] == ["DIRECT-L", "GA", "SAC", "TD3", "DDPG", "PPO"]
    sac = table.rows[3]
    assert sac[1] == "the fewest, less than 20% of the others' (abstract)"
    assert float(sac[2]) == pytest.approx(8, abs=0.2)
    assert "paper" not in OBSERVATIONS


def test_another_ranking_is_not():
    other = standings(directl=10, ga=12, sac=100, td3=90, ddpg=400, ppo=5, random=20)
    assert verdicts(fig6.claims(other)) == [report.NOT_REPRODUCED] * 6


def test_a_tie_is_no_win():
    """SAC at 1 trial and TD3 at 1 trial: SAC is not the one that needs fewest."""
    tie = standings(directl=20, ga=20, sac=1, td3=1, ddpg=1, ppo=20, random=20)
    first = fig6.claims(tie)[0]
    assert first.verdict == report.NOT_REPRODUCED
    assert "TD3" in first.reason


def test_what_holds_under_one_observation_only_says_so():
    assert verdict_over({"observation goal": True, "observation tip": False}) == "reproduced only with observation goal"
    both = {
        **standings(directl=100, ga=120, sac=8, td3=50, ddpg=55, ppo=150, random=200),
        "tip": standings(directl=10, ga=12, sac=100, td3=90, ddpg=400, ppo=5, random=20)["goal"],
    }
    assert verdicts(fig6.claims(both)) == ["reproduced only with observation goal"] * 6
