"""What a browser sends for a widget: only what the widget offers arrives, whatever is sent."""

from __future__ import annotations

import asyncio
import math
import sys
import threading
from types import SimpleNamespace

import pytest

pytest.importorskip("viser")

import viser
from viser._messages import GuiUpdateMessage

from whiptool.live_page.server import PageServer


@pytest.fixture
def gui(monkeypatch):
    """The widgets of a browser's page, as the server of pages gives them to a page."""
    server = PageServer(lambda client: SimpleNamespace(close=lambda: None), port=0)
    server._connected(SimpleNamespace(client_id=0, gui=server._server.gui))  # pyrefly: ignore
    monkeypatch.setattr(server._server.gui, "_resolve_client", lambda _: "a browser")
    yield server._server.gui
    server._pages.clear()
    server.close()


def send(gui, uuid: str, **updates) -> None:
    asyncio.run(gui._websock_interface._handle_incoming_message(0, GuiUpdateMessage(uuid, updates)))


def test_a_list_takes_one_of_its_choices_and_no_other_text(gui):
    """A model's name that is a path would be read, and what is in the file be said in the error."""
    models, asked = gui.add_dropdown("model", ("lemon2024", "ur5e"), initial_value="lemon2024"), []

    @models.on_update
    async def _(event) -> None:
        asked.append(event.target.value)

    for wrong in ("/etc/passwd", "secret.toml", "../foreign.urdf", "", None, 1, True, ["ur5e"], {"x": 1}):
        send(gui, models._impl.uuid, value=wrong)
    assert models.value == "lemon2024"
    assert asked == []
    send(gui, models._impl.uuid, value="ur5e")
    assert asked == ["ur5e"]


def test_numbers_are_finite_and_boxes_true_or_false(gui):
    slider, box = gui.add_slider("time", 0.0, 1.0, 0.1, 0.5), gui.add_checkbox("play", True)
    for wrong in (math.nan, math.inf, -1.0, 2, "0.3", None, True, [0.3]):
        send(gui, slider._impl.uuid, value=wrong)
    assert slider.value == 0.5
    for wrong in ("", 0, 1.0, None, []):
        send(gui, box._impl.uuid, value=wrong)
    assert box.value is True
    send(gui, slider._impl.uuid, value=1)
    send(gui, box._impl.uuid, value=False)
    assert (slider.value, box.value) == (1.0, False)


def test_a_number_out_of_range_reaches_the_function_that_refuses_it(gui):
    slider, said = gui.add_slider("length", 0.0, 1.0, 0.1, 0.5), []

    @slider.on_update
    async def _(event) -> None:
        said.append(event.target.value)

    send(gui, slider._impl.uuid, value=10)  # as it is typed
    assert said == [10.0]


def test_only_the_value_of_a_widget_is_the_browsers(gui):
    models, pressed = gui.add_dropdown("model", ("a", "b")), threading.Event()
    for others in ({"update_cb": []}, {"props": None}, {"value": "b", "removed": True}, {"is_button": True}, {}):
        send(gui, models._impl.uuid, **others)
    assert (models.value, models.options, models._impl.removed) == ("a", ("a", "b"), False)
    send(gui, "not a widget of this page", value="b")
    button = gui.add_button("Aim again")
    button.on_click(lambda _: pressed.set())
    send(gui, button._impl.uuid, value="x")
    assert not pressed.is_set()
    send(gui, button._impl.uuid, value=True)
    assert pressed.wait(60)


def test_servers_that_start_and_end_leave_standard_output_to_others(monkeypatch, capsys):
    """It is the whole process's: what another thread prints in that moment is printed."""
    seen, plain = [], viser.ViserServer.__init__

    def watched(self, *args, **options) -> None:
        print("of another thread")
        seen.append(sys.stdout)
        plain(self, *args, **options)

    monkeypatch.setattr(viser.ViserServer, "__init__", watched)
    PageServer(lambda _: SimpleNamespace(close=lambda: None), port=0).close()
    assert seen == [sys.stdout]
    assert capsys.readouterr().out == "of another thread\n"
