"""The same motion as every laboratory format has it: made by the format's own library, or by its specification.

The motion lies on a grid of whole millimetres at 100 frames a second, which all formats hold exactly. In the plane a
pixel is a millimetre. In space x is forward and y up, and what is in files whose z is up is turned.
"""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

RATE = 100.0
SHOULDER = (3000, 2000)  # pixel of the origin
PLANE = {"scale": 1e-3, "origin": list(SHOULDER)}


@dataclass(frozen=True)
class Motion:
    """Places [mm], whole numbers, (T, M, 2), x forward, y up, NaN where missing, of markers at 0, 0.01 s, ..."""

    places: np.ndarray
    markers: tuple[str, ...]

    @property
    def t(self) -> np.ndarray:
        return np.arange(len(self.places)) / RATE

    def in_space(self, up: str) -> np.ndarray:
        """Places (T, M, 3) [mm], across the plane 0, with y or z up."""
        x, y = np.moveaxis(self.places, 2, 0)
        across = np.where(np.isnan(x), np.nan, 0.0)
        return np.stack([x, y, across] if up == "y" else [x, across, y], axis=2)

    @property
    def pixels(self) -> np.ndarray:
        return np.array(SHOULDER) + self.places * [1, -1]


def swing(count: int = 80) -> Motion:
    """A tip that swings below a handle, and is hidden for four frames."""
    angle = np.cos(3.0 * np.arange(count) / RATE)
    handle = np.stack([100 + 20 * np.sin(angle), -800 + 0 * angle], axis=1)
    places = np.round(np.stack([handle, handle + 700 * np.stack([np.sin(angle), -np.cos(angle)], axis=1)], axis=1))
    places[4:8, 1] = np.nan
    return Motion(places, ("handle", "tip"))


def cell(x: float, digits: int = 3) -> str:
    return "" if np.isnan(x) else f"{x:.{digits}f}"


def rows_to(path: Path, rows: list[list], mark: str = ",") -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, delimiter=mark, lineterminator="\r\n").writerows(rows)


def motive(path: Path, motion: Motion, *, unit: str = "Millimeters", factor: float = 1.0, extra: bool = True) -> dict:
    """Motive 2 and 3, after OptiTrack's page on CSV export, with a rigid body and an unlabeled marker among them."""
    points = factor * motion.in_space("y")
    count = len(motion.t)
    head = ["Format Version", "1.23", "Take Name", "swing", "Take Notes", "", "Capture Frame Rate", "100.000000",
            "Export Frame Rate", "100.000000", "Total Exported Frames", str(count), "Rotation Type", "Quaternion",
            "Length Units", unit, "Coordinate Space", "Global"]  # fmt: skip
    rows = [["", "Type"], ["", "Name"], ["", "ID"], ["", ""], ["Frame", "Time (Seconds)"]]
    for i, name in enumerate(motion.markers):
        for axis in "XYZ":
            for row, text in zip(rows, ("Marker", f"Whip:{name}", f"A{i}", "Position", axis)):
                row.append(text)
    body = [[str(k), f"{t:.6f}", *(cell(x, 6) for x in points[k].ravel())] for k, t in enumerate(motion.t)]
    if extra:
        for axis in (*("Rotation " + x for x in "XYZW"), "Mean Error"):
            quantity = axis.split()[0] if axis.startswith("Rot") else "Mean Marker Error"
            for row, text in zip(rows, ("Rigid Body", "Stick", "B0", quantity, axis[-1:] if quantity != axis else "")):
                row.append(text)
        for what, name in (("Rigid Body", "Stick"), ("Rigid Body Marker", "Whip:tip"), ("Marker", "Unlabeled 1189")):
            for axis in "XYZ":
                for row, text in zip(rows, (what, name, "C0", "Position", axis)):
                    row.append(text)
        body = [[*row, "0", "0", "0", "1", "0.1", *["0.5"] * 3, *["0.25"] * 3, *["0.125"] * 3] for row in body]
    rows_to(path, [head, [], *rows, *body])
    return {"markers": list(motion.markers)}


def motive_metres(path: Path, motion: Motion) -> dict:
    """Motive 1, in metres, without the words Type, Name and ID."""
    motive(path, motion, unit="Meters", factor=1e-3, extra=False)
    text = path.read_text(encoding="utf-8").replace("1.23", "1.1", 1)
    path.write_text(text.replace(",Type,", ",,").replace(",Name,", ",,").replace(",ID,", ",,"), encoding="utf-8")
    return {}


def nexus(path: Path, motion: Motion) -> dict:
    """Vicon Nexus 2, with a section of devices before and of model outputs after, and blank lines first."""
    points = motion.in_space("z")
    names = [x for name in motion.markers for x in (f"Whip:{name.upper()}", "", "")]
    axes, units = list("XYZ") * len(motion.markers), ["mm"] * 3 * len(motion.markers)
    body = [[k + 1, 0, *(cell(x, 6) for x in p.ravel())] for k, p in enumerate(points)]
    devices = [["Devices"], ["1000"], ["", "", "Force"], ["Frame", "Sub Frame", "Fx"], ["", "", "N"], [1, 0, 5.0], []]
    outputs = [[], ["Model Outputs"], ["100"], ["", "", "Whip:Angle"], ["Frame", "Sub Frame", "X"], ["", "", "deg"]]
    head = [["Trajectories"], ["100"], ["", "", *names], ["Frame", "Sub Frame", *axes], ["", "", *units]]
    rows_to(path, [[], *devices, *head, *body, *outputs, [1, 0, 2.0]])
    return {}


def qualisys(path: Path, motion: Motion, *, timed: bool = True) -> dict:
    """QTM's TSV, after its manual; what is missing is zero."""
    points = np.nan_to_num(motion.in_space("z"))
    keys = [["NO_OF_FRAMES", len(points)], ["NO_OF_CAMERAS", 8], ["NO_OF_MARKERS", len(motion.markers)],
            ["FREQUENCY", 100], ["NO_OF_ANALOG", 0], ["ANALOG_FREQUENCY", 0], ["DESCRIPTION", "--"],
            ["TIME_STAMP", "2024-05-06, 10:11:12.345", "512.25"], ["DATA_INCLUDED", "3D"],
            ["EVENT", "start", 3, 0.02], ["MARKER_NAMES", *motion.markers],
            ["TRAJECTORY_TYPES", *["Measured"] * len(motion.markers)]]  # fmt: skip
    head = [["Frame", "Time", *(f"{name} {axis}" for name in motion.markers for axis in "XYZ")]] if timed else []
    body = [[*([k + 1, f"{motion.t[k]:.5f}"] if timed else []), *(cell(x) for x in p.ravel())]
            for k, p in enumerate(points)]  # fmt: skip
    rows_to(path, [*keys, *head, *body], "\t")
    return {}


def qualisys_untimed(path: Path, motion: Motion) -> dict:
    return qualisys(path, motion, timed=False)


def qualisys_mat(path: Path, motion: Motion, kind: np.ndarray | None = None) -> dict:
    """QTM's MAT file, after its manual: one struct, with fields that are no trajectories."""
    from scipy.io import savemat

    points = motion.in_space("z")
    data = np.concatenate([points, np.full_like(points[..., :1], 0.7)], axis=2).transpose(1, 2, 0)  # (M, 4, T)
    seen = np.isfinite(data[:, 0])
    labeled = {"Count": len(motion.markers), "Data": data, "Type": np.uint8(seen) if kind is None else np.uint8(kind),
               "Labels": np.array(motion.markers, object)[None]}  # fmt: skip
    take = {"FileVersion": np.array([2, 0, 0]), "File": "C:\\swing.qtm", "Timestamp": "2024-05-06, 10:11:12\t1.2",
            "StartFrame": 1, "Frames": len(points), "FrameRate": 100, "Analog": np.zeros((0, 0)),
            "Trajectories": {"Labeled": labeled, "Unidentified": {"Count": 0}}}  # fmt: skip
    savemat(path, {"swing": take})
    return {}


def c3d(path: Path, motion: Motion) -> dict:
    import ezc3d

    points, file = motion.in_space("z"), ezc3d.c3d()
    group = file["parameters"]["POINT"]
    group["RATE"]["value"], group["UNITS"]["value"], group["LABELS"]["value"] = [RATE], ["mm"], list(motion.markers)
    file.add_parameter("POINT", "X_SCREEN", ["+X"])
    file.add_parameter("POINT", "Y_SCREEN", ["+Z"])
    file["data"]["points"] = np.concatenate([points.transpose(2, 1, 0), np.ones((1, *points.shape[1::-1]))])
    file.write(str(path))
    return {}


def trc(path: Path, motion: Motion) -> dict:
    """OpenSim's page on TRC files."""
    points, n = motion.in_space("y"), len(motion.markers)
    names = [x for name in motion.markers for x in (name, "", "")]
    axes = [f"{axis}{i + 1}" for i in range(n) for axis in "XYZ"]
    keys = ["DataRate", "CameraRate", "NumFrames", "NumMarkers", "Units", "OrigDataRate", "OrigDataStartFrame",
            "OrigNumFrames"]  # fmt: skip
    values = [100.0, 100.0, len(points), n, "mm", 100.0, 1, len(points)]
    body = [[k + 1, f"{motion.t[k]:.3f}", *(cell(x) for x in p.ravel())] for k, p in enumerate(points)]
    rows_to(path, [["PathFileType", 4, "(X/Y/Z)", path.name], keys, values, ["Frame#", "Time", *names],
                   ["", "", *axes], [], *body], "\t")  # fmt: skip
    return {}


def tracker(path: Path, motion: Motion) -> dict:
    """A table of several masses, in Tracker's own digits, with decimal commas and a trailing tab."""
    digits = lambda x: "" if np.isnan(x) else f"{x:.3E}".replace("E+0", "E").replace("E-0", "E-")  # noqa: E731
    first, second = ["#multi:"], [""]
    for name in motion.markers:
        second += [name, "", ""]
    body = [[digits(t), *(y for p in places for y in (k, digits(p[0] / 1e3), digits(p[1] / 1e3))), ""]
            for k, (t, places) in enumerate(zip(motion.t, motion.places))]  # fmt: skip
    body = [[str(x).replace(".", ",") for x in row] for row in body]
    rows_to(path, [first, second, ["t", *["frame", "x", "y"] * len(motion.markers), ""], *body], "\t")
    return {}


def dlc_frame(motion: Motion, *, individuals: tuple[str, ...] = ()) -> Any:
    """The table as DeepLabCut makes it: of several animals the second is the whip."""
    import pandas as pd

    levels = ["scorer", *(["individuals"] if individuals else []), "bodyparts", "coords"]
    columns, values = [], []
    for animal in individuals or ("",):
        for i, name in enumerate(motion.markers):
            pixels = motion.pixels[:, i] if animal in ("", "whip") else np.full((len(motion.t), 2), 7.0)
            seen = np.isfinite(pixels[:, 0])
            for coord, column in zip(("x", "y", "likelihood"), (*pixels.T, np.where(seen, 0.95, 0.01))):
                columns.append(("DLC_resnet50", *([animal] if individuals else []), name, coord))
                values.append(np.where(seen, column, 12.5) if coord != "likelihood" else column)
    return pd.DataFrame(np.stack(values, 1), columns=pd.MultiIndex.from_tuples(columns, names=levels))


def dlc_csv(path: Path, motion: Motion) -> dict:
    dlc_frame(motion).to_csv(path)
    return {**PLANE, "fps": RATE}


def dlc_animals_csv(path: Path, motion: Motion) -> dict:
    dlc_frame(motion, individuals=("mouse", "whip")).to_csv(path)
    return {**PLANE, "fps": RATE, "individual": "whip"}


def dlc_h5(path: Path, motion: Motion) -> dict:
    dlc_frame(motion).to_hdf(path, key="df_with_missing", format="table", mode="w")
    return {**PLANE, "fps": RATE}


def dlc_animals_h5(path: Path, motion: Motion) -> dict:
    dlc_frame(motion, individuals=("mouse", "whip")).to_hdf(path, key="df_with_missing", mode="w")
    return {**PLANE, "fps": RATE, "individual": "whip"}


def lightning_pose(path: Path, motion: Motion) -> dict:
    """The same header, with the further columns of an ensemble."""
    import pandas as pd

    frame = dlc_frame(motion).rename(columns={"DLC_resnet50": "heatmap_tracker"}, level=0)
    for name in motion.markers:
        frame["heatmap_tracker", name, "x_posterior_var"] = 0.25
    order = [(s, name, c) for name in motion.markers for s, n, c in frame.columns if n == name]
    pd.DataFrame(frame[order]).to_csv(path)
    return {**PLANE, "fps": RATE}


def sleap_labels(motion: Motion) -> Any:
    import sleap_io as sio

    skeleton = sio.Skeleton(nodes=list(motion.markers))
    video, track = sio.Video("swing.mp4", open_backend=False), sio.Track("whip")
    frames = []
    for k, points in enumerate(motion.pixels):
        scores = np.full(len(points), 0.9)
        one = sio.PredictedInstance.from_numpy(points, skeleton=skeleton, point_scores=scores, score=0.9, track=track)
        frames.append(sio.LabeledFrame(video=video, frame_idx=k, instances=[one]))
    return sio.Labels(frames, videos=[video], skeletons=[skeleton], tracks=[track])


def slp(path: Path, motion: Motion) -> dict:
    import sleap_io as sio

    sio.save_slp(sleap_labels(motion), str(path))
    return {**PLANE, "fps": RATE}


def sleap_analysis(path: Path, motion: Motion) -> dict:
    import sleap_io as sio

    sio.save_analysis_h5(sleap_labels(motion), str(path))
    return {**PLANE, "fps": RATE}


def sleap_csv(path: Path, motion: Motion) -> dict:
    head = ["track", "frame_idx", "instance.score", *(f"{x}.{c}" for x in motion.markers for c in ("x", "y", "score"))]
    body = [["whip", k, 0.9, *(x for p in points for x in (cell(p[0]), cell(p[1]), 0.8))]
            for k, points in enumerate(motion.pixels)]  # fmt: skip
    rows_to(path, [head, *body])
    return {**PLANE, "fps": RATE}


def anipose(path: Path, motion: Motion) -> dict:
    """As its triangulation writes it, in the axes of the first camera: y down, z away from it."""
    points = motion.in_space("y") * [1, -1, -1]
    names = [f"{x}_{c}" for x in motion.markers for c in ("x", "y", "z", "error", "ncams", "score")]
    more = [f"M_{i}{j}" for i in range(3) for j in range(3)] + [f"center_{i}" for i in range(3)] + ["fnum"]
    body = [[y for p in frame for y in (*(cell(x) for x in p), 1.25, 3, 0.9)] + [*np.eye(3).ravel(), 0, 0, 0, k]
            for k, frame in enumerate(points)]  # fmt: skip
    rows_to(path, [[*names, *more], *body])
    return {"fps": RATE, "axes": ["x", "-y", "-z"]}


def nwb(path: Path, motion: Motion, *, stamped: bool = False) -> dict:
    from datetime import UTC, datetime

    from ndx_pose import PoseEstimation, PoseEstimationSeries, Skeleton, Skeletons
    from pynwb import NWBHDF5IO, NWBFile

    file = NWBFile("a swing", "swing", datetime(2024, 5, 6, tzinfo=UTC))
    clock = {"timestamps": motion.t} if stamped else {"rate": RATE, "starting_time": 0.0}
    series = [
        PoseEstimationSeries(
            name=name, description="marker", data=motion.pixels[:, i], unit="pixels",
            reference_frame="(0, 0) is the top left", confidence=np.full(len(motion.t), 0.9), **clock,
        )
        for i, name in enumerate(motion.markers)
    ]  # fmt: skip
    skeleton = Skeleton(name="whip", nodes=list(motion.markers))
    module = file.create_processing_module("behavior", "poses")
    module.add(Skeletons(skeletons=[skeleton]))
    module.add(PoseEstimation(pose_estimation_series=series, name="whip", skeleton=skeleton))
    with NWBHDF5IO(str(path), "w") as io:
        io.write(file)
    return PLANE


def nwb_stamped(path: Path, motion: Motion) -> dict:
    return nwb(path, motion, stamped=True)


# of each: the file's name, what writes it, and the packages that it needs
FORMATS: dict[str, tuple[str, Callable[[Path, Motion], dict], tuple[str, ...]]] = {
    "Motive": ("a.csv", motive, ()),
    "Motive, metres": ("a.csv", motive_metres, ()),
    "Nexus": ("a.csv", nexus, ()),
    "Qualisys TSV": ("a.tsv", qualisys, ()),
    "Qualisys TSV, untimed": ("a.tsv", qualisys_untimed, ()),
    "Qualisys MAT": ("a.mat", qualisys_mat, ()),
    "C3D": ("a.c3d", c3d, ("ezc3d",)),
    "TRC": ("a.trc", trc, ()),
    "Tracker": ("a.txt", tracker, ()),
    "DeepLabCut CSV": ("a.csv", dlc_csv, ()),
    "DeepLabCut CSV, animals": ("a.csv", dlc_animals_csv, ()),
    "DeepLabCut h5": ("a.h5", dlc_h5, ("h5py", "tables")),
    "DeepLabCut h5, animals": ("a.h5", dlc_animals_h5, ("h5py", "tables")),
    "Lightning Pose": ("a.csv", lightning_pose, ()),
    "SLEAP slp": ("a.slp", slp, ("sleap_io",)),
    "SLEAP analysis": ("a.analysis.h5", sleap_analysis, ("sleap_io",)),
    "SLEAP CSV": ("a.csv", sleap_csv, ()),
    "Anipose": ("a.csv", anipose, ()),
    "NWB": ("a.nwb", nwb, ("ndx_pose",)),
    "NWB, stamped": ("a.nwb", nwb_stamped, ("ndx_pose",)),
}
