"""The page of a user, on a server that no browser looks at: older outcomes are pale, numbers out of range refused."""

from __future__ import annotations

import asyncio
import threading
import time
from types import SimpleNamespace

import pytest
from processes import HANG

pytest.importorskip("viser")

from whiptool.live_page import panel as panel_module
from whiptool.live_page.page import Choices, Page
from whiptool.models import preset


def until(condition) -> None:
    end = time.monotonic() + HANG
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.005)


@pytest.fixture
def page(monkeypatch):
    """A page, and what its notices say."""
    import viser

    monkeypatch.setattr(panel_module, "TYPED", 0.0)
    server, notices = viser.ViserServer(host="127.0.0.1", port=0, verbose=False), []
    client = SimpleNamespace(
        gui=server.gui,
        scene=server.scene,
        client_id=0,
        camera=SimpleNamespace(aspect=1.5, position=None, look_at=None),
        atomic=server.atomic,
        flush=server.flush,
        add_notification=lambda title, body, **_: (notices.append(body), SimpleNamespace(remove=lambda: None))[1],
    )
    page = Page(client, Choices(lambda name: (preset(name), None), ("lemon2024",)))  # pyrefly: ignore
    until(lambda: page._state is not None and "✓ Hit" in outcome(page))
    notices.clear()
    yield page, notices
    page.close()
    server.stop()


def outcome(page: Page) -> str:
    assert page._state is not None
    return page._state[2]._outcome.content


def typed(widget, *values: float) -> None:
    """Do what a browser does when a user types."""

    async def type_them() -> None:
        for value in values:
            widget._impl.value = value
            for each in widget._impl.update_cb:
                await each(SimpleNamespace(client="a browser"))
        await asyncio.sleep(0.05)

    asyncio.run(type_them())


def test_an_outcome_is_pale_while_something_newer_is_computed(page):
    page, _ = page
    gate, number = threading.Event(), page.shown.number
    page._ask("hold", lambda _: gate.wait(HANG))
    assert "Computing" in outcome(page)
    assert "Hit" not in outcome(page)
    page._ask("whip", lambda session: session.turn_whip("length", 1.0))
    assert page.shown.number == number
    gate.set()
    until(lambda: page.shown.settings.whip == {"length": 1.0} and "✗ Miss" in outcome(page))
    assert "Computing" not in outcome(page)


def test_a_number_out_of_range_is_refused_once_and_taken_back(page):
    page, notices = page
    panel, usual = page._state[2], page.shown.settings
    for widget, values, before, said in (
        (panel._radius, [5.0], 0.06, "hit radius [m]: got 5.0; allowed: 0.001 to 0.15"),
        (panel._radius, [5.0, 0.15], 0.06, "hit radius [m]: got 5.0; allowed: 0.001 to 0.15"),  # as browsers do
        (panel._sliders["whip"]["length"], [10.0, 100.0], 0.864, "length [m]: got 100.0; allowed: 0.2 to 1.8"),
    ):
        typed(widget, *values)
        until(lambda: not page._pale)
        assert widget.value == before
        assert notices == [said]
        notices.clear()
    assert page.shown.settings == usual
    typed(panel._sliders["whip"]["length"], 0.0, 0.2)  # 0.2, the least, is typed with a 0 at its beginning
    until(lambda: page.shown.settings.whip == {"length": 0.2} and not page._pale)
    assert notices == []
