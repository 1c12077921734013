"""What the report says of the whip: numbers with intervals, measured and modelled cascades, and a uniform whip."""

from __future__ import annotations

from typing import Any

import numpy as np

from papers.human import pictures
from papers.human.bullwhip import Cascade
from papers.human.cascade_fit import (
    DISCRETE,
    Explained,
    Measured,
    fit_cascade,
    measured,
    predicted,
    resampled,
)
from papers.human.reading import STYLES, People
from whiptool.viz.report import Picture, Section, Table, Text


def whip_section(people: People, resamples: int) -> tuple[dict[str, Any], Section]:
    seen = {style: measured(people, style) for style in STYLES}
    best = fit_cascade(seen[DISCRETE])
    refitted = fit_cascade(seen[DISCRETE], first=best.x, uniform=True)
    bare = best.x.copy()
    bare[-3] = 0.0  # the same path and whip, without the taper
    intervals = resampled(people, best, resamples) if resamples else {}
    names = {"tapered": best.x, "uniform, same throw": bare, "uniform, own throw": refitted.x}
    models = {style: _cascades(names, seen[style]) for style in STYLES}
    result = {
        "numbers": best.numbers,
        "intervals": {name: list(interval) for name, interval in intervals.items()},
        "costs": {"tapered": best.cost, "uniform": refitted.cost},
        **{style: {name: _off(one, seen[style]) for name, one in models[style].items()} for style in STYLES},
    }
    tapered = {style: models[style]["tapered"] for style in STYLES if "tapered" in models[style]}
    parts = [
        Text(
            "A thong clamped to a handle whose end moves with people's mean hand speed. Assumed: one vertical plane, "
            "in which the directions of hand and handle are smooth splines through seven instants. They are fitted "
            "with the whip to the discrete style's peaks and times, its speeds at both ends, the whip's mean shape at "
            "peak hand speed and the target's place. The rhythmic throw repeats the same path with its own speed: "
            "nothing of it is fitted."
        ),
        _numbers_table(best, refitted, intervals),
        Picture(pictures.cascade_picture(seen, models), "Peaks and their times along the whip."),
        Picture(pictures.throw_picture(tapered, seen), "Speeds of the markers of the tapered whip."),
        _off_table(seen, models),
    ]
    return result, Section("The whip of the task", parts)


def _cascades(names: dict[str, np.ndarray], seen: Measured) -> dict[str, Cascade]:
    found = {name: predicted(x, seen.hand) for name, x in names.items()}
    return {name: one for name, one in found.items() if one is not None}


def _off(one: Cascade, seen: Measured) -> dict[str, list[float]]:
    return {
        "peaks": one.peaks.tolist(),
        "peaks_off": (one.peaks / seen.peaks - 1).tolist(),
        "times": one.times.tolist(),
        "times_off": (one.times - seen.times).tolist(),
    }


def _numbers_table(best: Explained, uniform: Explained, intervals: dict[str, tuple[float, float]]) -> Table:
    words = {
        "stiffness": "EI at the handle, for 0.3 kg/m there [N m²]",
        "taper": "diameter at the tip over that at the handle",
        "damping_time": "damping over stiffness [s]",
        "grip": "from hand to thong [m]",
    }
    rows = [["number", "tapered", "95 % (people resampled)", "uniform, own throw"]]
    for name, said in words.items():
        interval = " to ".join(f"{x:.3g}" for x in intervals[name]) if intervals else "not computed"
        rows.append([said, f"{best.numbers[name]:.3g}", interval, f"{uniform.numbers[name]:.3g}"])
    rows.append(["half the sum of squared residuals", f"{best.cost:.1f}", "", f"{uniform.cost:.1f}"])
    return Table(rows)


def _off_table(seen: dict[str, Measured], models: dict[str, dict[str, Cascade]]) -> Table:
    rows = [["style", "whip", "peaks off, largest [%]", "peaks within 10 %", "times off, largest", "times within 0.05"]]
    for style, of in models.items():
        for name, one in of.items():
            off = _off(one, seen[style])
            peaks, times = np.abs(off["peaks_off"]), np.abs(off["times_off"])
            counts = [f"{int((x <= y).sum())} of {len(x)}" for x, y in ((peaks, 0.1), (times, 0.05))]
            rows.append([style, name, f"{100 * peaks.max():.1f}", counts[0], f"{times.max():.3f}", counts[1]])
    return Table(rows, "Ten markers; the eleventh is the hand, whose speed drives the whip.")
