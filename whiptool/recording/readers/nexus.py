"""CSV exports of Vicon Nexus, with a section of trajectories.

Of the sections (Devices, Model Outputs, Trajectories, ...) the trajectories are read: their rate, the markers' names,
the units, and a row for each frame, frame 1 being at 0 s. An empty cell is a missing point; velocities and
accelerations are left out. Nexus does not write its axes: z is taken as up, as is Vicon's own convention, and x as
forward.
"""

from __future__ import annotations

from whiptool.errors import InputError
from whiptool.recording.readers import mocap
from whiptool.recording.readers.mocap import Capture, numbers
from whiptool.recording.readers.programs import NEXUS
from whiptool.recording.readers.sidecar import Sidecar

TRACKS = "Trajectories"
SECTIONS = (TRACKS, "Joints", "Segments", "Model Outputs", "Devices", "Events")


def _capture(rows: list[list[str]], side: Sidecar) -> Capture:
    """What the rows of a CSV export of Nexus hold."""
    sections = {row[0]: i for i, row in enumerate(rows) if len(row) == 1 and row[0] in SECTIONS}
    if TRACKS not in sections:
        given = f"{NEXUS.what} with {', '.join(sections)}, without trajectories"
        raise InputError("contents", given, "the section Trajectories", "export it, too, or read the trial's C3D")
    at = sections.pop(TRACKS)
    if len(rows) < at + 6:
        raise InputError("contents", f"{NEXUS.what} whose trajectories are empty", "at least two frames")
    (rate, *_), names, axes, units = rows[at + 1 : at + 5]
    labels, columns = mocap.grouped(names, axes)
    end = next((i for i in range(at + 5, len(rows)) if not rows[i] or rows[i][0] in SECTIONS), len(rows))
    table = numbers(rows[:end], at + 5, [0, *(i for found in columns for i in found)], len(axes))
    per_second = mocap.rate_of(rate, "rate of the trajectories")
    said = {units[i] for found in columns for i in found if i < len(units)} or {""}
    if len(said) > 1:
        raise InputError("units", ", ".join(sorted(said)), "one unit for all trajectories")
    return Capture(
        what=NEXUS.what,
        t=(table[:, 0] - 1) / per_second,
        clock=f"times by frame number at {per_second:g} a second, frame 1 at 0",
        points=table[:, 1:].reshape(len(table), len(columns), 3),
        labels=labels,
        units=mocap.unit_of(said.pop(), "units of the trajectories", side),
        forward="x",
        up="z",
        axes="z is up, as is Vicon's own convention, for the file does not say it, x taken as forward",
        notes=(f"left out the sections {', '.join(sections)}",) if sections else (),
    )


read_nexus = mocap.text_reader("Nexus CSV", ",", _capture)
