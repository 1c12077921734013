"""Figs. 9 and 10 and Eq. 23: the same strikes in simulation and on a rig that is not the model, here a twin."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from papers.context import Context
from papers.lemon2024.printed import (
    DRAWN,
    FIGURE_TARGETS,
    HIT_RADIUS,
    LONGEST,
    RHO,
    TRAJECTORIES,
    compared,
)
from papers.lemon2024.twin_strikes import (
    CLOCK_OFFSET,
    LATENCY,
    SCALES,
    SETTLE,
    PlanUnit,
    TwinUnit,
    controller,
    recording,
    true_model,
)
from whiptool import CompiledRollout, Plant, Strike, StrikeRecording, Trajectory, fit, similarity
from whiptool.comparison import TargetScene
from whiptool.errors import WhiptoolError
from whiptool.identification.fit import FitOptions, RecordingFit, predict
from whiptool.identification.similarity import Similarity
from whiptool.identification.uncertainty import Parameter
from whiptool.rig.emulator.motor import HARDWARE
from whiptool.viz.report import Claim, Claims, Picture, Section, Table, Text, verdict_over
from whiptool.viz.style import COLORS, STYLE
from whiptool.words import counted, rounded

LEARN_FROM = 3  # strikes
OF_WHIP = ("whip.k", "whip.b", "whip.drag", "delay")  # found from tip and measured joints: per mass of the whip
OF_ARM = ("arm.friction[0]", "arm.friction[1]", "arm.inertia[0]")  # then, from tip and command
KNOTS = 0.05  # [s], of the measured joints' spline: a strike is smooth
_ABSOLUTE = ("delay", "hit_time", "hit_speed")
_FIGURES = {
    "rho_mean": ("rho (Eq. 23) [%]", 1e2),
    "rmse": ("RMSE [cm]", 1e2),
    "nrmse": ("RMSE over the path's size [%]", 1e2),
    "largest": ("largest error [cm]", 1e2),
    "delay": ("delay, absolute [ms]", 1e3),
    "frechet": ("Frechet distance [cm]", 1e2),
    "hit_point": ("hit-point error [cm]", 1e2),
    "hit_time": ("hit-time error, absolute [ms]", 1e3),
    "hit_speed": ("tip-speed error, absolute [m/s]", 1.0),
}
_COLORS = {"model": COLORS["orange"], "identified": COLORS["blue"]}


def sections(context: Context) -> list[Section]:
    """Strikes on the model and on the twin, compared, before and after identification.

    Raises:
        WhiptoolError: Too few strikes were completed.
    """
    scene, quick = context.comparison.scene, context.quick
    plan = PlanUnit(scene=scene, iterations=2 if quick else 6, targets=2 if quick else 3)
    strikes = context.store.results([plan], desc="sim2real: plan")[plan.key]["strikes"]
    units = [
        TwinUnit(scene=scene, number=i, strike=tuple(s["strike"]), target=tuple(s["target"]), images=not quick)
        for i, s in enumerate(strikes)
    ]
    results = context.store.results(units, desc="sim2real: strikes")
    done = [unit for unit in units if results[unit.key]["fault"] is None]
    if len(done) <= LEARN_FROM:
        faults = {results[unit.key]["fault"] for unit in units} - {None}
        total = counted(len(units), "strike")
        raise WhiptoolError(f"{len(done)} of {total} were completed: {', '.join(sorted(faults))}")
    # iteration after iteration, target after target: it is the first strikes that are learnt from
    done.sort(key=lambda unit: (unit.number % plan.iterations, unit.number))
    recordings = [recording(unit, results[unit.key]) for unit in done]
    plant = Plant(scene.model, controller())
    measured = FitOptions(drive="joints", knots=KNOTS)
    commanded = FitOptions(drive="command")
    whip = fit(recordings[:LEARN_FROM], plant, OF_WHIP, options=measured)
    whole = fit(recordings[:LEARN_FROM], whip.plant, OF_ARM, options=commanded)
    predicted = {
        "model": predict(recordings, plant, {}, commanded),
        "identified": predict(recordings, whole.plant, {}, commanded),
        "identified whip, measured arm": predict(recordings, whip.plant, whip.nuisance, measured),
    }
    alike = {name: [_similar(r, p) for r, p in zip(recordings, of, strict=True)] for name, of in predicted.items()}
    last = max(range(len(done)), key=lambda i: done[i].number)
    about = (
        f"{counted(len(units), 'strike')} at {counted(plan.targets, 'target')}, "
        f"{counted(plan.iterations, 'iteration')} each of a search on the model "
        "within the motors' speed-torque line, struck on a twin behind the servos' protocol: another whip ("
        + ", ".join(f"{name.removeprefix('whip.')} {x - 1:+.0%}" for name, x in SCALES.items())
        + f", in air), motors with dry and viscous friction and rotor inertia, {1e3 * LATENCY:g} ms of latency, a "
        f"camera clock that is {1e3 * CLOCK_OFFSET:g} ms late. OIAC as printed, its torque held for a cycle. "
        + ("Quick form: the tip's position with the error of images. " if quick else "The tip is tracked in images. ")
        + (
            f"Left out, as it ended in a fault: {counted(len(units) - len(done), 'strike')}. "
            * (len(done) < len(units))
        )
        + f"Then the model was identified from the first {LEARN_FROM} strikes: first the whip, driven by the joints as "
        "they were measured, which gives its stiffness, damping and drag over its mass (there is no force in this to "
        "weigh it by: the mass stays the model's); then the arm, driven by the command. The arm's model knows viscous "
        "friction only, which here stands for the motors' dry friction, too, and the controller's model carries the "
        "weight of the whip in its model: these errors remain under the command; taking the arm as it was "
        "measured leaves them out, though not what the whip still did when the strike began. "
        + (
            "The twin stands at the start at once. "
            if quick
            else f"Every strike is predicted from rest at its start; the twin moves there, where friction may hold it "
            f"off, and waits {SETTLE:g} s for the whip to hang still, whose hinge is free."
        )
    )
    return [
        Section(
            "Figs. 9 and 10: from simulation to a rig",
            [
                Text(about),
                Claims([_claim(alike)]),
                Picture(_paths(done, recordings, predicted), "Fig. 9: tip paths. Crosses: targets.", vector=False),
                _printed_paths(plan, alike),
                Picture(
                    _distances(done[last], recordings[last], predicted, last, scene), "Fig. 10b-d: the last strike."
                ),
                _printed_strike(done[last], recordings[last], scene),
                Table(
                    _similarities(alike, 0),
                    caption=f"Similarity of tip paths, means over {counted(len(done), 'strike')}",
                ),
                Table(
                    _similarities(alike, LEARN_FROM),
                    caption="The same without those that it was identified from: "
                    + counted(len(done) - LEARN_FROM, "strike"),
                ),
                Table(_misses(plan, units, results), caption="Distance to the target as the camera saw it [cm]"),
                Table(
                    _numbers(plant, [*whip.parameters, *whole.parameters], scene),
                    caption="What was identified, and what the twin really has, the whip's at the mass of the model",
                ),
            ],
        )
    ]


def _printed_paths(plan: PlanUnit, alike: dict[str, list[Similarity]]) -> Table:
    """What the paper prints of Fig. 9, and ours."""
    rows = [
        ["targets", f"{FIGURE_TARGETS} (places {DRAWN})", f"{plan.targets}"],
        ["trajectories", f"{TRAJECTORIES}", f"{len(alike['model'])}"],
        ["similarity rho (Eq. 23), model as it was", f"{RHO:.2%}", f"{_mean(alike['model'], 'rho_mean'):.2%}"],
        ["the same, identified", "not done", f"{_mean(alike['identified'], 'rho_mean'):.2%}"],
    ]
    return compared(rows, "Fig. 9 in numbers; the paths themselves are only drawn in the paper.")


def _printed_strike(unit: TwinUnit, r: StrikeRecording, scene: TargetScene) -> Table:
    """What the paper states about Fig. 10, and the last strike here."""
    path = _path_of(unit, scene)
    stiff, damp = (np.abs(np.diagonal(gains, axis1=1, axis2=2)).max(axis=0) for gains in (path.K, path.B))
    away = np.linalg.norm(r.points[:, 0] - np.array(unit.target), axis=1)
    rows = [
        ["duration of the movement", f"< {LONGEST:g} s (abstract)", f"{unit.strike[-1]:.2f} s"],
        ["least distance L", f"{DRAWN}; a hit within {HIT_RADIUS:g} m", f"{np.nanmin(away):.3f} m, as filmed"],
        ["largest stiffness", "shoulder above elbow", " and ".join(f"{x:.3g}" for x in stiff) + " N m/rad"],
        ["largest damping", "shoulder above elbow", " and ".join(f"{x:.3g}" for x in damp) + " N m s/rad"],
    ]
    caption = "Fig. 10 in numbers: ours are of shoulder and elbow; the paper's curves are only drawn."
    return compared(rows, caption)


def _path_of(unit: TwinUnit, scene: TargetScene) -> Trajectory:
    """The strike as it is simulated with the model."""
    rollout = CompiledRollout(scene.model, controller())
    return rollout.trajectory(Strike.from_vector(unit.strike), t_stay=scene.t_stay)


def _claim(alike: dict[str, list[Similarity]]) -> Claim:
    before, after = alike["model"], alike["identified"]
    model, other = _mean(before, "rho_mean"), _mean(after[LEARN_FROM:], "rho_mean")
    return Claim(
        claim="Simulated and physical tip paths are alike: rho",
        paper=f"{RHO:.2%} (Sect. 3.3)",
        ours=f"{model:.2%} over {counted(len(before), 'strike')} with the model as it was; identified from "
        f"{LEARN_FROM} of them, {_mean(after, 'rho_mean'):.2%}, and {other:.2%} over the others alone. "
        f"RMSE {100 * _mean(before, 'rmse'):.2f} cm and {100 * _mean(after, 'rmse'):.2f} cm",
        verdict=verdict_over({"the model as it was": model >= RHO, "the identified model": other >= RHO}),
        reason="Eq. 23 divides by each coordinate, so it depends on the origin (here the shoulder) and on how often "
        "the path crosses the axes; the errors in cm below do not. The rig here is a twin, not hardware.",
    )


def _mean(some: list[Similarity], name: str) -> float:
    return float(np.mean([np.abs(getattr(s, name)) if name in _ABSOLUTE else getattr(s, name) for s in some]))


def _similarities(alike: dict[str, list[Similarity]], first: int) -> list[list[str]]:
    """Of all strikes but the first few, one column for each model."""
    return [["", *alike]] + [
        [label, *(f"{scale * _mean(of[first:], name):.2f}" for of in alike.values())]
        for name, (label, scale) in _FIGURES.items()
    ]


def _misses(plan: PlanUnit, units: list[TwinUnit], results: dict[str, Any]) -> list[list[str]]:
    """By target and iteration."""
    rows = [["target", *(f"iteration {i + 1}" for i in range(plan.iterations))]]
    for first in range(0, len(units), plan.iterations):
        x, y = units[first].target
        found = [results[unit.key] for unit in units[first : first + plan.iterations]]
        rows.append([f"({x:g}, {y:g}) m", *("fault" if r["fault"] else f"{100 * r['miss']:.1f}" for r in found)])
    return rows


def _numbers(plant: Plant, found: Sequence[Parameter], scene: TargetScene) -> list[list[str]]:
    """What the model had, what was found, and what the twin has."""
    before, twin = plant.values(), true_model(scene.model).parameters()
    weight = before["whip.m"] / twin["whip.m"]
    truth = {name: f"{weight * x:.4g}" for name, x in twin.items() if name.startswith("whip.")}
    truth["delay"] = f"{CLOCK_OFFSET - LATENCY / 2:.4g}"  # the camera's clock, less that of the joints
    truth["arm.inertia[0]"] = f"{before['arm.inertia[0]'] + HARDWARE.inertia:.4g}"
    friction = f"{HARDWARE.viscous_friction:g}, and {HARDWARE.dry_friction:g} N m dry"
    rows = [["number", "model", "twin", "identified", "95 % interval", "class"]]
    for p in found:
        interval = "none" if p.interval is None else " to ".join(rounded(x, 4) for x in p.interval)
        numbers = rounded(before.get(p.name, 0.0), 4), truth.get(p.name, friction), rounded(p.value, 4)
        rows.append([p.name, *numbers, interval, p.kind])
    return rows


def _similar(r: StrikeRecording, p: RecordingFit) -> Similarity:
    t = r.t_points[:, 0]
    simulated = np.stack([np.interp(t, p.t, x) for x in p.path["tip"].T], axis=1)
    return similarity(t, r.points[:, 0], simulated, target=r.target)


def _paths(
    units: list[TwinUnit], recordings: list[StrikeRecording], predicted: dict[str, list[RecordingFit]]
) -> Figure:
    targets = list(dict.fromkeys(unit.target for unit in units))
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(4.2 * len(targets), 4.6), layout="constrained")
        axes = np.atleast_1d(figure.subplots(1, len(targets), sharey=True))
        for ax, target in zip(axes, targets, strict=True):
            for i, unit in enumerate(units):
                if unit.target != target:
                    continue
                tip = recordings[i].points[:, 0]
                ax.plot(*tip.T, ".", color=COLORS["black"], markersize=3, label="twin, filmed")
                for name, color in _COLORS.items():
                    p = predicted[name][i]
                    ax.plot(
                        *p.path["tip"][p.t <= recordings[i].t[-1]].T, color=color, linewidth=1, alpha=0.8, label=name
                    )
            ax.plot(*target, "x", color=COLORS["vermilion"], markersize=10, markeredgewidth=2.5)
            ax.set(xlabel="x [m]", aspect="equal", title=f"target ({target[0]:g}, {target[1]:g}) m")
        axes[0].set_ylabel("y [m]")
        handles, labels = axes[0].get_legend_handles_labels()
        unique = dict(zip(labels, handles, strict=True))
        figure.legend(unique.values(), unique.keys(), loc="outside lower center", ncols=3)
    return figure


def _distances(
    unit: TwinUnit, r: StrikeRecording, predicted: dict[str, list[RecordingFit]], i: int, scene: TargetScene
) -> Figure:
    path, target = _path_of(unit, scene), np.array(unit.target)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(11, 3.6), layout="constrained")
        left, middle, right = figure.subplots(1, 3)
        left.plot(r.t_points[:, 0], np.hypot(*(r.points[:, 0] - target).T), ".", color=COLORS["black"], label="twin")
        for name, color in _COLORS.items():
            p = predicted[name][i]
            shown = p.t <= r.t[-1]
            left.plot(p.t[shown], np.hypot(*(p.path["tip"][shown] - target).T), color=color, label=name)
        left.set(xlabel="time [s]", ylabel="distance L [m]")
        left.legend()
        for ax, gains, unit_name in ((middle, path.K, "K [N m/rad]"), (right, path.B, "B [N m s/rad]")):
            for j, color in enumerate((COLORS["blue"], COLORS["vermilion"])):
                ax.plot(path.t, gains[:, j, j], color=color, label=scene.model.arm.joints[j])
            ax.set(xlabel="time [s]", ylabel=unit_name)
            ax.legend()
    return figure
