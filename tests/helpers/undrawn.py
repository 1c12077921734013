"""Commands without the film and the figures of their strikes, which tests of pictures draw."""

from __future__ import annotations

import pytest

from whiptool.commands import optimize, pictures
from whiptool.viz import plots


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
    """Let commands draw neither film nor figures of a strike."""
    monkeypatch.setattr(plots, "save_strike_figures", lambda *_: None)
    for module in (optimize, pictures):
        monkeypatch.setattr(module, "PictureProcess", NoPictures)
