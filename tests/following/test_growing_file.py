"""Lines of a file that grows: each once, and only when it is whole."""

from __future__ import annotations

from pathlib import Path

from whiptool.following.followed import GrowingFile
from whiptool.whole_files import append_whole, write_whole


def test_each_line_comes_once_and_when_it_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    file = GrowingFile(path)
    assert file.new_lines() == (False, [])  # it does not exist yet
    append_whole(path, "one\ntwo\nthr")
    assert file.new_lines() == (True, [b"one", b"two"])
    assert file.new_lines() == (False, [])
    append_whole(path, "ee\n")
    assert file.new_lines() == (False, [b"three"])


def test_a_file_that_was_replaced_or_shortened_is_read_from_its_beginning(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    append_whole(path, "one\ntwo\n")
    file = GrowingFile(path)
    file.new_lines()
    write_whole(path, "one\ntwo\n")  # as a resumed run writes it, of the same length
    assert file.new_lines() == (True, [b"one", b"two"])
    with path.open("r+b") as open_file:
        open_file.truncate(4)
    assert file.new_lines() == (True, [b"one"])
    path.unlink()
    assert file.new_lines() == (True, [])
