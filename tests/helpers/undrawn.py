"""Commands without the film and the figures of their strikes and reports, which tests of pictures draw.

Each takes from a third of a second to five. The figures of a report are still made, only not drawn as pictures.
"""

from __future__ import annotations

import pytest

from whiptool.commands import optimize, pictures
from whiptool.viz import plots, report


class NoPictures:
    """In place of the process that draws: it starts none."""

    def draw(self, *_: object) -> None:
        """Draw nothing."""

    def stop(self) -> None:
        """There is nothing to stop."""

    def __enter__(self) -> NoPictures:
        return self

    def __exit__(self, *_: object) -> None:
        pass


def leave_out_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let commands draw neither film nor figures of a strike or report."""
    monkeypatch.setattr(report, "_image", lambda _: ("svg+xml", b"<svg/>"))
    monkeypatch.setattr(plots, "save_strike_figures", lambda *_: None)
    monkeypatch.setattr(pictures.StrikeRun, "write_video", lambda *_: None)
    for module in (optimize, pictures):
        monkeypatch.setattr(module, "PictureProcess", NoPictures)


@pytest.fixture(autouse=True)
def nothing_drawn(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave pictures out of a test that is not marked `figures`; fixtures of whole files draw them."""
    if request.node.get_closest_marker("figures") is None:
        leave_out_pictures(monkeypatch)
