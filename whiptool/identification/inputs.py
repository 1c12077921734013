"""Inputs of a fit from a command line or from recordings: names, priors, profile, controller."""

from __future__ import annotations

import dataclasses
import math
import re
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.dynamics.structure import LUMPED
from whiptool.errors import InputError
from whiptool.given_files import read_toml
from whiptool.identification.plant import BareArm, Plant
from whiptool.identification.readings import NEUTRAL
from whiptool.identification.variables import Prior, names_of, variable
from whiptool.impedance import Controller
from whiptool.impedance.controller import controller_from_table, controller_to_table
from whiptool.models.numbers import number
from whiptool.models.parameters import Model
from whiptool.models.profile import WhipProfile, profile_from
from whiptool.recording.readers import READERS, VideoSource, find_format, log_alone, open_any, split_episode
from whiptool.recording.readers.angles import read_swings
from whiptool.recording.readers.joint_log import Logs
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.runs import CONFIG
from whiptool.vision.markers import Marker

POSES = ("deeplabcut", "sleap", "hdf5")  # formats of pose estimation
RECORDED = "recording.npz"  # of a strike of a rig or robot, in its run folder


def recording_in(path: str) -> str:
    """Return the recording that a run folder of `rig strike` or `robot strike` holds; any other path unchanged."""
    inside = Path(path) / RECORDED
    return str(inside) if inside.is_file() else path


def model_of_run(path: str) -> dict[str, Any]:
    """Return the options `model` and, where it is needed, `mount` for the model of the run, or of one of its strikes,
    in whose folder a `recording.npz` lies; empty if it is not in such a folder."""
    folder = Path(path).absolute().parent
    if Path(path).name != RECORDED:
        return {}
    for config in (folder / CONFIG, folder.parent / CONFIG):
        if config.is_file():
            table = read_toml(config)
            options = table.get("options", {})
            if "model" in table:
                return {"model": str(config)}
            return {name: options[name] for name in ("model", "mount") if name in options}
    return {}


def split(recordings: tuple[str, ...], held_out: tuple[str, ...] | None) -> tuple[list[str], list[str]]:
    """Return the paths of the recordings to fit, and those of the recordings to hold out, of which `held_out` has the
    names or the number, counted from the last; None: one if there are three or more recordings."""
    if len(set(recordings)) < len(recordings):
        twice = next(name for name in recordings if recordings.count(name) > 1)
        raise InputError("recordings", twice, "each path once")
    if held_out is None:
        held_out = ("1",) if len(recordings) >= 3 else ("0",)
    if len(held_out) == 1 and held_out[0].isdigit():
        count = int(held_out[0])
        fitted, others = list(recordings[: max(len(recordings) - count, 0)]), list(recordings[-count:] if count else ())
    else:
        fitted, others = [name for name in recordings if name not in held_out], list(dict.fromkeys(held_out))
    if not fitted:
        raise InputError(
            "held out", " ".join(held_out), "fewer than all recordings, because at least one has to be fitted"
        )
    return fitted, others


_LONGEST_HEADER = 100_000  # [characters]
_WORDS = {"stiffness": "k", "damping": "b", "mass": "m", "length": "l", "density": "linear_density"}  # parameters


def full_name(name: str, plant: Plant) -> str:
    """Return the full name of a parameter of a plant, or of a nuisance parameter: `whip.k` for `k`."""
    known = plant.values() if isinstance(plant.model, BareArm) else {**plant.values(), **NEUTRAL}
    found = names_of(name, known)
    if len(found) == 1:
        return found[0]
    quantity = name.removeprefix("whip.")
    if plant.profile is not None and quantity in LUMPED:
        allowed = ", ".join(x for x in known if x.startswith("profile."))
        raise InputError("free parameter", name, allowed, "the profile gives the whip's l, m, k and b")
    per_node = f"whip.{quantity}[0]"
    if per_node in found:
        raise InputError("free parameter", name, f"{per_node} and so on", "this model has a value per node")
    short = _WORDS.get(quantity, "")
    fix = f"did you mean {short}?" if not found and names_of(short, known) else ""
    raise InputError("free parameter", name, "one of " + ", ".join(found or _grouped(known)), fix)


def _grouped(names: Iterable[str]) -> list[str]:
    """Names without `whip.`, and those that differ in a number only as one."""
    return list(dict.fromkeys(re.sub(r"\[\d+\]", "[i]", name.removeprefix("whip.")) for name in names))


def profile_of(model: Model, name: str) -> WhipProfile:
    """Return the whip's profile (its properties along its length): that in the file or preset `name` of the model, else
    that from which the nodes were computed, else that of a uniform whip; other nodes are refused."""
    if name.endswith(".toml"):
        profile = read_toml(Path(name)).get("whip", {}).get("profile")
        if profile is not None:
            return WhipProfile(**profile)
    return profile_from(model.whip)


def read_prior(path: str | None, plant: Plant, free: tuple[str, ...]) -> Prior | None:
    """Read a prior of free parameters (full names) from a TOML file, None without a file, with lines such as
    `"whip.m" = {value = 0.012, error = 0.1}`.

    An error is relative for a parameter that is always positive, and in the unit of a parameter that may be zero (drag,
    friction, rest angle, delay).
    """
    if path is None:
        return None
    names, means, errors = [], [], []
    for name, entry in read_toml(Path(path)).items():
        if not isinstance(entry, dict) or set(entry) != {"value", "error"}:
            raise InputError(f"{path}: {name}", entry, "{value = ..., error = ...}")
        try:
            full = full_name(name, plant)
        except InputError as error:
            raise error.within(f"{path}: ") from None
        if full not in free:
            raise InputError(f"{path}: {name}", full, "one of the free parameters " + ", ".join(free))
        names.append(full)
        positive = variable(full, 1.0).log
        low = 0.0 if positive else -math.inf
        means.append(number(f"{path}: {name}.value", entry["value"], low=low, strict=positive))
        errors.append(number(f"{path}: {name}.error", entry["error"], low=0, strict=True))
    if not names:
        raise InputError(path, "empty", '"whip.m" = {value = 0.012, error = 0.1} and so on')
    return Prior(tuple(names), tuple(means), np.diag(np.square(errors)))


def read_marker(path: str | None) -> Marker | None:
    """Read a marker's appearance from a TOML file with the fields of `Marker`; None if no file is given."""
    if path is None:
        return None
    table: dict[str, Any] = read_toml(Path(path))
    known = [f.name for f in dataclasses.fields(Marker)]
    for key in table:
        if key not in known:
            raise InputError(f"{path}: {key}", table[key], "one of the keys " + ", ".join(known))
    try:
        looks: dict[str, Any] = {key: tuple(x) if isinstance(x, list) else x for key, x in table.items()}
        return Marker(**looks)
    except InputError as error:
        raise error.within(f"{path}: ") from None
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(path, str(table)[:80], "radius, and hue, saturation or value", f"reason: {error}") from None


def common_controller(recordings: Sequence[StrikeRecording]) -> Controller | None:
    """Return the controller that the recordings state, or None if they state none; different ones are refused. If one
    does not state the masses that its gravity compensation assumes, those of the other recordings are taken."""
    found: Controller | None = None
    for recording in recordings:
        if (controller := _controller_of(recording)) is None:
            continue
        if found is not None and controller.compensated is None:
            controller = dataclasses.replace(controller, compensated=found.compensated)
        elif found is not None and found.compensated is None:
            found = dataclasses.replace(found, compensated=controller.compensated)
        if found is not None and controller != found:
            name = f"{recording.called}: controller"
            raise InputError(name, recording.controller, "that of the other recordings", "fit them separately")
        found = controller
    return found


def _controller_of(recording: StrikeRecording) -> Controller | None:
    """The controller that a recording holds, None if it holds none."""
    if recording.controller is None:
        return None
    try:
        return controller_from_table(recording.controller)
    except InputError as error:
        raise error.within(f"{recording.source}: " if recording.source else "") from None


def check_controllers(
    recordings: Sequence[StrikeRecording], controller: Controller, *, free: Sequence[str] = ()
) -> None:
    """Refuse recordings of strikes that were made with another controller than the plant's, except for free parameters.

    The masses that gravity compensation assumes are only compared if the recording states them, the control period only
    if both state it. Recordings without a controller are accepted.
    """
    now, fitted = controller_to_table(controller), {name.split(".")[-1].split("[")[0] for name in free}
    unsaid = {"compensated", "control_period"}
    for recording in recordings:
        if (held := _controller_of(recording)) is None:
            continue
        then = controller_to_table(held)
        settled = fitted | (unsaid - set(then)) | ({"control_period"} - set(now))
        other = [key for key in {**then, **now} if then.get(key) != now.get(key) and key not in settled]
        if other:
            shown = ["law"] if "law" in other else ["law", *other]
            given, allowed = (", ".join(f"{key} = {table.get(key)}" for key in shown) for table in (then, now))
            fix = "give the plant the controller of the recordings; fit reads it from them if it is given a Model"
            name = f"{recording.called}: controller"
            raise InputError(name, given, f"{allowed}, as the plant's controller has", fix)


def each_episode(paths: tuple[str, ...]) -> tuple[str, ...]:
    """Return the paths, with each file of several swings replaced by one path per swing: `FILE#0`, `FILE#1`, ..."""
    found: list[str] = []
    for path in paths:
        angles = Path(path).is_file() and find_format(path) == "angles"
        found += [swing.source for swing in read_swings(path)] if angles else [path]
    return tuple(found)


def opened(path: str, *, handle: bool = False, cameras: Path | None = None) -> StrikeRecording | VideoSource:
    """Return a recording of any of `READERS` (`FOLDER#3` is episode 3 of a dataset), or the video in which the tip
    still has to be tracked; films are refused if the handle's path is needed. `cameras` is the file of the calibrated
    cameras; default: that which each recording names."""
    file, _ = split_episode(path)
    form = READERS[find_format(file)]
    if handle and form.tracks is None and form.video is not None:
        raise _handle_filmed(path)
    found = open_any(path, **camera_options(path, cameras))
    if isinstance(found, Logs):
        raise log_alone(path)
    if handle and isinstance(found, VideoSource):
        raise _handle_filmed(path)
    return found


def camera_options(path: str, cameras: Path | str | None) -> dict[str, Any]:
    """Return the option of a recording's reader for a file of cameras; empty where the recording is not in pixels."""
    form = READERS[find_format(split_episode(path)[0])]
    filmed = in_pixels(path) or (form.tracks is None and form.video is not None)
    return {"cameras": cameras} if cameras is not None and filmed else {}


def _handle_filmed(path: str) -> InputError:
    return InputError(
        "drive handle",
        path,
        "tracks with a marker handle, since in images only the tip is tracked",
        "track both with another program (DeepLabCut, CSV), or give --drive passive if the hand stays still",
    )


def may_be_filmed(path: str) -> bool:
    """Whether a recording has a format that can contain images."""
    return READERS[find_format(split_episode(path)[0])].video is not None


def in_pixels(path: str) -> bool:
    """Whether a recording has a camera's pixel coordinates of markers: a CSV file, or one of pose estimation whose
    sidecar names the camera, and no way to metres.
    """
    if not Path(path).is_file() or (form := find_format(path)) not in ("csv", *POSES):
        return False
    if form in POSES:
        side = Path(path).with_suffix(".toml")
        said = read_toml(side) if side.is_file() else {}
        return "camera" in said and not said.keys() & {"homography", "known_points", "scale"}
    with Path(path).open(encoding="utf-8-sig", errors="replace") as file:
        return any(name.strip().strip('"').endswith("_u") for name in file.readline(_LONGEST_HEADER).split(","))


def tracked(
    found: StrikeRecording | VideoSource, *, name: str, tip: Marker | None = None
) -> tuple[StrikeRecording, bool]:
    """Return one recording, and whether it states that it is synthetic; a film is tracked (with progress on stderr) on
    the strike plane, or in pixels of a camera in space. By default the tip looks as in the virtual camera's images."""
    if isinstance(found, StrikeRecording):
        return found, False
    from whiptool.progress import Progress
    from whiptool.vision.film_files import RecordedCamera
    from whiptool.vision.source import frames_of
    from whiptool.vision.tracking import track, track_view

    camera = RecordedCamera(found)
    frames = Progress(
        frames_of(camera),
        total=len(camera),
        unit=" frames",
        file=sys.stderr,
        desc=f"tracking {Path(name).name}",
        dynamic_ncols=True,
        leave=False,
    )
    try:
        if found.view is None:
            return track(frames, calibration=camera.calibration, tip=tip).to_recording(**found.about), found.synthetic
        about: dict[str, Any] = dict(found.about)
        if found.synthetic:
            about["camera"] = f"{found.view.name} (virtual)"
        distance = float(np.linalg.norm(found.view.position))  # markers are about as far away as the arm's base
        return track_view(frames, tip=tip, distance=distance, **about), found.synthetic
    except InputError as error:
        raise (error if name in error.name else error.within(f"{name}: ")) from None
