"""A film that another process renders: whole, or its error is told here."""

from __future__ import annotations

from dataclasses import replace

import pytest
from space_swing import swing

from whiptool.errors import WhiptoolError
from whiptool.models import preset
from whiptool.target import Target
from whiptool.viz.video_process import VideoProcess

LEMON = preset("lemon2024")
PATH, TARGET = swing(LEMON, instants=4), Target((1.3, 0.0))


@pytest.mark.heavy
def test_the_film_is_there_when_it_was_waited_for(tmp_path):
    with VideoProcess(tmp_path / "x.mp4", PATH, LEMON, TARGET) as video:
        video.wait()
    assert (tmp_path / "x.mp4").read_bytes()[4:8] == b"ftyp"


@pytest.mark.heavy
def test_its_error_is_raised_here(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(OSError, match="file"), VideoProcess(tmp_path / "file" / "x.mp4", PATH, LEMON, TARGET) as video:
        video.wait()


def test_a_process_that_died_is_told(tmp_path):
    with VideoProcess(tmp_path / "x.mp4", PATH, LEMON, replace(TARGET, hit_radius=0.1)) as video:
        video._process.kill()
        with pytest.raises(WhiptoolError, match=r"ended with status -9; give --no-video"):
            video.wait()


def test_it_ends_with_an_error_here(tmp_path):
    with pytest.raises(KeyboardInterrupt), VideoProcess(tmp_path / "x.mp4", PATH, LEMON, TARGET) as video:
        raise KeyboardInterrupt
    assert not video._process.is_alive()
    assert not list(tmp_path.glob("*.mp4"))
