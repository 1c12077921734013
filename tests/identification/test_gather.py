"""Recordings are gathered by what is named on the command line."""

from __future__ import annotations

import pytest
import tomli_w

from whiptool.errors import InputError
from whiptool.identification.gather import opened, tracked

pytestmark = pytest.mark.slow


def test_an_episode_of_a_dataset_is_named_behind_its_folder(tmp_path):
    pytest.importorskip("pyarrow", reason="needs the extra `io`")
    from recordings import TABLE, H, T, write_lerobot

    write_lerobot(tmp_path / "set")
    sidecar = {"homography": H.tolist(), "episode": {"1": {"strike": TABLE}}}
    (tmp_path / "set" / "whiptool.toml").write_text(tomli_w.dumps(sidecar))
    recording, synthetic = tracked(opened(f"{tmp_path / 'set'}#1"), name="set#1")
    assert recording.strike is not None
    assert (len(recording.t), recording.markers, synthetic) == (T, ("tip", "handle"), False)
    with pytest.raises(InputError, match="episode"):
        opened(f"{tmp_path / 'set'}#7")
    with pytest.raises(InputError, match="exists"):
        opened(f"{tmp_path / 'none'}#1")
