"""Texts on an adaptation: lines for the terminal after each strike, and the sections of its report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.ticker import FuncFormatter, LogLocator, MultipleLocator, NullFormatter

from whiptool.adaptation.posterior import AFTER, usable
from whiptool.adaptation.prior import Belief, fresh_terms
from whiptool.adaptation.steps import Step, percent
from whiptool.goals.goals import CLAIMED
from whiptool.goals.target import Target, base_name
from whiptool.identification.variables import with_unit
from whiptool.models.strike import T_STAY
from whiptool.recording.filmed_approach import approach_seen
from whiptool.rollout.compiled import CompiledRollout
from whiptool.viz.drawn_posture import arm_and_whip, at_times
from whiptool.viz.report import Picture, Section, Table, Text
from whiptool.viz.style import COLORS, STYLE
from whiptool.words import counted, rounded

SHOWN = 6  # numbers that are listed after each strike and have a colour: those that narrowed most
PANELS = 6  # strikes that are drawn
CONTRADICTS = 3.0  # standard errors of the belief before, from which a new value contradicts it
_RATE = 1000.0  # [1/s] of a drawn path
_NONE = "–"


@dataclass(frozen=True)
class _Number:
    """One number of a belief and of the prior; errors as in `Belief.errors`."""

    name: str
    relative: bool
    prior: float
    before: float
    value: float
    after: float
    moved: float  # in standard errors of the prior
    marks: tuple[str, ...]
    unit: str

    def error(self, size: float) -> str:
        """An error with its unit."""
        if self.relative and size >= 1:
            return f"{100 * size:.0f} %"
        return f"{100 * size:.2g} %" if self.relative else f"{size:.2g} {self.unit}".strip()

    @property
    def narrowing(self) -> str:
        """How the error changed, in words; the same two figures say that it stayed."""
        old, new = self.error(self.before), self.error(self.after)
        return f"{old}, as before" if old == new else f"{old} -> {new}"


def lines(step: Step, prior: Belief, previous: Belief | None = None) -> list[str]:
    """Return the lines that the terminal shows after a strike; standard errors are compared with those of `prior`,
    before any recording, and `previous` is the belief before this strike (None: the prior).
    """
    o, p, learned = step.outcome, step.plan, step.learned
    said = [f"{_name(step)}: {p.reason}"]
    if o.fault:
        said.append(f"  fault          {o.fault}")
    if o.refused:
        said.append(f"  refused        {o.refused}")
    if step.number:
        said.append(f"  outcome        {_outcome(step)}")
    if o.recording is not None and o.recording.remarks:
        said.append(f"  recording      {'; '.join(o.recording.remarks)}")
    if learned is None:
        return said
    if learned.rmse:
        numbers = _numbers(learned.belief, prior, previous or prior)
        shown = [n for i, n in enumerate(numbers) if i < SHOWN or n.marks]
        few = len(numbers) > SHOWN
        said.append(f"  {SHOWN} of {len(numbers)} parameters, those that narrowed most" if few else "  all parameters")
        for i, n in enumerate(shown):
            if i == SHOWN:
                said.append("  other parameters")
            value = with_unit(n.value, n.unit, 4)
            marks = "".join(f"; {mark}" for mark in n.marks)
            said.append(f"    {n.name:26s} {value:18s} error {n.narrowing}{marks}")
    else:
        said.append("  learned        nothing: no recording was used")
    said += [f"  not used       {source}: {reason}" for source, reason in learned.refused.items()]
    if learned.rmse:
        said.append(f"  model error    {100 * learned.belief.model_error.scale:.2f} cm")
    return [*said, f"  time           {p.wall_time:.1f} s planned, {learned.wall_time:.1f} s learned"]


def sections(steps: Sequence[Step], prior: Belief, target: Target) -> list[Section]:
    """Return the report's sections, for `whiptool.viz.report.to_html`; of the steps in order, the first may be the
    measurement before the first strike.
    """
    if not steps:
        return [Section("Strikes", [Text("No strike was made.")])]
    beliefs = [prior]
    for step in steps:
        beliefs.append(beliefs[-1] if step.learned is None else step.learned.belief)
    paths = [_Path.of(step, belief, target) for step, belief in zip(steps, beliefs[1:], strict=True)]
    with matplotlib.rc_context(STYLE):
        found = [_strikes(steps, paths, target), Section("Paths of the tip", [_plane(steps, paths, target)])]
        if any(step.learned is not None and step.learned.rmse for step in steps):
            numbers = _numbers(beliefs[-1], prior, beliefs[-2])
            found.append(Section("How the numbers narrowed", [_narrowed(steps, beliefs, numbers)]))
            found.append(_values(numbers, beliefs[-1]))
        else:
            found.append(Section("The whip", [Text("No recording was used, so nothing was learned about the whip.")]))
    return [*found, _unused(steps)]


def _numbers(belief: Belief, prior: Belief, previous: Belief) -> list[_Number]:
    """All numbers, those first that narrowed most."""
    before, after, was, now = prior.errors(), belief.errors(), prior.values(), belief.values()
    jump = np.abs(belief.z - previous.z) / np.sqrt(np.diag(previous.covariance))
    moved = (belief.z - prior.z) / np.sqrt(np.diag(prior.covariance))
    found = []
    for i, v in enumerate(belief.variables):
        marks = []
        if v.bound(belief.z[i]):
            marks.append("at its bound")
        if jump[i] > CONTRADICTS:
            marks.append("contradicts the estimate before")
        x = v.name
        found.append(_Number(x, v.log, was[x], before[x], now[x], after[x], float(moved[i]), tuple(marks), v.unit))
    return sorted(found, key=lambda n: n.after / n.before)


def _name(step: Step) -> str:
    return f"strike {step.number}" if step.number else "first look"


def _used(step: Step) -> bool:
    """Whether the strike's own recording taught something."""
    r = step.outcome.recording
    return r is not None and step.learned is not None and r.source in step.learned.rmse


def _verdict(step: Step) -> str:
    return "not seen" if step.judged is None else step.judged.verdict


def _centimetres(miss: float | None) -> str:
    return _NONE if miss is None else f"{100 * miss:.2f}"


def _judged_centimetres(step: Step) -> str:
    return _NONE if step.judged is None else f"{100 * step.judged.miss:.2f} ± {100 * step.judged.error:.2f}"


def _chance(step: Step) -> str:
    return _NONE if step.judged is None else percent(step.judged.probability)


def _outcome(step: Step) -> str:
    seen, true, judged = step.outcome.seen_miss, step.outcome.true_miss, step.judged
    parts = []
    if judged is not None:
        by = "from the learned whip and the camera" if _used(step) else "from the camera"
        parts.append(f"estimated miss {judged} {by}, hit probability {percent(judged.probability)}")
    if seen is not None:
        parts.append(f"{_length(seen)} in the camera's frames")
    if true is not None:
        parts.append(f"true miss {_length(true)}, known to the twin only")
    if step.plan.probability is not None:
        parts.append(f"predicted hit probability {step.plan.probability:.0%}")
    return f"{_verdict(step)}: {'; '.join(parts)}" if parts else _verdict(step)


def _length(miss: float) -> str:
    return f"{100 * miss:.2f} cm" if np.isfinite(miss) else "out of all bounds"


@dataclass(frozen=True, eq=False)
class _Path:
    """The tip's path that the posterior mean after a strike predicts for that strike, and one posture."""

    t: np.ndarray
    points: np.ndarray  # (S, d) [m]
    nearest: float  # [s]
    speed: str  # [m/s]
    arm: np.ndarray  # (A, d) [m], at the closest approach, of a first look at its start
    whip: np.ndarray  # (N + 1, d) [m], then

    @classmethod
    def of(cls, step: Step, belief: Belief, target: Target) -> _Path:
        plant, recording = belief.at(), step.outcome.recording
        assert plant.controller is not None
        stood = None if recording is None else recording.stood
        rollout = CompiledRollout(plant.model, plant.controller, free=fresh_terms(belief), sag=stood)
        vector, t_stay = np.array([step.plan.strike]), T_STAY if recording is None else recording.t_stay
        near = rollout.approach(vector, np.array(target.position), t_stay=t_stay)
        t, points, _ = rollout.tip_path(vector, t_stay=t_stay, rate=_RATE)
        if near.diverged[0]:  # its path leaves all bounds
            points[:] = np.nan
        speed = _NONE
        if _used(step) and not near.diverged[0]:
            speed = f"{near.speed[0]:.1f}"
        elif recording is not None:
            seen = approach_seen(recording, target.position) if "tip" in recording.markers else None
            speed = _NONE if seen is None else f"about {seen.speed:.1f}"
        shown = rollout.trajectory(vector[0], t_stay=t_stay)
        instant = near.time[:1] if step.number else np.zeros(1)
        arms, whips = arm_and_whip(plant.model, at_times(instant, shown.t, shown.q))
        return cls(t, points[0], float(near.time[0]), speed, arms[0], whips[0])


def _strikes(steps: Sequence[Step], paths: Sequence[_Path], target: Target) -> Section:
    head = ["strike", "stated probability", "judged miss [cm]", "hit, as judged", "camera [cm]", "truth [cm]"]
    rows = [[*head, "outcome", "tip speed [m/s]", "model error [cm]", "planned [s]", "learned [s]"]]
    for step, path in zip(steps, paths, strict=True):
        p, o, learned = step.plan, step.outcome, step.learned
        misses = [_judged_centimetres(step), _chance(step), _centimetres(o.seen_miss), _centimetres(o.true_miss)]
        misses = misses if step.number else [_NONE] * 4
        number = str(step.number) if step.number else "0, first look"
        stated = _NONE if p.probability is None else f"{p.probability:.0%}"
        kind = "fault, " if o.fault else "refused, " if o.refused else ""
        verdict = kind + (_verdict(step) if step.number else "not to hit")
        error = f"{100 * learned.belief.model_error.scale:.2f}" if learned is not None and learned.rmse else _NONE
        spent = _NONE if learned is None else f"{learned.wall_time:.1f}"
        rows.append([number, stated, *misses, verdict, path.speed, error, f"{p.wall_time:.1f}", spent])
    caption = (
        "Judged: miss distance and its standard error, by the learned whip and the camera together if the strike's "
        f"recording was used, else by the camera; a hit is claimed from a probability of {CLAIMED:.0%}, a miss up to "
        f"{1 - CLAIMED:.0%}. "
        "Truth: known to a twin only, and not used. Tip speed: of the learned whip at its closest approach; “about”: "
        "of a smooth path through the frames. Model error: how far the tip may be from where the learned whip has it."
    )
    place, r = ", ".join(f"{x:g}" for x in target.position), target.hit_radius
    said = f"Target at ({place}) m, hit radius {100 * r:g} cm. "
    strikes = [step for step in steps if step.number]
    hit = next((step for step in strikes if step.hit), None)
    said += f"First hit: strike {hit.number}." if hit else f"No hit in {counted(len(strikes), 'strike')}."
    plans = [Text(f"{_name(step).capitalize()}: {step.plan.reason}.") for step in steps]
    return Section("Strikes", [Text(said), Table(rows, caption), *plans])


def _plane(steps: Sequence[Step], paths: Sequence[_Path], target: Target) -> Picture:
    pairs = list(zip(steps, paths, strict=True))
    chosen = pairs if len(pairs) <= PANELS else [pairs[0], *pairs[1 - PANELS :]]
    columns = min(3, len(chosen))
    rows = -(-len(chosen) // columns)
    figure = Figure(figsize=(max(3.5 * columns, 6.0), 3.7 * rows + 0.6), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    for ax in grid.ravel()[len(chosen) :]:
        ax.remove()
    for ax, (step, path) in zip(grid.ravel(), chosen, strict=False):
        _panel(ax, step, path, target)
    for i, ax in enumerate(grid.ravel()[: len(chosen)]):
        if i + columns >= len(chosen):
            ax.tick_params(labelbottom=True)
            ax.set_xlabel("x, forward [cm]")
    in_space = len(target.position) == 3
    seen = "seen from the side" if in_space else "in the strike plane"
    for ax in grid[:, 0]:
        ax.set_ylabel("z, up [cm]" if in_space else "y, up [cm]")
    labels: dict[str, Any] = {}
    for ax in grid.ravel()[: len(chosen)]:
        labels |= dict(zip(*reversed(ax.get_legend_handles_labels()), strict=True))
    figure.legend(labels.values(), labels.keys(), loc="outside upper left", ncols=3 if columns > 1 else 2)
    caption = (
        f"The tip {seen}, as recorded and as predicted with the posterior mean after the strike; solid "
        f"until {AFTER:g} s after its closest approach to the target. Arm and whip as predicted at the closest "
        "approach, in the first look at its start. Recordings are cut so long after the camera's closest frame or the "
        "planned contact, whichever is later."
    )
    if len(chosen) < len(pairs):
        caption += f" The first and the last {PANELS - 1} of {len(pairs)} strikes."
    return Picture(figure, caption)


def _panel(ax: Axes, step: Step, path: _Path, target: Target) -> None:
    """Draw the tip of one strike from the side, with the target; places in m, ticks in cm."""
    _draw_tip(ax, step, path, [0, len(target.position) - 1])
    place, r = (target.position[0], target.position[-1]), target.hit_radius
    ax.add_patch(Circle(place, r, facecolor="#F8E1B0", edgecolor=COLORS["orange"], linewidth=1.6, zorder=1))
    ring = {"color": "#F8E1B0", "markeredgecolor": COLORS["orange"], "markersize": 9}
    ax.plot([], [], "o", label=f"target, hit radius {100 * r:g} cm", **ring)
    ax.plot(
        0,
        0,
        "+",
        color=COLORS["black"],
        markersize=11,
        markeredgewidth=2,
        zorder=4,
        label=base_name(len(target.position)),
    )
    title = _name(step)
    if step.number:
        title += f": {_verdict(step)}" + ("" if step.judged is None else f", {_judged_centimetres(step)} cm")
    ax.set(aspect="equal", title=title)
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(MultipleLocator(0.5))
        axis.set_major_formatter(FuncFormatter(lambda x, _: f"{100 * x:.0f}"))


def _draw_tip(ax: Axes, step: Step, path: _Path, side: list[int]) -> None:
    """Draw the tip as recorded and as the posterior mean has it, by the two coordinates `side`, and one posture."""
    points, used, notes = np.zeros((0, 2)), np.zeros(0, bool), []
    recording = step.outcome.recording
    if recording is not None and "tip" in recording.markers:
        points = recording.marker("tip")[:, side]
        used = np.zeros(len(points), bool)
        if _used(step):
            cut, _ = usable(recording, step.plan.contact)
            tip = recording.markers.index("tip")
            used = used if cut is None else cut.seen[:, tip]
            if used.sum() == 1:  # at rest, where one frame stands for the median of all
                used = recording.seen[:, tip]
    else:
        notes.append("nothing recorded")
    if np.isnan(path.points).all():
        notes.append("the whip of the posterior mean diverges")
    ax.text(0.03, 0.03, "\n".join(notes), transform=ax.transAxes, color="0.4", fontsize=10)
    dots = {"linestyle": "none", "marker": "o", "markeredgewidth": 0}
    ax.plot(*points[used].T, color=COLORS["blue"], markersize=4.5, label="recorded tip, learned from", **dots)
    ax.plot(*points[~used].T, color="0.65", markersize=3, label="recorded tip, not learned from", **dots)
    late, line = path.t > path.nearest + AFTER, {"color": COLORS["vermilion"], "zorder": 3}
    ax.plot(*path.points[~late][:, side].T, linewidth=1.2, label="tip, posterior mean", **line)
    ax.plot(*path.points[late][:, side].T, linewidth=0.8, linestyle=":", **line)
    if not np.isnan(path.points).all():
        ax.plot(*path.arm[:, side].T, color=COLORS["black"], linewidth=2.6, alpha=0.45, zorder=1.8, label="arm")
        ax.plot(*path.whip[:, side].T, color=COLORS["black"], linewidth=1.0, alpha=0.6, zorder=1.8, label="whip")
    if step.number:
        nearest = path.points[np.abs(path.t - path.nearest).argmin(), side]
        edge = {"markeredgecolor": "white", "markersize": 6}
        ax.plot(*nearest, "D", color=COLORS["vermilion"], zorder=5, label="its closest approach", **edge)


def _narrowed(steps: Sequence[Step], beliefs: Sequence[Belief], numbers: Sequence[_Number]) -> Picture:
    prior = beliefs[0].errors()
    ratios = {n.name: np.array([b.errors()[n.name] / prior[n.name] for b in beliefs]) for n in numbers}
    figure = Figure(figsize=(9, 4.6), layout="constrained")
    ax = figure.subplots()
    for n in numbers[SHOWN:]:
        ax.plot(ratios[n.name], color="0.75", linewidth=1)
    top = numbers[:SHOWN]
    for n, color, mark in zip(top, list(COLORS.values())[:SHOWN], "os^Dvh", strict=False):
        ax.plot(ratios[n.name], mark, linestyle="-", color=color, markersize=5, clip_on=False)
    ax.set(yscale="log", ylabel="standard error / that of the prior", xlim=(-0.1, len(steps)))
    ax.set_xticks(range(len(beliefs)), ["prior", *(_name(step) for step in steps)])
    ax.grid(visible=False, axis="x")
    low, high = ax.get_ylim()
    ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high / low < 100 else (1.0,)))
    ax.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{y:g}"))
    ax.yaxis.set_minor_formatter(NullFormatter())
    ends = np.log10([ratios[n.name][-1] for n in top])
    places = 10 ** _spread(ends, 0.06 * np.log10(high / low))
    for n, place, color in zip(top, places, COLORS.values(), strict=False):
        at = (len(steps), float(ratios[n.name][-1]))
        line = {"arrowstyle": "-", "color": color, "linewidth": 0.8}
        beside, about = (len(steps) * 1.06, float(place)), {"color": color, "va": "center"}
        ax.annotate(n.name, at, beside, annotation_clip=False, arrowprops=line, **about)
    caption = (
        "Standard error of each number, in parts of the prior's, after each strike; those in colour narrowed most."
    )
    if len(numbers) > SHOWN:
        caption += f" Grey: the other {len(numbers) - SHOWN}."
    return Picture(figure, caption)


def _spread(places: np.ndarray, gap: float) -> np.ndarray:
    """Places in rising order moved up, so that no two are nearer than a gap."""
    moved = places.copy()
    order = np.argsort(places, kind="stable")
    for below, above in pairwise(order):
        moved[above] = max(moved[above], moved[below] + gap)
    return moved


def _values(numbers: Sequence[_Number], belief: Belief) -> Section:
    rows = [["number", "unit", "prior", "error", "now", "error", "narrowed by", "moved", ""]]
    for n in numbers:
        was, now = [rounded(n.prior, 4), n.error(n.before)], [rounded(n.value, 4), n.error(n.after)]
        moved = [f"{n.before / n.after:.3g}", f"{n.moved:+.1f}", ", ".join(n.marks)]
        rows.append([n.name, n.unit, *was, *now, *moved])
    caption = (
        "One standard error each: relative where a number is positive, else in its unit. “Moved”: from the prior's "
        "value, in the prior's standard errors. Those that narrowed most come first."
    )
    error = belief.model_error
    text = (
        f"The tip may pass {100 * error.scale:.2f} cm from where this whip has it (scale of Student's t with "
        f"{error.freedom:g} degrees of freedom). The errors of single numbers hold; a region of several numbers "
        "together is larger than their covariance says, for the posterior bends: "
        "whiptool.adaptation.posterior_sample.sample_posterior gives it."
    )
    return Section("Posterior of the whip", [Table(rows, caption), Text(text)])


def _unused(steps: Sequence[Step]) -> Section:
    rows: dict[tuple[str, str], list[str]] = {}
    for step in steps:
        for source, reason in {} if step.learned is None else step.learned.refused.items():
            rows.setdefault((source, reason), []).append(_name(step))
    parts: list[Text | Table] = []
    if rows:
        table = [["recording", "why it was not used", "when learning after"]]
        table += [[*key, ", ".join(after)] for key, after in rows.items()]
        caption = "Every recording is looked at again after each strike: one that was not used may be used later."
        parts.append(Table(table, caption))
    for step in steps:
        for how, why in (("fault", step.outcome.fault), ("refused", step.outcome.refused)):
            parts += [Text(f"{_name(step).capitalize()}, {how}: {why}")] if why else []
    unseen = [_name(step) for step in steps if step.outcome.recording is None]
    if unseen:
        parts.append(Text(f"No recording of the tip: {', '.join(unseen)}."))
    if all(step.learned is None for step in steps):
        parts.append(Text("No recording was learned from."))
    return Section("Recordings that were not used", parts or [Text("None: every recording was used.")])
