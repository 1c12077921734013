"""The look of figures: colours that can be told apart, legends beside data, whole files, lengths in words."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import matplotlib.colors
import numpy as np
import pytest
from matplotlib.figure import Figure

from whiptool.viz.style import (
    COLORS,
    CYCLE,
    JOINT_COLORS,
    SPEED,
    STYLE,
    TIME,
    head,
    legend_above,
    length_text,
    save_figure,
    ticks,
    verbatim,
)


def luminance(rgb: np.ndarray) -> np.ndarray:
    """Relative luminance of sRGB colours (..., 3), as the W3C defines it."""
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    return linear @ [0.2126, 0.7152, 0.0722]


def contrast_with_white(rgb: np.ndarray) -> np.ndarray:
    return 1.05 / (luminance(rgb) + 0.05)


def test_lines_differ_and_are_seen_on_white():
    for colors in (CYCLE, JOINT_COLORS):
        rgb = np.array([matplotlib.colors.to_rgb(x) for x in colors])
        assert min(np.linalg.norm(a - b) for a, b in combinations(rgb, 2)) > 0.2
        assert contrast_with_white(rgb).min() > 2
    assert contrast_with_white(np.array(matplotlib.colors.to_rgb(COLORS["yellow"]))) < 2  # why it draws no lines
    assert COLORS["yellow"] not in CYCLE
    assert COLORS["black"] not in JOINT_COLORS  # that is what is desired


def test_the_palette_is_okabes_and_itos():
    """By their numbers, 0 to 255."""
    theirs = {
        "orange": (230, 159, 0), "sky": (86, 180, 233), "green": (0, 158, 115), "yellow": (240, 228, 66),
        "blue": (0, 114, 178), "vermilion": (213, 94, 0), "pink": (204, 121, 167),
    }  # fmt: skip
    for name, rgb in theirs.items():
        assert matplotlib.colors.to_rgb(COLORS[name]) == pytest.approx(np.array(rgb) / 255)


def test_scales_of_colour_only_brighten_or_darken():
    """So that they keep their order in grey; late is bright, fast is dark, and both are seen on white."""
    steps = np.linspace(0, 1, 50)
    time, speed = (luminance(scale(steps)[:, :3]) for scale in (TIME, SPEED))
    assert (np.diff(time) > 0).all()
    assert (np.diff(speed) < 0).all()
    assert contrast_with_white(TIME(steps)[:, :3]).min() > 1.5


def test_matplotlib_knows_the_style():
    with matplotlib.rc_context(STYLE):
        assert [x["color"] for x in matplotlib.rcParams["axes.prop_cycle"]] == CYCLE
        assert not matplotlib.rcParams["axes.spines.top"]


@pytest.mark.parametrize("count", [1, 3, 7])
def test_a_legend_stands_between_title_and_axes(count: int):
    figure = Figure((6, 4), layout="constrained")
    ax = figure.subplots()
    ax.set_title("a title", loc="left")
    for k in range(count):
        ax.plot([0, 1], [0, k], label=f"line {k}")
    ax.plot([0, 1], [1, 0])  # without a label
    legend_above(ax)
    figure.draw_without_rendering()
    box, title = ax.get_legend().get_window_extent(), ax._left_title.get_window_extent()
    assert len(ax.get_legend().get_texts()) == count
    assert box.y0 >= ax.get_window_extent().y1 - 1
    assert title.y0 >= box.y1 - 8 * figure.dpi / 72
    assert title.y0 > ax.get_window_extent().y1


@pytest.mark.parametrize(("wide", "labels"), [(7.6, ["shoulder_pan, up to 17.7 N m"] * 7), (3.0, ["word " * 12])])
def test_a_legend_is_no_wider_than_its_axes(wide: float, labels: list[str]):
    figure = Figure((wide, 4), layout="constrained")
    ax = figure.subplots()
    for label in labels:
        ax.plot([0, 1], label=label)
    legend_above(ax)
    figure.draw_without_rendering()
    assert ax.get_legend().get_window_extent().x1 <= ax.get_window_extent().x1 + 1
    assert ax.get_window_extent().width > 0.6 * figure.bbox.width


def test_a_long_heading_is_wrapped_within_its_figure():
    figure = Figure((4, 3), layout="constrained")
    figure.subplots()
    head(figure, "a model, with a controller whose name is long and has $ in it, beyond its limits")
    figure.draw_without_rendering()
    assert figure.get_suptitle().count("\n") >= 1
    assert figure._suptitle.get_window_extent().x1 <= figure.bbox.x1


def test_a_legend_has_only_the_handles_given():
    ax = Figure().subplots()
    first, _ = ax.plot([0], label="a"), ax.plot([1], label="b")
    legend_above(ax, handles=first)
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["a"]


def test_a_figure_is_written_whole_into_a_new_folder(tmp_path, monkeypatch):
    path = tmp_path / "new" / "deep" / "figure.png"
    figure = Figure((1, 1))
    assert save_figure(figure, path) == path
    written = path.read_bytes()
    assert written.startswith(b"\x89PNG")

    def half(unfinished, **_):
        unfinished.write_bytes(b"half") if hasattr(unfinished, "write_bytes") else unfinished.write(b"half")
        raise OSError("disk full")

    monkeypatch.setattr(figure, "savefig", half)
    with pytest.raises(OSError, match="disk full"):
        save_figure(figure, path)
    assert path.read_bytes() == written
    assert [x.name for x in path.parent.iterdir()] == ["figure.png"]


@pytest.mark.parametrize(
    ("meters", "text"),
    [
        (0.0, "0.000 m"),
        (0.000016, "0.00002 m"),
        (0.00076, "0.00076 m"),
        (0.0012, "0.0012 m"),
        (0.06, "0.060 m"),
        (0.0994, "0.099 m"),
        (0.0995, "0.100 m"),
        (0.1018, "0.102 m"),
        (2.3854, "2.385 m"),
    ],
)
def test_lengths_in_words(meters: float, text: str):
    assert length_text(meters) == text


@pytest.mark.parametrize("name", [r"$\frac$", "$", "$$", "a_b^c", r"\$", "鞭"])
def test_a_name_from_outside_is_drawn_as_it_is(name: str, tmp_path: Path, recwarn) -> None:
    """Formulas that matplotlib cannot parse end in an error when the figure is written."""
    figure = Figure((1, 1))
    figure.suptitle(verbatim(name))
    save_figure(figure, tmp_path / "figure.png")
    assert not recwarn.list


def test_there_are_few_ticks_however_far_away_a_target_is() -> None:
    assert len(ticks(0.5, 2.0).tick_values(0, 2)) < 10
    assert len(ticks(0.5, 1e15).tick_values(-1e15, 1e15)) < 20
