"""The film of a strike: as long as it says, small enough for a notebook, its target green once hit."""

from __future__ import annotations

import base64
import re
from typing import Any

import imageio_ffmpeg
import matplotlib
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from whiptool.errors import InputError
from whiptool.goals.target import Target
from whiptool.impedance import ConstantImpedance, Controller
from whiptool.models import preset
from whiptool.models.strike import Strike
from whiptool.rollout import CompiledRollout
from whiptool.viz.animation import FPS, StrikeAnimation, animate
from whiptool.viz.style import STYLE

LEMON = preset("lemon2024")
STRIKE = Strike.from_vector([-1.36, 0.47, 1.73, 1.41, 0.95])


@pytest.fixture(scope="module")
def trajectory():
    return CompiledRollout(LEMON, Controller(), timestep=1e-3).trajectory(STRIKE, t_stay=0.0)


def film(html, folder):
    """Frames of the embedded film, (F, height, width, 3) of uint8, and its size [bytes]."""
    data = base64.b64decode(re.search(r'data:video/mp4;base64,([^"]+)"', html).group(1))
    file = folder / "film.mp4"
    file.write_bytes(data)
    frames = imageio_ffmpeg.read_frames(str(file))
    width, height = next(frames)["size"]
    return np.array([np.frombuffer(f, np.uint8).reshape(height, width, 3) for f in frames]), len(data)


def looks_green(frames):
    """Whether the target is green, of the pixels that are more green than red, or more red than blue, by far."""
    r, g, b = np.moveaxis(frames.astype(int), -1, 0)
    green = ((g > r + 60) & (g > b + 10)).sum(axis=(1, 2))
    orange = ((r > b + 60) & (g > b + 40)).sum(axis=(1, 2))
    return green > orange


def test_a_film_in_slow_motion_whose_target_turns_green(trajectory, tmp_path):
    target, radius = np.array([1.3, 0.0]), 0.1
    near = trajectory.approach(target)
    assert near.distance[0] < radius
    with matplotlib.rc_context(STYLE):  # whose figures are saved finer
        shown = animate(trajectory, LEMON, Target(tuple(target), radius), speed=0.5, dpi=60)._repr_html_()
    frames, size = film(shown, tmp_path)
    assert size < 1e6
    assert frames.shape[2] == pytest.approx(5.6 * 60, abs=1)
    assert len(frames) == pytest.approx(0.95 / 0.5 * FPS, abs=1.5)
    green = looks_green(frames)
    first = np.flatnonzero(green)[0]
    assert green[first:].all()
    assert first * 0.5 / FPS == pytest.approx(near.time[0], abs=0.5 / FPS)


def test_a_target_that_is_missed_stays_as_it_was(trajectory, tmp_path):
    frames, _ = film(animate(trajectory, LEMON, Target((1.3, -1.3), 0.1), speed=2.0, dpi=60).to_html(), tmp_path)
    assert not looks_green(frames).any()


def test_a_diverged_strike_is_shown_too():
    wild = Controller(ConstantImpedance(K=((1e7, 0), (0, 1e7)), B=((0, 0), (0, 0))))
    path = CompiledRollout(LEMON, wild, timestep=2.5e-4).trajectory(STRIKE, t_stay=0.3)
    assert path.diverged
    assert "<video" in animate(path, LEMON, (1.3, 0.0), dpi=40).to_html()


def test_bad_input_is_refused(trajectory):
    for wrong in ({"speed": 0.0}, {"width": float("nan")}, {"dpi": -1.0}):
        with pytest.raises(InputError, match=next(iter(wrong))):
            animate(trajectory, LEMON, (1.3, 0.0), **wrong)


ENDS = np.array([[0.1, 0.2, 0.3], [0.9, 0.5, 0.1], [0.4, 0.8, 0.9]])


def line_and_words(flat: bool) -> tuple[Figure, Any, Any]:
    """A figure with a grid, a line from the origin, and words above it."""
    figure = Figure((3, 2), dpi=60)
    ax: Any = figure.add_subplot(projection=None if flat else "3d")
    ax.grid(True)
    ax.set(xlim=(0, 1), ylim=(0, 1), **({} if flat else {"zlim": (0, 1)}))
    (line,) = ax.plot(*([[]] * (2 if flat else 3)), "o-", linewidth=3)
    return figure, line, ax.set_title(" ")


def put(line: Any, words: Any, i: int, flat: bool) -> None:
    places = np.stack([np.zeros(3), ENDS[i]])[:, : 2 if flat else 3]
    (line.set_data if flat else line.set_data_3d)(*places.T)
    words.set_text(f"at {i}")


@pytest.mark.parametrize("flat", [True, False])
def test_frames_are_what_a_whole_drawing_shows(flat):
    figure, line, words = line_and_words(flat)
    frames = list(StrikeAnimation(figure, [line, words], len(ENDS), lambda i: put(line, words, i, flat), 25).frames())
    assert len(frames) == len(ENDS)
    for i, frame in enumerate(frames):
        whole, line, words = line_and_words(flat)
        put(line, words, i, flat)
        canvas = FigureCanvasAgg(whole)
        canvas.draw()
        expected = np.asarray(canvas.buffer_rgba())[..., :3]
        assert frame.shape == expected.shape == (120, 180, 3)
        assert (expected != 255).any()
        differing = (np.abs(frame.astype(int) - expected) > 8).any(axis=-1)
        assert differing.mean() < 1e-3
    assert (frames[0] != frames[1]).any()
