"""The panel of a page: outcome, playing, target, whip, controller, strike and export."""

from __future__ import annotations

import asyncio
import html
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from whiptool.errors import InputError
from whiptool.goals.target import Target
from whiptool.live_page.export import EXPORTS
from whiptool.live_page.heat_map import HeatMap
from whiptool.live_page.knobs import Knob, law_knobs, law_names, strike_knobs, whip_knobs
from whiptool.live_page.outcome_bars import Bar, bars_html, outcome_bars
from whiptool.live_page.scene import LEAST, MOST
from whiptool.live_page.session import Session, Shown
from whiptool.live_page.spread import INSIDE, STRIKES, TipSpread

if TYPE_CHECKING:
    from viser import GuiApi, GuiEvent

THEME: dict[str, Any] = {"show_share_button": False, "show_logo": False, "control_width": "large"}
SPEEDS = {"real time": 1.0, "1/4": 0.25, "1/20": 0.05}
TYPED = 1.0  # [s] without a change after which a number in a box is whole, and is refused if it is out of range
REFUSED = "refused"  # kind of the request that shows the numbers that are in force
_NOTE = "font-size:0.75rem;padding:0.15rem 0.9rem;line-height:1.3;opacity:0.8"
Ask = Callable[[str, Callable[[Session], None]], None]


@dataclass(frozen=True)
class Actions:
    """What the widgets do.

    Args:
        ask: Function that has a change of the session carried out: its kind, and a function of the session.
        choose_model: Function that is called with the name of a model.
        export: Function that is called with a name of `EXPORTS`.
        show: Function that is called with a part of the scene (`heat`, `spread`, `ghost`) and whether it is shown.
        darken: Function that is called with whether the page is dark.
        refuse: Function that is called with the error of a number that is not allowed.
    """

    ask: Ask
    choose_model: Callable[[str], None]
    export: Callable[[str], None]
    show: Callable[[str, bool], None]
    darken: Callable[[bool], None]
    refuse: Callable[[InputError], None]


class Panel:
    """The panel of one user's page.

    Args:
        gui: Widgets of the user's page.
        session: What the widgets show at first.
        models: Names of the models that can be chosen.
        actions: What the widgets do.
    """

    def __init__(self, gui: GuiApi, session: Session, models: Sequence[str], actions: Actions) -> None:
        ask = actions.ask
        self._gui, self._ask, self._refuse = gui, ask, actions.refuse
        self._said: tuple[Shown, list[Bar]] | None = None
        self._sliders: dict[str, dict[str, Any]] = {"whip": {}, "law": {}, "strike": {}}
        gui.reset()
        model = session.model
        self._add_model(session, models, actions.choose_model)
        self._outcome = gui.add_html("")
        self._add_player()
        tabs = gui.add_tab_group()
        with tabs.add_tab("Target"):
            self._add_target(session)
        with tabs.add_tab("Whip"):
            for knob in whip_knobs(session.settings.base, session.settings.whip):
                self._add_slider("whip", knob, Session.turn_whip)
            gui.add_button("Reset the whip").on_click(lambda _: ask("whip", Session.reset_whip))
        with tabs.add_tab("Arm"):
            laws = gui.add_dropdown("control law", law_names(model), initial_value=session.settings.controller.law.kind)
            self._on(laws, lambda kind: ask("law", lambda s: s.choose_law(kind)))
            self._laws, self._law_folder = laws, gui.add_folder("numbers of the law")
        with tabs.add_tab("Strike"):
            gui.add_button("Aim again").on_click(lambda _: ask("aim", Session.aim))
            for knob in strike_knobs(model, np.array(session.settings.strike), session.striker.bounds):
                self._add_slider("strike", knob, Session.turn_strike)
        with tabs.add_tab("View"):
            self._add_view(session, actions)
        with tabs.add_tab("Export"):
            for name, what in EXPORTS.items():
                gui.add_button(what).on_click(lambda _, name=name: actions.export(name))
        self._law = ""
        self._arrives: tuple[float, ...] | None = None  # direction in which the tip arrives at present

    def _on(self, widget: Any, changed: Callable[[Any], None]) -> None:
        """Call a function when the user, and not the program, has changed a widget.

        A number out of a slider's range, which only its box can have, is refused when nothing more is typed for a
        while: it may be the beginning of another. A browser replaces it by the end of the range when its box is left.
        """
        outside: float | None = None

        def refuse(given: float) -> None:
            nonlocal outside
            if outside == given:
                outside = None
                self._refuse(InputError(widget.label, given, f"{widget.min:g} to {widget.max:g}"))
                self._ask(REFUSED, lambda _: None)  # shows the number that is in force

        @widget.on_update
        async def _(event: GuiEvent) -> None:
            nonlocal outside
            if event.client is None:
                return
            value, before, outside = widget.value, outside, None
            if getattr(widget, "max", None) is not None and not widget.min <= value <= widget.max:
                outside = value
                asyncio.get_running_loop().call_later(TYPED, refuse, value)
            elif before is not None and value in (widget.min, widget.max) and not str(value).startswith(f"{before:g}"):
                outside = before
                refuse(before)
            else:
                changed(value)

    def _add_model(self, session: Session, models: Sequence[str], choose: Callable[[str], None]) -> None:
        model = self._gui.add_dropdown("model", tuple(models), initial_value=session.settings.origin)
        self._on(model, choose)

    def _add_player(self) -> None:
        gui = self._gui
        self.time = gui.add_slider("time [s]", 0.0, 1.0, 0.01, 0.0)
        self.playing = gui.add_checkbox("play", True)
        self._speeds = gui.add_dropdown("speed", tuple(SPEEDS), initial_value="1/4")

    @property
    def pace(self) -> float:
        """Speed at which the strike is played, 1 is real time."""
        return SPEEDS[self._speeds.value]

    def _add_target(self, session: Session) -> None:
        gui, ask, target = self._gui, self._ask, session.settings.target
        letters = "xy" if session.model.dimension == 2 else "xyz"
        self._place = [
            gui.add_number(f"{letter} [m]", float(x), step=0.01) for letter, x in zip(letters, target.position)
        ]
        for widget in self._place:
            self._on(widget, lambda _: ask("target", self._moved_by_numbers))
        farthest = session.model.reach / 10
        self._radius = gui.add_slider("hit radius [m]", 0.001, max(round(farthest, 2), 0.1), 0.001, target.hit_radius)
        self._cone = gui.add_slider("cone, half angle [°]", 1.0, 60.0, 1.0, math.degrees(target.cone))
        self._speed = gui.add_slider("least speed [m/s]", 0.0, 20.0, 0.5, target.speed or 0.0)
        self._directed = gui.add_checkbox("ask for a direction", target.direction is not None)
        names = ("angle from forward [°]",) if len(letters) == 2 else ("azimuth [°]", "elevation [°]")
        half = (180.0, 90.0)
        self._angles = [gui.add_slider(x, -h, h, 1.0, 0.0) for x, h in zip(names, half, strict=False)]
        for widget in (self._radius, self._cone, self._speed, self._directed):
            self._on(widget, lambda _: ask("target", self._asked_by_widgets()))
        for widget in self._angles:
            self._on(widget, lambda _: ask("angles", self._turned_by_widgets))
        gui.add_html(f'<div style="{_NOTE}">Drag the ball in the scene to move the target, and the blue ball to turn '
                     "the direction of arrival.</div>")  # fmt: skip

    def _moved_by_numbers(self, session: Session) -> None:
        place = tuple(widget.value for widget in self._place)
        session.move_target(replace(session.settings.target, position=place))

    def _asked_by_widgets(self) -> Callable[[Session], None]:
        directed, radius = self._directed.value, self._radius.value
        cone, speed = math.radians(self._cone.value), self._speed.value or None

        def ask(session: Session) -> None:
            target = session.settings.target
            direction = (target.direction or self._arrives) if directed else None  # as it arrives at present
            session.move_target(Target(target.position, radius, direction, cone, speed))

        return ask

    def _turned_by_widgets(self, session: Session) -> None:
        direction = _direction([math.radians(widget.value) for widget in self._angles])
        session.move_target(replace(session.settings.target, direction=direction, sight=None))

    def _add_view(self, session: Session, actions: Actions) -> None:
        gui, ask = self._gui, self._ask
        names = {"heat": "heat map: where the tip can hit", "spread": "tolerance ellipses", "ghost": "strike before"}
        for part, what in names.items():
            box = gui.add_checkbox(what, True)
            self._on(box, lambda shown, part=part: actions.show(part, shown))
        self._heat_note = gui.add_html("")
        self._noise = noise = gui.add_slider("errors of the arm, σ [rad, s]", 0.0, 0.05, 0.001, session.settings.noise)
        self._on(noise, lambda value: ask("noise", lambda s: s.set_noise(value)))
        self._spread_note = gui.add_html("")
        follows = gui.add_checkbox("aim again after each change", session.settings.follows)
        self._on(follows, lambda value: ask("follows", lambda s: s.set_follows(value)))
        dark = gui.add_checkbox("dark", False)
        self._on(dark, actions.darken)

    def _add_slider(self, group: str, knob: Knob, turn: Callable[[Session, str, float], None]) -> None:
        low, high, value = knob.shown
        slider = self._gui.add_slider(knob.text, low, high, knob.step, value)
        self._on(
            slider, lambda value: self._ask(f"{group} {knob.name}", lambda session: turn(session, knob.name, value))
        )
        self._sliders[group][knob.name] = slider

    def show_outcome(self, *, computing: bool) -> None:
        """Show the outcome of the last result, pale while something newer is computed."""
        if self._said is not None:
            self._outcome.content = bars_html(*self._said, computing=computing)

    def refresh(self, session: Session, shown: Shown, touched: set[str]) -> None:
        """Show a new result; widgets that the user has just changed are left as they are.

        Args:
            session: The session.
            shown: The result.
            touched: Kinds of the requests that led to it, and of those that wait.
        """
        self._said = shown, outcome_bars(shown, session.striker.limits)
        end = math.ceil(100 * float(shown.trajectory.t[-1]) - 1e-9) / 100
        if self.time.max != end:
            self.time.max = end
        velocity = shown.near.velocity[0]
        fast = float(np.linalg.norm(velocity))
        self._arrives = tuple((velocity / fast).tolist()) if np.isfinite(fast) and fast > 0 else None
        settings = shown.settings
        for widget in (self._cone, *self._angles):
            widget.visible = settings.target.direction is not None
        self._refresh_target(settings.target, touched)
        if "noise" not in touched:
            _set(self._noise, settings.noise)
        self._refresh_law(session, settings.controller.law, touched)
        knobs = {"whip": whip_knobs(settings.base, settings.whip)}
        knobs["law"] = law_knobs(settings.controller.law, session.usual_law, shown.model)
        knobs["strike"] = strike_knobs(shown.model, np.array(settings.strike), session.striker.bounds)
        for group, its in knobs.items():
            for knob in its:
                if f"{group} {knob.name}" not in touched:
                    _set(self._sliders[group].get(knob.name), knob.shown[2])

    def _refresh_target(self, target: Target, touched: set[str]) -> None:
        if "target" not in touched:
            for widget, value in zip(self._place, target.position, strict=True):
                _set(widget, round(value, 4))
            _set(self._directed, target.direction is not None)
            _set(self._radius, target.hit_radius)
            _set(self._cone, round(math.degrees(target.cone), 6))
            _set(self._speed, target.speed or 0.0)
        if target.direction is not None and "angles" not in touched:
            for widget, angle in zip(self._angles, _angles(target.direction), strict=True):
                _set(widget, round(math.degrees(angle)))

    def _refresh_law(self, session: Session, law: Any, touched: set[str]) -> None:
        """Add the sliders of another law in place of those of the one before."""
        names = [knob.name for knob in law_knobs(law, session.usual_law, session.model)]
        if law.kind == self._law and names == list(self._sliders["law"]):
            return
        self._law = law.kind
        for slider in self._sliders["law"].values():
            slider.remove()
        self._sliders["law"] = {}
        with self._law_folder:
            for knob in law_knobs(law, session.usual_law, session.model):
                self._add_slider("law", knob, Session.turn_law)
        self._law_folder.visible = bool(names)
        if "law" not in touched:
            _set(self._laws, law.kind)

    def show_heat(self, heat: HeatMap) -> None:
        """Explain the heat map."""
        colors = "#ffffcc,#feb24c,#f03b20,#800026"
        self._heat_note.content = (
            f'<div style="{_NOTE}">Share of random strikes that pass a cell of {100 * heat.cell:.1f} cm in the '
            "vertical plane through the target; they keep the limits of the joints, with the tip above the floor"
            f'<div style="height:8px;border-radius:3px;background:linear-gradient(90deg,{colors})"></div>'
            '<div style="display:flex;justify-content:space-between">'
            f"<span>{LEAST:.1%} or less</span><span>{MOST:.0%} or more</span></div></div>"
        )

    def show_spread(self, spread: TipSpread | None, noise: float) -> None:
        """Explain the tolerance ellipses."""
        if spread is None:
            self._spread_note.content = ""
            return
        largest = 200 * spread.scale(INSIDE[1]) * float(np.linalg.norm(spread.axes, axis=0).max())
        half, most = (f"{inside:.0%}" for inside in INSIDE)
        self._spread_note.content = (
            f'<div style="{_NOTE}">With errors of {noise:g} rad and s in each number of the strike {spread.hits:.0%} '
            f"of {STRIKES} strikes hit. The pink ellipses contain {half} and {most} of the places where the tip comes "
            f"closest, to first order; the larger one is {largest:.1f} cm long.</div>"
        )


def _set(widget: Any, value: Any) -> None:
    """Show a value in a widget, whose range is widened if it does not contain the value."""
    if widget is None or widget.value == value:
        return
    if isinstance(value, float) and hasattr(widget, "max") and widget.max is not None:
        widget.min, widget.max = min(widget.min, value), max(widget.max, value)
    widget.value = value


def _direction(angles: Sequence[float]) -> tuple[float, ...]:
    """Return the unit vector of an angle from forward to up, or of azimuth and elevation [rad]."""
    first = angles[0]
    if len(angles) == 1:
        return math.cos(first), math.sin(first)
    flat = math.cos(angles[1])
    return flat * math.cos(first), flat * math.sin(first), math.sin(angles[1])


def _angles(direction: Sequence[float]) -> list[float]:
    """Return the angles [rad] of `_direction` for a unit vector."""
    first = math.atan2(direction[1], direction[0])
    return [first] if len(direction) == 2 else [first, math.asin(max(-1.0, min(1.0, direction[2])))]


def error_text(error: Exception) -> str:
    """Return what is said of an error, as text."""
    return html.unescape(str(error)) or type(error).__name__
