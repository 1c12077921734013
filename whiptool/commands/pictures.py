"""End of a command that made a strike: save and print the result, then draw its pictures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from whiptool.commands import cli
from whiptool.progress import note
from whiptool.runs import CITATIONS

if TYPE_CHECKING:
    from whiptool.goals.target import Target
    from whiptool.models import Model
    from whiptool.models.trajectory import Trajectory
    from whiptool.runs import RunFolder
    from whiptool.viz.picture_process import PictureProcess

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


def drawing_process() -> PictureProcess:
    """Return a separate process, just started, that draws pictures."""
    from whiptool.viz.picture_process import PictureProcess

    return PictureProcess()


class StrikePictures:
    """Saves the trajectory of a strike immediately, and draws its pictures.

    Used as a context manager, the object starts a separate process that draws video and figures, and waits for it at
    the end.

    Args:
        folder: Run folder.
        strike: The strike; if it exceeds its limits, it is not shown as a hit.
        video: Whether to render a video.
        process: Process that draws; None: a new one.
    """

    def __init__(self, folder: Path, strike: StrikeRun, *, video: bool, process: PictureProcess | None = None) -> None:
        self._folder, self._strike, self._wanted, self._process = folder, strike, video, process
        title = strike.label + (", beyond its limits" if strike.beyond else "")
        self._drawn = (strike.trajectory, strike.model, strike.target, title)
        strike.trajectory.save(folder / TRAJECTORY)

    def __enter__(self) -> Self:
        if self._wanted:
            from whiptool.viz.picture_process import Pictures

            self._process = self._process or drawing_process()
            beyond = self._strike.beyond is not None
            self._process.draw(Pictures(self._folder, self._folder / VIDEO, *self._drawn, beyond=beyond))
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: object) -> None:
        if self._process is not None:
            self._process.stop() if error is not None else self._process.wait()

    def draw(self) -> list[str]:
        """Write the page, and the figures unless a process does; return a description of the files."""
        note("drawing ...")
        self._strike.write_page(self._folder)
        if self._process is None:
            from whiptool.viz.plots import save_strike_figures

            save_strike_figures(self._folder, *self._drawn)
            return ["trajectory", "figures", "page"]
        return ["trajectory", "figures", "page", "video"]


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
        process: See `StrikePictures`.
    """
    folder.write_result(summary)  # whatever happens below
    if later is None or not options.json:
        cli.tell(options, summary, "\n".join(lines))
    with StrikePictures(folder.path, strike, video=options.video, process=process) as pictures:
        if later is not None:
            more, line = later()
            summary |= more
            folder.write_result(summary)
            cli.tell(options, summary, line)
        files = [*pictures.draw(), *further()]
    if not options.json:
        print(f"  run folder     {folder.path} ({', '.join([*files, CITATIONS])})")
