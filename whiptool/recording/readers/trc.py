"""TRC files, as OpenSim, Cortex and Pose2Sim write markers' trajectories.

Rate and units come from the header. Empty cells, `NaN` and exactly (0, 0, 0) are missing points. The format does not
state its axes: y is taken as up, as OpenSim has it, and x as forward.
"""

from __future__ import annotations

from whiptool.errors import InputError
from whiptool.recording.readers import mocap
from whiptool.recording.readers.mocap import Capture, numbers
from whiptool.recording.readers.programs import TRC
from whiptool.recording.readers.sidecar import Sidecar


def _capture(rows: list[list[str]], side: Sidecar) -> Capture:
    """What the rows of a TRC file hold."""
    said = dict(zip(rows[1], rows[2]))
    head = next((i for i, row in enumerate(rows) if row[:1] == ["Frame#"]), None)
    if head is None:
        raise InputError("rows", "no row that begins with Frame#", f"that row, as in {TRC.what}")
    names = rows[head][2:]
    spaced = not any(name for i, name in enumerate(names) if i % 3)  # each over the first of its columns
    names = names[::3] if spaced else [name for name in names if name]
    names = mocap.padded(names, said, "NumMarkers", rows[head + 2 :], 2)
    table = numbers(rows, head + 2, range(2 + 3 * len(names)), 2 + 3 * len(names))
    rate = mocap.rate_of(said.get("DataRate"), "DataRate")
    t, clock = mocap.even_times(table[:, 1], table[:, 0], rate, "the column Time")
    return Capture(
        what=TRC.what,
        t=t,
        clock=clock,
        points=table[:, 2:].reshape(len(table), len(names), 3),
        labels=names,
        units=mocap.unit_of(said.get("Units", ""), "Units", side),
        forward="x",
        up="y",
        axes="y is up, as OpenSim has it, for the file does not say it, x taken as forward",
        notes=mocap.announced(said, "NumFrames", len(table))
        + mocap.announced(said, "NumMarkers", len(names), "markers"),
    )


read_trc = mocap.text_reader("TRC", "\t", _capture)
