"""End of a command that made a strike: save and print the result, then draw its pictures in a separate process."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from whiptool.errors import WhiptoolError
from whiptool.progress import note
from whiptool.runs import CITATIONS

if TYPE_CHECKING:
    from whiptool.goals.target import Target
    from whiptool.models import Model
    from whiptool.models.trajectory import Trajectory
    from whiptool.runs import RunFolder

MAP = "strike map"  # label of a strike that a map found
TRAJECTORY, VIDEO, PAGE = "trajectory.npz", "strike.mp4", "strike.html"


@dataclass(frozen=True)
class StrikeRun:
    """The strike of a run folder.

    Args:
        trajectory, model, target: Trajectory of the strike, its model and its target.
        label: Description of the controller.
        beyond: The limit that the strike breaks, in words; None: it keeps all limits.
    """

    trajectory: Trajectory
    model: Model
    target: Target
    label: str
    beyond: str | None = None

    def write_page(self, folder: Path) -> None:
        """Write the interactive page."""
        from whiptool.viz.page import strike_page
        from whiptool.whole_files import write_whole

        page = strike_page(self.model, self.trajectory, self.target, label=self.label, beyond=self.beyond)
        write_whole(folder / PAGE, page)

    def write_figures(self, folder: Path) -> None:
        """Write the figures, see `whiptool.viz.plots.save_strike_figures`."""
        from whiptool.viz.plots import save_strike_figures

        title = self.label + (", beyond its limits" if self.beyond else "")
        save_strike_figures(folder, self.trajectory, self.model, self.target, title)

    def write_video(self, folder: Path) -> None:
        """Write the film, in which a strike beyond its limits is shown as no hit."""
        from whiptool.viz.video import render_video

        beyond = self.beyond is not None
        render_video(folder / VIDEO, self.trajectory, self.model, self.target, beyond=beyond)


class PictureProcess:
    """A separate process that imports the drawing libraries at once, and draws film and figures of a strike.

    It ends with this process, or, if nothing was sent to it, when this object is no longer referenced. As a context
    manager it waits for the pictures, or after an error it stops the process.
    """

    def __init__(self) -> None:
        fresh = multiprocessing.get_context("spawn")  # a forked process would share OpenGL and threads with this one
        self._pipe, there = fresh.Pipe()
        self._process = fresh.Process(target=_draw, args=(there,), daemon=True)
        with _interrupts_held():
            self._process.start()
        there.close()

    def draw(self, folder: Path, strike: StrikeRun) -> None:
        """Start to draw the pictures of a strike into a folder."""
        with suppress(BrokenPipeError):  # it died, as `wait` says
            self._pipe.send((folder, strike))

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

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: object) -> None:
        self.stop() if error is not None else self.wait()


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
    from whiptool.viz import plots, video  # noqa: F401  # imported before anything is to be drawn

    try:
        folder, strike = pipe.recv()
    except EOFError:  # nothing was to be drawn in the end
        return
    try:
        strike.write_video(folder)
        strike.write_figures(folder)
    except (OSError, WhiptoolError) as error:
        pipe.send(error)
    else:
        pipe.send(None)


def tell_strike(
    options: Any,
    folder: RunFolder,
    strike: StrikeRun,
    summary: dict[str, Any],
    lines: Sequence[str],
    *,
    later: Callable[[], tuple[dict[str, Any], str]] | None = None,
    further: Callable[[], list[str]] = list,
    process: PictureProcess | None = None,
) -> None:
    """Write and print the result of a strike, then draw; JSON is printed when the result is complete.

    Args:
        options: Options of the command, for the format of the result and the video.
        folder: Run folder.
        strike: The strike.
        summary: Result of the strike.
        lines: The result as lines of text.
        later: Function that returns further results and lines, which take longer, while a process draws.
        further: Function that draws more pictures, and returns lines about them.
        process: Process that draws video and figures; None: a new one, which is only started for a video.
    """
    folder.write_result(summary)  # whatever happens below
    if later is None or not options.json:
        options.tell(summary, "\n".join(lines))
    strike.trajectory.save(folder.path / TRAJECTORY)
    drawing = (process or PictureProcess()) if options.video else None
    with drawing or nullcontext():
        if drawing is not None:
            drawing.draw(folder.path, strike)
        if later is not None:
            more, line = later()
            summary |= more
            folder.write_result(summary)
            options.tell(summary, line)
        files = [*draw_here(folder.path, strike, figures=drawing is None), *further()]
    if not options.json:
        print(f"  run folder     {folder.path} ({', '.join([*files, CITATIONS])})")


def draw_here(folder: Path, strike: StrikeRun, *, figures: bool) -> list[str]:
    """Write the page and, if `figures`, the figures; return names of the run's files for the printed result."""
    note("drawing ...")
    strike.write_page(folder)
    if not figures:
        return ["trajectory", "figures", "page", "video"]
    strike.write_figures(folder)
    return ["trajectory", "figures", "page"]
