"""Frames of a film, drawn by matplotlib and encoded by ffmpeg."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import imageio_ffmpeg
import numpy as np

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure


def drawn_frames(
    figure: Figure, moving: Sequence[Artist], count: int, show: Callable[[int], None]
) -> Iterator[np.ndarray]:
    """Yield frames (height, width, 3) uint8; only moving artists are redrawn for each frame.

    Args:
        figure: Figure to draw; moving artists are drawn on top.
        moving: Artists that move, in drawing order.
        count: Number of frames.
        show: Called with each frame's number; sets the artists to that frame.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # not needed for films that MuJoCo draws

    canvas = FigureCanvasAgg(figure)
    for artist in moving:
        artist.set_animated(True)
    canvas.draw()
    background = canvas.copy_from_bbox(figure.bbox)
    for i in range(count):
        show(i)
        canvas.restore_region(background)
        for artist in moving:
            figure.draw_artist(artist)
        yield np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[..., :3])


def write_film(
    path: Path,
    frames: Iterable[np.ndarray],
    *,
    count: int,
    size: tuple[int, int],
    fps: float,
) -> None:
    """Write frames (height, width, 3) of uint8 as an H.264 film.

    Args:
        path: MP4 file to write.
        frames, count: Frames of the film, and their number.
        size: Width and height [pixels], both even.
        fps: Frames per second.

    Raises:
        OSError: The file cannot be written.
    """
    writer = imageio_ffmpeg.write_frames(
        path,
        size,
        fps=fps,
        codec="libx264",
        quality=7,
        macro_block_size=1,
        ffmpeg_log_level="error",
        output_params=["-preset", "veryfast", "-movflags", "+faststart"],
    )
    writer.send(None)
    try:
        for frame in frames:
            writer.send(frame)
    except OSError:
        raise OSError("ffmpeg ended before the last frame; the disk may be full") from None
    finally:
        writer.close()
    try:
        written, _ = imageio_ffmpeg.count_frames_and_secs(str(path))
    except RuntimeError:  # no film at all
        written = 0
    if written != count:
        raise OSError(f"ffmpeg wrote {written} of {count} frames; the disk may be full")
