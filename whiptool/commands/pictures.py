"""What a command draws of a strike after it has printed the result: figures, an interactive page and a video."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Self

from whiptool.commands import cli

if TYPE_CHECKING:
    from whiptool.goals.target import Target
    from whiptool.models import Model
    from whiptool.models.trajectory import Trajectory
    from whiptool.viz.picture_process import PictureProcess

VIDEO = "strike.mp4"


def drawing_process() -> PictureProcess:
    """Return a process that is getting ready to draw."""
    from whiptool.viz.picture_process import PictureProcess

    return PictureProcess()


class StrikePictures:
    """The trajectory of a strike, which is saved at once, and its pictures.

    As a context manager it has a separate process draw video and figures meanwhile, and waits for it at the end.

    Args:
        folder: Run folder.
        trajectory, model, target: The strike, what struck, and what was to be hit.
        label: The controller in words.
        video: Whether there is a video.
        beyond: Beyond which limit the strike is, in words; it is then shown as no hit. None: beyond none.
        process: Process that draws; None: a new one.
    """

    def __init__(
        self,
        folder: Path,
        trajectory: Trajectory,
        model: Model,
        target: Target,
        label: str,
        *,
        video: bool,
        beyond: str | None = None,
        process: PictureProcess | None = None,
    ) -> None:
        self._folder, self._trajectory, self._model, self._target = folder, trajectory, model, target
        self._label, self._wanted, self._beyond = label, video, beyond
        self._title = label + (", beyond its limits" if beyond else "")
        self._process = process
        trajectory.save(folder / "trajectory.npz")

    def __enter__(self) -> Self:
        if self._wanted:
            from whiptool.viz.picture_process import Pictures

            self._process = self._process or drawing_process()
            drawn = (self._trajectory, self._model, self._target, self._title)
            self._process.draw(Pictures(self._folder, self._folder / VIDEO, *drawn, beyond=self._beyond is not None))
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: object) -> None:
        if self._process is not None:
            self._process.stop() if error is not None else self._process.wait()

    def draw(self) -> list[str]:
        """Write the page, and figures unless a process does; return what there is in the end, for people."""
        cli.drawing()
        from whiptool.viz.page import strike_page
        from whiptool.whole_files import write_whole

        folder, trajectory, model, target = self._folder, self._trajectory, self._model, self._target
        page = strike_page(model, trajectory, target, label=self._label, beyond=self._beyond)
        write_whole(folder / "strike.html", page)
        if self._process is None:
            from whiptool.viz.plots import save_strike_figures

            save_strike_figures(folder, trajectory, model, target, self._title)
            return ["trajectory", "figures", "page"]
        return ["trajectory", "figures", "page", "video"]
