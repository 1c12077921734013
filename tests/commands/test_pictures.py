"""Pictures that another process draws: whole, or its error is told here."""

from __future__ import annotations

import gc

import pytest
from space_swing import swing

from whiptool.commands.pictures import VIDEO, PictureProcess, StrikeRun
from whiptool.errors import WhiptoolError
from whiptool.goals.target import Target
from whiptool.models import preset

LEMON = preset("lemon2024")
PATH, TARGET = swing(LEMON, instants=4), Target((1.3, 0.0))
STRIKE = StrikeRun(PATH, LEMON, TARGET, "swing")


def test_film_and_figures_are_there_when_they_were_waited_for(tmp_path):
    process = PictureProcess()
    process.draw(tmp_path, STRIKE)
    process.wait()
    assert (tmp_path / VIDEO).read_bytes()[4:8] == b"ftyp"
    assert (tmp_path / "strike.png").read_bytes()[1:4] == b"PNG"


def test_its_error_is_raised_here(tmp_path):
    (tmp_path / "file").touch()
    process = PictureProcess()
    process.draw(tmp_path / "file", STRIKE)
    with pytest.raises(OSError, match="file"):
        process.wait()


def test_a_process_that_died_is_told(tmp_path):
    process = PictureProcess()
    process._process.kill()
    process._process.join()
    process.draw(tmp_path, STRIKE)
    with pytest.raises(WhiptoolError, match=r"ended with status -9; give --no-video"):
        process.wait()


def test_it_is_stopped(tmp_path):
    process = PictureProcess()
    process.draw(tmp_path, STRIKE)
    process.stop()
    assert not process._process.is_alive()
    assert not list(tmp_path.glob("*.mp4"))


def test_where_nothing_is_drawn_it_ends_without_a_word(capfd):
    process = PictureProcess()
    child = process._process
    del process
    gc.collect()
    child.join()
    assert child.exitcode == 0
    assert capfd.readouterr().err == ""
