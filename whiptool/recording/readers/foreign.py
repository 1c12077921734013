"""Files of other programs that hold tracks and are not read: which program's they are, and what to do with them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from whiptool.errors import InputError

_C3D = "export the take as C3D there, which is read as it is"
_TABLE = "write it as CSV as DeepLabCut does, or with the columns t, tip_x, tip_y; see docs/file-formats.md"


@dataclass(frozen=True)
class Foreign:
    """A file format that is recognised but not supported.

    Args:
        what: Description of the format.
        cure: Advice to the user.
        suffixes: File suffixes; empty: any.
        head: Regular expression for the first bytes of a file.
    """

    what: str
    cure: str
    suffixes: tuple[str, ...] = ()
    head: bytes = b""

    def matches(self, path: Path, head: bytes) -> bool:
        """Whether a path with these first bytes has this format."""
        right = not self.suffixes or path.suffix.lower() in self.suffixes
        return right and re.match(self.head, head.removeprefix(b"\xef\xbb\xbf"), re.IGNORECASE | re.DOTALL) is not None


HDF5 = rb"\x89HDF\r\n\x1a\n"
FOREIGN = (
    Foreign("a CSV export of OptiTrack Motive", _C3D, head=rb'"?Format Version"?,'),
    Foreign(
        "a CSV export of Vicon Nexus",
        "read the trial's own C3D file, which Nexus keeps next to it",
        head=rb'"?(Trajectories|Joints|Segments|Model Outputs|Devices)"?,*\s*\r?\n"?\d+"?,*\s*\r?\n',
    ),
    Foreign("a TSV export of Qualisys Track Manager", _C3D, head=rb"NO_OF_FRAMES[\t,;]"),
    Foreign("a TRC file of OpenSim or Cortex", _C3D, head=rb"PathFileType\t"),
    Foreign("a CSV export of SLEAP", _TABLE, head=rb'"?track"?,"?frame_idx"?,'),
    Foreign("an HDF5 file of SLEAP", _TABLE, (".slp",), HDF5),
    Foreign("an HDF5 file, as SLEAP and DeepLabCut write them", _TABLE, (".h5", ".hdf5"), HDF5),
    Foreign(
        "a text export of Tracker",
        "name the columns t, tip_x, tip_y in one row, without the row of the mass, and save it as .csv",
        head=rb'(#multi:\s*?\n)?[^\n]{0,200}\n#?"?t"?[\t,;] *"?(v_?)?\{?x\}?"?[\t,;]',
    ),
    Foreign("a ROS 1 bag", "convert it with rosbags: rosbags-convert --src IN.bag --dst OUT", (".bag",), rb"#ROSBAG"),
    Foreign("an MCAP file", "convert it with ros2 bag convert to storage_id sqlite3", (".mcap",), rb"\x89MCAP"),
)


def refuse_foreign(path: Path, head: bytes) -> None:
    """Refuse a file of another program by its first bytes.

    Raises:
        InputError: The format is one of `FOREIGN`; the message advises the user.
    """
    for form in FOREIGN:
        if form.matches(path, head):
            raise InputError(str(path), form.what, "a recording of a format that is read", form.cure)
