"""The studio in a browser: how fast the strike follows the mouse, and whether it outlives random use.

`python benchmarks/studio.py [--drags 20] [--minutes 0] [--quick] [--json] [--window 1400x900] [--detail 0.25]`.
Headless Chromium opens the page of `lemon2024` and of `ur5e`. The target is dragged to random places of the map's
region that are in the window. Printed: the median and the largest time from the last movement of the mouse to the new
outcome on the page, and the medians of its parts: until the server hears of the movement, until it has sent the
outcome, and until the browser shows it; the time between two frames that the browser draws; the share of targets that
are hit where the map's strike hits; and, of every slider, the largest difference of the shown path from that of a
fresh simulation.

With `--minutes`, the page is then used at random: drags, sliders, tabs, check boxes, other models, wrong numbers and
exports. Printed: errors of page and server, and the growth of the memory of both between the first fifth and the end.
`--detail` lowers the resolution at which the scene is drawn: without a graphics card drawing takes
longer than everything else.
"""

from __future__ import annotations

import argparse
import json
import logging
import os
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import Error, sync_playwright

import whiptool as wt
from whiptool.live_page.page import Choices, Page
from whiptool.live_page.server import PageServer
from whiptool.models.kinematics import upright
from whiptool.strike_map.map_files import shipped_map

MODELS = ("lemon2024", "ur5e")
TABS = ("Target", "Whip", "Arm", "Strike", "View", "Export")
FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]
LONGEST = 300.0  # [s] that anything may take, also on a busy machine
GRASPED = 15.0  # [s] after which the ball was not grasped
MARGIN, PANEL = 60, 400  # [pixels] of the window in which nothing is dragged: at its sides, and at its panel
CLOCK = 2e-3  # [s] by which the browser's clock may be ahead of the server's
NOTICE = (320, 160)  # [pixels] at the top left, where the page tells of software rendering
# when the mouse moved last, and every outcome with the time at which it was on the page [ms]
WATCH = """
window.moved = 0; window.outcomes = []; window.frames_drawn = 0;
(function drawn() { window.frames_drawn += 1; requestAnimationFrame(drawn); })();
let at = "";  // a browser repeats the last movement when the page changes under the mouse
window.addEventListener("pointermove", e => {
  if (at !== (at = `${e.clientX} ${e.clientY}`)) window.moved = e.timeStamp;
}, true);
new MutationObserver(() => {
  const shown = document.querySelector(".outcome"), last = window.outcomes.at(-1);
  if (shown && (!last || last[1] !== +shown.dataset.number))
    window.outcomes.push([performance.now(), +shown.dataset.number, shown.dataset.hit === "true"]);
}).observe(document, {subtree: true, childList: true});
"""
Used = tuple[PageServer, Any, list[str]]


class WatchedPage(Page):
    """A page that notes when it hears of a movement, and when it has sent an outcome, by targets [s since 1970]."""

    def __init__(self, *arguments: Any) -> None:
        self.heard = list[tuple[float, tuple[float, ...]]]()
        self.sent = list[tuple[float, tuple[float, ...], int]]()
        super().__init__(*arguments)

    def _drag(self, target: wt.Target, begins: bool) -> None:
        self.heard.append((time.time(), target.position))
        super()._drag(target, begins)

    def _after(self, kinds: set[str]) -> Iterator[None] | None:
        longer = super()._after(kinds)
        if self.shown is not None:
            self.sent.append((time.time(), self.shown.settings.target.position, self.shown.number))
        return longer


@dataclass(frozen=True)
class Followed:
    """How the page followed the last movement of a drag.

    Args:
        total: Time from the movement to the outcome on the page [s].
        heard: Until the server hears of the movement [s].
        computed: From then until the outcome is sent [s].
        shown: From then until it is on the page [s].
    """

    total: float
    heard: float
    computed: float
    shown: float


class User:
    """A user of one page, in a browser.

    Args:
        tab: The browser's page.
        page: The page in the studio.
        window: Width and height [pixels].
    """

    def __init__(self, tab: Any, page: Page, window: tuple[int, int]) -> None:
        self.tab, self.page, self.window = tab, page, window

    def pixel(self, place: np.ndarray) -> np.ndarray:
        """Return where a place of the model (d,) [m] is in the window [pixels], (2,)."""
        camera = self.page.client.camera
        w, v = camera.wxyz[0], camera.wxyz[1:]
        away = upright(np.asarray(place, float)) - camera.position
        seen = away + 2 * np.cross(v, np.cross(v, away) - w * away)  # turned back
        drawn = np.array([camera.image_width, camera.image_height])  # pixels; at a lower detail fewer than shown
        focus = camera.image_height / 2 / np.tan(camera.fov / 2)
        return (drawn / 2 + focus * seen[:2] / seen[2]) * self.window[1] / camera.image_height

    def free(self, pixel: np.ndarray) -> bool:
        """Whether a pixel is in the scene and not behind anything."""
        (width, height), (x, y) = self.window, pixel
        inside = MARGIN < x < width - PANEL and MARGIN < y < height - MARGIN
        return bool(inside and not (x < NOTICE[0] and y < NOTICE[1]))

    @property
    def target(self) -> np.ndarray:
        """The target that is shown [m], (d,)."""
        shown = self.page.shown
        assert shown is not None
        return np.array(shown.settings.target.position)

    @property
    def number(self) -> int:
        """Number of the outcome on the page."""
        return int(self.tab.get_attribute(".outcome", "data-number") or 0)

    def settle(self, quiet: float = 0.3) -> int:
        """Wait until no outcome has come for so long [s]; return the number of the last."""
        last, since, end = self.number, time.monotonic(), time.monotonic() + LONGEST
        while time.monotonic() - since < quiet and time.monotonic() < end:
            time.sleep(0.03)
            if (now := self.number) != last:
                last, since = now, time.monotonic()
        return last

    def drag(self, to: np.ndarray) -> Followed | None:
        """Drag the target to a pixel; return how the page followed, or None if the ball could not be grasped."""
        at, mouse = self.pixel(self.target), self.tab.mouse
        before = self.number
        mouse.move(*at)
        mouse.down()
        mouse.move(*(at + 0.5 * (to - at)))
        mouse.move(*(at + 0.8 * (to - at)))
        grasped = self.wait(lambda: self.number > before, GRASPED)
        last = self.settle()
        mouse.move(*to)
        found = grasped and self.wait(lambda: self.number > last, LONGEST)
        self.settle()
        mouse.up()
        self.settle()
        found = found and self.wait(lambda: self._followed() is not None)
        return self._followed() if found else None

    def _followed(self) -> Followed | None:
        """Return how the page followed the last movement, whose outcome is the first at the target of the end; None: it
        has not come yet."""
        began, moved, outcomes = self.tab.evaluate("[performance.timeOrigin, window.moved, window.outcomes]")
        moved, (_, place) = (began + moved) / 1e3, self.page.heard[-1]
        heard = next((t for t, position in self.page.heard if t > moved - CLOCK and position == place), None)
        sent = next(((t, n) for t, position, n in self.page.sent if heard and t > heard and position == place), None)
        shown = next(((began + t) / 1e3 for t, n, _ in outcomes if sent and n >= sent[1]), None)
        if heard is None or sent is None or shown is None:
            return None
        return Followed(shown - moved, heard - moved, sent[0] - heard, shown - sent[0])

    def frame(self, seconds: float = 2.0) -> float:
        """Return the mean time between two frames that the browser draws, seen for so long [s]."""
        states = []
        for wait in (0.0, seconds):
            time.sleep(wait)
            states.append(self.tab.evaluate("[performance.now(), window.frames_drawn]"))
        (begin, before), (end, after) = states
        return (end - begin) / max(after - before, 1) / 1e3

    @staticmethod
    def wait(done: Callable[[], bool], longest: float = LONGEST) -> bool:
        """Wait until something is so, at most `longest` seconds; return whether it is."""
        end = time.monotonic() + longest
        while not done():
            if time.monotonic() > end:
                return False
            time.sleep(0.01)
        return True


@contextmanager
def used(models: tuple[str, ...], window: tuple[int, int], detail: float) -> Iterator[Used]:
    """A studio, a tab of a browser at its address, and the errors of the page, which grow."""
    choices, errors = Choices(lambda name: (wt.preset(name), None), models), list[str]()
    studio = PageServer(lambda client: WatchedPage(client, choices), port=0)
    chromium = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    try:
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=chromium, args=FLAGS)
            tab = browser.new_page(viewport={"width": window[0], "height": window[1]}, accept_downloads=True)
            tab.on("pageerror", lambda error: errors.append(str(error)))
            tab.add_init_script(WATCH)
            tab.goto(f"{studio.address}?fixedDpr={detail}")
            tab.wait_for_selector(".outcome", timeout=1e3 * LONGEST)
            yield studio, tab, errors
            browser.close()
    finally:
        studio.close()


def drags(user: User, name: str, count: int, seed: int) -> dict[str, Any]:
    """Drag the target to random places; return the times, and which were hit."""
    plan, rng = shipped_map(name), np.random.default_rng(seed)
    places = [x for x in plan.region.draw(50 * count, rng).positions if user.free(user.pixel(x))][:count]
    took, hits, said, missed = list[Followed](), [], [], 0
    for place in places:
        followed = user.drag(user.pixel(place))
        if followed is None:
            missed += 1
            continue
        took.append(followed)
        shown = user.page.shown
        assert shown is not None
        hits.append(shown.hit and bool(user.tab.evaluate("window.outcomes.at(-1)[2]")))
        said.append(bool(plan.refined(shown.settings.target.goals).struck.hit[0]))
    return {
        "drags": len(took),
        "not_grasped": missed,
        **{f.name: float(np.median([getattr(x, f.name) for x in took])) for f in fields(Followed)},
        "largest": max(x.total for x in took),
        "frame": user.frame(),
        "hits": int(np.sum(hits)),
        "hits_of_the_map": int(np.sum(said)),
        "as_the_map": int(np.sum(np.array(hits) == np.array(said))),
    }


def sliders(user: User, steps: int) -> dict[str, Any]:
    """Move every slider of whip, arm and strike by its keys; return the largest difference from fresh simulations."""
    worst, moved, unmoved = 0.0, 0, []
    for tab in ("Whip", "Arm", "Strike"):
        user.tab.get_by_role("tab", name=tab).click()
        user.settle()
        thumbs = user.tab.locator("[role=slider]:visible")
        for i in range(1, thumbs.count()):  # the first is the time
            before = user.number
            thumbs.nth(i).focus()
            for _ in range(steps):
                user.tab.keyboard.press("ArrowRight")
            if not user.wait(lambda before=before: user.number > before, LONGEST / 5):
                unmoved.append(f"{tab} {i}")
                continue
            user.settle(0.15)
            shown = user.page.shown
            assert shown is not None
            settings = shown.settings
            fresh = wt.CompiledRollout(settings.model, settings.controller).trajectory(wt.Strike(settings.strike))
            same = fresh.tip.shape == shown.trajectory.tip.shape
            worst = max(worst, float(np.abs(fresh.tip - shown.trajectory.tip).max()) if same else np.inf)
            moved += 1
    return {"sliders": moved, "unmoved": unmoved, "largest_difference": worst}


def memory() -> float:
    """Return the memory of this process, which serves [MiB]."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


class Errors(logging.Handler):
    """Collects what the studio logs."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.said: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.said.append(record.getMessage() + (f": {record.exc_info[1]!r}" if record.exc_info else ""))


def random_use(studio: PageServer, tab: Any, window: tuple[int, int], minutes: float, seed: int) -> dict[str, Any]:
    """Use a page at random; return what went wrong and how memory grew."""
    rng, logged, actions = np.random.default_rng(seed), Errors(), 0
    logging.getLogger("whiptool").addHandler(logged)
    logging.getLogger("asyncio").addHandler(logged)
    begin, early = time.monotonic(), None
    heap = "performance.memory ? performance.memory.usedJSHeapSize / 2 ** 20 : 0"
    without_widget = 0
    while (passed := time.monotonic() - begin) < 60 * minutes:
        try:
            _act(User(tab, studio.pages[0], window), rng)
        except (Error, IndexError, AssertionError):  # what was to be used went away meanwhile
            without_widget += 1
        actions += 1
        if early is None and passed > 12 * minutes:
            early = memory(), float(tab.evaluate(heap))
    user = User(tab, studio.pages[0], window)
    alive = user.wait(lambda: user.page.shown is not None) and user.settle() > 0
    early = early or (memory(), float(tab.evaluate(heap)))
    return {
        "minutes": minutes,
        "actions": actions,
        "actions_without_their_widget": without_widget,
        "alive": alive,
        "errors": logged.said,
        "server_memory": [early[0], memory()],
        "page_memory": [early[1], float(tab.evaluate(heap))],
    }


def _one_of(shown: Any, rng: np.random.Generator, first: int = 0) -> Any:
    """Return a random one of the widgets that are shown, from a number on."""
    count = shown.count()
    if count <= first:
        raise IndexError("no such widget is shown")
    return shown.nth(int(rng.integers(first, count)))


def _act(user: User, rng: np.random.Generator) -> None:
    """Do one random thing that a user can do."""
    tab = user.tab
    what = rng.choice(["drag", "slider", "tab", "box", "number", "model", "export", "law"],
                      p=[0.3, 0.3, 0.12, 0.09, 0.1, 0.02, 0.02, 0.05])  # fmt: skip
    width, height = user.window
    if what == "drag":
        to = rng.uniform([MARGIN, MARGIN], [width - PANEL, height - MARGIN])
        at = user.pixel(user.target)
        if user.free(at):
            tab.mouse.move(*at)
            tab.mouse.down()
            for share in (0.3, 0.6, 1.0):
                tab.mouse.move(*(at + share * (to - at)))
            tab.mouse.up()
    elif what == "tab":
        tab.get_by_role("tab", name=str(rng.choice(TABS))).click(timeout=2000)
    elif what == "slider":
        _one_of(tab.locator("[role=slider]:visible"), rng).focus(timeout=2000)
        for _ in range(int(rng.integers(1, 30))):
            tab.keyboard.press(str(rng.choice(["ArrowRight", "ArrowLeft", "PageUp", "PageDown", "Home", "End"])))
    elif what == "box":
        _one_of(tab.locator("input[type=checkbox]:visible"), rng).click(timeout=2000, force=True)
    elif what == "number":
        field = _one_of(tab.locator("input[inputmode=decimal]:visible, input[type=text]:visible"), rng, first=1)
        field.fill(str(rng.choice(["0", "-1", "1e9", "1.1", "0.3", "nan", "-", ""])), timeout=2000)
        field.press("Enter", timeout=2000)
    elif what == "export":
        tab.get_by_role("tab", name="Export").click(timeout=2000)
        tab.get_by_role("button", name=str(rng.choice(["TOML", "Python", "NPZ", "CSV", "HTML"]))).click(timeout=2000)
    else:
        if what == "law":
            tab.get_by_role("tab", name="Arm").click(timeout=2000)
        fields = tab.locator("input[role=combobox]:visible, input[aria-haspopup=listbox]:visible")
        fields.nth(0 if what == "model" else fields.count() - 1).click(timeout=2000)
        _one_of(tab.locator("[role=option]:visible"), rng).click(timeout=2000)
    time.sleep(float(rng.uniform(0.0, 0.5)))


def measured(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return everything that is printed."""
    width, height = (int(x) for x in arguments.window.split("x"))
    window, found = (width, height), dict[str, Any]()
    for name in MODELS if arguments.drags else ():
        with used((name,), window, arguments.detail) as (studio, tab, errors):
            user = User(tab, studio.pages[0], window)
            user.settle(2.0)
            found[name] = drags(user, name, arguments.drags, arguments.seed) | {"errors": errors}
            found[name] |= sliders(user, 2 if arguments.quick else 5)
    if arguments.minutes:
        with used((*MODELS, "panda", "nah2023"), window, arguments.detail) as (studio, tab, errors):
            used_at_random = random_use(studio, tab, window, arguments.minutes, arguments.seed)
            found["random_use"] = used_at_random | {"page_errors": errors}
    return found


def text_of(found: dict[str, Any]) -> str:
    """Return the results as lines of text."""
    lines = []
    for name, x in ((name, found[name]) for name in MODELS if name in found):
        lines += [
            f"{name}: the strike follows the mouse in {x['total']:.3f} s (median), {x['largest']:.3f} s at most, "
            f"in {x['drags']} drags",
            f"  of it          {x['heard']:.3f} s to the server, {x['computed']:.3f} s computation, {x['shown']:.3f} s "
            f"to the page, which draws a frame in {x['frame']:.3f} s",
            f"  hit            {x['hits']} of {x['drags']}; as the map in {x['as_the_map']}",
            f"  sliders        {x['sliders']}, largest difference from a fresh simulation "
            f"{x['largest_difference']:.1e} m",
        ]
    if "random_use" in found:
        x = found["random_use"]
        server, page = (f"{before:.0f} to {after:.0f} MiB" for before, after in (x["server_memory"], x["page_memory"]))
        wrong = len(x["errors"]) + len(x["page_errors"])
        lines.append(f"random use: {x['actions']} actions in {x['minutes']:g} min, {wrong} errors")
        lines.append(f"  memory         server {server}, page {page}, from the first fifth to the end")
        lines += [f"  error          {error}" for error in x["errors"] + x["page_errors"]]
    return "\n".join(lines)


def main() -> None:
    """Parse the command line, measure, and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--drags",
        type=int,
        help="drags for each model; default: 20, with --quick 3; 0: no sliders either",
    )
    parser.add_argument("--minutes", type=float, default=0.0, help="minutes of random use; default: none")
    parser.add_argument("--window", default="1400x900", help="size of the window [pixels]")
    parser.add_argument("--detail", type=float, default=0.25, help="pixels drawn for each pixel of the window")
    parser.add_argument("--seed", type=int, default=0, help="seed of places and of random use")
    parser.add_argument("--quick", action="store_true", help="few drags")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of text")
    arguments = parser.parse_args()
    if arguments.drags is None:
        arguments.drags = 3 if arguments.quick else 20
    found = measured(arguments)
    print(json.dumps(found) if arguments.json else text_of(found))


if __name__ == "__main__":
    main()
