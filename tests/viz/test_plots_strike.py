"""Figures of a strike in space: what is drawn is where MuJoCo has the bodies, in every view."""

from __future__ import annotations

import io
from dataclasses import fields

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import proj3d
from mpl_toolkits.mplot3d.art3d import Line3DCollection
from space_swing import places, swing
from spatial_arms import of_universal_nodes

from whiptool.errors import InputError
from whiptool.models import preset
from whiptool.models.trajectory import Trajectory
from whiptool.viz import plots, plots_strike
from whiptool.viz.report import Picture

NAH = preset("nah2023")


@pytest.fixture(
    scope="module", params=["nah2023", *(pytest.param(x, marks=pytest.mark.slow) for x in ("ur5e", "panda"))]
)
def model(request):
    return NAH if request.param == "nah2023" else of_universal_nodes(request.param)


def struck(model) -> tuple[Trajectory, plots.Target]:
    """A swing, and a target that its tip passes at 0.4 s, 2 cm away."""
    path = swing(model)
    at = int(np.searchsorted(path.t, 0.4))
    away = np.cross(path.tip_velocity[at], [0.3, 0.5, 0.8])
    return path, plots.Target(tuple(path.tip[at] + 0.02 * away / np.linalg.norm(away)), 0.05)


def nearest_posture(path, model, target):
    when = path.approach(target).time[0]
    return places(model, np.array([np.interp(when, path.t, x) for x in path.q.T]))


def lines_of(ax) -> dict[str, np.ndarray]:
    """What is drawn under a label, (points, 2 or 3)."""
    get = "get_data_3d" if hasattr(ax, "zaxis") else "get_data"
    return {line.get_label().split(" at ")[0]: np.transpose(getattr(line, get)()) for line in ax.lines}


def test_four_views_show_the_posture_at_the_closest_approach(model):
    path, target = struck(model)
    ax = plots_strike.plot_strike(path, model, target)
    arm, whip = nearest_posture(path, model, target)
    columns = {"side": [0, 2], "top": [0, 1], "front": [1, 2]}
    views = {view.texts[0].get_text(): view for view in ax.figure.axes[:3]}
    assert set(views) == set(columns)
    for name, view in views.items():
        drawn = lines_of(view)
        np.testing.assert_allclose(drawn["arm, then"], arm[:, columns[name]], atol=1e-9)
        np.testing.assert_allclose(drawn["whip"], whip[:, columns[name]], atol=1e-9)
        np.testing.assert_allclose(drawn["tip"], whip[-1:, columns[name]], atol=1e-9)
        circle = view.patches[-1]
        np.testing.assert_allclose(circle.center, np.array(target.position)[columns[name]])
        assert circle.radius == target.hit_radius
        assert view.get_aspect() == 1
    drawn = lines_of(ax)
    np.testing.assert_allclose(drawn["arm, then"], arm, atol=1e-9)
    np.testing.assert_allclose(drawn["whip"], whip, atol=1e-9)
    plt.close(ax.figure)


def test_all_views_have_labels_and_the_legend_names_the_dotted_path(model):
    path, target = struck(model)
    ax = plots_strike.plot_strike(path, model, target)
    ax.figure.draw_without_rendering()
    for view, seen in zip(ax.figure.axes[:3], ("xz", "xy", "yz"), strict=True):
        assert (view.get_xlabel()[0], view.get_ylabel()[0]) == tuple(seen)
        for axis in (view.xaxis, view.yaxis):
            assert any(label.get_visible() and label.get_text() for label in axis.get_ticklabels())
    legend = ax.figure.axes[0].get_legend()
    assert "path of the tip afterwards" in [text.get_text() for text in legend.get_texts()]
    dotted = next(line for line in ax.figure.axes[0].lines if line.get_label() == "path of the tip afterwards")
    after = next(line for line in ax.figure.axes[0].lines if len(line.get_xdata()) > 20 and line.is_dashed())
    assert dotted.get_color() == after.get_color()
    assert legend.get_window_extent().x1 <= ax.figure.axes[2].get_window_extent().x1
    plt.close(ax.figure)


def pixels(ax, point) -> np.ndarray:
    """Where a point in space is in the picture; pinhole camera, written out."""
    low, high = np.array([ax.get_xlim(), ax.get_ylim(), ax.get_zlim()]).T
    azimuth, elevation = np.deg2rad([ax.azim, ax.elev])
    back = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0])
    from_centre = np.asarray(point) - (low + high) / 2
    return np.array([from_centre @ right, from_centre @ np.cross(back, right)]), from_centre @ back


def test_the_perspective_has_one_scale_and_nearer_is_larger():
    path, target = struck(NAH)
    ax = plots_strike.plot_strike(path, NAH, target, ax=Figure().add_subplot(projection="3d"))
    shown = np.array([proj3d.proj_transform(*p, ax.get_proj())[:2] for p in path.tip[::30]])
    flat = [pixels(ax, p) for p in path.tip[::30]]
    # x' = f x / (d - depth): two unknowns, the same for all points and both directions
    rows = [[x, shown[k, i] * depth] for k, (xy, depth) in enumerate(flat) for i, x in enumerate(xy)]
    rights = shown.ravel()
    (f, per_distance), residual, *_ = np.linalg.lstsq(np.array(rows), rights, rcond=None)
    assert np.sqrt(residual[0]) < 1e-9
    assert f > 0
    assert per_distance > 0


def test_the_path_is_coloured_by_the_speed_up_to_the_closest_approach(model):
    path, target = struck(model)
    ax = plots_strike.plot_strike(path, model, target, ax=Figure().subplots())
    (drawn,) = [c for c in ax.collections if isinstance(c, LineCollection)]
    near = path.approach(target)
    ends = np.array(drawn.get_segments())
    np.testing.assert_allclose(ends[0, 0], path.tip[0, [0, 2]])
    np.testing.assert_allclose(ends[-1, 1], near.tip[0, [0, 2]], atol=1e-6)
    middles = ends.mean(axis=1)
    k = [int(np.abs(path.tip[:, [0, 2]] - m).sum(axis=1).argmin()) for m in middles]
    speed = np.linalg.norm(path.tip_velocity[k], axis=1)
    np.testing.assert_allclose(drawn.get_array(), speed, rtol=0.06, atol=0.05)
    assert drawn.norm.vmin == 0
    bar = ax.child_axes[0]
    assert bar.get_ylabel() == "speed of the tip [m/s]"
    assert [ax.get_xlabel(), ax.get_ylabel()] == ["x, forward [m]", "z, up [m]"]
    three = plots_strike.plot_strike(path, model, target, ax=Figure().add_subplot(projection="3d"))
    (drawn,) = [c for c in three.collections if isinstance(c, Line3DCollection) and c.get_array() is not None]
    assert three.get_zlabel() == "z, up [m]"


def test_a_figure_of_views_has_no_blank_third(model):
    path, target = struck(model)
    ax = plots_strike.plot_strike(path, model, target)
    ax.figure.savefig(data := io.BytesIO(), dpi=50, bbox_inches=None)
    image = plt.imread(io.BytesIO(data.getvalue()))[..., :3]
    inked = (image < 0.9).any(axis=2)
    for rows in np.array_split(inked, 3):
        for part in np.array_split(rows, 3, axis=1):
            assert part.mean() > 0.005
    plt.close(ax.figure)


def test_a_planar_target_is_refused_in_space_and_the_other_way_round():
    path, _ = struck(NAH)
    with pytest.raises(InputError, match="three coordinates x y z"):
        plots_strike.plot_strike(path, NAH, (1.3, 0.0))
    with pytest.raises(InputError, match="two coordinates x y"):
        plots_strike.plot_strike(path, preset("lemon2024"), (1.3, 0.0, 0.2))
    with pytest.raises(InputError, match="in space"):
        plots.plot_distance(path, (1.3, 0.0))


@pytest.mark.slow
def test_all_figures_of_a_run_and_a_reports_picture(model, tmp_path):
    path, target = struck(model)
    files = plots.save_strike_figures(tmp_path, path, model, target, "by hand")
    names = ("strike", "distance", "speed", "tracking", "torque", "gains")
    assert {file.name for file in files} == {f"{x}.png" for x in names}
    figure = Figure()
    plots_strike.draw_strike(figure, path, model, target)
    assert Picture(figure, "strike").source.startswith("data:image/svg+xml")


def test_a_strike_that_diverged_is_drawn():
    path, target = struck(NAH)
    cut = {f.name: getattr(path, f.name)[:40] for f in fields(path) if f.name != "diverged"}
    ax = plots_strike.plot_strike(Trajectory(**cut, diverged=True), NAH, target)
    assert ax.figure.axes[0].get_title(loc="left").startswith("diverged at 0.0780 s")
    plt.close(ax.figure)
