"""Videos: on machines without OpenGL, and in space, where they show all that moves, and the animation where it is."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest
from matplotlib.transforms import Bbox
from processes import HANG
from projection import projected
from space_swing import places, swing
from spatial_arms import of_universal_nodes

from whiptool.errors import InputError
from whiptool.goals.target import Target
from whiptool.models import preset
from whiptool.models.kinematics import joint_points
from whiptool.rollout.mujoco_model import build_spec
from whiptool.viz import video
from whiptool.viz.animation import animate
from whiptool.viz.film import film_of, film_place


@pytest.mark.slow
@pytest.mark.parametrize("gl", ["disabled", "nonsense"])
def test_without_opengl_matplotlib_draws_the_video(tmp_path, gl):
    command = [
        sys.executable,
        "-m",
        "whiptool.simulate",
        "--strike",
        "-1.2",
        "0.9",
        "1.2",
        "0.3",
        "0.4",
        "--t-stay",
        "0",
    ]
    done = subprocess.run(
        [*command, "--out", "run"],
        cwd=tmp_path,
        env={**os.environ, "MUJOCO_GL": gl},
        capture_output=True,
        text=True,
        timeout=HANG,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "run" / "strike.mp4").read_bytes()[4:8] == b"ftyp"
    assert "matplotlib" in done.stderr


UR5E = of_universal_nodes("ur5e")
PATH = swing(UR5E)
TARGET = Target(tuple(PATH.tip[200] + 0.01), 0.08)
SIZE = (480, 270)


@pytest.fixture(scope="module")
def film():
    return film_of(PATH, UR5E, TARGET, fps=5, speed=0.5, size=SIZE)


def test_everything_is_in_the_picture(film):
    mj = build_spec(UR5E).compile()
    i = mj.cam("view").id
    seen_from = film_place(mj, film, TARGET), mj.cam_mat0[i].reshape(3, 3).T, mj.cam_fovy[i]
    x, y, _ = np.moveaxis(projected(joint_points(UR5E, film.q), *seen_from), -1, 0)
    assert np.abs(x).max() < SIZE[0] / SIZE[1]
    assert np.abs(y).max() < 1
    assert max(np.abs(x).max() / SIZE[0] * SIZE[1], np.abs(y).max()) > 0.4  # and not small


def test_the_animation_moves_arm_whip_and_trail():
    shown = animate(PATH, UR5E, TARGET, speed=1.0, dpi=40)
    shown._draw_was_started = True
    frame = 5
    shown.show(frame)
    _, _, trail, whip, arm, tip, _ = shown.moving
    time = frame / 25
    expected = places(UR5E, np.array([np.interp(time, PATH.t, x) for x in PATH.q.T]))
    for line, points in zip((arm, whip, tip), (*expected, expected[1][-1:]), strict=True):
        np.testing.assert_allclose(np.transpose(line.get_data_3d()), points, atol=1e-9)
    np.testing.assert_allclose(np.transpose(trail.get_data_3d())[-1], expected[1][-1], atol=1e-4)
    assert len(trail.get_data_3d()[0]) > 50


@pytest.mark.parametrize("name", ["ur5e", "nah2023"])
def test_the_labels_of_an_animation_in_space_are_within_its_frame(name):
    """Both a wide strike and a tall one."""
    model = of_universal_nodes(name) if name == "ur5e" else preset(name)
    shown = animate(swing(model), model, TARGET, speed=1.0, dpi=60)
    shown._draw_was_started, figure = True, shown.figure
    (ax,) = figure.axes
    figure.draw_without_rendering()
    drawn = Bbox.union([axis.get_tightbbox() for axis in (ax.xaxis, ax.yaxis, ax.zaxis)])
    assert drawn.x0 > 0
    assert drawn.y0 > 0
    assert drawn.x1 < figure.bbox.width
    assert drawn.y1 < 0.95 * figure.bbox.height  # below the title
    assert max(drawn.width / figure.bbox.width, drawn.height / figure.bbox.height) > 0.8


def test_targets_of_the_plane_are_refused(tmp_path):
    for show in (
        lambda: video.render_video(tmp_path / "x.mp4", PATH, UR5E, (1.3, 0.0)),
        lambda: animate(PATH, UR5E, (1.3, 0.0)),
        lambda: film_of(PATH, UR5E, Target((1.3, 0.0)), fps=5, speed=1),
    ):
        with pytest.raises(InputError, match="three coordinates x y z"):
            show()
    assert not list(tmp_path.iterdir())
