"""Summary of a fit, as plain data and as text."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.identification.plant import BareArm
from whiptool.identification.readings import NEUTRAL, SMOOTHING
from whiptool.identification.results import DEPTH_AXIS, Fit, RecordingFit, root_mean_square
from whiptool.identification.similarity import Similarity, similarity
from whiptool.identification.time_base import DELAY, RATE, ClockFault
from whiptool.identification.uncertainty import MISFIT, Parameter, Uncertainty
from whiptool.identification.variables import Variable, unit_of, with_unit
from whiptool.recording.strike_recording import StrikeRecording, assumed_size
from whiptool.words import rounded

ABOVE = 1.5  # misfit from which more than half of the squared residuals is not what the stated errors leave
_ALIKE = "frames that were lost or stamped twice have a similar effect"
_SHARE = 0.05  # part of a direction from which a number belongs to it


def format_value(p: Parameter) -> str:
    """Return a parameter's value with its unit as text."""
    return with_unit(p.value, p.unit)


def format_interval(p: Parameter) -> str:
    """Return a parameter's 95 % interval as text, or "none"."""
    if p.interval is None:
        return "none"
    return " to ".join(rounded(x, 5) if math.isfinite(x) else "no bound" for x in p.interval)


def parameter_lines(fit: Fit) -> list[str]:
    """Return lines of text: one per parameter, per direction without information, and per ratio that is determined."""
    width = max(len(p.name) for p in fit.parameters)
    lines = []
    for p in fit.parameters:
        partner = f" with {p.partner} ({p.correlation:+.3f})" if p.kind in ("traded", "weak") and p.partner else ""
        lines.append(f"  {p.name:{width}s}  {format_value(p):24s} {format_interval(p):24s} {p.kind}{partner}")
    lines += [f"  not seen: {words}" for words in flat_directions(fit.uncertainty)]
    ratios = known_ratios(fit).items()
    return lines + [f"  {name}: {x:.5g}, {low:.5g} to {high:.5g}" for name, (x, (low, high)) in ratios]


def bound_lines(fit: Fit) -> list[str]:
    """Return a sentence for each parameter that ended at a bound, with the bound and the starting value."""
    lines = []
    for p in fit.parameters:
        if p.name not in fit.at_bounds:
            continue
        if p.value == 0:
            lines.append(f"{p.name} ended at 0, its smallest possible value")
        else:
            bound, start = f"{fit.at_bounds[p.name]} bound, {format_value(p)}", with_unit(p.start, p.unit)
            lines.append(f"{p.name} ended at its {bound} (it started at {start}), and is not an estimate")
    return lines


def misfit_line(fit: Fit) -> str:
    """Return the misfit as text, with the reason if the fit is not valid."""
    said = f"{fit.misfit:.2f} (RMS residual in standard errors; about 1 if the model fits)"
    if fit.explains and fit.misfit <= ABOVE:
        return said
    if fit.explains:
        share = f"{1 - 1 / fit.misfit**2:.0%} of the squared residuals are more than the stated errors leave"
        return f"{said}: {share}; intervals hold only if that is noise, and not the model's{_worst_words(fit)}"
    if fit.smoothed:
        return f"{said}; the tracks were smoothed before export"
    if fit.clock_fault is not None:
        return f"{said}; the times of {_source(fit, fit.clock_fault.recording)} are off"
    return f"{said}: above {MISFIT:g}, the model does not explain the recordings"


def assumed_errors(fit: Fit, recordings: Sequence[StrikeRecording]) -> list[str]:
    """Return as text that the errors are far above the residuals, or that those which were assumed of all recordings
    are far below them, and which standard error would explain them.
    """
    ((size, error, key), *others) = {(assumed_size(one), one.assumed_error, one.sigma_assumed) for one in recordings}
    assumed = bool(error) and not others
    if not fit.explains or 1 / ABOVE < fit.misfit < ABOVE or not (assumed or fit.misfit < 1):
        return []
    found = f"{fit.misfit * error:.2g}" if assumed else ""
    if fit.misfit > 1:
        return [f"{size} was assumed; if the markers are as far off as the residuals, say {key} = {found}"]
    times = f"{1 / max(fit.misfit, 1e-9):.2g} times"
    said = f"{size} was assumed, {times} as much as" if assumed else f"the standard errors are {times} what"
    said += " the readings scatter: intervals go by the scatter, but measured motions and a prior count for too much"
    return [f"{said}; say {key} = {found}" if assumed else f"{said}; state smaller ones, unless tracks were smoothed"]


def own_lines(fit: Fit) -> list[str]:
    """Return as text the value and interval of each recording's separate unknowns (`per_recording`)."""
    lines = []
    for i, one in enumerate(fit.recordings):
        for name, value in one.own.items():
            if name not in (*NEUTRAL, SMOOTHING):
                continue
            edge = f" (a filter of {1 / abs(value):.3g} Hz)" if name == SMOOTHING and value else ""
            interval = " to ".join(rounded(x, 5) for x in one.intervals.get(name, ())) or "none"
            lines.append(f"{name} of {_source(fit, i)}: {with_unit(value, unit_of(name))}{edge}, {interval}")
    return lines


def lag_lines(fit: Fit) -> list[str]:
    """Return as text how far the robot of each recording was behind its command, if that was fitted."""
    recordings, lines = [*fit.recordings, *fit.held_out], []
    for i, own in enumerate(found.own for found in recordings):
        if "lag" in own:
            lag, delay, shape = 1e3 * own["lag"], 1e3 * own["lag_delay"], own["lag_shape"]
            name = recordings[i].source or f"recording {i + 1}"
            lines.append(f"{name}: the robot lags by {lag:.1f} ms after a delay of {delay:.1f} ms (shape {shape:.2f})")
    return lines


def freed_line(fit: Fit) -> str:
    """Return as text how many directions of each measured motion of the base were fitted, too; empty if none was."""
    counts = [sum(name.startswith("motion[") for name in found.own) for found in (*fit.recordings, *fit.held_out)]
    if fit.drive not in ("joints", "hand") or not any(counts):
        return ""
    return f"{', '.join(map(str, counts))} directions of its motion that the logs leave open were fitted, too"


def warning(fit: Fit) -> str | None:
    """Return the warning that all classes and intervals are withdrawn, with the reason; None if the fit is valid."""
    if fit.explains:
        return None
    if fit.smoothed:
        edges = ", ".join(f"{_source(fit, i)} at {edge:.2g} Hz" for i, edge in enumerate(fit.smoothed))
        said = f"the tracks seem to be smoothed before export, which took the fast motion from them: {edges}"
    elif fit.clock_fault is not None:
        said = f"{_clock_words(fit, fit.clock_fault)}. If they are right, the model lacks a similar effect"
    else:
        largest = max(fit.misfit, math.sqrt(fit.uncertainty.residual_variance))
        said = f"the model does not explain the recordings: the RMS residual is {largest:.1f} standard errors"
        said += _worst_words(fit)
    return f"{said}. Classes and intervals are withdrawn; do not rely on the values"


def lost(fit: Fit) -> str:
    """Return as text that a whip's fit is of no use, for its errors are larger than the whip; empty if they are not."""
    error = root_mean_square(fit.recordings)
    if isinstance(fit.plant.model, BareArm) or error is None or error < fit.model.whip.length:
        return ""
    times = f"{error / fit.model.whip.length:.3g} times the whip's length"
    return f"the error is {times}: this is no fit; check units, axes, origin, and when the strike began"


def _clock_words(fit: Fit, fault: ClockFault) -> str:
    """What is wrong with a recording's times, and what mends it."""
    size, error, side = 1e3 * abs(fault.size), 1e3 * fault.error, "late" if fault.size > 0 else "early"
    of = f"the times of {_source(fit, fault.recording)} seem to be wrong"
    if fault.kind == RATE:
        fast = "fast" if fault.size > 0 else "slow"
        return (
            f"{of}: its clock runs {size / 10:.2g} % {fast} (standard error {error / 10:.1g} %); correct its frame "
            f"rate, or free clock_rate ({_ALIKE})"
        )
    if fault.kind == DELAY:
        said = f"{of}: they are {size:.3g} ms too {side} (standard error {error:.1g} ms)"
        return f"{said}; correct its start time, or free delay ({_ALIKE})"
    cause = "stamped twice" if fault.size > 0 else "lost"
    return (
        f"{of}: from about {fault.at:.3f} s on they are {size:.3g} ms too {side} ({fault.frames:.2g} frames; standard "
        f"error {error:.1g} ms), as if frames had been {cause}; correct the times there, or keep only the part before"
    )


def _worst_words(fit: Fit) -> str:
    """Which of several recordings is worst explained."""
    if len(fit.recordings) < 2:
        return ""
    chi = [found.chi for found in fit.recordings]
    worst = int(np.argmax(chi))
    others = max(x for i, x in enumerate(chi) if i != worst)
    return f" (most in {_source(fit, worst)}: {chi[worst]:.1f} times; of the others at most {others:.1f})"


def _source(fit: Fit, recording: int) -> str:
    return fit.recordings[recording].source or f"recording {recording + 1}"


def recording_facts(recordings: Sequence[StrikeRecording]) -> dict[str, str]:
    """Return for each recording, by the name of its file, a description of its source and content."""
    facts = {}
    for recording in recordings:
        about = recording.provenance
        seen = ", ".join(f"{marker} {count}" for marker, count in about["markers"].items())
        name = Path(recording.source).name
        facts[recording.source if name in facts else name] = (
            f"{recording.source}; {about['camera'] or 'camera not named'}; {about['frames']} frames; seen: {seen}; "
            f"sha256 {recording.sha256}"
        )
    return facts


def tip_paths(recording: StrikeRecording, found: RecordingFit) -> tuple[np.ndarray, np.ndarray, np.ndarray, str]:
    """Return times (S,) [s], measured and predicted positions (S, d) [m], and the name of the marker: the tip or,
    without a tip, the last marker.

    For an arm's angles the positions are angles [rad]; for a camera in space they are pixels, followed by depth [m] if
    it was measured.
    """
    which = found.markers.index("tip") if "tip" in found.markers else len(found.markers) - 1
    mine = found.channels[:, 1] == which
    frames = np.unique(found.channels[mine, 0])
    axes = int(found.channels[:, 2].max()) + 1 if recording.depth is None else DEPTH_AXIS + 1
    measured, predicted = np.full((2, len(frames), axes), np.nan)
    at = np.searchsorted(frames, found.channels[mine, 0]), found.channels[mine, 2]
    measured[at] = found.measured[mine]
    predicted[at] = (found.measured + found.residuals)[mine]
    name = found.markers[which]
    if recording.depth is not None:  # its inverse was read
        measured[:, DEPTH_AXIS], predicted[:, DEPTH_AXIS] = 1 / measured[:, DEPTH_AXIS], 1 / predicted[:, DEPTH_AXIS]
    return recording.t_points[frames, recording.markers.index(name)], measured, predicted, name


def similarity_of(recording: StrikeRecording, found: RecordingFit) -> Similarity | None:
    """Return the similarity of measured and predicted tip path; None for angles, for a camera in space, or if too
    little was seen."""
    if recording.view is not None or recording.angular:
        return None
    t, measured, predicted, _ = tip_paths(recording, found)
    try:
        return similarity(t, measured, predicted, target=recording.target)
    except InputError:
        return None


def error_words(found: Sequence[RecordingFit]) -> str:
    """Return the root mean square error of recordings as text: in mm or mrad, for cameras in space also in pixels,
    and of depth.
    """
    metres, pixels, depth = (root_mean_square(found, of) for of in ("places", "pixels", "depth"))
    said = [] if pixels is None else [f"{pixels:.3g} pixels"]
    said += [] if depth is None else [f"depth {1e3 * depth:.3g} mm"]
    unit = "mrad" if any(r.angular for r in found) else "mm"
    return f"{1e3 * (metres or 0.0):.3g} {unit}" + (f" ({', '.join(said)})" if said else "")


def coverage_words(found: Sequence[RecordingFit]) -> str:
    """Return as text which shares of the readings of held-out recordings lie within their predictive intervals."""
    counts = [len(r.residuals) for r in found]
    half, most = (np.average([r.coverage(level) for r in found], weights=counts) for level in (0.5, 0.9))
    return f"{half:.0%} of the readings within their 50 % intervals, {most:.0%} within their 90 % intervals"


def flat_directions(uncertainty: Uncertainty) -> list[str]:
    """Return each direction in parameter space on which the recordings have no information, as text."""
    U, said = uncertainty, []
    for change, direction, seen in zip(U.flat_changes, U.directions[U.flat], U.singular_values[U.flat], strict=True):
        moved = np.flatnonzero(np.abs(change) > _SHARE).tolist()
        positive = [i for i in moved if U.variables[i].log and U.units[i] == 1]
        lead = max(positive or moved, key=lambda i: abs(direction[i]))
        names = [U.variables[i].name for i in moved]
        if len(moved) == 1:
            step = abs(direction[lead] * U.units[lead])
            said.append(f"{names[0]} alone: {_bound(U.variables[lead], float(step), float(seen))}")
        elif np.ptp(change[moved]) < 0.1 * np.abs(change[moved]).max():
            said.append(f"{_listed(names)} all multiplied by the same factor: only their ratios are determined")
        else:
            steps = direction * U.units / (direction[lead] * U.units[lead])
            each = ", ".join(_change(U, i, float(steps[i]), bool(positive)) for i in moved)
            said.append(f"changed together, {each}: the predictions do not change")
    return said


def _change(U: Uncertainty, i: int, step: float, by_hundredth: bool) -> str:
    """By how much a number changes while the leading one changes by a hundredth, or by its usual size if that may be
    zero; in its unit if it may be zero or nearly so."""
    v = U.variables[i]
    if v.log and U.units[i] == 1:
        return f"{v.name} by {step:+.2g} %"
    changed = step * (v.value(U.z[i]) if v.log else v.scale)
    return f"{v.name} by {changed / (100 if by_hundredth else 1):+.2g} {v.unit}".rstrip()


def _bound(v: Variable, step: float, seen: float) -> str:
    """How little a single number is bounded, a step of which has this singular value, less than 1."""
    if v.log and seen > 0.2:
        return f"known to no better than a factor of {np.exp(step / seen):.2g}"
    if not v.log and seen > 0.01:
        return f"its standard error is {step / seen * v.scale:.2g} {v.unit}".rstrip()
    return "all values fit equally well"


def seen_ratios(uncertainty: Uncertainty) -> dict[str, tuple[float, tuple[float, float]]]:
    """Return ratios that are determined although their parameters are not, such as `whip.k / whip.m`, with 95 %
    intervals.
    """
    U = uncertainty
    unseen = [
        v.name for v, x in zip(U.variables, U.flat_changes.T, strict=True) if v.log and (np.abs(x) > _SHARE).any()
    ]
    if len(unseen) < 2:
        return {}
    below = "whip.m" if "whip.m" in unseen else unseen[-1]
    found = {f"{name} / {below}": U.product({name: 1, below: -1}) for name in unseen if name != below}
    return {name: (value, interval) for name, (value, interval) in found.items() if interval is not None}


def known_ratios(fit: Fit) -> dict[str, tuple[float, tuple[float, float]]]:
    """Return the determined ratios of a fit, see `seen_ratios`; empty if its intervals are withdrawn."""
    return seen_ratios(fit.uncertainty) if fit.explains else {}


def _listed(names: list[str]) -> str:
    return ", ".join(names[:-1]) + " and " + names[-1]


def fit_table(fit: Fit, fitted: Sequence[StrikeRecording], held_out: Sequence[StrikeRecording]) -> dict[str, Any]:
    """Return a fit as plain data for JSON, in SI units, with None for missing values."""
    U = fit.uncertainty
    pairs = [(r, f, False) for r, f in zip(fitted, fit.recordings, strict=True)]
    pairs += [(r, f, True) for r, f in zip(held_out, fit.held_out, strict=True)]
    return {
        "status": fit.status.name.lower(),
        "converged": fit.converged,
        "message": fit.status.value,
        "misfit": fit.misfit,
        "warning": warning(fit),
        "remarks": list(fit.remarks),
        "smoothed": list(fit.smoothed),
        "clock_fault": None if fit.clock_fault is None else _fault_table(fit, fit.clock_fault),
        "drive": fit.drive,
        "parameters": [
            {
                "name": p.name,
                "value": p.value,
                "unit": p.unit,
                "start": p.start,
                "class": p.kind,
                "standard_error": finite(p.error),
                "interval": None if p.interval is None else [finite(x) for x in p.interval],
                "standard_error_if_all_others_were_known": finite(p.alone),
                "partner": p.partner,
                "correlation": finite(p.correlation),
            }
            for p in fit.parameters
        ],
        "intervals_from": "correlated errors" if U.correlated else "covariance",
        "correlation": U.correlation.tolist(),
        "singular_values": [finite(x) for x in U.singular_values],
        "condition_number": finite(U.condition_number),
        "flat_directions": flat_directions(U),
        "ratios": [{"name": n, "value": x, "interval": list(i)} for n, (x, i) in known_ratios(fit).items()],
        "residual_variance": finite(U.residual_variance),
        "residual_correlation": finite(U.whiteness),
        "nuisance": fit.nuisance,
        "rmse": root_mean_square(fit.recordings),
        "held_out_rmse": root_mean_square(fit.held_out),
        "rmse_pixels": root_mean_square(fit.recordings, "pixels"),
        "held_out_rmse_pixels": root_mean_square(fit.held_out, "pixels"),
        "rmse_depth": root_mean_square(fit.recordings, "depth"),
        "held_out_rmse_depth": root_mean_square(fit.held_out, "depth"),
        "recordings": [_recording_table(*pair) for pair in pairs],
        "starts": [
            {
                "start": run.start,
                "values": run.values,
                "cost": finite(run.solution.cost),
                "cost_over_best": finite(run.over_best),
                "failed": bool(run.failed),
                "status": run.solution.status.name.lower(),
                "steps": max(len(run.solution.history) - 1, 0),
                "evaluations": run.solution.evaluations,
            }
            for run in fit.runs
        ],
        "fit_time": fit.wall_time,
    }


def _fault_table(fit: Fit, fault: ClockFault) -> dict[str, Any]:
    found = {"kind": fault.kind, "size": fault.size, "standard_error": fault.error, "at": fault.at}
    return {"source": _source(fit, fault.recording), **found, "p_value": fault.p_value}


def _recording_table(recording: StrikeRecording, found: RecordingFit, held_out: bool) -> dict[str, Any]:
    alike = similarity_of(recording, found)
    own = {name: x for name, x in found.own.items() if not name.startswith("motion[")}  # hundreds of coefficients
    return {
        **recording.provenance,
        "held_out": held_out,
        "predicted_from": finite(found.predicted_from),
        "rmse": found.rmse,
        "rmse_pixels": found.pixels,
        "rmse_depth": found.depth,
        "rms_over_stated_error": found.chi,
        "n_residuals": len(found.residuals),
        "down_weighted": int((found.weight < 1).sum()),
        "own": own,
        "own_intervals": {name: [finite(x) for x in ends] for name, ends in found.intervals.items()},
        "predictive": None
        if found.spread is None
        else {
            "coverage_50": found.coverage(0.5),
            "coverage_90": found.coverage(0.9),
            "half_width_90": found.half_width(0.9),
        },
        "similarity": None if alike is None else {k: _plain(x) for k, x in dataclasses.asdict(alike).items()},
    }


def _plain(x: Any) -> Any:
    return [finite(float(y)) for y in x] if isinstance(x, tuple) else finite(x)


def finite(x: float | None) -> float | None:
    """Return x, or None if it is not finite, because JSON has neither NaN nor infinity."""
    return None if x is None or not math.isfinite(x) else x if isinstance(x, int) else float(x)
