"""One user's page: it joins session, scene and panel, plays the strike, and outlives the user's errors."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING

from whiptool.errors import WhiptoolError
from whiptool.goals.target import Target
from whiptool.impedance.controller import Controller
from whiptool.live_page.export import exported
from whiptool.live_page.newest import Newest
from whiptool.live_page.panel import THEME, Panel, error_text
from whiptool.live_page.scene import Scene
from whiptool.live_page.session import Session, Shown
from whiptool.models.parameters import Model
from whiptool.models.strike import T_STAY
from whiptool.models.visuals import Look

if TYPE_CHECKING:
    from viser import ClientHandle

WIDTH = 380  # of the panel [pixels]
FRAMES = 30.0  # a second
_SLIDER = 5  # frames between two movements of the slider of time
_AT_END = 0.6  # [s] that a played strike rests at its end
GESTURE = 0.7  # [s] within which changes are one: the ghost is the strike before all of them
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Choices:
    """What the user of a page can choose.

    Args:
        load: Function that returns model and controller for a name; None for the controller: that of the model.
        models: Names of the models, the first of them at first.
        target: Target at first; None: the usual one of the model.
        t_stay: Time after the movement in which the tip can still hit [s].
        looks: Visual shapes of the first model's robot, see `robot_looks`; None: the shapes of the model.
    """

    load: Callable[[str], tuple[Model, Controller | None]]
    models: tuple[str, ...]
    target: Target | None = None
    t_stay: float = T_STAY
    looks: Sequence[Look] | None = None


class Page:
    """One user's page.

    Args:
        client: The user's browser.
        choices: What can be chosen.
    """

    def __init__(
        self,
        client: ClientHandle,
        choices: Choices,
    ) -> None:
        self._client, self._choices = client, choices
        self._closed = threading.Event()
        self._files = ThreadPoolExecutor(1, thread_name_prefix="studio files")
        self._worker = Newest(self._after, self._failed, name=f"studio {client.client_id}")
        self._state: tuple[Session, Scene, Panel] | None = None
        self._shown: Shown | None = None
        self._ghost: Shown | None = None
        self._changed = 0.0
        self._fresh = True  # whether nothing of the present model was shown
        client.gui.configure_theme(**THEME)
        client.gui.main_panel.dock_right()
        client.gui.main_panel.set_width(WIDTH)
        self._worker.ask("model", lambda: self._open(choices.models[0], choices.target))
        threading.Thread(target=self._play, name=f"studio player {client.client_id}", daemon=True).start()

    def close(self) -> None:
        """End the page's threads; the user has gone."""
        self._closed.set()
        self._worker.close()
        self._files.shutdown(wait=False, cancel_futures=True)

    def _ask(self, kind: str, change: Callable[[Session], None]) -> None:
        def action() -> None:
            if self._state is not None:
                change(self._state[0])

        self._worker.ask(kind, action)

    def _open(self, name: str, target: Target | None = None) -> None:
        """Show another model."""
        waits = self._client.add_notification("Loading", f"{name}; the first time some seconds", loading=True)
        try:
            model, controller = self._choices.load(name)
            session = Session(model, controller, origin=name, target=target, t_stay=self._choices.t_stay)
        finally:
            waits.remove()
        self._state, self._fresh, self._shown, self._ghost = None, True, None, None
        looks = self._choices.looks if name == self._choices.models[0] else None
        scene = Scene(self._client.scene, model, lambda to: self._ask("drag", lambda s: s.move_target(to)), looks)
        panel = Panel(
            self._client.gui,
            session,
            self._choices.models,
            ask=self._ask,
            choose_model=lambda name: self._worker.ask("model", lambda: self._open(name)),
            export=self._export,
            show=scene.set_visible,
        )
        self._client.camera.position, self._client.camera.look_at = scene.camera(self._client.camera.aspect)
        self._state = session, scene, panel

    def _after(self, kinds: set[str]) -> Iterator[None] | None:
        """Show the result of some requests, and return what is computed while nothing newer waits."""
        if self._state is None:
            return None
        session, scene, panel = self._state
        now = time.monotonic()
        if now - self._changed > GESTURE and not self._fresh and kinds != {"noise"}:
            self._ghost = self._shown
        self._changed, self._fresh = now, False
        shown = self._shown = session.shown()
        with self._client.atomic():
            panel.refresh(session, shown, kinds)
            scene.show(shown, self._ghost)
            scene.show_spread(None)
        self._client.flush()
        return self._longer(session, scene, panel, shown)

    def _longer(self, session: Session, scene: Scene, panel: Panel, shown: Shown) -> Iterator[None]:
        """Compute tolerance ellipses and heat map."""
        yield
        spread = session.spread() if shown.settings.noise > 0 and not shown.trajectory.diverged else None
        scene.show_spread(spread)
        panel.show_spread(spread, shown.settings.noise)
        yield
        yield from session.sample()
        heat = session.heat_map()
        scene.show_heat(heat)
        panel.show_heat(heat)

    def _failed(self, error: Exception) -> None:
        """Say what went wrong; the session is as before."""
        if not isinstance(error, WhiptoolError):
            _log.error("the studio goes on after an error", exc_info=error)
        title = "Not possible" if isinstance(error, WhiptoolError) else f"Error in whiptool: {type(error).__name__}"
        self._client.add_notification(title, error_text(error), color="orange", auto_close_seconds=8.0)

    def _export(self, kind: str) -> None:
        shown = self._shown
        if shown is not None:
            self._files.submit(self._send, shown, kind)

    def _send(self, shown: Shown, kind: str) -> None:
        try:
            waits = self._client.add_notification("Writing", f"strike.{kind}", loading=True)
            try:
                self._client.send_file_download(*exported(shown, kind), save_immediately=True)
            finally:
                waits.remove()
        except Exception as error:
            self._failed(error)

    def _play(self) -> None:
        """Move arm and whip over the strike, until the page is closed."""
        at, before, frame = 0.0, time.monotonic(), 0
        while not self._closed.wait(1 / FRAMES):
            now, state = time.monotonic(), self._state
            passed, before = now - before, now
            if state is None or state[1].postures is None:
                continue
            try:
                at = self._frame(state, at, passed, slide=frame % _SLIDER == 0)
            except Exception as error:  # a page that is being closed or opened again
                if not self._closed.is_set() and self._state is state:
                    _log.debug("a frame was left out", exc_info=error)
            frame += 1

    def _frame(self, state: tuple[Session, Scene, Panel], at: float, passed: float, *, slide: bool) -> float:
        """Show one frame; return the time in the strike [s]."""
        _, scene, panel = state
        assert scene.postures is not None
        end = float(scene.postures.t[-1])
        if panel.playing.value:
            at += passed * panel.pace
            at = 0.0 if at > end + _AT_END * panel.pace else at
            if slide:
                panel.time.value = round(min(at, float(panel.time.max)), 3)
        else:
            at = float(panel.time.value)
        with self._client.atomic():
            scene.pose(scene.postures.at(at))
        return at
