"""Images over time, for the tracker, from any video format; and files that OpenCV decodes.

The sidecar `NAME.toml` of `NAME.mp4` has, in addition to the common keys:

    timestamps = "NAME.times.csv"    # a column t [s], one row per frame; or an array; else the film's own stamps, and
    fps = 60                         # at which it was taken, where its stamps are merely evenly counted
    stamp = "middle"                 # or start, end: what of the first row's exposure a timestamp means
    exposure = 0.004                 # [s]
    shutter = "rolling"              # or "global"
    readout = 0.015                  # from the first row's exposure to the last's [s]; rolling only
    homography = [[...], [...], [...]]   # 3 x 3, pixel (u, v, 1) -> strike plane [m]; or instead
    known_points = {pixels = [[u, v], ...], metres = [[x, y], ...]}   # at least four; or instead
    scale = 0.004                    # [m/pixel] of a camera that looks straight at the plane, with
    origin = [424, 240]              # the shoulder's pixel
    kind = "infrared"                # or "color"; needed only where grey images are stored with three channels
    synthetic = false                # true where no real camera took them
    camera = "left"                  # of a camera in space, instead of the way to metres: which one it was, of those in
    cameras = "cameras.toml"         # this file; exposure and readout are those of the camera where none are stated
"""

from __future__ import annotations

import dataclasses
import itertools
import os
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.extras import optional
from whiptool.given_files import sha256, whole_file
from whiptool.recording.camera import Camera
from whiptool.recording.logs import check_pace, good_stamps
from whiptool.recording.readers.joint_log import JointLog
from whiptool.recording.readers.sidecar import CLOCK, FILM, KINDS, PIXELS, STAMPS, UNSTATED, Sidecar
from whiptool.recording.readers.table import read_columns, time_column

ROUNDED = 0.6e-3  # [s] by which stamps in whole milliseconds miss an even clock
UNROUNDED = 4e-3  # [s] between frames from which that can be detected
SLOWED = 1.5  # times slower than `fps` from which a film plays in slow motion
SAME = 1e-3  # part by which two rates may differ without a word


@dataclass(frozen=True, eq=False)
class FrameClock:
    """Times of frames."""

    times: np.ndarray  # middle of the first row's exposure of each kept frame [s], (F,), since the command's start
    keep: np.ndarray  # whether each of the file's frames is kept, (frames in the file,)
    notes: tuple[str, ...]  # sentences on the clock that was used and on frames that were left out


def frame_clock(
    side: Sidecar, count: int, *, stamps: np.ndarray | None = None, of: str = "", numbers: np.ndarray | None = None,
    hint: float = 0.0,
) -> FrameClock:  # fmt: skip
    """Return the times of `count` frames, from the sidecar's keys `timestamps` (numbers, or a CSV file), `fps`,
    `stamp`, `exposure` and `start`, and from the file's own time stamps (count,) [s], if it has any.

    `numbers` (count,) are the frames' numbers, by default from 0 on. In messages only, `of` names the source of the
    stamps, and `hint` is the frame rate in the file [1/s], which does not account for dropped frames.
    """
    if "timestamps" in side.table:
        times, note = _timestamps(side)
        if len(times) != count:
            raise InputError(f"{side.place}timestamps", f"{len(times)} times", f"{count}, one per frame")
    elif stamps is not None:
        times, note = stamps, f"times from {of}" + (", not from fps" if side.table.get("fps") else "")
    elif "fps" in side.table:
        fps = side.number("fps", 0.0, low=1.0, high=1e5)
        times, note = (
            (np.arange(count) if numbers is None else numbers) / fps,
            f"times by frame number at {fps:g} a second",
        )
    else:
        hinted = f" (the file itself says {hint:g}; true only if no frame was dropped)" if hint > 0 else ""
        raise InputError(f"{side.place}fps", None, "fps or timestamps" + hinted, UNSTATED["fps"])
    keep, bad = good_stamps(times, f"{side.place}times")
    shift = STAMPS[side.word("stamp", STAMPS, "middle")] * side.exposure()
    return FrameClock(times[keep] + shift - side.start, keep, (note, *bad))


def clock_of_rows(side: Sidecar, stamps: np.ndarray, note: str, what: str) -> FrameClock:
    """Return the times of a table's rows with time stamps (T,) [s], relative to the sidecar's `start` of the command,
    without rows that have bad stamps. `note` says where the stamps are from, and `what` names them in messages."""
    keep, bad = good_stamps(stamps, what)
    return FrameClock(stamps[keep] - side.start, keep, (note, *bad))


def _timestamps(side: Sidecar) -> tuple[np.ndarray, str]:
    """Times [s] of the key `timestamps`, and where they come from."""
    if not isinstance(side.table["timestamps"], str):
        times = side.array("timestamps", None)
        assert times is not None
        return times, "times from timestamps"
    file = side.file("timestamps")
    assert file is not None
    names, columns = read_columns(file)
    at, unit, note = time_column(names)
    return columns[:, at] * unit, f"{note} of {file.name}"


def stamps_of_film(played: np.ndarray, fps: float | None) -> tuple[np.ndarray | None, str]:
    """Return the times at which a film's images were taken, (F,) [s], or None, and the source of these times, from the
    presentation times `played` (F,) [s] and the images' rate `fps` [1/s], if it is given.

    Equidistant stamps that were rounded to milliseconds are made equidistant again. If a film plays much more slowly
    than `fps`, it is in slow motion, and its stamps are scaled. Exactly equidistant stamps may have been generated by
    the program that wrote the file, and are not used without `fps`.
    """
    steps = np.diff(played)
    if not len(steps) or not (np.median(steps) > 0):
        return None, ""
    usual = np.median(steps)
    step = float(np.mean(steps[np.abs(steps - usual) < usual / 2]))
    number = np.round((played - played[0]) / step)
    step, first = np.polyfit(number, played, 1)
    even = first + step * number
    rounded = step >= UNROUNDED and bool(np.abs(played - even).max() < ROUNDED)
    if rounded:
        played = even
    if fps is None:
        counted = rounded and bool((np.diff(number) == 1).all())
        return (None, "") if counted else (played, "the film's own stamps")
    slower = fps * step
    if slower >= SLOWED:
        return played / slower, f"the film's own stamps, {slower:.4g} times slower than fps = {fps:g}: slow motion"
    differs = f", {1 / step:.5g} a second" if abs(slower - 1) > SAME else ""
    return played, f"the film's own stamps{differs}"


MOST_FRAMES = 200_000
SUFFIXES = (".mp4", ".avi", ".mov", ".mkv", ".webm", ".m4v")


@dataclass(frozen=True, eq=False)
class VideoSource:
    """A sequence of images with the data that convert pixels to metres and rows to times.

    Args:
        frames: Function that returns a new iterator over the F images: (H, W, 3) uint8 in the order BGR, or (H, W)
            uint8 or uint16. It raises an InputError if an image cannot be decoded.
        times: Middle of the first row's exposure in each image [s], (F,), strictly increasing, relative to the
            command's start.
        shape: Height and width [pixels].
        homography: Homography from pixels (u, v, 1) to the strike plane (x, y) [m], (3, 3); (0, 0) is the centre of the
            first pixel. None: not calibrated.
        exposure: Exposure of every row [s].
        readout: Time from the first row's exposure to the last's [s]; 0 with a global shutter.
        kind: `color` or `infrared`; empty: determined by the number of channels.
        synthetic: Whether the images were rendered.
        fps: Images per second, the inverse of the median step of `times`.
        view: The camera in space, with exposure, readout and rate of these images; None for images of the strike plane.
        about: Further arguments of `StrikeRecording`: strike, controller, target, t_stay, joints_t,
            joints_q, camera, source, sha256, exposure.
    """

    frames: Callable[[], Iterator[np.ndarray]]
    times: np.ndarray
    shape: tuple[int, int]
    homography: np.ndarray | None = None
    exposure: float = 0.0
    readout: float = 0.0
    kind: str = ""
    synthetic: bool = False
    fps: float = 0.0
    view: Camera | None = None
    about: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        steps = np.diff(self.times)
        if len(self.times) < 2 or not np.isfinite(self.times).all() or not (steps > 0).all():
            raise InputError("times", f"{len(self.times)} times", "at least two, finite and strictly increasing [s]")
        check_pace("times", self.times)
        object.__setattr__(self, "fps", float(1 / np.median(steps)))

    def __len__(self) -> int:
        return len(self.times)

    def __iter__(self) -> Iterator[tuple[float, np.ndarray]]:
        """Time of the first row's middle of exposure [s] and image, for each image."""
        return zip(self.times.tolist(), self.frames(), strict=True)


def video_frames(path: Path | str) -> Generator[np.ndarray, None, None]:
    """Yield the images of a video file, (H, W, 3) uint8, BGR."""
    for image, _ in _shown(path):
        yield image


def _shown(path: Path | str) -> Generator[tuple[np.ndarray, float], None, None]:
    """The images of `video_frames`, and when each is to be shown [s]."""
    path = whole_file(path, largest=np.inf)
    cv2, capture = _capture(path)
    shape = None
    try:
        if not capture.isOpened():
            raise InputError(str(path), "no video that can be decoded", "a whole video file, such as MP4 or AVI")
        for _ in range(MOST_FRAMES):
            there, image = capture.read()
            if not there:
                return
            if image.shape != (shape := shape or image.shape) or image.dtype != np.uint8:
                raise InputError(str(path), f"an image of shape {image.shape}", f"images of shape {shape}")
            yield image, 1e-3 * float(capture.get(cv2.CAP_PROP_POS_MSEC))
        raise InputError(
            str(path), f"more than {MOST_FRAMES} images", f"at most {MOST_FRAMES}", "keep only the part with the strike"
        )
    except (cv2.error, MemoryError) as error:
        raise InputError(str(path), "a damaged file", "a whole video file", str(error)[:160]) from None
    finally:
        capture.release()


def read_video(path: Path | str, **options: Any) -> VideoSource:
    """Read a video file with its sidecar; the images are decoded once to count them.

    Args:
        path: The file.
        options: Keys of the sidecar file, whose values they override.

    Raises:
        InputError: The file cannot be decoded or has fewer than two images, there is not one time for each image, or a
            value is not allowed; or OpenCV is not installed.
    """
    path = whole_file(path, largest=np.inf)
    side = Sidecar.of(path, options, *CLOCK, *PIXELS, *FILM)
    _ = side.filmed_by  # a slip is found before the file is decoded
    shape, played = (0, 0), []
    for image, at in _shown(path):
        shape = image.shape[:2]
        played.append(at)
    count = len(played)
    if count < 2:
        raise InputError(str(path), f"{count} images that can be decoded", "at least two", "was the file cut off?")
    fps = side.number("fps", 0.0, low=1.0, high=1e5) if "fps" in side.table else None
    stamps, whose = stamps_of_film(np.array(played), fps)
    clock = frame_clock(side, count, stamps=stamps, of=whose, hint=_claimed_rate(path))
    return source(side, lambda: video_frames(path), clock, shape, path, sha256(path))


def source(
    side: Sidecar,
    frames: Callable[[], Iterator[np.ndarray]],
    clock: FrameClock,
    shape: tuple[int, ...],
    path: Path,
    digest: str,
    log: JointLog | None = None,
    *,
    others: tuple[str, ...] = (),
) -> VideoSource:
    """Return a source of images with the camera and strike that its sidecar describes. `frames` returns a new iterator
    over all images, `shape` starts with their height and width [pixels], and `digest` is the SHA-256 of the file; `log`
    was recorded with them, and the keys `others` are for something else in the file, such as tracks."""
    about = {**side.fields(clock.notes, log), "source": str(path), "sha256": digest}
    about["exposure"] = side.exposure()
    try:
        found = VideoSource(
            frames=frames if clock.keep.all() else lambda: itertools.compress(frames(), clock.keep),
            times=clock.times,
            shape=(int(shape[0]), int(shape[1])),
            homography=side.homography(),
            exposure=about["exposure"],
            readout=side.readout(),
            kind=side.word("kind", KINDS, "color") if "kind" in side.table else "",
            synthetic=side.flag("synthetic"),
            about=about,
        )
        side.check_used(others)
        return found if side.filmed_by is None else _in_space(found, side.filmed_by)
    except InputError as error:
        raise (error if error.name.startswith(side.place) else error.within(side.place)) from None


def _in_space(video: VideoSource, camera: Camera) -> VideoSource:
    """The images of a camera in space, with that camera as it took them."""
    if video.homography is not None:
        raise InputError(
            "homography", "together with cameras", "a calibrated strike plane or a camera in space, not both"
        )
    height, width = video.shape
    if (height, width) != (camera.height, camera.width):
        allowed = f"{camera.width} x {camera.height}, as {camera.name} has in the file of cameras"
        raise InputError("images", f"{width} x {height} pixels", allowed)
    readout = video.readout * height / max(height - 1, 1)  # to the row after the last
    exposure = video.exposure or camera.exposure
    view = dataclasses.replace(camera, fps=video.fps, exposure=exposure, readout=readout)
    return dataclasses.replace(video, view=view)


def segment(path: Path, first: float, count: int, fps: float) -> Iterator[np.ndarray]:
    """Yield `count` images of a file with `fps` images per second, starting at the time `first` [s]."""
    skip = round(first * fps)
    got = 0
    for image in itertools.islice(video_frames(path), skip, skip + count):
        got += 1
        yield image
    if got < count:
        raise InputError(str(path), f"{skip + got} images", f"at least {skip + count}", "was the file cut off?")


def _claimed_rate(path: Path) -> float:
    """Frames per second as the file says, 0 if it does not."""
    cv2, capture = _capture(path)
    rate = capture.get(cv2.CAP_PROP_FPS)
    capture.release()
    return float(rate) if 0 < rate < 1e5 else 0.0


def _capture(path: Path) -> tuple[Any, Any]:
    """OpenCV, and its decoder of a file."""
    # what OpenCV and FFmpeg print on damage says nothing that our error does not; both read these when first used
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    cv2 = optional("cv2", "video")
    return cv2, cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
