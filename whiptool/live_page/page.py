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
from whiptool.live_page.panel import REFUSED, THEME, Actions, Panel, error_text
from whiptool.live_page.scene import PageScene
from whiptool.live_page.session import Session, Shown
from whiptool.models.parameters import Model
from whiptool.models.strike import T_STAY
from whiptool.models.visuals import Look

if TYPE_CHECKING:
    from viser import ClientHandle

WIDTH = 380  # of the panel [pixels]
FRAMES = 30.0  # a second
SLOWER = 5  # frames, of which one is drawn while the user changes something: browsers answer late while they draw
_SLIDER = 5  # frames between two movements of the slider of time
_AT_END = 0.6  # [s] that a played strike rests at its end
GESTURE = 1.5  # [s] between changes that are not one: the ghost is the strike before all changes of one gesture
QUIET = 0.5  # [s] without a change before longer work begins, which would delay what is dragged
BEGIN = "begin"  # kind of the request with which a drag begins
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Choices:
    """What the user of a page can choose.

    Args:
        load: Function that returns model and controller for a name; None for the controller: that of the model.
        models: Names of the models, the first of them at first.
        target: Target at first; None: the usual one of the model.
        t_stay: Time after the movement in which the tip can still hit [s].
        strike: Strike vector of the first model at first; empty: one is found for the target.
        looks: Visual shapes of the first model's robot, see `robot_looks`; None: the shapes of the model.
    """

    load: Callable[[str], tuple[Model, Controller | None]]
    models: tuple[str, ...]
    target: Target | None = None
    t_stay: float = T_STAY
    looks: Sequence[Look] | None = None
    strike: tuple[float, ...] = ()


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
        self.client, self._choices = client, choices
        self._closed = threading.Event()
        self._files = ThreadPoolExecutor(1, thread_name_prefix="studio files")
        self._worker = Newest(self._after, self._failed, name=f"studio {client.client_id}")
        self._state: tuple[Session, PageScene, Panel] | None = None
        self._shown: Shown | None = None
        self._ghost: Shown | None = None
        self._asked = self._changed = 0.0  # when the user asked for a change last, and when one was shown
        self._dragged: Target | None = None  # where the user has dragged the target
        self._marking, self._pale = threading.Lock(), False  # whether the outcome is shown as that of an older request
        self._fresh = True  # whether nothing of the present model was shown
        client.gui.configure_theme(**THEME)
        client.gui.main_panel.dock_right()
        client.gui.main_panel.set_width(WIDTH)
        self._worker.ask("model", lambda: self._open(choices.models[0], choices.target, choices.strike))
        threading.Thread(target=self._play, name=f"studio player {client.client_id}", daemon=True).start()

    @property
    def session(self) -> Session | None:
        """The user's session; None while a model is loaded."""
        return None if self._state is None else self._state[0]

    @property
    def shown(self) -> Shown | None:
        """What is shown; None: nothing yet."""
        return self._shown

    @property
    def _changing(self) -> bool:
        """Whether the user changes something, or did a moment ago."""
        return time.monotonic() - max(self._asked, self._changed) < QUIET

    def close(self) -> None:
        """End the page's threads; the user has gone."""
        self._closed.set()
        self._worker.close()
        self._files.shutdown(wait=False, cancel_futures=True)

    def _ask(self, kind: str, change: Callable[[Session], None]) -> None:
        def action() -> None:
            if self._state is not None:
                change(self._state[0])

        self._asked = time.monotonic()
        self._request(kind, action)

    def _request(self, kind: str, action: Callable[[], None]) -> None:
        """Have a request carried out; until its result is there, the outcome before it is shown as such."""
        with self._marking:
            self._worker.ask(kind, action)
            if self._state is not None and not self._pale:
                self._pale = True
                self._state[2].show_outcome(computing=True)

    def _drag(self, target: Target, begins: bool) -> None:
        if begins:
            self._worker.ask(BEGIN, lambda: None)
        elif target == self._dragged:  # as at the end of a drag
            return
        self._dragged = target
        self._ask("drag", lambda session: session.move_target(target))

    def _open(self, name: str, target: Target | None = None, strike: tuple[float, ...] = ()) -> None:
        """Show another model."""
        waits = self.client.add_notification("Loading", f"{name}; the first time some seconds", loading=True)
        try:
            model, controller = self._choices.load(name)
            stay = self._choices.t_stay
            session = Session(model, controller, origin=name, target=target, t_stay=stay, strike=strike)
        finally:
            waits.remove()
        first = self._state is None
        self._state, self._fresh, self._shown, self._ghost = None, True, None, None
        looks = self._choices.looks if name == self._choices.models[0] else None
        scene = PageScene(self.client.scene, model, self._drag, looks)
        actions = Actions(
            ask=self._ask,
            choose_model=lambda name: self._request("model", lambda: self._open(name)),
            export=self._export,
            show=scene.set_visible,
            darken=lambda dark: self._darken(scene, dark),
            refuse=self._failed,
        )
        panel = Panel(self.client.gui, session, self._choices.models, actions)
        aspect = self.client.camera.aspect
        self.client.camera.position, self.client.camera.look_at = scene.camera(aspect)
        if first and aspect < 1:  # on a telephone it would cover half of the scene
            self.client.gui.main_panel.minimize()
        self._state = session, scene, panel

    def _darken(self, scene: PageScene, dark: bool) -> None:
        self.client.gui.configure_theme(dark_mode=dark, **THEME)
        scene.set_dark(dark)

    def _after(self, kinds: set[str]) -> Iterator[None] | None:
        """Show the result of some requests, and return what is computed while nothing newer waits."""
        if self._state is None:
            return None
        session, scene, panel = self._state
        now = time.monotonic()
        pause = now - self._changed > GESTURE and not kinds & {"drag", "noise", REFUSED}
        if (BEGIN in kinds or pause) and not self._fresh:
            self._ghost = self._shown
        self._changed, self._fresh = now, False
        shown = self._shown = session.shown()
        with self.client.atomic():
            panel.refresh(session, shown, kinds | self._worker.waiting)
            with self._marking:
                self._pale = bool(self._worker.waiting)
                panel.show_outcome(computing=self._pale)
            scene.show(shown, self._ghost)
            scene.show_spread(None)
        self.client.flush()
        return self._longer(session, scene, panel, shown)

    def _longer(self, session: Session, scene: PageScene, panel: Panel, shown: Shown) -> Iterator[None]:
        """Compute tolerance ellipses and heat map, once nothing has changed for a while."""
        while time.monotonic() - self._changed < QUIET:
            time.sleep(QUIET / 20)
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
        self.client.add_notification(title, error_text(error), color="orange", auto_close_seconds=8.0)

    def _export(self, kind: str) -> None:
        shown = self._shown
        if shown is not None:
            self._files.submit(self._send, shown, kind)

    def _send(self, shown: Shown, kind: str) -> None:
        try:
            waits = self.client.add_notification("Writing", f"strike.{kind}", loading=True)
            try:
                self.client.send_file_download(*exported(shown, kind), save_immediately=True)
            finally:
                waits.remove()
        except Exception as error:
            self._failed(error)

    def _play(self) -> None:
        """Move arm and whip over the strike, until the page is closed."""
        at, before, frame = 0.0, time.monotonic(), 0
        while not self._closed.wait((SLOWER if self._changing else 1) / FRAMES):
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

    def _frame(self, state: tuple[Session, PageScene, Panel], at: float, passed: float, *, slide: bool) -> float:
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
        with self.client.atomic():
            scene.pose(scene.postures.at(at))
        return at
