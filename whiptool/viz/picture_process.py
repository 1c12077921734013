"""The film and the figures of a strike, drawn by a separate process."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path

from whiptool.errors import WhiptoolError
from whiptool.goals.target import Target
from whiptool.models.parameters import Model
from whiptool.models.trajectory import Trajectory


@dataclass(frozen=True)
class Pictures:
    """Pictures to draw of one strike.

    Args:
        folder: Folder for the figures, see `whiptool.viz.plots.save_strike_figures`.
        film: MP4 file to write, see `whiptool.viz.video.render_video`.
        trajectory, model: Trajectory of the strike, and the model with which it was simulated.
        target: Target of the strike.
        title: Title of the figures.
        beyond: Whether the strike exceeds its limits, so that it is not shown as a hit.
    """

    folder: Path
    film: Path
    trajectory: Trajectory
    model: Model
    target: Target
    title: str
    beyond: bool = False


class PictureProcess:
    """A separate process that imports the drawing libraries at once, and draws the pictures that it is sent.

    It ends with this process, or, if nothing was sent to it, when this object is no longer referenced.
    """

    def __init__(self) -> None:
        fresh = multiprocessing.get_context("spawn")  # a forked process would share OpenGL and threads with this one
        self._pipe, there = fresh.Pipe()
        self._process = fresh.Process(target=_draw, args=(there,), daemon=True)
        with _interrupts_held():
            self._process.start()
        there.close()

    def draw(self, pictures: Pictures) -> None:
        """Start to draw pictures."""
        with suppress(BrokenPipeError):  # it died, as `wait` says
            self._pipe.send(pictures)

    def wait(self) -> None:
        """Wait until all pictures are written.

        Raises:
            OSError: A file cannot be written.
            WhiptoolError: The process ended unexpectedly, such as by a crash of a graphics driver.
        """
        try:
            error = self._pipe.recv()
        except (EOFError, ConnectionResetError):
            self._process.join()
            code = self._process.exitcode
            raise WhiptoolError(f"the process that draws ended with status {code}; give --no-video") from None
        self._process.join()
        if error is not None:
            raise error

    def stop(self) -> None:
        """Terminate the process, whether it has finished or not."""
        self._process.terminate()
        self._process.join()


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Hold a terminal's Ctrl-C back, also from processes that are started meanwhile, which is for this one alone."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _draw(pipe: Connection) -> None:
    """Draw in this process what is asked for, and send the error that came of it; None: all is written."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # where it could not be held back
    from whiptool.viz.plots import save_strike_figures
    from whiptool.viz.video import render_video

    try:
        asked: Pictures = pipe.recv()
    except EOFError:  # nothing was to be drawn in the end
        return
    try:
        render_video(asked.film, asked.trajectory, asked.model, asked.target, beyond=asked.beyond)
        save_strike_figures(asked.folder, asked.trajectory, asked.model, asked.target, asked.title)
    except (OSError, WhiptoolError) as error:
        pipe.send(error)
    else:
        pipe.send(None)
