"""A browser's page of a run that is followed: its chosen strike plays in the scene, its charts grow in the panel."""

from __future__ import annotations

import html
import logging
import threading
import time
from collections.abc import Mapping
from typing import TYPE_CHECKING

from whiptool.following.charts import ChartPanel
from whiptool.following.run_scene import RunScene
from whiptool.following.run_view import Measured, ShownMotion
from whiptool.following.watcher import Watched, Watcher
from whiptool.live_page.page import WIDTH
from whiptool.live_page.panel import SPEEDS, THEME

if TYPE_CHECKING:
    from viser import ClientHandle

FPS = 30.0  # frames a second of the strike
_PAUSE = 0.7  # [s] after the strike, before it begins again
_log = logging.getLogger(__name__)


class RunPage:
    """A page that shows a run until `close`.

    Args:
        client: The user's browser.
        watcher: What looks at the run.
    """

    def __init__(self, client: ClientHandle, watcher: Watcher) -> None:
        self._client, self._watcher = client, watcher
        self._ended = threading.Event()
        self._scene: RunScene | None = None
        self._shown: Watched | None = None
        self._motion: ShownMotion | None = None
        gui = client.gui
        client.gui.configure_theme(**THEME)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(WIDTH)
        self._facts = gui.add_html(_table("", {"state": "opening the run"}))
        self._speed = gui.add_dropdown("speed", tuple(SPEEDS), initial_value="1/4")
        self._playing = gui.add_checkbox("play", initial_value=True)
        self._said = gui.add_html("")
        self._charts = ChartPanel(gui)
        threading.Thread(target=self._work, name=f"page {client.client_id}", daemon=True).start()

    def close(self) -> None:
        """End the page's thread; the user has gone."""
        self._ended.set()

    def _work(self) -> None:
        """Show what is new, and play the strike again and again."""
        t, before = 0.0, time.monotonic()
        while not self._ended.wait(1 / FPS):
            now = time.monotonic()
            passed, before = now - before, now
            try:
                if (seen := self._watcher.seen) is not None and seen is not self._shown:
                    self._shown = seen
                    self._show(seen)
                t = self._frame(t, passed)
            except Exception as error:  # a page that is being closed
                if not self._ended.is_set():
                    _log.error("the page goes on after an error", exc_info=error)

    def _show(self, seen: Watched) -> None:
        view, motion = seen.view, seen.motion
        state = "ended" if view.finished else "running"
        self._facts.content = _table(view.heading, {"state": state, **view.facts})
        self._charts.show(view.charts)
        if motion is not None and motion is not self._motion:
            if self._scene is None:
                self._scene = RunScene(self._client, motion)
                self._speed.visible = self._playing.visible = True
            self._motion = motion
            self._scene.show(motion)
        if self._scene is not None:
            self._scene.show_points(view.points)
        said = [view.chosen.said] if view.chosen else []
        self._said.content = _note([*said, *(f"points: {name}" for name in view.points), seen.fault])

    def _frame(self, t: float, passed: float) -> float:
        """Show one frame; return the time in the strike [s]."""
        if self._scene is None or not self._playing.value:
            return t
        measured = None if self._shown is None else self._shown.view.measured
        if measured is not None and self._shown is not None and not self._shown.view.finished:
            return self._live(measured)
        pace = SPEEDS[self._speed.value]
        t += pace * passed
        t = 0.0 if t > self._scene.duration + pace * _PAUSE else t
        with self._client.atomic():
            self._scene.pose(t)
            if measured is not None:
                self._scene.show_measured(measured.at(t))
        return t

    def _live(self, measured: Measured) -> float:
        """Show an arm where it was measured last, and its twin at that time; return the time in the strike [s]."""
        assert self._scene is not None
        t = float(measured.t[-1]) if len(measured.t) else 0.0
        with self._client.atomic():
            self._scene.pose(max(t, 0.0))
            if len(measured.t):
                self._scene.show_measured(measured.q[-1])
        return 0.0


def _table(heading: str, facts: Mapping[str, str]) -> str:
    """Return facts as HTML; names of models and joints are text."""
    rows = "".join(
        f"<tr><td style='padding-right:1em;opacity:.7'>{html.escape(name)}</td><td>{html.escape(value)}</td></tr>"
        for name, value in facts.items()
    )
    return f"<div style='padding:0 .6em'><b>{html.escape(heading)}</b><table>{rows}</table></div>"


def _note(lines: list[str]) -> str:
    text = "<br>".join(html.escape(line) for line in lines if line)
    return f"<div style='padding:0 .6em;opacity:.7;font-size:.9em'>{text}</div>"
