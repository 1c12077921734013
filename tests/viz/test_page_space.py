"""The page of a strike in space: its data are the trajectory's, and in a browser it turns, zooms and scrubs."""

from __future__ import annotations

import json
from dataclasses import fields, replace

import numpy as np
import pytest
from browser_pages import Elements, browser, chromium, count, picture, root_data
from space_swing import places, swing
from spatial_arms import of_universal_nodes

from whiptool.goals.target import Target
from whiptool.viz.page import strike_data, strike_page

PANDA = of_universal_nodes("panda")
PATH, RADIUS = swing(PANDA), 0.05
TARGET = Target(tuple(PATH.tip[200] + [0.01, 0.02, -0.01]), RADIUS)


@pytest.fixture(scope="module")
def page():
    return strike_page(PANDA, PATH, TARGET, label="by hand")


def posture_at(time: float, path=PATH) -> tuple[np.ndarray, np.ndarray]:
    return places(PANDA, np.array([np.interp(time, path.t, x) for x in path.q.T]))


def eye(data: dict, point, around: float, above: float, *, flat: bool = False) -> np.ndarray:
    """Right, up and size of a point as the page is to show it: a pinhole four half diagonals from the middle."""
    every = np.concatenate([np.array(data["points"]).reshape(-1, 3, len(data["t"])).transpose(0, 2, 1).reshape(-1, 3)])
    target = np.array(data["target"])
    every = np.concatenate([every, [target - RADIUS, target + RADIUS, np.zeros(3)]])
    low, high = every.min(axis=0), every.max(axis=0)
    distance = 4 * np.linalg.norm(high - low) / 2
    a, e = np.deg2rad([around, above])
    back = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    right = np.cross([0, 0, 1], [np.cos(a), np.sin(a), 0])
    p = np.asarray(point) - (low + high) / 2
    size = 1 if flat else distance / (distance - p @ back)
    return np.array([p @ right * size, p @ np.cross(back, right) * size, size])


def test_data_are_the_trajectory():
    data = strike_data(PANDA, PATH, TARGET)
    t = np.array(data["t"])
    points = np.array(data["points"]).reshape(-1, 3, len(t))  # a + 1 + N places
    for k in (0, len(t) // 3, len(t) - 1):
        arm, whip = posture_at(t[k])
        np.testing.assert_allclose(points[:, :, k], np.concatenate([arm[1:], whip[1:]]), atol=1e-5)
    desired = np.array(data["desired"]).reshape(-1, 3, len(t))
    wanted = np.zeros(PANDA.n)
    wanted[: PANDA.arm.n] = PATH.q_d[-1]
    np.testing.assert_allclose(desired[:, :, -1], places(PANDA, wanted)[0][1:], atol=1e-5)
    np.testing.assert_allclose(np.array(data["tip"])[:, -1], PATH.tip[-1], atol=1e-5)
    assert data["speed"][-1] == pytest.approx(np.sqrt((PATH.tip_velocity[-1] ** 2).sum()), rel=1e-5)
    assert min(data["distance"]) == data["near"]["distance"]
    np.testing.assert_allclose(np.array(data["K"])[:, 0], PATH.K[0].diagonal(), rtol=1e-5)


def test_the_page_needs_nothing_else(page):
    found = Elements(page).found
    assert not [a for _, a in found if {"src", "href", "srcset", "action"} & a.keys()]
    assert "default-src 'none'" in page
    where = ", ".join(f"{x:.3f}" for x in TARGET.position)
    assert f"Hits the target at ({where}) m" in page


@browser
def test_a_page_under_position_control_has_no_empty_plots(tmp_path):
    """Neither gains that are zero, nor desired curves that coincide with the joints' own."""
    a = PANDA.arm.n
    q, v = PATH.q.copy(), PATH.v.copy()
    q[:, :a], v[:, :a] = PATH.q_d, PATH.v_d
    exact = replace(PATH, q=q, v=v, K=0 * PATH.K, B=0 * PATH.B)
    probe = """<script>root.dataset.plots = JSON.stringify(
      [...document.querySelectorAll("#plots figcaption")].map((x) => x.textContent));</script>"""
    for path, titles in ((exact, 4), (PATH, 6)):
        page = strike_page(PANDA, path, TARGET).replace("</body>", probe + "</body>")
        found = root_data(chromium(tmp_path, page, "--dump-dom"))
        plots = json.loads(found["data-plots"])
        assert len(plots) == titles
        assert ("desired" in plots[2]) == (path is PATH)


PROBE = """<script>
const said = (name, x) => { root.dataset[name] = JSON.stringify(x); };
const stageCanvas = byId("stage"), box = stageCanvas.getBoundingClientRect();
const pixels = () => stageCanvas.toDataURL();
const pointer = (kind, x, y) => stageCanvas.dispatchEvent(new PointerEvent(kind, {
  pointerId: 1, buttons: 1, bubbles: true, clientX: box.left + x, clientY: box.top + y }));
const key = (name) => dispatchEvent(new KeyboardEvent("keydown", { key: name }));
const look = () => [orbit.around, orbit.above, orbit.zoom, orbit.flat, byId("view").value];
said("posture", posture(state.at)); said("base", stage.place([0, 0, 0]));
said("seen", posture(state.at).map((p) => orbit.seen(p))); said("places", posture(state.at).map(stage.place));
said("middle", stage.middle); said("scale", stage.scale);
said("readings", [...document.querySelectorAll("#readings dd")].map((x) => x.textContent));
const still = pixels();
pointer("pointerdown", 200, 200); pointer("pointermove", 300, 240); pointer("pointerup", 300, 240);
said("dragged", look()); said("draggedDiffers", pixels() !== still); said("hash", location.hash);
said("turned", posture(state.at).map((p) => orbit.seen(p)));
pointer("pointermove", 500, 400); said("let", look());
const before = stage.place([0, 0, 0]);
stageCanvas.dispatchEvent(new WheelEvent("wheel", { deltaY: -300, cancelable: true,
  clientX: box.left + before[0], clientY: box.top + before[1] }));
said("zoomed", look()); said("kept", [before, stage.place([0, 0, 0])]); said("larger", stage.scale);
key("0"); said("reset", look()); said("resetSame", pixels() === still);
for (const name of ["1", "2", "3"]) { key(name); said("view" + name, posture(state.at).map((p) => orbit.seen(p))); }
said("front", look());
key("0"); key("d"); key("w"); key("+"); said("keys", look());
key("0"); const here = pixels();
slider.value = String(start); slider.dispatchEvent(new Event("input"));
said("scrubbed", posture(state.at)); said("scrubbedDiffers", pixels() !== here);
key("End"); said("end", posture(state.at));
</script>"""


@browser
def test_the_page_turns_zooms_and_scrubs(page, tmp_path):
    address = "t=0.25&view=-40,30,1"
    dom = chromium(tmp_path, page.replace("</body>", PROBE + "</body>"), "--dump-dom", at=address)
    found = root_data(dom)
    assert "data-error" not in found, found
    said = {name: json.loads(x) for name, x in found.items() if name.startswith("data-") and name != "data-drawn"}
    data = strike_data(PANDA, PATH, TARGET)

    arm, whip = posture_at(0.25)
    points = np.concatenate([arm[1:], whip[1:]])
    np.testing.assert_allclose(said["data-posture"], points, atol=2e-4)
    np.testing.assert_allclose(said["data-seen"], [eye(data, p, -40, 30) for p in points], atol=3e-4)
    middle, scale = np.array(said["data-middle"]), said["data-scale"]
    seen = np.array(said["data-seen"])[:, :2]
    np.testing.assert_allclose(said["data-places"], middle + scale * seen * [1, -1], atol=1e-6)
    tip, speed = PATH.tip[125], np.linalg.norm(PATH.tip_velocity[125])
    where = ", ".join(f"{x:.3f}" for x in tip).replace("-", "−")
    away = np.linalg.norm(tip - np.array(TARGET.position))
    assert said["data-readings"] == [f"{speed:.1f} m/s", f"{away:.3f} m", "not hit so far", f"({where}) m"]

    assert said["data-dragged-differs"]
    around, above = -40 - 0.45 * 100, 30 + 0.45 * 40
    assert said["data-dragged"] == pytest.approx([around, above, 1, False, "turned"])
    np.testing.assert_allclose(said["data-turned"], [eye(data, p, around, above) for p in points], atol=3e-4)
    assert said["data-hash"] == f"#t=0.2500&view={around:g},{above:g},1"
    assert said["data-let"] == said["data-dragged"]
    zoom = said["data-zoomed"][2]
    assert zoom == pytest.approx(np.exp(0.45))
    assert said["data-larger"] == pytest.approx(zoom * scale)
    np.testing.assert_allclose(*said["data-kept"], atol=1.0)  # the place under the wheel stays there, to a pixel

    assert said["data-reset"] == [-55, 20, 1, False, "turned"]
    for name, view in {"1": (-90, 0), "2": (-90, 90), "3": (0, 0)}.items():
        flat = [eye(data, p, *view, flat=True) for p in points]
        np.testing.assert_allclose(said[f"data-view{name}"], flat, atol=3e-4)
    assert said["data-front"][3:] == [True, "front"]
    assert said["data-keys"] == pytest.approx([-50, 25, 1.2, False, "turned"])

    assert said["data-scrubbed-differs"]
    for name, time in (("scrubbed", 0.0), ("end", PATH.t[-1])):
        arm, whip = posture_at(time)
        np.testing.assert_allclose(said[f"data-{name}"], np.concatenate([arm[1:], whip[1:]]), atol=2e-4)


@pytest.mark.slow
@browser
def test_pictures_of_the_page(page, tmp_path):
    first = picture(tmp_path, page, "first", at="t=0.1")
    stage = first[110:640, 25:600]
    assert count(stage, "#0072B2") > 300  # the arm
    assert count(stage, "#D55E00") > 20  # the tip
    turned = picture(tmp_path, page, "turned", at="t=0.1&view=30,50,2")
    assert (np.abs(turned[110:640, 25:600] - stage).max(axis=2) > 0.1).mean() > 0.01
    later = picture(tmp_path, page, "later", at="t=0.5")
    assert (np.abs(later[110:640, 25:600] - stage).max(axis=2) > 0.1).mean() > 0.005


@browser
def test_a_strike_that_diverged_at_once_has_a_page(tmp_path):
    arrays = {f.name: getattr(PATH, f.name)[:1] for f in fields(PATH) if isinstance(getattr(PATH, f.name), np.ndarray)}
    cut = replace(PATH, **arrays, diverged=True)
    found = root_data(chromium(tmp_path, strike_page(PANDA, cut, TARGET), "--dump-dom"))
    assert "data-error" not in found
    assert "data-drawn" in found


@browser
def test_a_frame_without_room_is_no_failure(page, tmp_path):
    """A page in another one is drawn before it has a size, and again when it has one."""
    narrow = "<script>document.body.style.width = '10px'; dispatchEvent(new Event('resize'))</script></body>"
    assert page.count("</body>") == 1
    assert "data-error" not in root_data(chromium(tmp_path, page.replace("</body>", narrow), "--dump-dom"))
