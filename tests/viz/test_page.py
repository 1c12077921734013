"""The interactive page of a strike: its data, and what a browser makes of it."""

from __future__ import annotations

import dataclasses
import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from browser_pages import Elements, browser, chromium, count, picture, root_data

from whiptool.goals.target import Target
from whiptool.impedance import ConstantImpedance, Controller
from whiptool.models import preset
from whiptool.models.kinematics import joint_points
from whiptool.models.strike import Strike
from whiptool.rollout import CompiledRollout
from whiptool.viz.page import strike_data, strike_page

LEMON, TARGET = preset("lemon2024"), Target((1.3, 0.0), 0.06)
STRIKE = [-1.361356816555577, 0.471238898038469, 1.7278759594743862, 1.413716694115407, 0.95]  # hits


@pytest.fixture(scope="module")
def trajectory():
    return CompiledRollout(LEMON, Controller()).trajectory(Strike.from_vector(STRIKE), t_stay=0.3)


@pytest.fixture(scope="module")
def page(trajectory):
    return strike_page(LEMON, trajectory, TARGET, label="OIAC table4")


@pytest.fixture(autouse=True)
def _no_display(monkeypatch):
    """Tests open no windows; those about windows say so."""
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(sys, "platform", "linux")


def test_data_are_the_trajectory(trajectory):
    data = strike_data(LEMON, trajectory, TARGET)
    t, near = np.array(data["t"]), trajectory.approach(TARGET)
    assert t[0] == 0
    assert t[-1] == pytest.approx(trajectory.t[-1])
    assert np.diff(t).max() <= 2e-3 + 1e-9
    assert (np.diff(t) > 0).all()
    at = np.abs(trajectory.t[:, None] - t).argmin(axis=0)
    same = np.abs(trajectory.t[at] - t) < 1e-9
    assert (~same).sum() == 1  # the closest approach lies between two steps
    at, n = at[same], LEMON.arm.n
    for i in range(LEMON.n):
        np.testing.assert_allclose(np.array(data["q"][i])[same], trajectory.q[at, i], rtol=1e-5)
    for k, (i, j) in enumerate(np.ndindex(n, n)):
        np.testing.assert_allclose(np.array(data["K"][k])[same], trajectory.K[at, i, j], rtol=1e-5)
        np.testing.assert_allclose(np.array(data["B"][k])[same], trajectory.B[at, i, j], rtol=1e-5)
    for name, values in {"q_d": trajectory.q_d, "tau": trajectory.tau, "tip": trajectory.tip}.items():
        np.testing.assert_allclose(np.array(data[name]).T[same], values[at], rtol=1e-5)
    speed = np.sqrt((trajectory.tip_velocity**2).sum(axis=1))
    np.testing.assert_allclose(np.array(data["speed"])[same], speed[at], rtol=1e-5)
    np.testing.assert_allclose(np.array(data["distance"])[same], trajectory.distance(TARGET)[at], rtol=1e-5)
    here = t.tolist().index(data["near"]["time"])
    assert t[here] == pytest.approx(near.time[0], abs=1e-7)
    assert data["near"]["distance"] == pytest.approx(near.distance[0], rel=1e-5)
    assert min(data["distance"]) == data["distance"][here] == data["near"]["distance"]
    assert data["speed"][here] == pytest.approx(near.speed[0], rel=1e-5)
    assert data["D"] == pytest.approx(0.95, abs=1e-3)


def test_the_page_needs_nothing_else(page):
    elements = Elements(page)
    assert not [a for _, a in elements.found if {"src", "href", "srcset", "action"} & a.keys()]
    assert not re.search(r"https?://|url\(|@import|\bfetch\(|XMLHttpRequest|WebSocket|import\(", page)
    assert "default-src 'none'" in page
    assert len(page.encode()) < 400_000
    assert str(Path.cwd()) not in page
    assert str(Path.home()) + "/" not in page
    opened = [tag for tag, _ in elements.found if tag in ("script", "style", "main", "body", "section", "dl")]
    closed = [tag[1:] for tag, _ in elements.found if tag[1:] in ("script", "style", "main", "body", "section", "dl")]
    assert sorted(opened) == sorted(closed)
    labelled = {a.get("for") for tag, a in elements.found if tag == "label"}
    for tag, a in elements.found:
        if tag in ("input", "select", "canvas"):
            assert "aria-label" in a or a.get("id") in labelled, a
    assert "Hits the target at (1.300, 0.000) m, hit radius 0.06 m; closest 0.0553 m" in page


def test_names_cannot_break_the_page(trajectory):
    arm = dataclasses.replace(LEMON.arm)
    object.__setattr__(arm, "joints", ("</script><b>", "<!--<script>"))  # past the check that refuses such names
    model = dataclasses.replace(LEMON, name="<i>{{data}}</script>", arm=arm)
    elements = Elements(strike_page(model, trajectory, TARGET, label="{{script}}<u>"))
    assert len(elements.scripts) == 2
    assert json.loads(elements.scripts[0])["joints"] == list(arm.joints)
    assert not {"b", "i", "u"} & {tag for tag, _ in elements.found}


def test_a_long_strike_stays_small():
    path = CompiledRollout(LEMON, Controller(ConstantImpedance())).trajectory(Strike.from_vector(STRIKE), t_stay=12)
    assert len(strike_page(LEMON, path, TARGET).encode()) < 1_500_000


def test_a_diverged_strike_has_a_page():
    wild = Controller(ConstantImpedance(K=((1e7, 0), (0, 1e7)), B=((0, 0), (0, 0))))
    path = CompiledRollout(LEMON, wild, timestep=2.5e-4).trajectory(Strike.from_vector(STRIKE), t_stay=0.3)
    assert path.diverged
    tau = path.tau.copy()
    tau[-1] = np.nan, np.inf
    page = strike_page(LEMON, dataclasses.replace(path, tau=tau), TARGET)
    assert "The simulation diverged at" in page
    data = json.loads(Elements(page).scripts[0], parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))
    assert [x[-1] for x in data["tau"]] == [None, None]


@pytest.mark.slow
@browser
def test_the_page_draws_the_strike(page, trajectory, tmp_path):
    """Opened at t = 0.5: no error, the readings are the trajectory's, and the joints drawn end at its tip."""
    # Runs after the page's own scripts, in the same scope
    probe = """<script>
    root.dataset.joints = JSON.stringify(joints(q.map((x) => value(x, state.at))));
    root.dataset.readings = JSON.stringify([...document.querySelectorAll("#readings dd")].map((x) => x.textContent));
    dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowRight" })); root.dataset.next = state.t;
    dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowLeft" })); root.dataset.previous = state.t;
    dispatchEvent(new KeyboardEvent("keydown", { key: "End" })); root.dataset.last = state.t;
    byId("nearest").click(); root.dataset.jumped = state.t; root.dataset.hash = location.hash;
    dispatchEvent(new KeyboardEvent("keydown", { key: " " })); root.dataset.playing = state.playing;
    dispatchEvent(new KeyboardEvent("keydown", { key: " " })); root.dataset.paused = !state.playing;
    </script>"""
    found = root_data(chromium(tmp_path, page.replace("</body>", probe + "</body>"), "--dump-dom", at="t=0.5"))
    assert "data-error" not in found, found
    q = np.array([np.interp(0.5, trajectory.t, x) for x in trajectory.q.T])
    np.testing.assert_allclose(json.loads(found["data-joints"]), joint_points(LEMON, q), atol=1e-4)
    x, y = (np.interp(0.5, trajectory.t, x) for x in trajectory.tip.T)
    speed = np.interp(0.5, trajectory.t, np.hypot(*trajectory.tip_velocity.T))
    away = np.interp(0.5, trajectory.t, trajectory.distance(TARGET))
    expected = [f"{speed:.1f} m/s", f"{away:.3f} m", "not hit so far", f"({x:.3f}, {y:.3f}) m".replace("-", "−")]
    assert json.loads(found["data-readings"]) == expected
    near = trajectory.approach(TARGET).time[0]
    assert float(found["data-next"]) == pytest.approx(0.502, abs=1e-4)
    assert float(found["data-previous"]) == pytest.approx(0.5, abs=1e-4)
    assert float(found["data-last"]) == pytest.approx(trajectory.t[-1])
    assert float(found["data-jumped"]) == pytest.approx(near, abs=1e-6)
    assert found["data-hash"] == f"#t={near:.4f}"
    assert (found["data-playing"], found["data-paused"]) == ("true", "true")


@browser
def test_pictures_of_the_page(page, tmp_path):
    at_hit = picture(tmp_path, page, "hit")
    stage = at_hit[110:600, 25:580]
    assert len(np.unique((stage.reshape(-1, 3) * 255).astype(int), axis=0)) > 100  # not blank
    assert count(stage, "#0072B2") > 300  # the arm
    assert count(stage, "#009E73") > 20  # the target, hit
    before = picture(tmp_path, page, "before", at="t=0.5")
    assert count(before[110:600, 25:580], "#009E73") == 0
    assert (np.abs(before - at_hit).max(axis=2) > 0.1).mean() > 0.002
    dark = picture(tmp_path, page, "dark", "--blink-settings=preferredColorScheme=0", size="500,900")
    assert dark.mean() < 0.25 < 0.75 < at_hit.mean()
    assert count(dark, "#4ba6e0") > 500


@browser
def test_an_error_is_seen(page, tmp_path):
    """That the page says so when it fails is what the other tests rely on."""
    broken = re.sub(r"(id=strike>)[^<]*", r"\1{}", page)
    dom = chromium(tmp_path, broken, "--dump-dom")
    assert "data-drawn" not in root_data(dom)
    assert "undefined" in root_data(dom)["data-error"]
    assert "This page failed" in dom


@browser
def test_a_diverged_strike_is_drawn(tmp_path):
    wild = Controller(ConstantImpedance(K=((1e7, 0), (0, 1e7)), B=((0, 0), (0, 0))))
    path = CompiledRollout(LEMON, wild, timestep=2.5e-4).trajectory(Strike.from_vector(STRIKE), t_stay=0.3)
    for cut in (len(path.t), 1):  # and one that diverged in its first step
        arrays = {f.name: getattr(path, f.name) for f in dataclasses.fields(path) if f.name != "diverged"}
        part = dataclasses.replace(path, **{name: x[:cut] for name, x in arrays.items()})
        found = root_data(chromium(tmp_path, strike_page(LEMON, part, TARGET), "--dump-dom"))
        assert "data-error" not in found
        assert "data-drawn" in found
