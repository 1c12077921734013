"""A thread that looks at a followed run again and again, for all pages that show it."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass

from whiptool.errors import WhiptoolError
from whiptool.following.followed import Followed
from whiptool.following.run_view import Chosen, RunView, ShownMotion

_EVERY = 0.5  # [s] between two tries to open the run
_log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Watched:
    """What a run shows, as pages take it.

    Args:
        view: The view.
        motion: ShownMotion of its chosen strike, the same object until another strike is chosen; None before the first.
        fault: Why the last look failed; empty: it did not.
    """

    view: RunView
    motion: ShownMotion | None
    fault: str = ""


class Watcher:
    """Looks at a run until `close`. A look that fails is made again: a file may be whole the next time.

    Args:
        opened: Function that returns the run; it is called in the watcher's thread, as it imports simulators.

    Attributes:
        seen: What was seen last, a new object whenever something changed; None before the first look.
    """

    def __init__(self, opened: Callable[[], Followed]) -> None:
        self._opened = opened
        self._run: Followed | None = None
        self.seen: Watched | None = None
        self._chosen: Chosen | None = None
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._look_again, name="watcher", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread after the present look."""
        self._ended.set()
        self._thread.join()

    def _look_again(self) -> None:
        while True:
            try:
                self._look()
            except Exception as error:
                self._failed(error)
            if self._ended.wait(_EVERY if self._run is None else self._run.every):
                return

    def _look(self) -> None:
        if self._run is None:
            self._run = self._opened()
        view = self._run.look()
        if view is None:
            return
        motion = None if self.seen is None else self.seen.motion
        self.seen = Watched(view, motion)  # charts first: a strike may take seconds, the first time
        if view.chosen is not None and view.chosen.is_other(self._chosen):
            self.seen = Watched(view, self._run.shown_motion(view.chosen))
            self._chosen = view.chosen

    def _failed(self, error: Exception) -> None:
        fault = str(error) if isinstance(error, WhiptoolError | OSError) else f"error in whiptool: {error!r}"
        before = self.seen or Watched(RunView("", False, {}, ()), None)
        if before.fault != fault:
            _log.warning("a look at the run failed", exc_info=error)
            self.seen = Watched(before.view, before.motion, fault)
