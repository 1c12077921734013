"""The report: verdicts follow the data, the file needs nothing else, and the quick form of all of it works."""

from __future__ import annotations

import json
import re
import subprocess
import sys

import numpy as np
import pytest
from matplotlib.figure import Figure
from processes import HANG

from whiptool.commands import reproduce
from whiptool.studies.comparison import Series
from whiptool.studies.reproduction import PARTS, fig6, fig7, table4
from whiptool.studies.tracking_errors import TABLE4_CONSTANT, TABLE4_OIAC, TrackingErrors
from whiptool.viz import report
from whiptool.viz.report import Claim, Claims, Picture, Section, Table, Text, to_html, verdict_over

pytestmark = pytest.mark.slow


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


def verdicts(claims: list[Claim]) -> list[str]:
    return [claim.verdict for claim in claims]


def test_the_papers_own_ranking_is_reproduced():
    """Data like the paper's Fig. 6: every claim holds."""
    like = standings(directl=100, ga=120, sac=8, td3=50, ddpg=55, ppo=150, random=200)
    assert verdicts(fig6.claims(like)) == [report.REPRODUCED] * 6


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
    assert (
        verdict_over({"observation goal": True, "observation paper": False}) == "reproduced only with observation goal"
    )
    both = {
        **standings(directl=100, ga=120, sac=8, td3=50, ddpg=55, ppo=150, random=200),
        "paper": standings(directl=10, ga=12, sac=100, td3=90, ddpg=400, ppo=5, random=20)["goal"],
    }
    assert verdicts(fig6.claims(both)) == ["reproduced only with observation goal"] * 6


@pytest.mark.parametrize(("sac", "expected"), [(40.0, [True, True]), (15.0, [True, False]), (5.0, [False, False])])
def test_rewards_decide_the_claims_of_fig7(sac, expected):
    rewards = {"sac": np.full(3, sac), "td3": np.full(3, 10.0), "ddpg": np.full(3, 9.0), "ppo": np.full(3, -2.0)}
    claims = fig7.claims({"paper": rewards})
    assert [claim.verdict == report.REPRODUCED for claim in claims] == expected


def test_table4s_own_numbers_are_reproduced():
    constant = TrackingErrors(TABLE4_CONSTANT, TABLE4_CONSTANT, 0)
    adaptive, worse = TrackingErrors(TABLE4_OIAC, TABLE4_OIAC, 0), TrackingErrors(2 * TABLE4_CONSTANT, TABLE4_OIAC, 0)
    good = table4.claims({"constant": constant, "OIAC printed": adaptive, "OIAC table4": adaptive})
    assert verdicts(good) == [report.REPRODUCED] * 5
    assert "22.36 %" in good[1].paper
    partly = table4.claims({"constant": constant, "OIAC printed": worse, "OIAC table4": adaptive})
    assert all(v.startswith("reproduced only with OIAC printed, mean errors or") for v in verdicts(partly))


def test_table4s_numbers_are_missed_to_either_side():
    """A ratio a fifth above or below the paper's is reproduced; one a third above or below is not."""
    constant = TrackingErrors(TABLE4_CONSTANT, TABLE4_CONSTANT, 0)
    for factor, held in ((1.2, True), (1 / 1.2, True), (1.3, False), (1 / 1.3, False)):
        adaptive = TrackingErrors(factor * TABLE4_OIAC, factor * TABLE4_OIAC, 0)
        better, *ratios = table4.claims({"constant": constant, "OIAC printed": adaptive, "OIAC table4": adaptive})
        assert better.verdict == report.REPRODUCED
        assert verdicts(ratios) == [report.REPRODUCED if held else report.NOT_REPRODUCED] * 4


def test_the_page_is_whole_and_escapes_what_it_shows():
    figure = Figure()
    figure.subplots().plot([0, 1])
    claim = Claim("a < b", "1 %", "2 %", report.NOT_REPRODUCED, "2 > 1")
    parts = [Text("<b>"), Table([["a", "b"], ["x", "&"]], "c"), Picture(figure, "line"), Claims([claim])]
    page = to_html("title", "sub", {"code": "1"}, [Section("one", parts)])
    assert page == to_html("title", "sub", {"code": "1"}, [Section("one", parts)])
    assert "&lt;b&gt;" in page
    assert "a &lt; b" in page
    assert "1 claims: 1 not reproduced." in page
    assert not re.search(r"""(src|href)=["'](?!data:|#)""", page)


def test_quick_form_of_everything(tmp_path):
    """Smaller still than by itself, and also resumed: nothing is worked out again, and the report is the same."""
    smaller = ["--targets", "6", "--cap", "20", "--episodes", "4", "--random-episodes", "2", "--trials", "16"]
    words = [sys.executable, "-m", "whiptool.reproduce"]

    def run(*more: str) -> subprocess.CompletedProcess:
        return subprocess.run([*words, *more], cwd=tmp_path, capture_output=True, text=True, timeout=HANG, check=False)

    done = run("all", "--quick", *smaller, "--out", "run", "--json")
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    page = (tmp_path / "run" / "report.html").read_text()
    assert len(result["claims"]) == page.count("<b class=") >= 13
    assert page.count("<h2>") >= len(PARTS)
    assert page.count("<img") >= len(PARTS)
    assert not re.search(r"""(src|href)=["'](?!data:|#)""", page)
    shown = ("Fig. 5", "Fig. 6", "Fig. 7", "Table 4", "22.36 %", "training trials", "random", "hard task")
    for said in (*shown, "One and the same strike", "a disc of radius 0.3 m", "wherever the tip can pass"):
        assert said in page
    again = run("--resume", "run", "--json")
    assert again.returncode == 0, again.stderr
    assert json.loads(again.stdout)["claims"] == result["claims"]
    assert (tmp_path / "run" / "report.html").read_text() == page


def test_unknown_zone_gets_one_line(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert reproduce.main(["fig6", "--further-zones", "0.3", "slow"]) == 2
    assert capsys.readouterr().err.startswith("whiptool: --further-zones: got 'slow'; allowed: radii > 0 in m, or fast")


def test_unknown_part_gets_one_line(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert reproduce.main(["fig99"]) == 2
    error = capsys.readouterr().err
    assert error.startswith("whiptool: what to reproduce: got 'fig99'")
    assert all(name in error for name in PARTS)
    assert error.count("\n") == 1
    assert not list(tmp_path.iterdir())
