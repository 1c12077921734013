"""Commands draw no figures, which take each of them more than a second, but where a test looks at them."""

from __future__ import annotations

import pytest

from whiptool.viz import plots


@pytest.fixture(autouse=True)
def no_figures(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave figures of a strike out of a test that is not marked `figures`; fixtures of whole files draw them."""
    if request.node.get_closest_marker("figures") is None:
        monkeypatch.setattr(plots, "save_strike_figures", lambda *_: None)
