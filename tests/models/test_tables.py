"""Tables as dataclasses: what is unknown, missing or out of range is named with its place."""

from __future__ import annotations

from dataclasses import dataclass, field

import pytest

from whiptool.errors import InputError
from whiptool.models.numbers import number
from whiptool.models.tables import build_from, read_toml


@dataclass(frozen=True)
class Spring:
    k: float
    b: float = 0.5
    bends: list = field(default_factory=list)

    def __post_init__(self) -> None:
        number("k", self.k, low=0)


def test_a_table_becomes_the_dataclass():
    assert build_from(Spring, {"k": 2.0}, "spring.") == Spring(2.0)
    assert build_from(Spring, {"k": 2.0, "b": 1, "bends": [3]}, "spring.") == Spring(2.0, 1, [3])


def test_what_is_ready_stands_in_for_what_the_table_holds():
    assert build_from(Spring, {}, "spring.", k=4.0) == Spring(4.0)
    assert build_from(Spring, {"k": 2.0, "b": 1.0}, "spring.", k=4.0) == Spring(4.0, 1.0)


@pytest.mark.parametrize(
    ("table", "name", "given", "allowed"),
    [
        ({"k": 1, "c": 7}, "arm.spring.c", 7, "one of the keys k, b, bends"),
        ({"b": 1}, "arm.spring.k", None, "a value; the key is missing, all keys are k, b, bends"),
        ({"k": -3}, "arm.spring.k", -3, "a finite number >= 0"),
        ({"k": "stiff"}, "arm.spring.k", "stiff", "a finite number >= 0"),
        (3, "arm.spring", 3, "a table"),
        ([1, 2], "arm.spring", [1, 2], "a table"),
    ],
)
def test_mistakes_are_named_with_their_place(table, name, given, allowed):
    with pytest.raises(InputError) as caught:
        build_from(Spring, table, "arm.spring.")
    assert (caught.value.name, caught.value.given, caught.value.allowed) == (name, given, allowed)


def test_toml_is_read_as_mappings(tmp_path):
    path = tmp_path / "good.toml"
    path.write_text('name = "Päitsche"\n[whip]\nN = 3\nl = [0.1, 0.2]\n', encoding="utf-8")
    assert read_toml(path) == {"name": "Päitsche", "whip": {"N": 3, "l": [0.1, 0.2]}}


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"whip = [", "valid TOML"),
        (b"x = 1\nx = 2\n", "valid TOML"),
        ("name = 'ä'".encode("latin-1"), "valid TOML"),
        (None, r"a readable TOML file \(No such file or directory\)"),
    ],
)
def test_files_that_are_no_toml_are_named(tmp_path, content, said):
    path = tmp_path / "file.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=rf"^file: got '.*file\.toml'; allowed: {said}") as caught:
        read_toml(path)
    assert "\n" not in str(caught.value)


def test_a_folder_is_no_file(tmp_path):
    with pytest.raises(InputError, match="a readable TOML file"):
        read_toml(tmp_path)
