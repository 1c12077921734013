"""A target that asks for a direction or a speed is shown as hit only where these came, too, by every display."""

from __future__ import annotations

import json
import warnings
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from space_swing import swing
from spatial_arms import of_universal_nodes

from whiptool.goals.target import Target
from whiptool.objective import Outcome, Trial
from whiptool.viz.animation import animate
from whiptool.viz.film import film_of
from whiptool.viz.page import strike_data, strike_page
from whiptool.viz.plots_search import plot_convergence, save_convergence
from whiptool.viz.style import COLORS

UR5E = of_universal_nodes("ur5e")
PATH = swing(UR5E)
PLACE = Target(tuple(PATH.tip[200]), 0.05)  # the tip passes through it
VELOCITY = PATH.tip_velocity[200]
SPEED = float(np.linalg.norm(VELOCITY))
ALONG = replace(PLACE, direction=tuple(VELOCITY))
ASKED = {
    "a point": (PLACE, True),
    "its direction": (ALONG, True),
    "the opposite direction": (replace(PLACE, direction=tuple(-VELOCITY)), False),
    "its speed": (replace(PLACE, speed=0.99 * SPEED), True),
    "more speed": (replace(PLACE, speed=1.01 * SPEED), False),
}
every_goal = pytest.mark.parametrize(("target", "hit"), ASKED.values(), ids=ASKED)


@every_goal
def test_the_page_says_whether_the_strike_hits(target: Target, hit: bool):
    page, data = strike_page(UR5E, PATH, target), strike_data(UR5E, PATH, target)
    assert ("Hits the target" in page, "Misses the" in page) == (hit, not hit)
    assert data["hit_time"] == (pytest.approx(PATH.t[200], abs=1e-6) if hit else None)
    json.dumps(data, allow_nan=False)


def test_the_page_says_how_the_tip_arrived():
    assert "0.0 degrees from the direction asked for (at most 10)" in strike_page(UR5E, PATH, ALONG)
    page = strike_page(UR5E, PATH, ASKED["the opposite direction"][0])
    assert "180.0 degrees from the direction asked for (at most 10)" in page
    assert "Misses the direction by 170 degrees: the target" in page
    page = strike_page(UR5E, PATH, ASKED["more speed"][0])
    assert f"{SPEED:.1f} m/s fast (at least" in page
    assert f"Misses the speed by {0.01 * SPEED:.3g} m/s: the target" in page


def test_a_strike_beyond_its_limits_is_shown_as_no_hit():
    why = "at 0.000 s the elbow asks for 9 N m"
    page = strike_page(UR5E, PATH, PLACE, label="by hand", beyond=why)
    assert "Hits" not in page
    assert f"Beyond its limits, and so no hit: {why}; target at (" in page
    assert '"hit_time": null' in page.replace('"hit_time":null', '"hit_time": null')
    assert not film_of(PATH, UR5E, PLACE, fps=20, speed=0.5, beyond=True).hit.any()


@every_goal
def test_the_target_of_a_film_lights_up(target: Target, hit: bool):
    film = film_of(PATH, UR5E, target, fps=20, speed=0.5)
    assert film.hit.any() == hit
    assert film.readings["target"] == ["hit" if struck else "not hit" for struck in film.hit]


@every_goal
def test_the_target_of_an_animation_lights_up(target: Target, hit: bool):
    shown = animate(PATH, UR5E, target, speed=1.0, dpi=40)
    shown._draw_was_started = True  # or matplotlib warns of an animation that was never drawn
    shown.show(shown.count - 1)
    color = to_rgba(shown.moving[0].get_edgecolor()[0][:3])
    assert color == to_rgba(COLORS["green" if hit else "orange"])
    assert shown.moving[1].get_marker() == ("o" if hit else "+")  # a ring once it is hit
    assert shown.moving[-1].get_text().endswith(", hit") == hit
    shown.show(0)
    assert shown.moving[1].get_marker() == "+"


def trial(number: int, miss: float, *, hit: bool = False, diverged: bool = False, refused: str | None = None) -> Trial:
    nothing = (0.0, 0.0)
    outcome = Outcome(miss, hit, 0.5, nothing, nothing, nothing, nothing, diverged, refused=refused)
    return Trial(number, (0.0,) * 5, outcome)


def test_the_convergence_counts_hits_as_they_are_judged():
    """Trial 2 passes the point the wrong way, trial 4 as asked."""
    trials = [trial(1, 0.4), trial(2, 0.01), trial(3, 0.2), trial(4, 0.05, hit=True)]
    ax = plot_convergence(Figure().subplots(), trials, Target((1.3, 0.0), 0.06, direction=(0, 1)))
    assert ax.get_title() == "first hit in trial 4, nearest 0.010 m"
    (hits,) = (line for line in ax.lines if line.get_label() == "hit")
    assert np.array_equal(hits.get_xydata(), [[4, 0.05]])
    (all_trials,) = (line for line in ax.lines if line.get_label() == "trial")
    assert hits.get_marker() != all_trials.get_marker()  # seen by those who do not see the colour
    ax = plot_convergence(Figure().subplots(), trials[:2], Target((1.3, 0.0), 0.06, direction=(0, 1)))
    assert ax.get_title() == "no hit in 2 trials, nearest 0.010 m"


def test_the_convergence_says_why_trials_have_no_result():
    lost = [
        (3, {"diverged": True}),
        (2, {"refused": "joint"}),
        (4, {"refused": "clearance"}),
        (1, {"refused": "posture"}),
    ]
    kinds = [kind for count, kind in lost for _ in range(count)]
    trials = [trial(1, 0.4), *(trial(i, 9.0, **kind) for i, kind in enumerate(kinds, start=2))]
    ax = plot_convergence(Figure().subplots(), trials, (1.3, 0.0))
    assert ax.get_ylabel() == "miss distance [m]"
    said = [text.get_text().replace("\n", " ") for text in ax.get_legend().get_texts()]
    assert "refused: 2 beyond the joints' limits, 4 would collide, 1 beyond the arm's reach" in said
    assert "no result: 3 diverged" in said
    marks = {line.get_label().partition(":")[0]: line for line in ax.lines}
    assert list(marks["refused"].get_xdata()) == [5, 6, 7, 8, 9, 10, 11]
    assert list(marks["no result"].get_xdata()) == [2, 3, 4]
    assert marks["refused"].get_marker() != marks["no result"].get_marker()


def test_a_search_whose_strikes_were_all_refused_for_many_reasons_is_drawn(tmp_path):
    """The list of reasons was wider than the figure, and left no room for the axes."""
    reasons = ("motor", "joint", "clearance", "unreachable")
    trials = [trial(i + 1, np.nan, refused=reasons[i % len(reasons)]) for i in range(300)]
    with warnings.catch_warnings(action="error"):
        save_convergence(tmp_path, trials, PLACE, label="lemon2024, OIAC table4, directl")
