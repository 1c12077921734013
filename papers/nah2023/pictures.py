"""Pictures of this reproduction."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from papers.nah2023 import published
from papers.nah2023.claims import PLANAR
from whiptool import Trajectory
from whiptool.models.kinematics import joint_points
from whiptool.models.presets import NAH2023
from whiptool.models.strike import strike_names
from whiptool.viz.style import COLORS, STYLE
from whiptool.words import counted

TARGET_COLORS = tuple(COLORS[name] for name in ("blue", "vermilion", "green", "pink", "orange", "sky"))
_JOINTS = NAH2023.arm.n


def convergence(by_rule: Sequence[dict[str, Any]], by_tip: Sequence[dict[str, Any]]) -> Figure:
    """The best distance so far over DIRECT-L's evaluations, and the published evaluations."""
    with matplotlib.rc_context(STYLE):
        figure = Figure((11, 4.2), layout="constrained")
        axes = figure.subplots(1, 2, sharey=True)
        titles = (f"any of the last {published.LAST_NODES} nodes", "the tip alone")
        for ax, results, title in zip(axes, (by_rule, by_tip), titles, strict=True):
            for i, (result, color) in enumerate(zip(results, TARGET_COLORS, strict=True)):
                best = np.minimum.accumulate(result["misses"])
                ax.step(np.arange(1, len(best) + 1), best, where="post", color=color, label=f"target {i + 1}")
                ax.plot(len(best), best[-1], "o", color=color, markersize=6)
            ax.axhline(published.HIT_RADIUS, color="0.4", linestyle="--", linewidth=1.2)
            ax.set(xscale="log", yscale="log", xlabel="evaluations", title=title)
        for i, (count, color) in enumerate(zip(published.EVALUATIONS, TARGET_COLORS, strict=True)):
            height = published.BEST[i] or 0.82 * published.HIT_RADIUS
            axes[0].plot(count, height, "D", color=color, markersize=7, markerfacecolor="none", markeredgewidth=1.8)
        axes[0].set_ylabel("smallest distance so far [m]")
        handles, labels = axes[0].get_legend_handles_labels()
        handles += [
            Line2D([], [], color="0.4", linestyle="--", linewidth=1.2),
            Line2D([], [], color="0.3", marker="D", markerfacecolor="none", linestyle="none"),
        ]
        figure.legend(handles, [*labels, "hit radius", "published"], loc="outside upper center", ncols=8)
    return figure


def strikes_in_space(paths: Sequence[Trajectory], times: Sequence[float]) -> Figure:
    """The nearest strike at each target: hand and tip paths, arm and whip at the start and at the closest approach."""
    with matplotlib.rc_context(STYLE):
        figure = Figure((12, 8), layout="constrained")
        for i, (path, time) in enumerate(zip(paths, times, strict=True)):
            ax: Any = figure.add_subplot(2, 3, i + 1, projection="3d")
            near = int(np.searchsorted(path.t, time))
            for k, shade in ((0, "0.6"), (near, COLORS["black"])):
                points = joint_points(NAH2023, path.q[k])
                ax.plot(*points[: _JOINTS + 1].T, color=shade, linewidth=4)
                ax.plot(*points[_JOINTS:].T, color=shade, linewidth=1.4)
            hand = joint_points(NAH2023, path.q[: near + 1 : 10])[:, _JOINTS]
            ax.plot(*hand.T, color=COLORS["blue"], linewidth=2)
            ax.plot(*path.tip[: near + 1].T, color=COLORS["vermilion"], linewidth=1.4)
            ax.plot(*published.TARGETS[i], "o", color=COLORS["green"], markersize=8)
            ax.set(xlim=(-2, 2.4), ylim=(-2.2, 2.2), zlim=(-2.2, 2.2), xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
            ax.set_title(f"target {i + 1}")
            ax.view_init(elev=12, azim=-62)
            ax.set_box_aspect((4.4, 4.4, 4.4), zoom=1.1)
        names = {
            "arm and whip, start": "0.6",
            "at the closest approach": COLORS["black"],
            "hand": COLORS["blue"],
            "tip": COLORS["vermilion"],
        }
        handles = [Line2D([], [], color=color) for color in names.values()]
        handles.append(Line2D([], [], color=COLORS["green"], marker="o", linestyle="none"))
        figure.legend(handles, [*names, "target"], loc="outside upper center", ncols=5)
    return figure


def ends_of_trials(ends: Sequence[np.ndarray], by_cmaes: Sequence[np.ndarray]) -> Figure:
    """Distances at which trials end, in order, and those of CMA-ES, at the targets at full reach [m]."""
    with matplotlib.rc_context(STYLE):
        figure = Figure((9, 4.6), layout="constrained")
        ax: Any = figure.subplots()
        first, markers = published.WITHIN_REACH, ("o", "s", "^")
        for i, (trials, others, marker) in enumerate(zip(ends, by_cmaes, markers, strict=True)):
            color = TARGET_COLORS[first + i]
            share, y = 100 * np.arange(1, len(trials) + 1) / len(trials), 1e3 * trials
            ax.plot(share, y, marker, color=color, markersize=5, label=f"target {first + i + 1}")
            ax.plot(np.full(len(others), -3.0), 1e3 * others, "D", color=color, markersize=7, markerfacecolor="none")
        ax.axhline(1e3 * published.HIT_RADIUS, color="0.4", linestyle="--", linewidth=1.2)
        ax.set(xlabel="share of the trials [%]", ylabel="distance at the end [mm]", yscale="log", xlim=(-6, 102))
        handles, labels = ax.get_legend_handles_labels()
        handles += [
            Line2D([], [], color="0.3", marker="D", markerfacecolor="none", linestyle="none"),
            Line2D([], [], color="0.4", linestyle="--", linewidth=1.2),
        ]
        figure.legend(handles, [*labels, "CMA-ES", "hit radius"], loc="outside upper center", ncols=5)
    return figure


def distributions(
    solutions: Sequence[dict[str, np.ndarray]], random: Sequence[dict[str, np.ndarray]], theirs
) -> Figure:
    """Each measure of the hand's movement at each target: solutions, random strikes, the published strike.

    Args:
        solutions: By target: values by the name of the measure, `outside`, `task`, `joint`.
        random: Likewise, of random strikes.
        theirs: Likewise, one value each.
    """
    what = {
        "outside": ("outside the plane [% of variance]", None, 100 * PLANAR),
        "task": ("along the hand's softest axis [% of v²]", 100 / 3, 50.0),
        "joint": ("along the joints' softest axis [% of e²]", 25.0, 50.0),
    }
    rng = np.random.default_rng(0)
    with matplotlib.rc_context(STYLE):
        figure = Figure((12, 4.2), layout="constrained")
        for ax, (name, (label, chance, limit)) in zip(figure.subplots(1, 3), what.items(), strict=True):
            for i in range(len(solutions)):
                for values, shift, color in ((random, 0.17, "0.65"), (solutions, -0.17, COLORS["blue"])):
                    y = 100 * np.asarray(values[i][name])
                    ax.plot(
                        i + 1 + shift + rng.uniform(-0.1, 0.1, len(y)), y, ".", color=color, markersize=6, alpha=0.8
                    )
                ax.plot(i + 1 - 0.17, 100 * theirs[i][name], "D", color=COLORS["vermilion"], markersize=7)
            ax.axhline(limit, color="0.3", linestyle="--", linewidth=1.2)
            if chance is not None:
                ax.axhline(chance, color="0.3", linestyle=":", linewidth=1.2)
            ax.set(xlabel="target", ylabel=label, xticks=range(1, len(solutions) + 1))
            if name == "outside":
                ax.set_yscale("log")
            else:
                ax.set_ylim(0, 102)
        handles = [
            Line2D([], [], color=COLORS["blue"], marker=".", linestyle="none", markersize=9),
            Line2D([], [], color="0.65", marker=".", linestyle="none", markersize=9),
            Line2D([], [], color=COLORS["vermilion"], marker="D", linestyle="none"),
            Line2D([], [], color="0.3", linestyle="--", linewidth=1.2),
            Line2D([], [], color="0.3", linestyle=":", linewidth=1.2),
        ]
        names = ["solutions", "random strikes", "published strike", "limit of the claim", "no preference"]
        figure.legend(handles, names, loc="outside upper center", ncols=5)
    return figure


def sensitivities(scaled: Sequence[np.ndarray]) -> Figure:
    """How far each parameter moves the tip's path, at each target: medians and quartiles over solutions.

    Args:
        scaled: By target, (solutions, parameters) [m per width of the box].
    """
    labels = [short_name(name).replace(" ", "\n") for name in strike_names(NAH2023.arm)]
    with matplotlib.rc_context(STYLE):
        figure = Figure((12, 5.6), layout="constrained")
        axes = figure.subplots(2, 3, sharex=True, sharey=True)
        for i, (ax, values) in enumerate(zip(axes.ravel(), scaled, strict=True)):
            ax.set_title(f"target {i + 1}: {counted(len(values), 'solution')}")
            ax.set_xticks(range(len(labels)), labels, fontsize=9)
            ax.grid(axis="x", visible=False)
            if not len(values):
                continue
            low, middle, high = np.percentile(values, (25, 50, 75), axis=0)
            colors = [COLORS["blue"]] * (len(labels) - 1) + [COLORS["vermilion"]]
            ax.bar(
                range(len(labels)), middle, color=colors, yerr=(middle - low, high - middle), ecolor="0.3", capsize=3
            )
        for ax in axes[:, 0]:
            ax.set_ylabel("path moves [m per width]")
        for ax in axes[1]:
            ax.set_xlabel("parameter, i at the start, f at the end")
    return figure


def short_name(name: str) -> str:
    """`q_shoulder_flexion_i` as `flex i`."""
    parts = name.split("_")
    if len(parts) == 1:
        return name
    stem = {"flexion": "flex", "abduction": "abd", "rotation": "rot", "elbow": "elb"}[parts[-2]]
    return f"{stem} {parts[-1]}"
