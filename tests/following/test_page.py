"""The page of a run, on a server that no browser looks at."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("viser", reason="the page needs pip install 'whiptool[studio]'")

from whiptool.errors import InputError
from whiptool.following.page import RunPage
from whiptool.following.run_view import Chart, Chosen, Curve, Measured, RunView, ShownMotion
from whiptool.following.watcher import Watcher
from whiptool.goals.target import Target
from whiptool.models import preset
from whiptool.models.strike import Strike
from whiptool.rollout.compiled import CompiledRollout

MODEL = preset("lemon2024")


class Scripted:
    """A run that shows one view after the other; an error in their place is raised."""

    every = 0.0

    def __init__(self, *script: RunView | Exception | None) -> None:
        self.script, self.played = list(script), []

    def look(self) -> RunView | None:
        shown = self.script.pop(0) if self.script else None
        if isinstance(shown, Exception):
            raise shown
        return shown

    def shown_motion(self, chosen: Chosen) -> ShownMotion:
        self.played.append(chosen.number)
        trajectory = CompiledRollout(MODEL).trajectory(Strike((-1.0, 0.5), (2.0, 0.8), 0.8), t_stay=0.3)
        return ShownMotion(MODEL, trajectory, Target((1.2, 0.1)))


def view(number: int, count: int = 3, **changes: Any) -> RunView:
    curve = Curve("best so far", np.arange(1, count + 1), np.linspace(0.5, 0.1, count))
    chart = Chart("miss distance", "trial", "m", (curve,), logarithmic=True)
    chosen = Chosen(number, f"best, trial {number}", (float(number),))
    points = {"points": np.zeros((4, 2))}
    return RunView("optimize: <b>run</b>", False, {"trials": str(count)}, (chart,), points, chosen, **changes)


def until(condition) -> None:
    while not condition():
        time.sleep(0.005)


@pytest.fixture
def client():
    """What a page takes of a browser."""
    import viser

    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    camera = SimpleNamespace(aspect=1.5, position=None, look_at=None)
    yield SimpleNamespace(gui=server.gui, scene=server.scene, client_id=0, camera=camera, atomic=server.atomic)
    server.stop()


def test_a_page_shows_charts_strike_and_points_and_names_as_text(client) -> None:
    run: Any = Scripted(view(1), None, view(1, 4), view(2, 5))
    watcher = Watcher(lambda: run)
    until(lambda: watcher.seen is not None and watcher.seen.view.facts["trials"] == "5" and run.played == [1, 2])
    page = RunPage(client, watcher)
    until(lambda: client.scene.get_handle_by_name("/points/0") is not None and "trial 2" in page._said.content)
    assert "&lt;b&gt;run&lt;/b&gt;" in page._facts.content
    assert client.camera.position is not None
    x, y = page._charts._handles["miss distance"][1].data
    np.testing.assert_array_equal(x, [1, 2, 3, 4, 5])
    np.testing.assert_allclose(y, 1e3 * np.linspace(0.5, 0.1, 5))
    page.close()
    watcher.close()


def test_the_measured_arm_stands_where_it_was_measured_last(client) -> None:
    q = np.array([[0.0, 0.0], [np.pi / 2, 0.0]])  # down, then forward
    run: Any = Scripted(view(1, measured=Measured(np.array([0.0, 0.1]), q)))
    watcher = Watcher(lambda: run)
    page = RunPage(client, watcher)
    until(lambda: client.scene.get_handle_by_name("/measured") is not None)
    line = client.scene.get_handle_by_name("/measured").points
    reach = sum(link.length for link in MODEL.arm.links)
    np.testing.assert_allclose(line[-1, -1], [reach, 0.0, 0.0], atol=1e-6)
    page.close()
    watcher.close()


def test_a_look_that_fails_is_made_again_and_a_strike_is_rolled_out_once() -> None:
    damaged = InputError("trials.csv", "?", "a log")
    run: Any = Scripted(view(1), damaged, view(1, 4))
    tries = [damaged, OSError("not there yet")]

    def opened() -> Any:
        if tries:
            raise tries.pop()
        return run

    faults = []
    watcher = Watcher(opened)
    until(lambda: faults.append(watcher.seen.fault if watcher.seen else "") or not run.script)
    until(lambda: watcher.seen is not None and watcher.seen.view.facts.get("trials") == "4")
    assert watcher.seen is not None
    assert watcher.seen.fault == ""
    assert run.played == [1]
    assert not tries
    watcher.close()
