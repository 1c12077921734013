"""The report of a fit: fitted values, their uncertainty, and the accuracy of predictions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from matplotlib.typing import HashableList

from whiptool.identification.results import Fit, RecordingFit, known_part
from whiptool.identification.similarity import Similarity
from whiptool.identification.summary import (
    error_words,
    flat_directions,
    format_interval,
    format_value,
    known_ratios,
    similarity_of,
    tip_paths,
    warning,
)
from whiptool.identification.variables import with_unit
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.viz.report import Picture, Section, Table, Text
from whiptool.viz.style import COLORS, STYLE, verbatim
from whiptool.words import rounded

_MEANING = {
    "well determined": "known to 10 % or better",
    "weak": "seen, but known worse than to 10 %",
    "traded": "would be known if its partner were: only their combination is",
    "flat": "not seen by these recordings; its value is where the fit left it, and no interval is given",
    "at bound": "stopped by its bound; no interval is given",
    "withdrawn": "the model does not explain the readings, or their times are wrong: no interval holds",
}


def sections(
    fit: Fit,
    fitted: Sequence[StrikeRecording],
    held_out: Sequence[StrikeRecording],
    *,
    nodes: Sequence[tuple[int, float, float]] = (),
    chosen: int = 0,
) -> list[Section]:
    """Return the report's sections, for `whiptool.viz.report.to_html`. Of each number N of nodes that was tried,
    `nodes` has N and the RMSE of the fitted and of the held-out recordings [m]; `chosen` is the chosen N."""
    pairs = [(r, f, "fitted") for r, f in zip(fitted, fit.recordings, strict=True)]
    pairs += [(r, f, "held out") for r, f in zip(held_out, fit.held_out, strict=True)]
    with matplotlib.rc_context(STYLE):
        found = [
            parameters_section(fit),
            _prediction(fit, pairs),
            Section("Measured and modelled paths", [_overlay(*pair) for pair in pairs]),
            Section("Residuals over time", [_residuals(pairs)]),
            knowledge_section(fit),
            convergence_section(fit),
        ]
    if nodes:
        found.insert(2, _nodes(nodes, chosen))
    return found


def parameters_section(fit: Fit) -> Section:
    """Return the section with every parameter, its interval and class, and the directions without information."""
    rows = [["parameter", "best start", "value", "95 % interval", "class", "alone", "goes with", "correlation"]]
    for p in fit.parameters:
        flat = p.kind == "flat"
        rows.append(
            [
                p.name,
                rounded(p.start, 4),
                format_value(p),
                format_interval(p),
                p.kind,
                with_unit(p.alone, p.unit, 2) if math.isfinite(p.alone) else "none",
                "" if flat or p.partner is None else p.partner,
                "" if flat or p.partner is None else f"{p.correlation:+.3f}",
            ]
        )
    U = fit.uncertainty
    kinds = [kind for kind in _MEANING if any(p.kind == kind for p in fit.parameters)]
    source = (
        "the covariance of the linearised fit for errors that correlate from reading to reading, by "
        f"{U.errors.first[1]:+.2f} as the residuals show"
        if U.correlated
        else "the covariance of the linearised fit: successive residuals are independent"
    )
    said = [
        Table(
            rows,
            "“alone”: standard error of the value if all others were known. "
            "The correlation is that with the parameter that it goes with most.",
        ),
        Text("Classes: " + "; ".join(f"{kind}: {_MEANING[kind]}" for kind in kinds) + "."),
    ]
    said.append(Text(f"Intervals are drawn from {source}." if fit.explains else f"No interval holds: {warning(fit)}."))
    flat = flat_directions(U)
    if flat:
        said.append(Text("What these recordings cannot tell: " + "; ".join(flat) + "."))
        ratios = [[name, f"{x:.5g}", f"{i[0]:.5g} to {i[1]:.5g}"] for name, (x, i) in known_ratios(fit).items()]
        if ratios:
            said.append(Table([["what they tell instead", "value (SI)", "95 % interval"], *ratios]))
    else:
        said.append(Text("No direction among the free parameters is unseen by these recordings."))
    return Section("Parameters", said)


_KNOWN = {"handle": "the handle's path was", "joints": "the measured joints were", "hand": "the hand's pose was"}


def _prediction(fit: Fit, pairs: Sequence[tuple[StrikeRecording, RecordingFit, str]]) -> Section:
    unit = "mrad" if any(f.angular for _, f, _ in pairs) else "mm"
    rows = [["recording", "", "frames", f"RMS [{unit}]", "RMS / stated error", "down-weighted"]]
    in_pixels = any(f.view is not None for _, f, _ in pairs)
    if in_pixels:
        rows[0].insert(4, "RMS [pixels]")
    deep = any(f.depth is not None for _, f, _ in pairs)
    if deep:
        rows[0].insert(5, "RMS of depth [mm]")
    for r, f, kind in pairs:
        down = f"{int((f.weight < 1).sum())} of {len(f.residuals)}"
        rows.append([_name(r), kind, str(len(r.t)), f"{1e3 * f.rmse:.3g}", f"{f.chi:.2f}", down])
        if in_pixels:
            rows[-1].insert(4, "" if f.pixels is None else f"{f.pixels:.3g}")
        if deep:
            rows[-1].insert(5, "" if f.depth is None else f"{1e3 * f.depth:.3g}")
    said = f"Residuals of all fitted recordings: {error_words(fit.recordings)} RMS per coordinate. "
    if in_pixels:
        said += "What a camera saw is judged in pixels; its errors in mm are those across its line of sight"
        said += ", those of depth along its optical axis. " if deep else ". "
    if not fit.held_out:
        said += "No recording was held out: how well the model predicts a new strike was not tested."
    else:
        said += (
            f"Held-out recordings, which no parameter was fitted to: {error_words(fit.held_out)} RMS per coordinate. "
            "If this is much more than for the fitted ones, the model does not hold for new strikes."
        )
        if any(f.predicted_from is not None for f in fit.held_out):
            part = known_part(fit.drive)[1]
            said += (
                f" They have their own unknowns, fitted to the {part} of their frames; the error is that of the others."
            )
        if fit.drive in _KNOWN:
            said += f" Of the motion of a held-out recording only {_KNOWN[fit.drive]} known."
    alike = [(r, kind, s) for r, f, kind in pairs if (s := similarity_of(r, f)) is not None]
    similar = [_similarities(alike), Text(_RHO)] if alike or not (in_pixels or unit == "mrad") else []
    return Section("Fit and held-out error", [Text(said), Table(rows), *similar])


_SIMILARITY = (
    "recording", "", *(f"rho {axis}" for axis in "xyz"), "rho mean", "NRMSE [%]", "largest [mm]", "delay [ms]",
    "Fréchet [mm]", "hit point [mm]", "hit time [ms]", "hit speed [m/s]",
)  # fmt: skip
_RHO = (
    "rho is the similarity of Eq. 23 (Wang, Xiong, Tolu and Gorb 2024), divided by the number of samples, which the "
    "paper's print leaves out; it depends on where the origin lies, here the arm's base, and samples at which it "
    "divides by zero are left out. It says little alone: see the errors next to it. Hit point, time and speed are "
    "those of the closest approach to the target, modelled minus measured, of a smooth path through the frames."
)


def _similarities(alike: Sequence[tuple[StrikeRecording, str, Similarity]]) -> Table:
    rows: list[list[str]] = [list(_SIMILARITY)]
    in_plane = all(len(s.rho) == 2 for _, _, s in alike)
    for r, kind, s in alike:
        hit = ["", "", ""]
        if s.hit_point is not None and s.hit_time is not None and s.hit_speed is not None:
            hit = [f"{1e3 * s.hit_point:.2f}", f"{1e3 * s.hit_time:+.2f}", f"{s.hit_speed:+.3f}"]
        numbers = [*(f"{x:.4f}" for x in s.rho), *[""] * (3 - len(s.rho)), f"{s.rho_mean:.4f}"]
        errors = [f"{100 * s.nrmse:.2f}", f"{1e3 * s.largest:.2f}", f"{1e3 * s.delay:+.2f}", f"{1e3 * s.frechet:.2f}"]
        rows.append([_name(r), kind, *numbers, *errors, *hit])
    if in_plane:
        z = _SIMILARITY.index("rho z")
        rows = [row[:z] + row[z + 1 :] for row in rows]
    return Table(rows, "Similarity of the modelled to the measured tip.")


def _nodes(nodes: Sequence[tuple[int, float, float]], chosen: int) -> Section:
    rows = [["N", "fitted RMS [mm]", "held-out RMS [mm]", ""]]
    rows += [[str(n), f"{1e3 * a:.3g}", f"{1e3 * b:.3g}", "taken" if n == chosen else ""] for n, a, b in nodes]
    return Section("Number of nodes", [Text("N is the one with the smallest held-out error."), Table(rows)])


def _overlay(recording: StrikeRecording, found: RecordingFit, kind: str) -> Picture:
    if recording.angular:
        return _angles(recording, found, kind)
    t, measured, _, name = tip_paths(recording, found)
    path, axes_of = found.path[name], _axes(recording)
    side = [0, 1 if recording.view is not None else len(axes_of) - 1]  # forward and upward
    figure = Figure(figsize=(10, 0.4 + 1.9 * len(axes_of)), layout="constrained")
    cells: list[HashableList[str]] = [["plane", axis] for axis in axes_of]
    axes = figure.subplot_mosaic(cells, width_ratios=[1, 1.25])
    shown = (found.t >= t[0] - 0.02) & (found.t <= t[-1] + 0.02)
    dots = {
        "linestyle": "",
        "marker": "o",
        "markersize": 5,
        "color": COLORS["orange"],
        "markeredgewidth": 0,
        "zorder": 2,
    }
    line = {"color": COLORS["blue"], "linewidth": 1.4, "zorder": 3}
    axes["plane"].plot(*path[shown][:, side].T, label="modelled", **line)
    axes["plane"].plot(*measured[:, side].T, label="measured", **dots)
    if (target := _target(recording)) is not None:
        where = [target[i] for i in side]
        axes["plane"].plot(*where, "x", color=COLORS["black"], markersize=9, label="target")
    axes["plane"].set(
        **{f"{which}label": _with_unit(recording, axes_of[i]) for which, i in zip("xy", side, strict=True)}
    )
    axes["plane"].set_title(verbatim(f"{_name(recording)}: {name}, {kind}"))
    axes["plane"].set_aspect("equal", adjustable="datalim")
    if recording.view is not None:
        axes["plane"].invert_yaxis()
    figure.legend(*axes["plane"].get_legend_handles_labels(), loc="outside upper right", ncols=3)
    for i, axis in enumerate(axes_of):
        axes[axis].plot(found.t[shown], path[shown, i], **line)
        axes[axis].plot(t, measured[:, i], **dots)
        axes[axis].set(ylabel=_with_unit(recording, axis))
        axes[axis].tick_params(labelbottom=axis == axes_of[-1])
    axes[axes_of[-1]].set(xlabel="time from the command's start [s]")
    caption = (
        f"{_name(recording)}, {kind}: {name} {_seen(recording)} and over time. RMS {error_words([found])} per "
        "coordinate. Points are means over an exposure, the line is the path itself."
    )
    return Picture(figure, caption)


def _angles(recording: StrikeRecording, found: RecordingFit, kind: str) -> Picture:
    figure = Figure(figsize=(10, 2.8), layout="constrained")
    ax = figure.subplots()
    inside = np.searchsorted(found.t, recording.t[-1])
    for i, (name, path) in enumerate(found.path.items()):
        measured = recording.points[:, recording.markers.index(name), 0]
        ax.plot(recording.t, measured, ".", markersize=2, color=f"C{i}", label=f"{name} measured")
        ax.plot(found.t[:inside], path[:inside, 0], linewidth=1, color=f"C{i}", label=f"{name} modelled")
    ax.set(xlabel="time [s]", ylabel="angle [rad]")
    ax.legend(fontsize=8, ncols=2)
    return Picture(figure, f"{_name(recording)}, {kind}: {error_words([found])} RMS.")


def _axes(recording: StrikeRecording) -> tuple[str, ...]:
    """Return the names of a recording's coordinates."""
    if recording.angular:
        return ("angle",)
    if recording.view is None:
        return ("x", "y", "z")[: recording.points.shape[2]]
    return ("u", "v") if recording.depth is None else ("u", "v", "depth")


def _seen(recording: StrikeRecording) -> str:
    """Return how a recording's path is shown, in words."""
    if recording.view is not None:
        return "in the camera's image"
    return "in the strike plane" if recording.points.shape[2] == 2 else "seen from the side"


def _with_unit(recording: StrikeRecording, axis: str) -> str:
    """Return the name of a coordinate with its unit."""
    return f"{axis} [{'m' if recording.view is None or axis == 'depth' else 'pixels'}]"


def _target(recording: StrikeRecording) -> Sequence[float] | np.ndarray | None:
    """Return where the target is in a recording's coordinates; None where it is not known."""
    if recording.view is None or recording.target is None:
        return recording.target
    return recording.view.project(np.array(recording.target)) if len(recording.target) == 3 else None


def _residuals(pairs: Sequence[tuple[StrikeRecording, RecordingFit, str]]) -> Picture:
    panels = [(pair, axes) for pair in pairs for axes in _panels(pair[0])]
    rows = -(-len(panels) // 2)
    figure = Figure(figsize=(10, 2.2 * rows + 0.6), layout="constrained")
    grid = figure.subplots(rows, 2, squeeze=False).ravel()
    for ax in grid[len(panels) :]:
        ax.remove()
    labels = {}
    for ax, ((recording, found, kind), axes) in zip(grid, panels, strict=False):
        t, measured, predicted, name = tip_paths(recording, found)
        deep = axes == ("depth",)
        unit, factor = ("mm", 1e3) if recording.view is None or deep else ("pixels", 1.0)
        unit = "mrad" if recording.angular else unit
        stated = 2 * factor * _stated(recording, name, t, deep=deep)
        ax.fill_between(t, -stated, stated, color="0.88", linewidth=0, label="±2 stated errors")
        for axis in axes:
            i = _axes(recording).index(axis)
            color, mark = (("blue", "o"), ("vermilion", "s"), ("black", "^"))[i]
            ax.plot(
                t,
                factor * (predicted - measured)[:, i],
                mark,
                linestyle="-",
                linewidth=0.7,
                markersize=2.5,
                color=COLORS[color],
                label=axis,
            )
        ax.set(title=verbatim(f"{_name(recording)}: {name}{', depth' if deep else ''}, {kind}"), ylabel=f"[{unit}]")
        labels |= dict(zip(*reversed(ax.get_legend_handles_labels()), strict=True))
    for ax in grid[max(len(panels) - 2, 0) : len(panels)]:
        ax.set_xlabel("time from the command's start [s]")
    figure.supylabel("modelled - measured", fontsize=11)
    figure.legend(labels.values(), labels.keys(), loc="outside upper right", ncols=len(labels))
    caption = (
        "Residuals. What is left over should look like noise within the grey band; waves are what the model, or what "
        "is said of the camera, cannot explain."
    )
    return Picture(figure, caption)


def _panels(recording: StrikeRecording) -> list[tuple[str, ...]]:
    """Return which coordinates share a panel: depth, in metres, has a separate one."""
    axes = _axes(recording)
    return [axes] if recording.depth is None else [axes[:2], axes[2:]]


def _stated(recording: StrikeRecording, name: str, t: np.ndarray, *, deep: bool) -> np.ndarray:
    """Return the stated errors of a marker, or of its depth, at times t, (T,)."""
    at = recording.markers.index(name)
    sigma = recording.depth_sigma[:, at] if deep else recording.sigma[:, at]
    there = recording.seen[:, at] & np.isfinite(sigma)
    return np.interp(t, recording.t_points[there, at], sigma[there]) if there.any() else np.zeros(len(t))


def knowledge_section(fit: Fit) -> Section:
    """Return the section with correlations and singular values."""
    U = fit.uncertainty
    names = [v.name for v in U.variables]
    size = 1.8 + 0.62 * len(names)
    figure = Figure(figsize=(size + 1.2, size), layout="constrained")
    ax = figure.subplots()
    image = ax.imshow(U.correlation, cmap="RdBu_r", vmin=-1, vmax=1)
    ax.grid(visible=False)
    ax.spines[:].set_visible(False)
    ax.set_xticks(range(len(names)), names, rotation=40, ha="right", rotation_mode="anchor")
    ax.set_yticks(range(len(names)), names)
    for (i, j), c in np.ndenumerate(U.correlation):
        ax.text(
            j,
            i,
            "1" if i == j else f"{c:+.3f}",
            ha="center",
            va="center",
            color="white" if abs(c) > 0.6 else "black",
            fontsize=9,
        )
    figure.colorbar(image, ax=ax, label="correlation", shrink=0.9)
    rows = [["singular value", *names, ""]]
    for s, direction, flat in zip(U.singular_values, U.directions, U.flat, strict=True):
        rows.append([f"{s:.4g}", *(f"{x:+.2f}" for x in direction), "flat" if flat else ""])
    text = (
        f"Condition number of the Jacobian with columns of unit length: {U.condition_number:.3g}. Variance of the "
        f"residuals over that of the stated errors: {U.residual_variance:.3g} (1 if model and stated errors are right)."
    )
    caption = (
        "Singular values of the Jacobian, largest first, by relative changes of the parameters, and the direction of "
        "each: the inverse is the direction's standard error. Flat: an error of 100 % or more, of a number that may be "
        "zero of ten times its usual size."
    )
    return Section(
        "What the recordings know",
        [Picture(figure, "Correlations of the estimates, flat directions left out."), Table(rows, caption), Text(text)],
    )


def convergence_section(fit: Fit) -> Section:
    """Return the section with the convergence from every starting point."""
    figure = Figure(figsize=(8, 3.6), layout="constrained")
    ax = figure.subplots()
    marks = "osD^vP*X"
    for i, run in enumerate(fit.runs):
        costs = [cost for cost, _, _ in run.solution.history]
        ax.plot(costs, marker=marks[i % len(marks)], markersize=5, label=f"start {i + 1}: {run.outcome}")
    ax.set(xlabel="accepted step", ylabel="cost", yscale="log")
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    ax.legend()
    names = [p.name for p in fit.parameters]
    rows = [["start", *(f"{n} from" for n in names), *(f"{n} to" for n in names), "cost", "steps"]]
    for i, run in enumerate(fit.runs):
        ends = [rounded(values[n], 4) for values in (run.start, run.values) for n in names]
        rows.append([str(i + 1), *ends, f"{run.solution.cost:.6g}", str(max(len(run.solution.history) - 1, 0))])
    text = "Every start, the best first. Values, intervals and classes are those of the best. "
    if len(fit.runs) == 1:
        text += "There was one start only: whether another would end lower was not tested."
    elif fit.failed:
        text += f"{len(fit.failed)} of {len(fit.runs)} failed: they ended far above the best, and say nothing."
    else:
        text += "All ended alike. Where their values differ, the answer is not unique."
    return Section("Convergence", [Text(text), Picture(figure, "Cost of every start, after each step."), Table(rows)])


def _name(recording: StrikeRecording) -> str:
    return Path(recording.source).name or "recording"
