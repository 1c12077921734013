"""What a command draws of a strike after it has printed the result: figures, an interactive page and a video."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Self

from whiptool.commands import cli

if TYPE_CHECKING:
    from whiptool.models import Model
    from whiptool.rollout import Trajectory
    from whiptool.target import Target
    from whiptool.viz.video_process import VideoProcess

VIDEO = "strike.mp4"


class StrikePictures:
    """The trajectory of a strike, which is saved at once, and its pictures.

    As a context manager it has a process of its own render the video meanwhile.

    Args:
        folder: Run folder.
        trajectory, model, target: The strike, what struck, and what was to be hit.
        label: The controller in words.
        video: Whether there is a video.
        beyond: Beyond which limit the strike is, in words; it is then shown as no hit. None: beyond none.
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
    ) -> None:
        self._folder, self._trajectory, self._model, self._target = folder, trajectory, model, target
        self._label, self._wanted, self._beyond = label, video, beyond
        self._video: VideoProcess | None = None
        self._open = ExitStack()
        trajectory.save(folder / "trajectory.npz")

    def __enter__(self) -> Self:
        if self._wanted:
            from whiptool.viz.video_process import VideoProcess

            path, beyond = self._folder / VIDEO, self._beyond is not None
            video = VideoProcess(path, self._trajectory, self._model, self._target, beyond=beyond)
            self._video = self._open.enter_context(video)
        return self

    def __exit__(self, *error) -> None:
        self._open.__exit__(*error)

    def draw(self) -> list[str]:
        """Write figures and page, wait for the video; return what there is, for people."""
        cli.drawing()
        from whiptool.viz.page import strike_page
        from whiptool.viz.plots import save_strike_figures
        from whiptool.whole_files import write_whole

        folder, trajectory, model, target = self._folder, self._trajectory, self._model, self._target
        title = self._label + (", beyond its limits" if self._beyond else "")
        save_strike_figures(folder, trajectory, model, target, title)
        page = strike_page(model, trajectory, target, label=self._label, beyond=self._beyond)
        write_whole(folder / "strike.html", page)
        if self._video is None:
            return ["trajectory", "figures", "page"]
        self._video.wait()
        return ["trajectory", "figures", "page", "video"]
