"""Files are whole or not there, also where the disk is full."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
from full_disk import full_disk
from robot_files import URDF

from whiptool.comparison.search_unit import StrikeLibrary
from whiptool.goals.zone import Region
from whiptool.impedance import ConstantImpedance, Controller
from whiptool.impedance.controller import read_controller, write_controller
from whiptool.models import preset
from whiptool.models.files import read_model, read_robot, write_model
from whiptool.models.robot_files import ArmChoice
from whiptool.whole_files import append_whole, replacing, write_npz, write_whole


def test_a_device_is_written_to_and_not_replaced(tmp_path: Path) -> None:
    """`--export /dev/stdout` must not leave a regular file in /dev. Through a link, for a test that fails as root."""
    null = tmp_path / "null"
    null.symlink_to(os.devnull)
    write_whole(null, "lost")
    assert null.is_symlink()
    assert [path.name for path in tmp_path.iterdir()] == ["null"]


WRITERS: dict[str, Callable[[Path | str], None]] = {
    "write": lambda path: write_whole(path, "new" * 1000),
    "append": lambda path: append_whole(path, b"new" * 1000),
    "arrays": lambda path: write_npz(path, {"x": np.random.default_rng(0).random(1000)}),
}


@pytest.mark.parametrize("writer", WRITERS)
@pytest.mark.parametrize("there", [True, False])
def test_what_does_not_fit_leaves_no_half(writer: str, there: bool, tmp_path: Path) -> None:
    path = tmp_path / "file"
    if there:
        path.write_bytes(b"before")
    with full_disk(100), pytest.raises(OSError, match=r"file'$") as caught:
        WRITERS[writer](path)
    assert caught.value.filename == str(path)
    assert (path.read_bytes() if path.exists() else b"") == (b"before" if there else b"")
    assert {found.name for found in tmp_path.iterdir()} <= {"file"}


@pytest.mark.parametrize("writer", WRITERS)
def test_a_path_may_be_text(writer: str, tmp_path: Path) -> None:
    for path in (tmp_path / "by path", str(tmp_path / "by text")):
        WRITERS[writer](path)
    assert len({found.read_bytes() for found in tmp_path.iterdir()}) == 1


def test_what_saves_and_loads_takes_text(tmp_path: Path) -> None:
    model, controller = preset("lemon2024"), Controller(ConstantImpedance())
    library = StrikeLibrary(np.zeros((1, 5)), np.zeros((1, 4, 2)))
    region = Region(np.zeros((1, 2)), 0.1)
    for made in (library, region):
        made.save(str(tmp_path / "file.npz"))
        assert type(made).load(str(tmp_path / "file.npz")) is not None
    write_model(model, str(tmp_path / "file.toml"))
    assert read_model(str(tmp_path / "file.toml")) == model
    write_controller(controller, str(tmp_path / "file.toml"))
    assert read_controller(str(tmp_path / "file.toml")) == controller
    (tmp_path / "arm.urdf").write_text(URDF)
    assert read_robot(str(tmp_path / "arm.urdf"), ArmChoice(tip="tool")).n == 3


def test_an_error_without_a_number_names_the_file_too(tmp_path: Path) -> None:
    with pytest.raises(OSError, match=r"film\.mp4: no frames"), replacing(tmp_path / "film.mp4"):
        raise OSError("no frames")


@pytest.mark.parametrize("room", [True, False])
def test_a_film_is_whole_or_not_there(room: bool, tmp_path: Path) -> None:
    from whiptool.viz.animation import write_film

    frames = (np.full((64, 64, 3), 40 * i, np.uint8) for i in range(5))
    expected = nullcontext() if room else pytest.raises(OSError, match=r"strike\.mp4: .* the disk may be full")
    with nullcontext() if room else full_disk(100), expected, replacing(tmp_path / "strike.mp4") as unfinished:
        write_film(unfinished, frames, count=5, size=(64, 64), fps=25.0)
    assert [path.name for path in tmp_path.iterdir()] == (["strike.mp4"] if room else [])


def test_a_full_disk_is_none_for_the_output_of_the_tests_themselves(tmp_path: Path) -> None:
    """As with `pytest > file`: the report of a test is longer than what its full disk lets a file hold."""
    command = [sys.executable, "-m", "pytest", "-n", "0", "-v", "-k", "film_is_whole", __file__]
    with (tmp_path / "out").open("w") as out:
        done = subprocess.run(command, stdout=out, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "2 passed" in (tmp_path / "out").read_text()
