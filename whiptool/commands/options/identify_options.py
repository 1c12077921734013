"""Options of `python -m whiptool.identify`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import tyro

from whiptool.commands.options.controller_options import LawName, LawOptions, Preset
from whiptool.commands.options.model_options import ModelName, ModelOptions
from whiptool.commands.options.option_group import (
    Conditions,
    Count,
    Interval,
    Names,
    Ranges,
    ResumableOptions,
    SeedOptions,
    unless,
    when,
)
from whiptool.errors import InputError

if TYPE_CHECKING:
    from whiptool.models.parameters import Model

Drive = Annotated[str, Names("whiptool.identification.drives:DRIVES")]
Own = Annotated[str, Names("whiptool.identification.readings:NEUTRAL", others=("start", "smoothing"))]

OF_WHIPS = (
    "per_recording",
    "nodes",
    "profile",
    "prior",
    "mend_labels",
    "tip",
    "cameras",
    "whip_length",
    "taper",
    "youngs_modulus",
    "diameter",
    "density",
    "arm",
    "arm_tip",
    "mount",
)  # options of whips, of robots' files and of cameras
REPORT, IDENTIFIED, RECORDINGS = "report.html", "identified.toml", "recordings"  # what a run leaves


@dataclass(frozen=True, kw_only=True)
class IdentifyOptions(ResumableOptions, SeedOptions, LawOptions, ModelOptions):
    """Options of `identify`, which fits a whip's parameters to recorded strikes."""

    first: ClassVar[tuple[str, ...]] = (
        "recordings",
        "free",
        "drive",
        "held_out",
        "nodes",
        "profile",
        "cameras",
    )
    in_space: ClassVar[bool] = True
    only_with: ClassVar[Conditions] = {
        **dict.fromkeys(OF_WHIPS, unless("drive", "free")),
        "pieces": when("drive", "free"),
        "clamp": when("drive", "passive", why=": the model's k includes the hinge"),
        "controller": when("drive", "command"),
        "preset": when("drive", "command"),
        "knots": when("drive", "joints", "hand", "handle", why=", whose motion was measured"),
    }

    ranges: ClassVar[Ranges] = {
        "knots": Interval(0.002, 1.0),
        "starts": Count(high=1000),
        "clamp": Interval(),
        "pieces": Interval(0, strict=True),
    }

    recordings: tyro.conf.Positional[Annotated[tuple[str, ...], tyro.conf.arg(metavar="RECORDING ...")]] = ()
    """Recorded strikes: tracks (.csv, .tsv, .trc, .c3d, .mat, .h5, .npz, .mcap, ...) or films (.mp4, .mkv, .db3, ...),
    all of which docs/file-formats.md describes. Tracks are also those of Motive, Nexus, Qualisys, Tracker, DeepLabCut,
    SLEAP, LeRobot folders and ROS bags; in films the tip is tracked first."""
    free: tuple[str, ...] = ("k", "b", "m")
    """Parameters to fit: k, b, m (stiffness, damping, mass of the nodes), arm.mass[0], law.a, ... (a wrong name prints
    all). Others are whip.k[3], gravity, delay and, with --profile, bending_stiffness."""
    drive: Drive = "command"
    """What drives the simulated whip: command (the commanded strike), joints (their measured angles), robot (the
    command with a fitted lag), hand (its measured pose), handle (a tracked marker) or passive (nothing after a release
    by hand), while free fits a pendulum and no whip. command simulates the controller. robot and hand are for models in
    space; the lag is of second order, with a delay. passive also fits the first state of the whip. free takes the
    measured angles of the pendulum's links."""
    clamp: float | None = None
    """With --drive passive: angle at which the whip is clamped, 0 being straight down [rad]; a first guess if clamp is
    in --free. Default: the whip hangs from a free hinge."""
    model: ModelName = "lemon2024"
    """Model at which the fit starts: a preset or a file. With --drive free it is the file of the pendulum."""
    controller: LawName | None = None
    """Controller of recordings that name none: oiac (adapts the impedance online, default in the plane), constant
    (default of nah2023) or position (default in space)."""
    preset: Preset | None = None
    """Parameters of the law of --controller; default: table4 for oiac, nah2020 (Eq. 22) for constant."""
    held_out: tuple[str, ...] | None = None
    """Recordings for validation, left out of the fit: their number or paths (default: 1 if there are 3 or more, 0 if
    fewer). A number counts from the last recording."""
    per_recording: tuple[Own, ...] = ()
    """Parameters whose value is fitted for each recording separately; start is the first state, smoothing the
    edge of a filter that tracks went through before export. Default: none."""
    nodes: tuple[int, ...] = ()  # pyrefly: ignore[bad-override]
    """Numbers of nodes of the whip to try (default: that of the model). The one with the smallest held-out error is
    kept."""
    profile: bool = False
    """Fit a whip whose properties vary from handle to tip. Its parameters are length, linear_density,
    bending_stiffness, bending_damping, drag, tapers."""
    knots: float | None = None
    """With --drive joints, hand or handle: spacing of the knots of the spline through the measured motion [s]. Default:
    for joints and hand by cross-validation, for a handle 1.5 frames."""
    pieces: tuple[float, ...] = ()
    """With --drive free: lengths of the pieces into which long swings are cut for a first fit [s], such as 0.3."""
    loss: Literal["huber", "none"] = "huber"
    """Loss function: Huber's, or least squares (none)."""
    starts: int = 3
    """Number of starting points of the fit; the first is the model as given."""
    prior: str | None = None
    """TOML file with prior knowledge, such as "whip.m" = {value = 0.012, error = 0.1}; docs/file-formats.md describes
    it."""
    mend_labels: bool = False
    """Restore exchanged marker labels, and leave out points where two markers are merged. Without this option such a
    recording is refused."""
    cameras: str | None = None
    """TOML file with the calibration of the cameras, for recordings in space (default: that of each recording). It is
    for recordings in pixels and films."""
    tip: str | None = None
    """TOML file with the appearance of the tip in videos: radius [m], hue range [deg, deg] and saturation, or for
    infrared the brightness (value)."""

    @property
    def number_of_nodes(self) -> None:
        """None: `--nodes` lists the numbers of nodes that the fit tries, and does not set the model's."""
        return

    def check(self) -> None:
        from whiptool.identification.inputs import read_marker

        super().check()
        if not self.recordings:
            raise InputError("recordings", "none", "one or more files or folders of recorded strikes")
        if len(set(self.nodes)) < len(self.nodes) or not all(1 <= n <= 200 for n in self.nodes):
            raise InputError("--nodes", self.nodes, "different whole numbers from 1 to 200")
        read_marker(self.tip)

    def _model(self) -> Model | None:
        return None if self.drive == "free" else super()._model()  # no law is that of an arm without a whip

    def find_model(self) -> Model | Any:
        """Return the model at which the fit starts: with --drive free an arm without a whip."""
        from whiptool.identification.plant import read_bare_arm

        allowed = "a pendulum's .toml file, with --drive free"
        try:
            if self.drive != "free":
                return super().find_model()
            if not self.model.endswith(".toml"):
                raise InputError("--model", self.model, allowed, "docs/file-formats.md describes it")
            return read_bare_arm(self.model)
        except InputError:
            if fix := self._pendulum_meant():
                rule = allowed if self.drive == "free" else "a model of arm and whip, without --drive free"
                raise InputError("--model", self.model, rule, fix) from None
            raise

    def _pendulum_meant(self) -> str:
        """Return how a pendulum is given whose file, or whose fit's configuration, was; empty: none was."""
        from whiptool.given_files import read_toml

        path = Path(self.model)
        table = read_toml(path) if path.suffix == ".toml" and path.is_file() else {}
        kept = table.get("options")
        if isinstance(kept, dict) and kept.get("drive") == "free":
            return f"the pendulum that this run fitted is {path.with_name(IDENTIFIED)}, for --drive free"
        return "this file is a pendulum's: add --drive free" if "links" in table and self.drive != "free" else ""

    def needs(self) -> tuple[str, ...]:
        from whiptool.recording.readers import needed_for

        return needed_for(self.recordings)
