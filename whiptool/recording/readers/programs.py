"""Files of other programs, recognised by their suffix and first bytes.

Those of `EXPORTS` are recordings, and have a reader each; those of `OTHERS` are refused with advice.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from whiptool.errors import InputError
from whiptool.given_files import encoding_of

HEAD = 4096  # bytes by which files are recognised
HDF5 = b"\x89HDF\r\n\x1a\n"  # the first bytes of such a file


@dataclass(frozen=True)
class Program:
    """A file format of another program."""

    what: str  # description of the format
    cure: str = ""  # advice to the user if the format is not read
    suffixes: tuple[str, ...] = ()  # file suffixes; empty: any
    head: bytes = b""  # regular expression for the first bytes of a file

    def matches(self, path: Path, head: bytes) -> bool:
        """Whether a path with these first bytes has this format."""
        if not path.is_file() or (self.suffixes and path.suffix.lower() not in self.suffixes):
            return False
        return re.match(self.head, head.removeprefix(b"\xef\xbb\xbf"), re.IGNORECASE | re.DOTALL) is not None


_ALONE = "it is a whole recording: give it as one"
MOTIVE = Program("a CSV export of OptiTrack Motive", _ALONE, head=rb'"?Format Version"?,')
NEXUS = Program(
    "a CSV export of Vicon Nexus",
    _ALONE,
    head=rb'[\s,]*"?(Trajectories|Joints|Segments|Model Outputs|Devices|Events)"?,*\s*\r?\n"?\d+"?,*\s*\r?\n',
)
QUALISYS = Program("a TSV export of Qualisys Track Manager", _ALONE, head=rb"(FILE_VERSION|NO_OF_FRAMES)[\t,;]")
TRC = Program("a TRC file of OpenSim or Cortex", _ALONE, head=rb"PathFileType\t")
TRACKER = Program(
    "a text export of Tracker",
    _ALONE,
    head=rb'(#multi:[^\n]*\n)?[^\n]{0,400}\n#?"?t"?( *[(\[]\w+[)\]])?[\t,;] *("?(frame|step)"?[\t,;] *)*'
    rb'"?(v_?)?\{?[xr]\}?"?( *[(\[]\w+[)\]])?[\t,;\r\n]',
)
ANIPOSE = Program("a CSV file of Anipose", _ALONE, head=rb'"?([^,\n]+)_x"?,"?\1_y"?,"?\1_z"?,"?\1_error"?,"?\1_ncams"?')
SLEAP = Program("a CSV file of SLEAP", _ALONE, head=rb'"?track"?,"?frame_idx"?,')
POSES = Program("an HDF5 file of DeepLabCut, SLEAP or NWB", _ALONE, (".h5", ".hdf5", ".slp", ".nwb"), HDF5)
EXPORTS = (MOTIVE, NEXUS, QUALISYS, TRC, TRACKER, ANIPOSE, SLEAP, POSES)
OTHERS = (
    Program("a take of OptiTrack Motive", "export it as CSV or C3D there", (".tak",)),
    Program("a trial of Vicon Nexus", "read the trial's C3D file, which is next to it", (".x1d", ".x2d", ".vsk")),
    Program("a project of Qualisys Track Manager", "export it as TSV, MAT or C3D there", (".qtm",)),
    Program("a project of Tracker", "export the tracks' data as text there", (".trk", ".trz")),
    Program("a file of OpenSim with a table", "give the markers' TRC file", (".mot", ".sto")),
    Program("a skeleton's motion", "export the markers as CSV, C3D or TRC", (".bvh", ".fbx", ".asf", ".amc")),
    Program("a pickle, as DeepLabCut writes it", "export CSV or .h5 there", (".pickle", ".pkl")),
)


def beginning(path: Path) -> bytes:
    """Return the first bytes of a file; of a text in UTF-16 they are given in UTF-8."""
    with path.open("rb") as file:
        head = file.read(HEAD)
    coded = encoding_of(head)
    return head.decode(coded, "ignore").encode() if coded == "utf-16" else head


def refuse_others(path: Path, head: bytes, known: tuple[Program, ...] = OTHERS) -> None:
    """Refuse a file of another program, one of `known`, by its first bytes; the message advises the user."""
    for form in known:
        if form.matches(path, head):
            raise InputError(str(path), form.what, "a recording in a supported format", form.cure)
