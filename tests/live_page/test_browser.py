"""The studio in a browser: the target is dragged, sliders move the path, and names are shown as text."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest
from browser_pages import browser
from repository import ROOT

pytest.importorskip("viser")
pytest.importorskip("playwright")
BENCHMARK = ROOT / "benchmarks" / "studio.py"
DETAIL = 0.05  # without a graphics card, drawing takes longer than everything else
SMALL = ("--window", "1200x800", "--detail", str(DETAIL))


def ran(*words: str) -> dict:
    """What the benchmark says, which uses the studio in a browser."""
    command = [sys.executable, str(BENCHMARK), "--json", *words]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@browser
@pytest.mark.slow
def test_drags_and_sliders_in_plane_and_space():
    for name, found in ran("--quick", *SMALL).items():
        assert found["drags"] >= 2, name
        assert found["as_the_map"] == found["drags"]
        assert found["hits"] >= 2
        assert found["sliders"] >= {"lemon2024": 14, "ur5e": 19}[name]
        assert found["unmoved"] == []
        assert found["largest_difference"] <= 1e-9
        assert found["errors"] == []


@browser
@pytest.mark.hours
def test_ten_minutes_of_random_use():
    found = ran("--drags", "0", "--minutes", "10")["random_use"]
    assert found["alive"]
    assert found["errors"] == found["page_errors"] == []
    for before, after in (found["server_memory"], found["page_memory"]):
        assert after < 1.5 * before + 100


BAD = "<img src=x onerror=alert(1)>"  # the name of a model


@pytest.fixture(scope="module")
def opened():
    """The benchmark, and a studio with a tab of a browser, which takes seconds to start; every model is the paper's."""
    import whiptool as wt
    from whiptool.live_page.page import Choices

    def load(name: str):
        if name == "broken":
            raise ValueError("it cannot be loaded")
        return wt.preset("lemon2024"), None

    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(BENCHMARK.parent))
        import studio as bench

        patch.setattr(bench, "Choices", lambda *_: Choices(load, (BAD, "broken")))
        with bench.used((BAD,), (1000, 700), DETAIL) as used:
            yield bench, *used


@browser
@pytest.mark.slow
def test_names_are_text_and_errors_end_nothing(opened):
    bench, studio, tab, errors = opened
    page = studio.pages[0]
    user = bench.User(tab, page, (1000, 700))
    user.settle()
    assert tab.locator("img[src=x]").count() == 0
    assert BAD in tab.evaluate("[...document.querySelectorAll('input')].map(each => each.value)")
    assert tab.evaluate("document.documentElement.innerHTML").count("<img src=x") == 0
    page._worker.ask("model", lambda: page._open("broken"))
    tab.get_by_text("it cannot be loaded").wait_for(timeout=1e3 * bench.LONGEST)
    page._ask("strike D", lambda session: session.turn_strike("D", -1.0))
    tab.get_by_text("Not possible").first.wait_for(timeout=1e3 * bench.LONGEST)
    page._ask("whip k", lambda session: session.turn_whip("k", 0.5))
    assert user.wait(lambda: page.shown.model.whip.k == 0.5)
    assert np.isfinite(page.shown.trajectory.tip).all()
    assert errors == []


@browser
@pytest.mark.slow
def test_each_browser_has_its_own_session(opened):
    bench, studio, tab, errors = opened
    other = tab.context.browser.new_page(viewport={"width": 400, "height": 300})
    other.goto(f"{studio.address}?fixedDpr={DETAIL}")
    other.wait_for_selector(".outcome", timeout=1e3 * bench.LONGEST)
    first, second = studio.pages
    first._ask("whip length", lambda session: session.turn_whip("length", 1.2))
    assert bench.User.wait(lambda: first.session.model.whip.length > 1.1)
    assert second.session.model.whip.length == pytest.approx(0.864)
    other.close()
    assert bench.User.wait(lambda: studio.pages == [first])
    assert bench.User.wait(lambda: not second._worker._thread.is_alive())
    assert errors == []
