"""Charts of a run in the page's panel."""

from __future__ import annotations

from dataclasses import replace
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np

from whiptool.following.run_view import Chart, Curve
from whiptool.viz.style import CYCLE

if TYPE_CHECKING:
    from viser import GuiApi

MOST = 800  # points of a curve that are sent to the page
_LINES = {"grid": {"stroke": "rgba(128, 128, 128, 0.18)", "width": 1}, "ticks": {"show": False}}
_WHOLE = tuple(m * 10**k for k in range(7) for m in (1, 2, 5))  # between numbers along x
_AXES: Any = ({"size": 34, "incrs": _WHOLE, **_LINES}, {"size": 58, **_LINES})  # [px] of the numbers along x and y
_PADDING = (12, 12, 0, 0)  # [px] above, right, below and left, so that the outermost numbers of the axes are whole
_ASPECT = 1.6  # width over height
_LEAST = 0.01  # [mm], what is nearer is drawn there on a logarithmic axis


def columns(chart: Chart, most: int = MOST) -> tuple[np.ndarray, ...]:
    """Return a chart's x and the values of each curve there, (K,) each, in its `drawn_unit`; all are finite.

    Between two of its points a curve is interpolated; before its first and after its last point it keeps the value of
    that point. The page's charts show nothing where a value is not a number.
    """
    x = np.unique(np.concatenate([curve.thinned(most).x for curve in chart.curves])).astype(float)
    values = [np.interp(x, curve.x, curve.y) for curve in chart.curves]
    if drawn_unit(chart) == "mm":
        values = [np.maximum(1e3 * y, _LEAST) for y in values]
    return x, *values


def drawn_unit(chart: Chart) -> str:
    """Return the unit in which a chart is drawn: logarithmic axes of the page write no small numbers."""
    return "mm" if chart.logarithmic and chart.unit == "m" else chart.unit


def _known(chart: Chart) -> Chart | None:
    """Return a chart without values that are not finite; None: nothing is left."""
    curves = [Curve(c.name, *(part[np.isfinite(c.y)] for part in (c.x, c.y))) for c in chart.curves]
    kept = tuple(curve for curve in curves if len(curve.x))
    return replace(chart, curves=kept) if kept else None


class ChartPanel:
    """Charts that are made when they first have values, and then get further values.

    Args:
        gui: Panel of the page.
    """

    def __init__(self, gui: GuiApi) -> None:
        self._gui = gui
        self._handles: dict[str, tuple[tuple[str, ...], Any]] = {}  # names of the curves, and the chart

    def show(self, charts: tuple[Chart, ...]) -> None:
        """Show charts with their present values."""
        for chart in filter(None, map(_known, charts)):
            names, data = tuple(curve.name for curve in chart.curves), columns(chart)
            before, handle = self._handles.get(chart.title, ((), None))
            if handle is not None and names == before:
                handle.data = data
                continue
            if handle is not None:
                handle.remove()
            self._handles[chart.title] = names, self._add(chart, data)

    def _add(self, chart: Chart, data: tuple[np.ndarray, ...]) -> Any:
        series: list[Any] = [{"label": chart.across}]
        for curve, color in zip(chart.curves, cycle(CYCLE), strict=False):
            series.append({"label": curve.name, "stroke": color, "width": 2, "points": {"show": False}})
        scales: Any = {"x": {"time": False}, "y": {"distr": 3 if chart.logarithmic else 1}}
        unit = drawn_unit(chart)
        title = f"{chart.title}{f' [{unit}]' if unit else ''} by {chart.across}"
        return self._gui.add_uplot(
            data,
            tuple(series),
            title=title,
            scales=scales,
            axes=_AXES,
            legend={"show": True},
            aspect=_ASPECT,
            padding=_PADDING,
        )
