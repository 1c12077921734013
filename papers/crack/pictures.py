"""Pictures and film of this reproduction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from papers.crack.chains import Motion
from papers.crack.closed_forms import folded_speed
from papers.crack.published import CRACK
from whiptool.rollout.trust import BEND, MACH, SOUND
from whiptool.viz.animation import StrikeAnimation, write_film
from whiptool.viz.style import COLORS, STYLE
from whiptool.whole_files import replacing

_COLORS = tuple(COLORS[name] for name in ("blue", "vermilion", "green", "pink", "orange"))
_MARKS = "os^Dv"
_FPS, _FRAMES = 25.0, 150


def fall_picture(found: Mapping[int, Mapping[str, Any]], gravity: float) -> Figure:
    """The tip's speed over depth of folded chains of some numbers of nodes, and the closed form."""
    with matplotlib.rc_context(STYLE):
        figure = Figure((6.4, 4.2), layout="constrained")
        ax = figure.subplots()
        for (nodes, one), color, mark in zip(found.items(), _COLORS, _MARKS, strict=False):
            ax.plot(one["depths"], one["speeds"], mark, color=color, markersize=5, label=f"{nodes} nodes")
        y = np.linspace(0, 0.92, 200)
        ax.plot(y, folded_speed(y, 1.0, gravity), color=COLORS["black"], label="energy conserved (closed form)")
        ax.plot(y, np.sqrt(2 * gravity * y), "--", color="0.5", label="free fall")
        ax.set(
            xlabel="depth of the tip below its start [m]", ylabel="tip speed [m/s]", title="A folded chain of 1 m falls"
        )
        ax.legend()
    return figure


def taper_picture(found: Mapping[tuple[float, int], Mapping[str, Any]]) -> Figure:
    """The largest tip speed over the number of nodes for some tapers, and what the last node could have at most."""
    with matplotlib.rc_context(STYLE):
        figure = Figure((6.4, 4.2), layout="constrained")
        ax = figure.subplots()
        for taper, color, mark in zip(dict.fromkeys(t for t, _ in found), _COLORS, _MARKS, strict=False):
            nodes = [n for t, n in found if t == taper]
            ax.plot(nodes, [found[taper, n]["gain"] for n in nodes], mark, color=color, label=f"taper {taper:g}")
            ax.plot(nodes, [found[taper, n]["most"] for n in nodes], color=color, linewidth=1.2)
        ax.set(xscale="log", yscale="log", xlabel="number of nodes", ylabel="largest tip speed over that at the start")
        ax.set_title("A loop without drag; lines: all energy in the last node")
        ticks = sorted({n for _, n in found})
        ax.set_xticks(ticks, [str(n) for n in ticks], minor=False)
        ax.set_xticks([], minor=True)
        speeds = (5, 10, 20, 50)
        ax.set_yticks(speeds, [str(x) for x in speeds])
        ax.set_yticks([], minor=True)
        ax.legend()
    return figure


def trust_picture(bends: Sequence[float], errors: Sequence[float]) -> Figure:
    """The error of the largest tip speed over the sharpest bend, of a loop that damping keeps round."""
    with matplotlib.rc_context(STYLE):
        figure = Figure((6.4, 4.2), layout="constrained")
        ax = figure.subplots()
        ax.plot(bends, 100 * np.array(errors), "o", color=COLORS["blue"], markersize=7)
        ax.axvline(BEND.limit, color=COLORS["vermilion"], linestyle="--", label=f"trusted up to {BEND.limit:g} degrees")
        ax.set(xlabel="sharpest bend between neighbouring links [degrees]", ylabel="error of the largest tip speed [%]")
        ax.set(xlim=(0, None), title="Fewer nodes: sharper bends, slower tips")
        ax.legend()
    return figure


def reached_picture(speeds: Mapping[str, float]) -> Figure:
    """Tip speeds that are reached, and those of Mach 0.3, 1 and 2, at which the loop is at Mach 1."""
    with matplotlib.rc_context(STYLE):
        figure = Figure((6.4, 0.5 + 0.42 * len(speeds)), layout="constrained")
        ax = figure.subplots()
        ax.barh(list(speeds), list(speeds.values()), color=COLORS["sky"])
        for row, speed in enumerate(speeds.values()):
            ax.text(speed * 1.04, row, f"{speed:.0f}", va="center", fontsize=9)
        for mach, color, of_loop in (
            (MACH.limit, "orange", ""),
            (1.0, "pink", ""),
            (CRACK, "vermilion", ", its loop Mach 1"),
        ):
            ax.axvline(mach * SOUND, color=COLORS[color], linestyle="--", label=f"Mach {mach:g}{of_loop}")
        ax.set(xscale="log", xlim=(3, 1600), xlabel="tip speed [m/s]")
        ax.set_xticks((5, 10, 20, 50, 100, 200, 500, 1000), [str(x) for x in (5, 10, 20, 50, 100, 200, 500, 1000)])
        ax.invert_yaxis()
        figure.legend(loc="outside upper right", ncols=3)
    return figure


def write_loop_film(path: Path, seen: Motion, title: str) -> None:
    """Write a film of a loop that runs along a whip until its tip is fastest, drawn in equal parts of that time."""
    fastest = int(seen.tip_speed.argmax())
    end = min(len(seen.t) - 1, int(1.05 * fastest))
    rows = np.linspace(0, end, _FRAMES).astype(int)
    nodes = np.concatenate([np.zeros((len(rows), 1, 2)), seen.places[rows]], axis=1)
    nodes = np.stack([-nodes[..., 1], nodes[..., 0]], axis=-1)  # along the whip to the right
    with matplotlib.rc_context(STYLE):
        figure = Figure((6.4, 2.8), dpi=100, layout="constrained")
        ax = figure.subplots()
        (line,) = ax.plot([], [], color=COLORS["blue"], linewidth=2.5)
        (tip,) = ax.plot([], [], "o", color=COLORS["vermilion"], markersize=7)
        said = ax.text(0.02, 0.9, "", transform=ax.transAxes)
        ax.set(xlabel="along the whip [m]", ylabel="across [m]", title=title, aspect="equal")
        low, high = nodes.min(axis=(0, 1)), nodes.max(axis=(0, 1))
        ax.set(xlim=(low[0] - 0.05, high[0] + 0.05), ylim=(low[1] - 0.1, high[1] + 0.25))
        figure.canvas.draw()
        figure.set_layout_engine("none")

        def show(i: int) -> None:
            line.set_data(*nodes[i].T)
            tip.set_data(*nodes[i, -1:].T)
            said.set_text(f"{1e3 * seen.t[rows[i]]:5.1f} ms, tip {seen.tip_speed[rows[i]]:.0f} m/s")

        film = StrikeAnimation(figure, [line, tip, said], _FRAMES, show, _FPS)
        with replacing(path) as unfinished:
            write_film(unfinished, film.frames(), count=_FRAMES, size=film.size, fps=_FPS)
