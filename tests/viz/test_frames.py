"""Frames of which only what moves is drawn anew: as if each were drawn whole, in the plane and in perspective."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from whiptool.viz.frames import drawn_frames

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
    frames = list(drawn_frames(figure, [line, words], len(ENDS), lambda i: put(line, words, i, flat)))
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
