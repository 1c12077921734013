"""Options of `python -m whiptool.identify`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import tyro

from whiptool.errors import InputError
from whiptool.options import LawOptions, ModelOptions, Preset, ResumableOptions, SeedOptions, refuse_idle, whole
from whiptool.options.controller import CONTROLLERS
from whiptool.options.scene import MODELS

if TYPE_CHECKING:
    from whiptool.models.parameters import Model

Drive = Literal["command", "joints", "robot", "hand", "handle", "passive", "free"]
Own = Literal[
    "delay", "clock_rate", "scale", "rotation", "shift_x", "shift_y", "start", "rotation_x", "rotation_y", "rotation_z",
    "shift_z",
]  # fmt: skip

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
)  # options of whips and cameras
REPORT, IDENTIFIED, RECORDINGS = "report.html", "identified.toml", "recordings"  # what a run leaves


@dataclass(frozen=True, kw_only=True)
class IdentifyOptions(ResumableOptions, SeedOptions, LawOptions, ModelOptions):
    """Fit a whip's parameters to recorded strikes."""

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

    recordings: tyro.conf.Positional[Annotated[tuple[str, ...], tyro.conf.arg(metavar="RECORDING ...")]] = ()
    """Tracks (CSV, DeepLabCut, NPZ, MAT, C3D, LeRobot folders) or videos (files, ROS bags), which are tracked first."""
    free: tuple[str, ...] = ("k", "b", "m")
    """What to fit: names such as k (for whip.k), whip.k[3], arm.mass[0], gravity, law.a, bending_stiffness, delay."""
    drive: Drive = "command"
    """What drives the whip: command (the strike, controller in the loop), joints (measured), in space robot (the
    command, followed behind a first-order lag that is fitted) and hand (its measured pose), handle (tracked), passive
    (nothing: held still and released by hand; the first state is free); free: a pendulum of links by its angles."""
    clamp: float | None = None
    """With passive: the whip is clamped, and the clamp points there, 0 straight down [rad]; a first guess if clamp is
    among --free. Default: a free hinge."""
    model: Annotated[str, tyro.conf.arg(metavar=MODELS)] = "lemon2024"
    """Where the fit starts: a published whip and arm, or those of a file; with free, the pendulum's file."""
    controller: Annotated[str | None, tyro.conf.arg(metavar=CONTROLLERS)] = None
    """Used only where the recordings do not hold it; default: as that of simulate, by the model."""
    preset: Preset | None = None
    """Likewise, parameters of the law; default: table4 of oiac, nah2020 (Eq. 22) of constant."""
    held_out: tuple[str, ...] | None = None
    """Recordings to predict and not to fit: how many, from the end, or their paths; default: of three or more, one."""
    per_recording: tuple[Own, ...] = ()
    """What each recording has its own value of."""
    nodes: tuple[int, ...] = ()  # pyrefly: ignore[bad-override]
    """Numbers of nodes to try; the one with the smallest held-out error is taken."""
    profile: bool = False
    """Fit the whip as a profile: length, linear_density, bending_stiffness, bending_damping, drag, tapers."""
    knots: float | None = None
    """With joints, hand or handle: spacing of the knots of the spline through what was measured [s]; default: of
    joints and hand as foresees left-out samples best, of a handle 1.5 frames."""
    pieces: tuple[float, ...] = ()
    """With free: lengths of the pieces that long swings are cut into for a first fit [s], such as 0.3."""
    loss: Literal["huber", "none"] = "huber"
    """Huber's loss; none: least squares."""
    starts: int = 3
    """From how many places to begin; the first is the model as given."""
    prior: str | None = None
    """TOML file of what is known beforehand: "whip.m" = {value = 0.012, error = 0.1}; see the file formats."""
    mend_labels: bool = False
    """Put labels of markers back that were exchanged, and leave out points where one marker swallowed another; without
    it, such a recording is refused."""
    cameras: str | None = None
    """TOML file of the cameras in space, for recordings in pixels and for films; default: the file that each names."""
    tip: str | None = None
    """TOML file of the tip's looks, for videos: radius [m], hue [deg, deg], saturation, or value for infrared."""

    @property
    def number_of_nodes(self) -> None:
        """None: `--nodes` are those that the fit tries."""
        return

    def check(self) -> None:
        """Refuse values that are out of range, and options that contradict each other."""
        from whiptool.identification.inputs import read_marker
        from whiptool.models.parameters import number

        super().check()
        if not self.recordings:
            raise InputError("recordings", "none", "one or more files or folders of recorded strikes")
        if self.drive != "free":
            refuse_idle(self, {"pieces": "nothing but with --drive free"})
        if self.drive != "passive":
            refuse_idle(self, {"clamp": "nothing but with --drive passive: the model's k includes the hinge"})
        if self.drive != "command":
            refuse_idle(self, dict.fromkeys(("controller", "preset"), "nothing but with --drive command"))
        if self.drive not in ("joints", "hand", "handle"):
            refuse_idle(self, {"knots": "nothing but with --drive joints, hand or handle, whose motion was measured"})
        elif self.knots is not None:
            number("--knots", self.knots, low=0.002, high=1.0)
        whole("--starts", self.starts, high=1000)
        if self.clamp is not None:
            number("--clamp", self.clamp)
        for piece in self.pieces:
            number("--pieces", piece, low=0, strict=True)
        if len(set(self.nodes)) < len(self.nodes) or not all(1 <= n <= 200 for n in self.nodes):
            raise InputError("--nodes", self.nodes, "different whole numbers from 1 to 200")
        if self.drive == "free":
            refuse_idle(self, dict.fromkeys(OF_WHIPS, "nothing with --drive free"))
        read_marker(self.tip)

    def _model(self) -> Model | None:
        return None if self.drive == "free" else super()._model()  # a pendulum is none of ours

    def needs(self) -> tuple[str, ...]:
        """Return the modules of extras that the command imports with these options."""
        from whiptool.recording.readers import needed_for

        return needed_for(self.recordings)
