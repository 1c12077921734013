"""Joints that slide have their own units in plots and on a strike's page."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from approaches import approaches
from matplotlib.figure import Figure
from random_space import random_arm, random_whip
from space_swing import swing

from whiptool.goals.target import Target
from whiptool.models import Model
from whiptool.models.strike import sliding_names, strike_names
from whiptool.objective import Outcome, Trial
from whiptool.viz import plots
from whiptool.viz.page import strike_data
from whiptool.viz.plots_search import axis_label, plot_landscape, plot_trials

RNG = np.random.default_rng(3)
MODEL = Model(random_whip(RNG, 2), random_arm(RNG, 3, prismatic=1))
SWING = swing(MODEL)


def test_gains_of_slides_are_told_in_newtons_and_metres():
    rising = replace(SWING, K=SWING.K * (1 + SWING.t[:, None, None]))
    axes = plots.plot_gains(rising, MODEL, axes=Figure().subplots(2))
    assert [ax.get_ylabel() for ax in axes] == ["stiffness K [N m/rad, N/m]", "damping B [N m s/rad, N s/m]"]
    axes = plots.plot_gains(rising, axes=Figure().subplots(2))
    assert [ax.get_ylabel() for ax in axes] == ["stiffness K [N m/rad]", "damping B [N m s/rad]"]


def test_errors_of_slides_are_in_millimetres():
    axes = plots.plot_tracking(SWING, MODEL, axes=Figure().subplots(2))
    assert [ax.get_ylabel() for ax in axes] == ["position error [deg, mm]", "velocity error [deg/s, mm/s]"]
    said = [text.get_text().rpartition(" ")[2] for ax in axes for text in ax.get_legend().get_texts()]
    assert said == ["deg", "mm", "deg", "deg/s", "mm/s", "deg/s"]


def test_a_page_knows_what_slides():
    data = strike_data(MODEL, SWING, Target((0.0, 0.0, 0.5), 0.1))
    assert data["slides"] == [False, True, False]
    assert data["units"] == {"q": "deg, mm", "tau": "N m, N", "K": "N m/rad, N/m", "B": "N m s/rad, N s/m"}


def test_numbers_of_a_strike_have_the_units_of_their_joints():
    names, slides = strike_names(MODEL.arm), sliding_names(MODEL.arm)
    assert slides == (names[1], names[4])
    ends = [axis_label(name, slides).rpartition(" ")[2] for name in names]
    assert ends == ["[rad]", "[m]", "[rad]", "[rad]", "[m]", "[rad]", "[s]"]
    assert (axis_label("x_f"), axis_label("turn_x_f")[-5:]) == ("$x_{f}$ [m]", "[rad]")
    landscape = plot_landscape(
        Figure().subplots(),
        *np.ones((2, 2)).cumsum(0),
        approaches(np.eye(2)),
        Target(),
        names=names[3:5],
        slides=slides,
    )
    pair = (0.0, 0.0)
    trial = Trial(1, (0.0,) * len(names), Outcome(0.5, False, 0.3, pair, pair, pair, pair, False))
    trials = plot_trials(Figure().subplots(), [trial], (3, 4), names=names[3:5], slides=slides)
    for ax in (landscape, trials):
        assert [ax.get_xlabel()[-5:], ax.get_ylabel()[-3:]] == ["[rad]", "[m]"]
