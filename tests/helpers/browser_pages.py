"""Pages in headless chromium: what they say of themselves, and how they look."""

from __future__ import annotations

import os
import shutil
import subprocess
from html import unescape
from html.parser import HTMLParser
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from processes import HANG

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
browser = pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")


class Elements(HTMLParser):
    """Tags with their attributes, and the text of scripts."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict]] = []
        self.scripts: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))
        if tag == "script":
            self.scripts.append("")

    def handle_data(self, data):
        if self.found[-1:] and self.found[-1][0] == "script":
            self.scripts[-1] += data

    def handle_endtag(self, tag):
        self.found.append(("/" + tag, {}))


def chromium(folder: Path, text: str, *flags: str, at: str = "") -> str:
    """What chromium prints for a page; `at` is the address behind `#`."""
    assert CHROMIUM is not None
    (folder / "page.html").write_text(text, encoding="utf-8")
    command = [CHROMIUM, "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run",
               "--hide-scrollbars", f"--user-data-dir={folder / 'profile'}", "--virtual-time-budget=3000"]  # fmt: skip
    address = (folder / "page.html").as_uri() + (f"#{at}" if at else "")
    done = subprocess.run(
        [*command, *flags, address],
        capture_output=True,
        text=True,
        timeout=HANG,
        check=False,
        env={**os.environ, "HOME": str(folder)},
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def root_data(dom: str) -> dict[str, str]:
    """Attributes of `<html>`, in which the page says what it did."""
    return {k: unescape(v or "") for k, v in next(a for tag, a in Elements(dom).found if tag == "html").items()}


def picture(folder: Path, text: str, name: str, *flags: str, at: str = "", size: str = "1200,900") -> np.ndarray:
    """A screenshot (height, width, 3), values 0 to 1."""
    file = folder / f"{name}.png"
    chromium(folder, text, f"--window-size={size}", f"--screenshot={file}", *flags, at=at)
    return matplotlib.image.imread(file)[..., :3]


def count(image: np.ndarray, color: str) -> int:
    """Pixels of nearly a colour such as #0072B2."""
    rgb = [int(color[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    return int((np.abs(image - rgb).max(axis=2) < 0.03).sum())
