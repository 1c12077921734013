"""Files from outside: regular, bounded, whole, of the right kind, or one line that names them."""

from __future__ import annotations

import io
import os
import struct
import tracemalloc
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from whiptool.comparison.search_unit import StrikeLibrary
from whiptool.errors import InputError
from whiptool.given_files import build_from, read_arrays, read_json, read_text, read_toml
from whiptool.goals.zone import Region
from whiptool.models.joint_trajectory import JointTrajectory
from whiptool.models.numbers import number
from whiptool.models.trajectory import Trajectory
from whiptool.recording.readers.angles import read_swings
from whiptool.recording.strike_recording import StrikeRecording


def some_trajectory(T: int = 5) -> Trajectory:
    t, of_joints = np.linspace(0, 1, T), np.ones((T, 2))
    gains = np.ones((T, 2, 2))
    return Trajectory(
        t,
        np.ones((T, 4)),
        np.ones((T, 4)),
        of_joints,
        of_joints,
        of_joints,
        gains,
        gains,
        t[:, None] * [1, 2],
        of_joints,
    )


def saved_region(path: Path) -> None:
    Region(np.array([[0.0, 0.1], [0.1, 0.1]]), 0.1).save(path)


def saved_library(path: Path) -> None:
    StrikeLibrary(np.ones((3, 5)), np.ones((3, 7, 2), np.float32)).save(path)


def saved_angles(path: Path) -> None:
    np.savez(path, angle=np.random.default_rng(0).normal(size=(20, 2)), dt=0.01)


def saved_recording(path: Path) -> None:
    t = np.arange(40) / 60
    StrikeRecording(t, np.stack([np.sin(t), -np.cos(t)], 1)[:, None], ("tip",), np.array(0.005)).save(path)


LOADERS: dict[str, tuple[Callable[[Path], object], Callable[[Path], object]]] = {
    "trajectory": (lambda path: some_trajectory().save(path), Trajectory.load),
    "region": (saved_region, Region.load),
    "library": (saved_library, StrikeLibrary.load),
    "angles": (saved_angles, read_swings),
    "recording": (saved_recording, StrikeRecording.load),
}


def announcing(shape: tuple[int, ...], dtype: str = "<f8", *, holding: bytes = b"") -> bytes:
    """An array's file whose header says more than there is."""
    header = repr({"descr": dtype, "fortran_order": False, "shape": shape}).encode() + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + holding


def zipped(**members: bytes) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return buffer.getvalue()


def pickled() -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, t=np.array([{"a": 1}], object), corners=np.array([print], object), angle=np.array([None]))
    return buffer.getvalue()


HOSTILE = {
    "empty": b"",
    "text": b"t,x,y\n1,2,3\n",
    "an array": announcing((2,), holding=bytes(16)),
    "a pickle": b"\x80\x04K\x01.",
    "pickled members": pickled(),
    "an empty archive": zipped(),
    "another archive": zipped(**{"word/document.xml": b"<xml/>"}),
    "a member that is no array": zipped(**{"t.npy": b"hello"}),
    "a shape of a petabyte": zipped(
        **{f"{key}.npy": announcing((10**14,)) for key in ("t", "corners", "angle", "strikes")}
    ),
    "a shape of 10^40": zipped(**{f"{key}.npy": announcing((10**20, 10**20)) for key in ("t", "corners", "angle")}),
    "a negative shape": zipped(**{f"{key}.npy": announcing((-3, -2)) for key in ("t", "corners", "angle", "strikes")}),
    "a header that is code": zipped(**{"t.npy": b"\x93NUMPY\x01\x00\x10\x00__import__('os')"}),
    "version 9": zipped(**{"t.npy": b"\x93NUMPY\x09\x00" + bytes(100)}),
}


@pytest.mark.parametrize("name", LOADERS)
@pytest.mark.parametrize("content", HOSTILE.values(), ids=HOSTILE)
def test_what_is_none_of_whiptools_arrays_is_one_error(content: bytes, name: str, tmp_path: Path) -> None:
    path = tmp_path / "x.npz"
    path.write_bytes(content)
    tracemalloc.start()
    with pytest.raises(InputError, match=r"x\.npz"):
        LOADERS[name][1](path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 20e6


@pytest.mark.parametrize("name", LOADERS)
def test_a_file_of_another_kind_is_one_error(name: str, tmp_path: Path) -> None:
    """Each reader on what all the others wrote."""
    for other, (save, _) in LOADERS.items():
        save(path := tmp_path / f"{other}.npz")
        if other == name:
            LOADERS[name][1](path)
        else:
            with pytest.raises(InputError, match=rf"{other}\.npz"):
                LOADERS[name][1](path)


@pytest.mark.parametrize("name", LOADERS)
def test_a_damaged_file_is_read_right_or_refused(name: str, tmp_path: Path) -> None:
    save, load = LOADERS[name]
    save(path := tmp_path / "x.npz")
    whole, rng = path.read_bytes(), np.random.default_rng(1)
    for _ in range(40):
        content = bytearray(whole)
        for at in rng.integers(len(content), size=3):
            content[at] = rng.integers(256)
        path.write_bytes(content[: rng.integers(len(content) // 2, 2 * len(content))])
        try:
            load(path)
        except InputError as error:
            assert "x.npz" in str(error)  # noqa: PT017


def test_a_bomb_is_refused_by_its_size_unpacked(tmp_path: Path, monkeypatch) -> None:
    """Three megabytes that unpack to more than is allowed."""
    monkeypatch.setattr("whiptool.given_files.LARGEST", 10_000_000)
    (tmp_path / "x.npz").write_bytes(zipped(**{"corners.npy": announcing((1_000_000, 2), holding=bytes(16_000_000))}))
    with pytest.raises(InputError, match="bytes unpacked"):
        Region.load(tmp_path / "x.npz")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"t": np.linspace(0, 1, 6)}, "T being 6"),
        ({"t": np.zeros(5)}, "later than the previous time"),
        ({"t": np.full(5, np.nan)}, "finite time"),
        ({"q": np.ones(5)}, r"numbers of shape \(T, n\)"),
        ({"q": np.array(list("abcde"))}, r"numbers of shape \(T, n\)"),
        ({"K": np.ones((5, 2, 3))}, "a being"),
        ({"diverged": np.array([True, False])}, r"numbers of shape \(\)"),
    ],
)
def test_a_trajectorys_arrays_belong_together(change: dict, said: str, tmp_path: Path) -> None:
    some_trajectory().save(tmp_path / "x.npz")
    with np.load(tmp_path / "x.npz") as data:
        np.savez(tmp_path / "y.npz", **{**data, **change})
    with pytest.raises(InputError, match=rf"y\.npz: .*{said}"):
        Trajectory.load(tmp_path / "y.npz")


@pytest.mark.parametrize(
    ("corners", "cell", "said"),
    [
        (np.empty((0, 2)), 0.1, "one finite corner"),
        (np.full((3, 2), np.nan), 0.1, "one finite corner"),
        (np.ones((3, 4)), 0.1, "in the plane or in space"),
        (np.ones((3, 2)), 0.0, "cell"),
        (np.ones((3, 2)), np.nan, "cell"),
        (np.array([[0.0, 0.0], [1e9, 1e9]]), 0.01, "spread over at most"),
    ],
)
def test_a_regions_cells_are_plausible(corners: np.ndarray, cell: float, said: str, tmp_path: Path) -> None:
    np.savez(tmp_path / "x.npz", corners=corners, cell=cell)
    with pytest.raises(InputError, match=rf"x\.npz: .*{said}"):
        Region.load(tmp_path / "x.npz")


def pipe(path: Path) -> Path:
    os.mkfifo(path)
    return path


@pytest.mark.parametrize(
    "read",
    [
        read_toml, read_json, lambda path: read_text(path, "URDF"), lambda path: read_arrays(path, "region"),
        StrikeRecording.load, JointTrajectory.load_csv, Trajectory.load,
    ],
)  # fmt: skip
def test_a_pipe_or_a_device_is_no_file(read: Callable[[Path], object], tmp_path: Path) -> None:
    """Opening the one waits for ever, reading the other never ends."""
    for path in (pipe(tmp_path / "x.npz"), Path("/dev/zero"), Path("/dev/null")):
        with pytest.raises(InputError, match="not a pipe or a device"):
            read(path)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a" + ".a" * 200_000 + " = 1", "at most 50 parts"),
        ("[a" + ' . "b"' * 60 + "]", "at most 50 parts"),
        ("x = {" + "'a'.b." * 60 + "c = 1}", "at most 50 parts"),
        ("x = " + "[" * 100_000, "nested"),
        ("x = " + "{a = " * 100_000, "nested"),
        ("x = 1" + "0" * 5000, "digits"),
    ],
    ids=["a key", "a header", "a key within", "arrays", "tables", "an integer"],
)
def test_toml_that_is_too_deep_or_too_long_is_refused(text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "x.toml").write_text(text)
    with pytest.raises(InputError, match=rf"x\.toml.*{said}") as caught:
        read_toml(tmp_path / "x.toml")
    assert len(str(caught.value)) < 1000


def test_many_points_in_texts_and_numbers_are_no_keys(tmp_path: Path) -> None:
    content = {"name": ". . . " * 60 + "..." * 60, "m": [0.5] * 200, "a": {"b": {"c": 1.5}}}
    (tmp_path / "x.toml").write_text(
        f'name = "{content["name"]}"\nm = {content["m"]}\na.b.c = 1.5  # {"." * 500} {"1." * 20}\n'
    )
    assert read_toml(tmp_path / "x.toml") == content


@pytest.mark.parametrize(
    "text", ["", "{", "[" * 100_000, "[1, 2]", "3", "null", '{"a": 1' + "0" * 5000 + "}", '{"a": "\\ud800', "\x00"]
)
def test_json_that_is_none_or_no_table_is_one_error(text: str, tmp_path: Path) -> None:
    (tmp_path / "x.json").write_text(text)
    with pytest.raises(InputError, match=r"x\.json"):
        read_json(tmp_path / "x.json")


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
        (None, r"a readable TOML file; reason: No such file or directory"),
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


@pytest.mark.parametrize("word", ["NaN", "Infinity", "-Infinity"])
def test_json_has_no_number_that_is_none(word: str, tmp_path: Path) -> None:
    (tmp_path / "x.json").write_text(f'{{"miss": {word}}}')
    with pytest.raises(InputError, match=f"valid JSON; reason: {word} does not count as a number"):
        read_json(tmp_path / "x.json")
