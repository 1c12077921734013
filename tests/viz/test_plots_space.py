"""Pictures, page and film of a strike in space: what they show is where the chain is."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from matplotlib.figure import Figure

from whiptool.impedance import Controller, constant_preset
from whiptool.models import Strike, preset
from whiptool.models.kinematics import arm_frames
from whiptool.rollout import CompiledRollout
from whiptool.rollout.trajectory import joint_points
from whiptool.viz.page import strike_page
from whiptool.viz.plots import plot_strike, save_strike_figures, strike_drawing
from whiptool.viz.plots_space import plot_strike_views
from whiptool.viz.video import render_video

MODEL, TARGET = preset("nah2023"), np.array([1.995, 0.0, 0.0])
STRIKE = Strike((-1.36, 0.0, -1.05, 1.41), (1.73, 0.0, -0.35, 1.41), 0.95)  # hits


@pytest.fixture(scope="module")
def trajectory():
    rollout = CompiledRollout(MODEL, Controller(constant_preset("nah2023")), timestep=5e-4)
    return rollout.trajectory(STRIKE, t_stay=0.3)


def test_every_view_shows_the_closest_approach(trajectory):
    drawing = strike_drawing(trajectory, MODEL, TARGET)
    near = trajectory.approach(TARGET)
    np.testing.assert_allclose(drawing.near[-1], near.tip[0], atol=2e-3)
    assert drawing.arm.shape[1:] == (5, 3)
    assert drawing.whip.shape[1:] == (26, 3)
    figure = Figure((11, 9.6), layout="constrained")
    plot_strike_views(figure, trajectory, MODEL, TARGET)
    side, front, top, perspective, _ = figure.axes
    for ax, pair in ((side, [0, 2]), (front, [1, 2]), (top, [0, 1])):
        whip = next(line for line in ax.lines if str(line.get_label()).startswith("closest approach"))
        np.testing.assert_allclose(whip.get_xydata(), drawing.near_whip[:, pair])
        assert "[m]" in ax.get_xlabel()
    assert perspective.name == "3d"
    assert plot_strike(trajectory, MODEL, TARGET, ax=Figure().subplots(), view="top").get_ylabel() == "y, left [m]"


def test_figures_are_written(trajectory, tmp_path):
    files = save_strike_figures(tmp_path, trajectory, MODEL, TARGET, 0.06, "constant")
    assert {file.name for file in files} == {"strike.png", "distance.png", "tracking.png", "gains.png"}


def test_the_page_holds_points_and_desired_arm(trajectory):
    page = strike_page(MODEL, trajectory, TARGET, 0.06)
    data = json.loads(re.search(r"id=strike>(.*?)</script>", page, re.S).group(1))  # type: ignore[union-attr]
    t = np.array(data["t"])
    q = np.stack([np.interp(t, trajectory.t, x) for x in trajectory.q.T], axis=1)
    points = np.array(data["points"], float).T.reshape(len(t), -1, 3)
    np.testing.assert_allclose(points, joint_points(MODEL, q), atol=2e-3)  # the page's are between instants
    q_d = np.stack([np.interp(t, trajectory.t, x) for x in trajectory.q_d.T], axis=1)
    desired = np.stack([frame.origin for frame in arm_frames(MODEL.arm, q_d)], axis=1)  # type: ignore[arg-type]
    np.testing.assert_allclose(np.array(data["desired"]).T.reshape(len(t), -1, 3), desired, atol=1e-4)
    assert len(data["q"]) == len(data["K"]) == len(data["tau"]) == 4
    assert len(data["tip"]) == len(data["target"]) == 3
    assert min(data["distance"]) == pytest.approx(trajectory.approach(TARGET).distance[0], abs=1e-4)
    assert "<select id=view>" in page


@pytest.mark.slow
@pytest.mark.parametrize("gl", ["egl", "disabled"])
def test_films_are_written(trajectory, tmp_path, monkeypatch, gl):
    monkeypatch.setenv("MUJOCO_GL", gl)
    used = render_video(tmp_path / "strike.mp4", trajectory, MODEL, TARGET, 0.06, fps=5, size=(320, 180), speed=1.0)
    assert used in ("mujoco", "matplotlib")
    assert (tmp_path / "strike.mp4").stat().st_size > 1000
