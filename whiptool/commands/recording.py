"""Show what was understood of recordings, and convert them: `python -m whiptool.recording show FILE...`."""

from __future__ import annotations

import dataclasses
import textwrap
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np
import tyro

from whiptool.commands import cli, run_folders
from whiptool.commands.options.model_options import ModelName
from whiptool.commands.options.option_group import JsonOptions, check_place
from whiptool.errors import InputError
from whiptool.recording.finding import DOUBTFUL, Finding

if TYPE_CHECKING:
    from whiptool.recording.readers.joint_log import JointLog, Logs
    from whiptool.recording.strike_recording import StrikeRecording
    from whiptool.recording.understood import Understood

_WIDTH, _TOPIC, _CERTAINTY = 100, 11, 9  # [characters] of a line, and of its first two columns
_WRITTEN = (".csv", ".toml", ".joints.csv", ".hand.csv", ".cameras.toml")  # endings of what `convert` may write


@dataclass(frozen=True, kw_only=True)
class ShowOptions(JsonOptions):
    """Options of `recording show`, which prints and draws what was understood of recordings."""

    first: ClassVar[tuple[str, ...]] = ("files", "model", "cameras", "out")

    files: tyro.conf.Positional[Annotated[tuple[str, ...], tyro.conf.arg(metavar="FILE ...")]] = ()
    """Recordings, films and logs of a robot, files or folders; FOLDER#3 is episode 3 of a dataset."""
    cameras: Path | None = None
    """TOML file with the calibration of the cameras, for recordings in pixels (default: that of each recording)."""
    model: ModelName | None = None
    """Model of the arm whose joints were logged, with which clock and frame of the logs are compared with the
    tracks."""
    out: Path = Path("recording.png")
    """Picture to write, PNG."""

    def check(self) -> None:
        super().check()
        if not self.files:
            raise InputError("FILE", "none", "one or more recordings, films or logs")
        if len(set(self.files)) < len(self.files):
            raise InputError("FILE", next(x for x in self.files if self.files.count(x) > 1), "each file once")
        if self.out.suffix != ".png":
            raise InputError("--out", str(self.out), "a file that ends in .png")
        check_place("--out", self.out)

    def needs(self) -> tuple[str, ...]:
        from whiptool.recording.readers import needed_for, split_episode

        return needed_for([split_episode(file)[0] for file in self.files])


@dataclass(frozen=True, kw_only=True)
class ConvertOptions(JsonOptions):
    """Options of `recording convert`, which writes a recording as CSV."""

    file: tyro.conf.Positional[Annotated[str, tyro.conf.arg(metavar="FILE")]]
    """Recording with tracks, or log of a robot; FOLDER#3 is episode 3 of a dataset."""
    out: tyro.conf.Positional[Annotated[Path, tyro.conf.arg(metavar="OUT.csv")]]
    """CSV file to write. What does not fit into it is written next to it: OUT.toml, OUT.joints.csv, OUT.hand.csv."""

    def check(self) -> None:
        super().check()
        if self.out.suffix != ".csv":
            raise InputError("OUT.csv", str(self.out), "a file that ends in .csv")
        check_place("OUT.csv", self.out)
        stem = self.out.with_suffix("")
        if stem.absolute() == Path(self.file).absolute().with_suffix(""):
            rule = f"another name than {stem.name}, whose sidecar {stem.name}.toml belongs to the recording"
            raise InputError("OUT.csv", str(self.out), rule, f"such as {stem.name}_converted.csv")
        there = [str(file) for ending in _WRITTEN if (file := self.out.with_suffix(ending)).exists()]
        if there:
            raise InputError("OUT.csv", str(self.out), f"a name for which {', '.join(there)} does not exist yet")

    def needs(self) -> tuple[str, ...]:
        from whiptool.recording.readers import needed_for, split_episode

        return needed_for([split_episode(self.file)[0]])


def _show(options: ShowOptions) -> int:
    from whiptool.identification.inputs import camera_options
    from whiptool.models.files import load_model
    from whiptool.recording.compared import compared
    from whiptool.recording.picture import draw
    from whiptool.recording.understood import understand

    run_folders.check_matplotlib()
    arm = None if options.model is None else load_model(options.model).arm
    cameras = [camera_options(file, options.cameras) for file in options.files]
    if options.cameras is not None and not any(cameras):
        raise InputError("--cameras", str(options.cameras), "only with recordings in pixels")
    found = compared([understand(file, **given) for file, given in zip(options.files, cameras, strict=True)], arm)
    over = ", over an older picture" * options.out.exists()
    draw(found, options.out)
    summary = {"files": [one.table for one in found], "picture": str(options.out)}
    options.tell(summary, "\n\n".join([*map(_described, found), f"drawn in {options.out}{over}"]))
    return 0


def _described(understood: Understood) -> str:
    """Return the lines of a file: topic, certainty, value, and below it its reason and what to do."""
    return "\n".join([understood.path, *(line for finding in understood.findings for line in _lines(finding))])


def _lines(finding: Finding) -> list[str]:
    mark = "!" if finding.certainty == DOUBTFUL else " "
    left = f"{mark} {finding.topic:{_TOPIC}s}{finding.certainty:{_CERTAINTY}s}"
    value = finding.value + (f" ({finding.reason})" if finding.reason else "")
    lines = textwrap.wrap(value, _WIDTH, initial_indent=left, subsequent_indent=" " * len(left)) or [left]
    fix = textwrap.wrap(finding.fix, _WIDTH, initial_indent=" " * len(left) + "-> ", subsequent_indent=" " * len(left))
    return [*lines, *fix]


def _convert(options: ConvertOptions) -> int:
    from whiptool.recording.readers import open_any
    from whiptool.recording.readers.footage import VideoSource
    from whiptool.recording.readers.joint_log import Logs
    from whiptool.recording.readers.tracks import write_csv, write_logs

    found = open_any(options.file)
    if isinstance(found, VideoSource):
        raise InputError("FILE", options.file, "tracks or a log", "images have no tracks yet: identify tracks the tip")
    if isinstance(found, Logs):
        written = write_logs(found, options.out)
        _check_logs(found, written)
    else:
        written = write_csv(found, options.out)
        _check_read_back(found, written)
    names = [str(path) for path in written]
    options.tell({"file": options.file, "written": names}, f"wrote {', '.join(names)}")
    return 0


def _check_read_back(recording: StrikeRecording, written: list[Path]) -> None:
    """Remove files that do not read back as the recording that was written, and say what they lack."""
    from whiptool.recording.readers import read_recording

    try:
        again = read_recording(written[0])
        lacking = [f.name for f in dataclasses.fields(recording) if not _same(recording, again, f.name)]
        cause = f"a recording whose {', '.join(lacking)} fits into CSV" if lacking else ""
    except InputError as error:
        cause = f"a recording that reads back ({error})"
    if cause:
        for path in written:
            path.unlink()
        raise InputError("FILE", recording.called, cause, "keep it as NPZ: StrikeRecording.save")


def _check_logs(logs: Logs, written: list[Path]) -> None:
    """Remove the files of logs whose joints or poses do not read back the same."""
    from whiptool.recording.readers import open_any
    from whiptool.recording.readers.joint_log import Logs

    again = [one for one in (open_any(str(path)) for path in written) if isinstance(one, Logs)]
    for log, found in ((logs.joints, [x.joints for x in again]), (logs.hand, [x.hand for x in again])):
        if log is None or any(_same_log(log, other) for other in found if other is not None):
            continue
        for path in written:
            path.unlink()
        raise InputError("FILE", ", ".join(log.names), "names of joints that columns of a CSV file can have")


def _same_log(a: JointLog, b: JointLog) -> bool:
    """Whether two logs have the same times, names and values, the first's in degrees or radians."""
    values = np.deg2rad(a.q) if a.unit == "deg" else a.q
    return a.names == b.names and np.array_equal(a.t, b.t) and np.array_equal(values, b.q)


def _same(a: StrikeRecording, b: StrikeRecording, name: str) -> bool:
    """Whether a field is the same, or is not of the recording itself."""
    from whiptool.recording.camera import Camera

    if name in ("source", "sha256", "start", "notes", "sigma_assumed"):
        return True
    one, other = getattr(a, name), getattr(b, name)
    if isinstance(one, Camera) and isinstance(other, Camera):
        return one.table() == other.table()
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return np.array_equal(one, other, equal_nan=True)
    return one is other if isinstance(one, np.ndarray) or isinstance(other, np.ndarray) else one == other


_SHOWN = (
    "Print what was understood of recordings before any fit, and draw it: format, clock, rate, markers, gaps, axes, "
    "units, logs, and what was assumed. Example: python -m whiptool.recording show strike1.csv"
)
_CONVERTED = (
    "Write a recording, or a robot's log, as CSV that reads back the same. "
    "Example: python -m whiptool.recording convert take1.c3d swing1.csv"
)
_MAINS = {
    "show": (_SHOWN, cli.command(ShowOptions, "recording show", _SHOWN, _show)),
    "convert": (_CONVERTED, cli.command(ConvertOptions, "recording convert", _CONVERTED, _convert)),
}
main = cli.subcommands("recording", _MAINS)
