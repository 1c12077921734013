"""Fig. 5: where the targets lie, and strikes that hit some of them."""

from __future__ import annotations

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from papers.context import Context
from papers.lemon2024.printed import HIT_RADIUS, TARGETS, ZONE_RADIUS, compared
from whiptool import Disc, Objective, Target, Trajectory, search
from whiptool.comparison import TargetScene
from whiptool.models.kinematics import joint_points
from whiptool.viz.report import Picture, Section, Table, Text
from whiptool.viz.style import COLORS, STYLE
from whiptool.words import counted

_PATH_COLORS = [COLORS[name] for name in ("blue", "vermilion", "green", "pink", "black")]


def sections(context: Context) -> list[Section]:
    """The zone, the targets, the arm at rest, and the tip's paths of strikes that DIRECT-L finds at some targets."""
    scene = context.comparison.scene
    points, rollout = scene.points(), scene.rollout()
    shown, rows = [], [["target x, y [m]", "trials", "miss [m]", "hit after [s]", "tip speed [m/s]"]]
    for i in range(min(2 if context.quick else 5, len(points))):
        objective = Objective(
            rollout,
            Target(tuple(points[i]), scene.radii[0]),
            t_stay=scene.t_stay,
            max_trials=scene.cap,
            stop_at_hit=True,
        )
        found = search(objective, "directl")
        if found.strike is None or found.outcome is None or not found.outcome.hit:
            continue
        shown.append((i, rollout.trajectory(found.strike, t_stay=scene.t_stay)))
        x, y = points[i]
        o = found.outcome
        rows.append(
            [f"{x:.3f}, {y:.3f}", f"{found.n_trials}", f"{o.miss_distance:.3f}", f"{o.time:.3f}", f"{o.tip_speed:.1f}"]
        )
    caption = (
        f"{counted(len(points), 'random target')} (Fig. 5), the arm and whip hanging at rest, and the tip's path of "
        f"{counted(len(shown), 'strike')} that DIRECT-L found, up to its hit."
    )
    figure = _figure(scene, points, shown)
    text = (
        f"The stretched arm and whip reach {scene.model.reach:.3f} m. Where the circle of the targets lies, the paper "
        "draws and does not print."
    )
    parts: list[Text | Table | Picture] = [Text(text), Picture(figure, caption), _printed(scene, points)]
    if len(rows) > 1:
        parts.append(Table(rows, "The strikes shown."))
    return [Section("Fig. 5: the targets", parts)]


def _printed(scene: TargetScene, points: np.ndarray) -> Table:
    """What the paper prints of the targets, and ours."""
    x, y = np.mean(scene.zone.box, axis=0)
    circle = f"{scene.zone.radius:g} m" if isinstance(scene.zone, Disc) else "another zone"
    rows = [
        ["random targets", f"{TARGETS}", f"{len(points)}"],
        ["radius of their circle", f"{ZONE_RADIUS:g} m", circle],
        ["its middle, from the shoulder", "not printed", f"({x:g}, {y:g}) m"],
        ["hit within (Eq. 17)", f"{HIT_RADIUS:g} m", f"{scene.radii[0]:g} m"],
    ]
    return compared(rows, "Fig. 5 in numbers.")


def _figure(scene: TargetScene, points: np.ndarray, shown: list[tuple[int, Trajectory]]) -> Figure:
    model = scene.model
    with matplotlib.rc_context(STYLE):
        figure = Figure((11, 5.2), layout="constrained")
        whole, near = figure.subplots(1, 2)
        rest = joint_points(model, np.zeros(model.n))
        n = model.arm.n
        whole.plot(*rest[: n + 1].T, "o-", color=COLORS["black"], linewidth=5, markersize=5, label="arm at rest")
        whole.plot(*rest[n:].T, color=COLORS["black"], linewidth=2, label="whip")
        reach = Circle((0, 0), model.reach, fill=False, edgecolor="0.6", linestyle=":", linewidth=1.2)
        whole.add_patch(reach)
        for ax, size in ((whole, 4), (near, 14)):
            ax.scatter(*points.T, s=size, color=COLORS["green"], linewidths=0, alpha=0.8, zorder=3, label="targets")
            for color, (i, path) in zip(_PATH_COLORS, shown, strict=False):
                until = path.t <= float(path.approach(points[i]).time[0])
                ax.plot(*path.tip[until].T, color=color, linewidth=1.2, zorder=4)
                ax.plot(*points[i], "o", color=color, markersize=6, zorder=5)
                ax.add_patch(
                    Circle(tuple(points[i]), scene.radii[0], fill=False, edgecolor=color, linewidth=1, zorder=5)
                )
            ax.set(aspect="equal", xlabel="x, forward [m]", ylabel="y, up [m]")
        lower, upper = scene.zone.box
        whole.set(xlim=(-model.reach - 0.1, model.reach + 0.1), ylim=(-model.reach - 0.1, model.reach + 0.1))
        whole.legend(loc="upper left", fontsize=9)
        whole.set_title("all within reach (dotted)")
        margin = 1.3 * scene.radii[0]
        near.set(xlim=(lower[0] - margin, upper[0] + margin), ylim=(lower[1] - margin, upper[1] + margin))
        near.set_title("the zone, with the hit radius of the strikes' targets")
    return figure
