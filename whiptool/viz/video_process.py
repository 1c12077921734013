"""A film of a strike that a process of its own renders, while this one goes on."""

from __future__ import annotations

import multiprocessing
import signal
from multiprocessing.connection import Connection
from pathlib import Path
from types import TracebackType

from whiptool.errors import WhiptoolError
from whiptool.models.parameters import Model
from whiptool.rollout.trajectory import Trajectory
from whiptool.target import Target


class VideoProcess:
    """A process that renders the film of one strike.

    As a context manager it is ended where an error is raised meanwhile.

    Args:
        path: MP4 file to write, see `whiptool.viz.video.render_video`.
        trajectory, model: The strike, and the model that it was rolled out with.
        target: What was to be hit.
        beyond: Whether the strike is beyond its limits, which is no hit.
    """

    def __init__(
        self, path: Path, trajectory: Trajectory, model: Model, target: Target, *, beyond: bool = False
    ) -> None:
        fresh = multiprocessing.get_context("spawn")  # a forked process would share OpenGL and threads with this one
        self._told, tells = fresh.Pipe(duplex=False)
        self._process = fresh.Process(
            target=_render, args=(tells, path, trajectory, model, target, beyond), daemon=True
        )
        self._process.start()
        tells.close()

    def wait(self) -> None:
        """Wait until the film is written.

        Raises:
            OSError: The file cannot be written.
            WhiptoolError: The process ended without a word, as where a graphics driver crashed.
        """
        try:
            error = self._told.recv()
        except EOFError:
            self._process.join()
            code = self._process.exitcode
            raise WhiptoolError(
                f"the process that renders the video ended with status {code}; give --no-video"
            ) from None
        self._process.join()
        if error is not None:
            raise error

    def __enter__(self) -> VideoProcess:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None):
        if error is not None:
            self._process.terminate()
        self._process.join()


def _render(tells: Connection, path: Path, trajectory: Trajectory, model: Model, target: Target, beyond: bool) -> None:
    """Render the film in this process, and send the error that came of it; None: the film is written."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal's Ctrl-C is for the process that waits, which ends this
    from whiptool.viz.video import render_video

    try:
        render_video(path, trajectory, model, target, beyond=beyond)
    except (OSError, WhiptoolError) as error:
        tells.send(error)
    else:
        tells.send(None)
