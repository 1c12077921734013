"""Unknown whips: misses strike by strike, for a whip that is learned and for one that is not."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from papers.context import Context
from papers.unknown import ropes_report
from papers.unknown.calibration import calibration, forecasts, stated
from papers.unknown.scores import Scores
from papers.unknown.trials import Trials, hits, reliability
from papers.unknown.unknown_whips import (
    LOOKING,
    METHODS,
    OWN_PLAN,
    LookUnit,
    OpeningUnit,
    PolicyUnit,
    Study,
    WhipUnit,
)
from papers.unknown.whole_chain import ReachUnit, RigTransferUnit, RigUnit
from whiptool import Disc
from whiptool.adaptation.twins import FAMILIES
from whiptool.goals.target import HIT_RADIUS
from whiptool.viz.plots import COLORS, STYLE
from whiptool.viz.report import Picture, Section, Table, Text
from whiptool.words import counted, fixed, rounded

ZONE = Disc((1.15, 0.0), 0.1)
POOL = 60  # targets
RADII = (0.06, 0.03, 0.01)  # [m]
# mean trials within 6 cm, of `wiggle`, and within 3 cm (not of `wiggle`); median miss of the second strike [m]
GOALS = {"kin": (1.1, 1.05, 1.3, 0.005), "strange": (1.4, 1.15, 1.7, 0.01), "stranger": (1.5, 1.25, 1.9, 0.015)}
TRANSFER_GOAL, CALIBRATION_GOAL, TIME_GOAL = 0.95, 0.1, 2.0
COVERAGE_GOAL, BEYOND_GOAL = 0.05, 0.03
_OPENING = dict.fromkeys(METHODS, "robust") | {"nominal": "nominal", "correction": "nominal", "uniform": "uniform"}
_CHAIN = dict.fromkeys(FAMILIES, ("adapt", "still", "wiggle")) | {"kin": ("adapt", "still", "wiggle", "uniform")}
_LINES = {  # dashed: what learns nothing about the whip
    "nominal": ("black", "--"),
    "robust": ("pink", "--"),
    "correction": ("green", "--"),
    "sac": ("sky", "--"),
    "told": ("vermilion", "--"),
    "uniform": ("black", "-"),
    "adapt": ("blue", "-"),
    "still": ("orange", "-"),
    "wiggle": ("vermilion", "-"),
}


@dataclasses.dataclass(frozen=True)
class Size:
    """How much is tried.

    Args:
        whips: Whips of each family.
        targets: Targets of each whip.
        rigs: Whips of each family that go through the whole chain, at one target each.
        transfers: Whips of each family that are struck at further targets; and those of `strange` that are tried with
            `uniform`.
        further: Number of further.
        rig_transfers: Whips of each family that are struck at further targets through the whole chain.
        episodes: Episodes of SAC's training.
    """

    whips: int = 100
    targets: int = 3
    rigs: int = 20
    transfers: int = 10
    further: int = 20
    rig_transfers: int = 2
    episodes: int = 500  # the paper's

    @classmethod
    def of(cls, context: Context) -> Size:
        """Return the size of the study that a run asks for."""
        if context.quick:
            return cls(whips=1, targets=1, rigs=1, transfers=1, further=2, rig_transfers=0, episodes=4)
        few = max(1, context.whips // 5)
        rigs = min(20, few) if context.tries("chain") else 0
        return cls(whips=context.whips, targets=context.whip_targets, rigs=rigs, transfers=min(10, few))


def sections(context: Context) -> list[Section]:
    """Simulated strikes with the tip seen, transfer, the whole chain, calibration; or ropes in space."""
    if context.space:
        return ropes_report.sections(context)
    size, quick = Size.of(context), context.quick
    scene = dataclasses.replace(context.comparison.scene, zone=ZONE, targets=POOL)
    study = Study(scene=scene, strikes=2 if quick else 6, thorough=not quick)
    work, policies, excluded = _plan_work(context, study, size)
    results = context.store.results([*work, *policies], desc="unknown whips")
    rigs, again, passed = _rigs(context, study, size)
    if quick:
        rigs = rigs[-1:]  # a strike through servos and images takes long
    chain = context.store.results(rigs, desc="whole chain")
    further = context.store.results(again, desc="further targets")
    table: dict[tuple[str, str], Trials] = {}
    for family in FAMILIES:
        for method in METHODS:
            if method == "sac":
                trials = [results[p.key][f"{f}-{seed}"] for p in policies for f, seed, _ in p.whips if f == family]
            else:
                trials = [results[u.key]["trials"] for u in work if (u.family, u.method) == (family, method)]
            if any(trials):
                table[family, method] = Trials.of(trials)
    learned = {f: [results[u.key] for u in work if u.family == f and u.method in ("adapt", *LOOKING)] for f in FAMILIES}
    whole = {
        f: [
            *({"trials": [chain[u.key]], "transferred": []} for u in rigs if u.family == f and u.method != "uniform"),
            *({"trials": [], **further[u.key]} for u in again if u.family == f),
        ]
        for f in FAMILIES
    }
    through = [Section("Through servos, images and tracker", _chain(rigs, chain, passed))]
    return [
        Section(
            "Unknown whips, strike by strike",
            [
                Text(_about(study, size, excluded)),
                Table(_hits(table), "Share of trials that have hit within 6 cm at strike 1, 2, ..., and median miss."),
                Table(_trials(table), "Mean trials to a hit, 95 % intervals over whips, and share that ever hit."),
                Text(_OTHERS),
                Picture(_figure(table), "Median miss by strike number; shaded: 95 % intervals over whips."),
            ],
        ),
        Section(
            "Whips once learned, at other targets", [Text(_further(again, further)), Table(_transfer(learned, whole))]
        ),
        *(through if context.tries("chain") else []),
        Section("Does the planner know what it does not know?", calibration(learned, whole)),
        Section("Goals", [Table(_goals(table, learned, rigs, chain, whole), judges=True)]),
    ]


def _plan_work(context: Context, study: Study, size: Size) -> tuple[list[WhipUnit], list[PolicyUnit], int]:
    """The units of all whips; on the way there the first plans, which are worked on at once."""
    # a killed run has about as many of each family
    whips = [(family, seed) for seed in range(size.whips) for family in FAMILIES]
    within = {whip: study.within(study.twin(*whip)).tolist() for whip in whips}
    excluded = sum(not own for own in within.values())
    targets = {whip: tuple(own[: size.targets]) for whip, own in within.items() if own}
    used = sorted({(study.material(seed), t) for (_, seed), own in targets.items() for t in own})
    materials = sorted({material for material, _ in used})
    struck = {method for method in METHODS if context.tries(method) and method not in OWN_PLAN}
    looks = {material: LookUnit(study=study, material=material) for material in materials if context.tries("wiggle")}
    openings = {
        (kind, material, t): OpeningUnit(study=study, kind=kind, material=material, target=t)
        for kind in sorted({kind for method, kind in _OPENING.items() if method in struck})
        for material, t in used
    }
    known = context.store.results([*looks.values(), *openings.values()], desc="first plans")
    work = []
    # fits that cannot explain what was seen take long, and a few of them say all
    uniform = {"kin": size.whips, "strange": size.transfers, "stranger": 0}
    for (family, seed), own in targets.items():
        material = study.material(seed)
        for method in METHODS:
            if method == "sac" or not context.tries(method) or (method == "uniform" and seed >= uniform[family]):
                continue
            further = method == "adapt" and seed < size.transfers
            work.append(
                WhipUnit(
                    study=study,
                    family=family,
                    seed=seed,
                    method=method,
                    targets=own,
                    openings={}
                    if method in OWN_PLAN
                    else {t: known[openings[_OPENING[method], material, t].key] for t in own},
                    look=tuple(known[looks[material].key]["strike"]) if method == "wiggle" else (),
                    transfer=tuple(within[family, seed][size.targets :][: size.further]) if further else (),
                )
            )
    policies = [
        PolicyUnit(
            study=study,
            material=material,
            whips=tuple((f, s, own) for (f, s), own in targets.items() if study.material(s) == material),
            episodes=size.episodes,
        )
        for material in materials
        if context.tries("sac")
    ]
    return work, policies, excluded


def _rigs(
    context: Context, study: Study, size: Size
) -> tuple[list[RigUnit], list[RigTransferUnit], dict[str, list[int]]]:
    """What goes through the whole chain, at one target and at further ones; and, by family, how many whips reach
    nothing there and how many targets were passed over."""
    # a killed run has about as many of each family
    reach = [ReachUnit(study=study, family=f, seed=seed) for seed in range(size.rigs) for f in FAMILIES]
    known = context.store.results(reach, desc="within the motors' reach")
    found, again, passed = [], [], {family: [0, 0] for family in FAMILIES}
    for unit in reach:
        target = known[unit.key]["target"]
        passed[unit.family][0] += target is None
        passed[unit.family][1] += known[unit.key]["passed"]
        if target is not None:
            own = {"study": study, "family": unit.family, "seed": unit.seed, "target": target}
            found += [RigUnit(**own, method=method) for method in _CHAIN[unit.family]]
            if unit.seed < size.rig_transfers:
                others = study.within(study.twin(unit.family, unit.seed)).tolist()
                others.remove(target)
                again.append(RigTransferUnit(**own, further=tuple(others[: size.further])))
    return found, again, passed


def _about(study: Study, size: Size, excluded: int) -> str:
    return (
        "Whips of cotton, leather, nylon, silicone or steel chain, in turn, drawn by seed from what handbooks and data "
        "sheets say of each (whiptool.adaptation.materials). The prior is that of the material, which is all that is "
        "known of a whip; the model is the uniform whip in the middle of it. kin: uniform. strange: 36 nodes, a cone "
        "with random deviations, a bead, a soft joint, rest curvature, springs that stiffen with the bend, less drag "
        "along the whip than across, uneven friction, a wrong arm and a late camera. stranger: twice these deviations. "
        f"{counted(size.whips, 'whip')} of each family, {counted(size.targets, 'target')} each, out of {POOL} in a "
        f"circle of radius {ZONE.radius:g} m around {ZONE.centre} m, those within the whip's own reach"
        + (f"; {counted(excluded, 'whip')} reach none of them and are left out. " if excluded else ". ")
        + "The tip is seen 60 times a second with 5 mm noise, more than images give; there are no servos. At most "
        f"{counted(study.strikes, 'strike')}; a look before the first one counts as none, and only still and wiggle "
        "have it. A strike that is judged to be within 1 cm, from what was seen, is repeated. Misses are "
        "the twin's own. " + " ".join(f"{name}: {what}." for name, what in METHODS.items())
    )


_OTHERS = (
    "For comparison, on real whips and ropes, and so not the same task: published strikes without a second try miss by "
    "3.6 cm, iterated ones end near 2 cm after up to nine tries, people need a median of two throws to come within "
    "6 cm. All numbers here are of simulated twins."
)


def _hits(table: dict[tuple[str, str], Trials]) -> list[list[str]]:
    strikes = next(iter(table.values())).miss.shape[1]
    header = ["family", "method", "trials", *(f"hit by {i + 1}" for i in range(strikes))]
    rows = [header + [f"miss {i + 1} [cm]" for i in range(strikes)]]
    for (family, method), t in table.items():
        hit = np.logical_or.accumulate(t.hits(HIT_RADIUS), axis=1).mean(axis=0)
        median = np.median(t.miss, axis=0)
        rows.append([family, method, str(len(t.miss)), *(f"{100 * x:.0f} %" for x in hit)])
        rows[-1] += [fixed(100 * x) for x in median]
    return rows


def _trials(table: dict[tuple[str, str], Trials]) -> list[list[str]]:
    rows = [["family", "method", *(f"within {100 * r:g} cm" for r in RADII)]]
    for (family, method), t in table.items():
        cells = []
        for r in RADII:
            number = t.trials(r)
            low, high = t.interval(number)
            cells.append(f"{number.mean():.2f} ({low:.2f} to {high:.2f}), {100 * t.hits(r).any(axis=1).mean():.0f} %")
        rows.append([family, method, *cells])
    return rows


def _figure(table: dict[tuple[str, str], Trials]) -> Figure:
    with matplotlib.rc_context(STYLE):
        figure = Figure((12, 4.2), layout="constrained")
        axes = figure.subplots(1, len(FAMILIES), sharey=True)
        for ax, family in zip(axes, FAMILIES, strict=True):
            plot_misses(ax, {m: t for (f, m), t in table.items() if f == family}, title=family)
            ax.label_outer()
        figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper left", ncols=len(METHODS))
    return figure


def plot_misses(ax: Axes, by_method: dict[str, Trials], *, title: str = "") -> Axes:
    """Median miss [cm] of each method by strike number, with intervals, and the hit radius."""
    for method, t in by_method.items():
        number = np.arange(1, t.miss.shape[1] + 1)
        ends = np.array([t.interval(column, np.median) for column in t.miss.T])
        color, dashes = COLORS[_LINES[method][0]], _LINES[method][1]
        ax.fill_between(number, *100 * ends.T, color=color, alpha=0.15, linewidth=0)
        median = 100 * np.median(t.miss, axis=0)
        ax.plot(number, median, marker="o", linestyle=dashes, color=color, markersize=4, label=method)
    ax.axhline(100 * HIT_RADIUS, color="0.4", linestyle="--", linewidth=1.2)
    ax.set(yscale="log", xlabel="strike", ylabel="median miss [cm]", title=title)
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    ax.yaxis.set_major_formatter("{x:g}")
    return ax


def _further(again: list[RigTransferUnit], further: dict[str, dict[str, Any]]) -> str:
    said = "Learned at one target, without a look before; then struck once at each of others."
    if again:
        asked, passed = sum(len(unit.further) for unit in again), sum(r["passed"] for r in further.values())
        faults = sum(bool(x["fault"]) for r in further.values() for x in r["transferred"])
        said += (
            f" Through the whole chain {passed} of {asked} others are left out, which the motors do not reach even "
            f"with the true whip known; {counted(faults, 'strike')} ended in a fault."
        )
    return said


def _transfer(learned: dict[str, list[dict[str, Any]]], whole: dict[str, list[dict[str, Any]]]) -> list[list[str]]:
    rows = [["family", "through", "whips", "strikes", "hit at once within 6 cm", "within 3 cm", "median miss [cm]"]]
    for through, by_family in (("tip seen", learned), ("whole chain", whole)):
        for family, results in by_family.items():
            whips = [r["transferred"] for r in results if r["transferred"]]
            if whips:
                miss = _misses([x for whip in whips for x in whip])
                shares = [f"{100 * hits(miss, r).mean():.0f} %" for r in RADII[:2]]
                said = [family, through, str(len(whips)), str(len(miss))]
                rows.append([*said, *shares, fixed(100 * np.median(miss))])
    return rows


def _misses(rows: Sequence[dict[str, Any]]) -> np.ndarray:
    return np.array([np.inf if row["miss"] is None else row["miss"] for row in rows])


def _chain(rigs: list[RigUnit], chain: dict[str, dict[str, Any]], passed: dict[str, list[int]]) -> list[Text | Table]:
    if not rigs:
        return [Text("The motors reach no target with any of the whips.")]
    strikes, seen = rigs[0].study.strikes, "rendered infrared images and the tracker"
    if not rigs[0].study.thorough:
        seen = "the tip's position with the error of images (quick form)"
    radii, numbers = [f"within {100 * r:g} cm" for r in RADII], [f"miss {i + 1} [cm]" for i in range(strikes)]
    rows = [["family", "method", "whips", "hit by 1", "hit by 2", *radii, *numbers]]
    for (family, method), t in _whole(rigs, chain).items():
        means = [f"{t.trials(r).mean():.2f} ({100 * t.hits(r).any(axis=1).mean():.0f} %)" for r in RADII]
        hit = np.logical_or.accumulate(t.hits(HIT_RADIUS), axis=1).mean(axis=0)[:2]
        said = [family, method, str(len(t.miss)), *(f"{100 * x:.0f} %" for x in hit), *means]
        rows.append([*said, *(fixed(100 * x) for x in np.median(t.miss, axis=0))])
    faults = sum(bool(fault) for result in chain.values() for fault in result["faults"])
    over = "; ".join(f"{family}: {targets} ({whips})" for family, (whips, targets) in passed.items())
    text = (
        f"The same through emulated servos with friction, current limits and latency, {seen}, within the motors' "
        "limits, which leaves slow strikes only. Each whip gets the first of its targets that the motors reach when "
        "the true whip is known; targets passed over (and whips left out): "
        f"{over}. " + (f"{counted(faults, 'strike')} ended in a fault." if faults else "No strike ended in a fault.")
    )
    return [Text(text), Table(rows, "Mean trials to a hit (share that ever hit), and median miss by strike.")]


def _whole(rigs: list[RigUnit], chain: dict[str, dict[str, Any]]) -> dict[tuple[str, str], Trials]:
    found = {}
    for family in FAMILIES:
        for method in _CHAIN[family]:
            own = [[chain[u.key]] for u in rigs if (u.family, u.method) == (family, method)]
            if own:
                found[family, method] = Trials.of(own)
    return found


def _goals(
    table: dict[tuple[str, str], Trials],
    learned: dict[str, list[dict[str, Any]]],
    rigs: list[RigUnit],
    chain: dict[str, dict[str, Any]],
    through: dict[str, list[dict[str, Any]]],
) -> list[list[str]]:
    rows = [["", "goal", "tip seen", "whole chain", "met"]]
    whole = _whole(rigs, chain)

    def add(what: str, goal: float, tip: float | None, full: float | None, *, least: bool = False) -> None:
        known = [x for x in (tip, full) if x is not None]
        if not known:
            return  # no row that was tried says it
        met = all(x >= goal if least else x <= goal for x in known)
        said = ["" if x is None else rounded(x) for x in (tip, full)]
        rows.append([what, f"{'>=' if least else '<='} {goal:g}", *said, "yes" if met else "no"])

    def add_scores(family: str, firsts: list[Scores | None], alls: list[Scores | None]) -> None:
        worse = [x.brier - x.brier_constant if x else None for x in firsts]
        add(f"{family}: Brier score of first strikes, less that of the best constant forecast", 0.0, *worse)
        for i, level in enumerate((0.5, 0.9)):
            off = [abs(x.within[i] - level) if x else None for x in alls]
            add(f"{family}: share of misses within the predicted {level:.0%}, distance from it", COVERAGE_GOAL, *off)
        add(f"{family}: misses beyond all samples", BEYOND_GOAL, *(x.beyond if x else None for x in alls))

    for family, (six, wiggled, three, miss) in GOALS.items():
        for method, said in (("adapt", "unseen"), ("still", "filmed as it hangs"), ("wiggle", "after a slow movement")):
            tip, full = table.get((family, method)), whole.get((family, method))
            if tip is None:
                continue
            what, goal = f"{family}, {said}: ", wiggled if method == "wiggle" else six
            add(what + "mean trials within 6 cm", goal, *(x.trials(0.06).mean() if x else None for x in (tip, full)))
            if method == "wiggle":
                continue
            add(what + "mean trials within 3 cm", three, *(x.trials(0.03).mean() if x else None for x in (tip, full)))
            second = [100 * float(np.median(x.miss[:, 1])) if x else None for x in (tip, full)]
            add(what + "median miss of the second strike [cm]", 100 * miss, *second)
    for family in FAMILIES:
        both = learned[family], through[family]
        for what, first in (("calibration error", False), ("calibration error of first strikes", True)):
            errors = [reliability(*stated(r, first=first))[1] if r else None for r in both]
            add(f"{family}: {what}", CALIBRATION_GOAL, *errors)
        firsts, alls = ([Scores.of(forecasts(r, first=one)) if r else None for r in both] for one in (True, False))
        add_scores(family, firsts, alls)
        again = [[x for r in results for x in r["transferred"]] for results in both]
        shares = [float(hits(_misses(x), HIT_RADIUS).mean()) if x else None for x in again]
        if any(again):
            add(f"{family}: first hits at other targets", TRANSFER_GOAL, *shares, least=True)
    seconds = [x for r in learned.values() for one in r for t in one["trials"] for x in t["seconds"][1:]]
    slow = [x for r in chain.values() for x in r["seconds"][1:]]
    times = [float(np.median(x)) if x else None for x in (seconds, slow)]
    add("median time to learn and plan [s]", TIME_GOAL, *times)
    return rows
