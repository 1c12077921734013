"""HDF5 files of pose estimation: DeepLabCut's `.h5`, SLEAP's analysis files and projects, and NWB.

What a file holds is found by its contents, in a separate process, as the HDF5 library crashes on damaged files.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.extras import optional
from whiptool.given_files import parsed_apart, parsing, whole_file
from whiptool.recording.readers import deeplabcut, nwb, poses, sleap
from whiptool.recording.readers.programs import POSES
from whiptool.recording.readers.sidecar import Sidecar
from whiptool.recording.strike_recording import StrikeRecording

KINDS = {
    "deeplabcut": deeplabcut.of_hdf5,
    "sleap": sleap.of_analysis,
    "project": sleap.of_project,
    "nwb": nwb.of_nwb,
}


def read_hdf5(path: Path | str, **options: Any) -> StrikeRecording:
    """Read an HDF5 file of pose estimation; `options` are keys of its sidecar, whose values they override."""
    path = whole_file(path)
    optional("h5py", "HDF5 files")
    read = parsed_apart(path, "HDF5", parse)
    kind = str(read["kind"])
    with parsing(path, "HDF5"):
        if kind == "nwb":
            return nwb.recorded(path, options, read)
        side = Sidecar.of(path, options, *poses.KEYS)
        if kind == "deeplabcut":
            names = [tuple(str(x) for x in name) for name in read["names"]]
            found = deeplabcut.tracks(side, names, read["table"], read["frames"])
        else:
            found = sleap.of_animal(side, "a file of SLEAP", read)
        return poses.recorded(path, side, found)


def parse(path: str) -> dict[str, np.ndarray]:
    """Return the arrays of the first of `KINDS` that a file has, and the `kind`; it runs in a separate process."""
    import h5py

    with h5py.File(path, "r") as file:
        for kind, look in KINDS.items():
            if (read := look(file)) is not None:
                return {**read, "kind": np.array(kind)}
        held = ", ".join(file) or "nothing"
    raise InputError("contents", held[:120], f"tracks, as in {POSES.what}", "export the tracks there")
