"""A run folder that is followed: it is read again and again, and only what is new in it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from whiptool.following.run_view import Chosen, RunView, ShownMotion
from whiptool.given_files import parsing
from whiptool.models.visuals import Look
from whiptool.runs import RESULT


class Followed(ABC):
    """A run that another process may still write.

    Nothing is written in the folder, and no lock is taken.

    Args:
        folder: Run folder.
        heading: Which run it is, in words.

    Attributes:
        every: Time between two looks [s].
        looks: Visual shapes of the robot, as for `ShownMotion`.
    """

    every = 0.5

    def __init__(self, folder: Path, heading: str) -> None:
        self.folder, self.heading = folder, heading
        self.looks: Sequence[Look] | None = None
        self._finished: bool | None = None

    def look(self) -> RunView | None:
        """Return what is shown of the run now; None if nothing changed since the last look.

        Raises:
            InputError: A file of the run is damaged.
        """
        with parsing(self.folder, "run"):
            new, finished = self._read(), (self.folder / RESULT).is_file()
            if not new and finished == self._finished:
                return None
            self._finished = finished
            return self._view(finished)

    @abstractmethod
    def _read(self) -> bool:
        """Read what is new, and return whether anything was."""

    @abstractmethod
    def _view(self, finished: bool) -> RunView:
        """Return what is shown now."""

    def shown_motion(self, chosen: Chosen) -> ShownMotion:
        """Return the motion of the strike that a view of this run chose, with the looks of its robot."""
        return replace(self.motion(chosen), looks=self.looks)

    @abstractmethod
    def motion(self, chosen: Chosen) -> ShownMotion:
        """Return the motion of the strike that a view of this run chose."""


class GrowingFile:
    """A file to which another process appends lines.

    A last line without an end is left for the next look. A file that was replaced or shortened, as by a resumed run,
    is read from its beginning.

    Args:
        path: The file, which may not exist yet.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._place: tuple[int, int] | None = None  # device and inode
        self._read = 0  # bytes, of whole lines

    def new_lines(self) -> tuple[bool, list[bytes]]:
        """Return whether the file was begun again, and the whole lines since the last look, without their ends."""
        try:
            with self.path.open("rb") as file:
                status = self.path.stat()
                place = status.st_dev, status.st_ino
                anew = place != self._place or status.st_size < self._read
                self._place, self._read = place, 0 if anew else self._read
                file.seek(self._read)
                whole, end, _ = file.read().rpartition(b"\n")
        except FileNotFoundError:
            anew = self._place is not None
            self._place, self._read = None, 0
            return anew, []
        self._read += len(whole) + len(end)
        return anew, whole.split(b"\n") if end else []
