"""The report on aimed strikes: what is worked on, what it says, and where goals are missed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from papers.aim import published
from papers.aim.aimed import Aimed, aim
from papers.aim.task import AimTask, hard, ur5e
from papers.aim.units import SEARCHES
from papers.context import Context
from papers.lemon2024.hard import HIT_RADIUS
from whiptool import Controller, oiac_preset, preset
from whiptool.comparison import TargetScene
from whiptool.comparison.target_scene import SPEED, fast_region
from whiptool.rl.trained import one_torch_thread
from whiptool.strike_map.building import built
from whiptool.strike_map.strike_map import StrikeMap
from whiptool.viz.report import Picture, Section, Table, Text
from whiptool.viz.style import COLORS, STYLE

REPLAYS = 20


def sections(context: Context) -> list[Section]:
    """The UR5e's goals and the published figures, where they are missed, and the planar hard task."""
    quick, task = context.quick, ur5e(quick=context.quick)
    goals, replays = (5, 1) if quick else (task.drawn, REPLAYS)
    strike_map, folder = _map(task, context)
    aimed = aim(task, strike_map, folder, context.store, goals=goals, replays=replays, brief=quick)
    return [_in_space(aimed, strike_map), _planar(context)]


def _map(task: AimTask, context: Context) -> tuple[StrikeMap, Path]:
    """Return the map of a task and its folder among the store's checkpoints; what is missing of it is made."""
    folder = context.store.checkpoints / f"map-{task.name}"
    folder.mkdir(exist_ok=True)
    with one_torch_thread():
        return built(task.building(), folder), folder


def figures(aimed: Aimed) -> list[list[str]]:
    """Return the table of shares, ours and the published."""
    s = aimed.summary()
    of_any = (aimed.one_shot.hit.sum() + sum(x["hit"] for x in aimed.followed["candidates"])) / len(aimed)
    rows = [
        ["", "published", "ours"],
        ["goals, in simulation", f"{published.GOALS:,}", f"{s['goals']:,}"],
        ["hit in one shot", percent(published.ONE_SHOT), percent(s["one_shot"])],
        ["... by the first strike proposed, no strike rolled out", "-", percent(s["one_shot_unchecked"])],
        ["... and if collisions were none of the limits", "-", percent(s["one_shot_by_joints"])],
        ["hit by the best of 64 strikes", percent(published.BEST_OF_64), percent(of_any)],
        ["hit after refinement by rollouts", "-", percent(s["refined_of_all"])],
        ["... of the goals that any search has reached", "-", percent(s["refined"])],
        ["never reached by any search", "-", f"{(~aimed.reached).sum()} ({percent(s['never_reached'])})"],
        ["median miss in one shot", "-", millimetres(s["one_shot_median_miss"])],
        ["median miss after refinement", "-", millimetres(s["median_miss"])],
        ["... of 99 % of the goals, at most", "-", millimetres(s["p99_miss"])],
        ["refined strikes within the limits", "-", percent(s["refined_within_limits"])],
        [
            "rollouts, and times derivatives, a goal",
            "-",
            f"{s['rollouts_per_goal']:.1f}, {s['derivatives_per_goal']:.2f}",
        ],
    ]
    if aimed.clear:
        names = {"arm": "refined strikes in which arm and whip keep clear", "floor": "... of the floor, too"}
        rows += [[names[x], "-", percent(share)] for x, share in s["clear"].items() if x in names]
    for name, words in (("in_mujoco", "in MuJoCo"), ("in_cosserat", "with a Cosserat rod")):
        seen = s[name]
        if seen["strikes"]:
            rows.append([f"refined strikes that hit {words}, too", "-", f"{seen['hits']} of {seen['strikes']}"])
        for figure in ("difference", "miss"):
            if seen[f"median_{figure}"] is not None:
                what = "difference of the miss" if figure == "difference" else "miss there"
                both = f"{millimetres(seen[f'median_{figure}'])}, {millimetres(seen[f'largest_{figure}'])}"
                rows.append([f"... {what}: median, largest", "-", both])
        if seen["median_angle"] is not None:
            both = ", ".join(f"{np.degrees(seen[f'{x}_angle']):.1f}" for x in ("median", "largest"))
            rows.append(["... angle there [degrees]: median, largest", "-", both])
    return rows


def _in_space(aimed: Aimed, strike_map: StrikeMap) -> Section:
    about = (
        f"The map: {len(strike_map.answers):,} answers, strikes with an instant at which the tip passes a place as "
        "asked, and the derivatives of place and velocity there. Of a goal the nearest answers are corrected to first "
        "order, and a network ranks them. The one shot is the first of the best few that keeps the limits, which "
        "a rollout of it says; where it passes is not looked at. Refinement corrects "
        "it with rollouts, candidate after candidate until one hits. A hit: tip within 5 cm, its velocity within 10 "
        "degrees of the arrival angle as it is seen from the base, and at least 1 m/s along it, within the limits of "
        "the joints, while arm, whip and the floor 1.7 m below the base keep clear of each other from the first "
        "movement to the whip's fall after it. The published figures are of a network on a Cosserat rope; goals, "
        "models and limits are not the same."
    )
    parts: list[Text | Table | Picture] = [Text(about), Table(figures(aimed), "Shares of goals that are hit.")]
    caption = "Where goals are missed. Height and distance are from the base; 0 degrees is upward, 90 to the left."
    parts.append(Picture(misses(aimed), caption, vector=False))
    searches = ", then ".join(f"{name} ({cap:,} rollouts)" for name, cap in SEARCHES.items())
    parts.append(Text(f"What refinement missed was given to all candidates of the map, then to {searches}."))
    if aimed.missed:
        parts.append(Table(other_searches(aimed), "Goals that refinement missed."))
    return Section("A UR5e strikes points at arrival angles", parts)


def other_searches(aimed: Aimed) -> list[list[str]]:
    """Return the table of goals that refinement missed, and what other searches came to."""
    rows = [
        ["goal", "position [m]", "arrival angle [degrees]", "reached by", "nearest tip [cm]", "angle then [degrees]"]
    ]
    for goal, found in sorted(aimed.missed.items()):
        by = next((x["search"] for x in found if x["hit"]), "none")
        last = found[-1]
        place = " ".join(f"{x:.2f}" for x in aimed.positions[goal])
        miss = "-" if last["miss"] is None else f"{100 * last['miss']:.1f}"
        angle = "-" if last["angle"] is None else f"{np.degrees(last['angle']):.1f}"
        rows.append([f"{goal}", place, f"{np.degrees(aimed.angles[goal]):.0f}", by, miss, angle])
    return rows


def _planar(context: Context) -> Section:
    quick = context.quick
    scene = TargetScene(model=preset("lemon2024"), controller=Controller(oiac_preset("table4")), radii=(HIT_RADIUS,))
    region = fast_region(scene, context.store, quick=quick)
    task = hard(replace(scene, zone=region, targets=20 if quick else 300), quick=quick)
    strike_map, folder = _map(task, context)
    aimed = aim(task, strike_map, folder, context.store, goals=task.drawn, brief=quick)
    about = (
        f"The paper's whip in the plane: targets anywhere that the tip of random strikes reaches with {SPEED:g} m/s, "
        f"{region.size:.2f} m^2, within {100 * HIT_RADIUS:g} cm; the targets of `reproduce hard`, where the figures of "
        f"SAC with hindsight are from. The map: {len(strike_map.answers):,} answers. A trial is a strike; derivatives "
        "that corrections take count as one for every number of a strike."
    )
    return Section("The planar hard task, from a map", [Text(about), Table(planar_figures(aimed))])


def planar_figures(aimed: Aimed) -> list[list[str]]:
    """Return the table of the planar hard task."""
    s = aimed.summary()
    return [
        ["", "hits at the first strike", "mean trials to the first hit"],
        ["SAC with hindsight", percent(published.SAC_FIRST_HITS), f"{published.SAC_TRIALS:g}"],
        ["map, then its next candidate", percent(s["one_shot"]), f"{s['mean_trials']['candidates']:.2f}"],
        ["map, then corrections of its strike", percent(s["one_shot"]), f"{s['mean_trials']['refinement']:.2f}"],
        ["map, refined in simulation before the strike", percent(s["refined_of_all"]), "-"],
    ]


def percent(share: float) -> str:
    """Return a share in percent; 100 % only where it is all."""
    text = f"{100 * share:.1f}"
    if share < 1 and text == "100.0":
        text = f"{100 * share:.2f}"
    return f"{text} %"


def millimetres(length: float) -> str:
    """Return a length [m] in millimetres."""
    return f"{1e3 * length:.3f} mm" if length < 1e-3 else f"{1e3 * length:.1f} mm"


def misses(aimed: Aimed) -> Figure:
    """Goals in space by height over distance from the base, and over the arrival angle: hit, missed, never reached.

    Left in one shot, right after refinement.
    """
    height = aimed.positions[:, 2]
    across = {
        "distance from the base [m]": np.linalg.norm(aimed.positions, axis=1),
        "arrival angle [degrees]": np.degrees(aimed.angles),
    }
    shots = {"in one shot": aimed.one_shot.hit, "after refinement": aimed.refined.hit}
    with matplotlib.rc_context(STYLE):
        figure = Figure((11, 8.6), layout="constrained")
        axes = figure.subplots(2, 2, sharey=True, sharex="row")
        for row, (name, x) in zip(axes, across.items(), strict=True):
            for ax, (shot, hit) in zip(row, shots.items(), strict=True):
                _draw(ax, x, height, hit, aimed.reached)
                ax.set(xlabel=name, title=f"{shot}: {hit.sum():,} of {len(hit):,} hit")
            row[0].set_ylabel("height above the base [m]")
        for ax in axes[1]:
            ax.set_xticks([-180, -90, 0, 90, 180])
        figure.legend(_handles(), ["hit", "missed", "never reached by any search"], loc="outside upper center", ncols=3)
    return figure


def _draw(ax: Any, x: np.ndarray, y: np.ndarray, hit: np.ndarray, reached: np.ndarray) -> None:
    ax.plot(x[hit], y[hit], ".", color="0.8", markersize=3, zorder=1)
    ax.plot(x[~hit], y[~hit], "x", color=COLORS["vermilion"], markersize=5, markeredgewidth=1.3, zorder=2)
    ax.plot(x[~reached], y[~reached], "o", color=COLORS["black"], markersize=10, markerfacecolor="none", zorder=3)


def _handles() -> list[Line2D]:
    """Return what stands in the legend."""
    return [
        Line2D([], [], color="0.7", marker=".", markersize=8, linestyle="none"),
        Line2D([], [], color=COLORS["vermilion"], marker="x", linestyle="none"),
        Line2D([], [], color=COLORS["black"], marker="o", markersize=9, markerfacecolor="none", linestyle="none"),
    ]
