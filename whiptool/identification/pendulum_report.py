"""The report of a pendulum's fit: what was fitted, how well it is known, and how well it predicts."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from whiptool.identification.fit_report import convergence_section, knowledge_section, parameters_section
from whiptool.identification.pendulum import AngleRecording
from whiptool.identification.results import Fit, RecordingFit
from whiptool.viz.plots import STYLE
from whiptool.viz.report import Picture, Section, Table, Text

_PLOTTED = 6  # swings, the held-out ones first


def sections(fit: Fit, fitted: Sequence[AngleRecording], held_out: Sequence[AngleRecording]) -> list[Section]:
    """The report's sections, for `whiptool.viz.report.to_html`.

    Args:
        fit: The fit.
        fitted, held_out: The swings, in the fit's order.
    """
    pairs = [(r, f, "held out") for r, f in zip(held_out, fit.held_out, strict=True)]
    pairs += [(r, f, "fitted") for r, f in zip(fitted, fit.recordings, strict=True)]
    with matplotlib.rc_context(STYLE):
        pictures = [_overlay(*pair) for pair in pairs[:_PLOTTED]]
        return [
            parameters_section(fit),
            _prediction(pairs),
            Section("Measured and modelled angles", list(pictures)),
            knowledge_section(fit),
            convergence_section(fit),
        ]


def _prediction(pairs: Sequence[tuple[AngleRecording, RecordingFit, str]]) -> Section:
    rows = [["swing", "", "samples", "RMS [mrad]", "RMS / stated error"]]
    rows += [[r.source, kind, str(len(r.t)), f"{1e3 * f.rmse:.3g}", f"{f.chi:.2f}"] for r, f, kind in pairs]
    said = "A held-out swing begins where its first samples say, and nothing else of it is fitted."
    return Section("Fit and held-out error", [Text(said), Table(rows)])


def _overlay(swing: AngleRecording, found: RecordingFit, kind: str) -> Picture:
    figure = Figure(figsize=(8, 2.8), layout="constrained")
    ax = figure.subplots()
    for i, (name, path) in enumerate(found.path.items()):
        ax.plot(swing.t, swing.angles[:, i], ".", markersize=2, color=f"C{i}", label=f"{name} measured")
        inside = np.searchsorted(found.t, swing.t[-1])
        ax.plot(found.t[:inside], path[:inside, 0], linewidth=1, color=f"C{i}", label=f"{name} modelled")
    ax.set(xlabel="time [s]", ylabel="angle [rad]")
    ax.legend(fontsize=8, ncols=2)
    return Picture(figure, f"{swing.source}, {kind}: {1e3 * found.rmse:.3g} mrad RMS.")
