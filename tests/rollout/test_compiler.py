"""Compiling: the cache holds the user's own, whole libraries, or compiles again."""

from __future__ import annotations

import contextlib
import ctypes
import errno
import logging
import os
import stat
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from processes import HANG
from rich_model import CONTROLLERS, LEMON

from whiptool.rollout import CompiledRollout, compiler
from whiptool.rollout.compiler import find_compiler, load_library

DRIVER = 'extern "C" __attribute__((visibility("default"))) int seven() { return 7; }'

pytestmark = pytest.mark.skipif(find_compiler() is None, reason="no compiler")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch) -> Path:
    """The folder of an empty cache."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    compiler._temporary_folder.cache_clear()
    compiler.find_compiler.cache_clear()
    yield tmp_path / "whiptool" / "compiled"
    monkeypatch.undo()
    compiler._temporary_folder.cache_clear()
    compiler.find_compiler.cache_clear()
    compiler._hanging.clear()


def seven() -> int | None:
    library = load_library("", DRIVER, {}, ("seven",))
    return None if library is None else library.seven()


def one_in(folder: Path) -> Path:
    (library,) = folder.iterdir()
    return library


def opened(monkeypatch) -> list[str]:
    """The libraries that are loaded from now on."""
    names, load = [], ctypes.CDLL
    monkeypatch.setattr(ctypes, "CDLL", lambda name: names.append(Path(name).name) or load(name))
    return names


def damaged(library: Path, how: str) -> None:
    """As after a loss of power; under another file, as this process has the whole one loaded."""
    content = bytearray(library.read_bytes())
    if how == "cut":
        del content[5000:]
    else:
        content[len(content) // 2 :] = bytes(len(content) - len(content) // 2)
    library.unlink()
    library.write_bytes(content)
    library.chmod(0o700)


def test_the_cache_is_private_whatever_the_umask(folder: Path) -> None:
    before = os.umask(0)
    try:
        assert seven() == 7
    finally:
        os.umask(before)
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert stat.S_IMODE(one_in(folder).stat().st_mode) == 0o700


def test_what_is_cached_is_loaded_without_a_compiler_at_work(folder: Path, monkeypatch) -> None:
    assert seven() == 7
    monkeypatch.setattr(compiler, "_built", None)
    names = opened(monkeypatch)
    assert seven() == 7
    assert names == [one_in(folder).name]


@pytest.mark.parametrize("how", ["cut", "zeroed"])
def test_a_damaged_library_is_never_loaded_and_compiled_again(how: str, folder: Path, monkeypatch, caplog) -> None:
    """Loading it ended Python: SIGBUS where it was cut, SIGSEGV where half of it was zeros."""
    assert seven() == 7
    library = one_in(folder)
    damaged(library, how)
    names = opened(monkeypatch)
    with caplog.at_level(logging.WARNING, logger="whiptool"):
        assert seven() == 7
    assert names == ["out.so"]  # the one that was built now
    assert one_in(folder).stat().st_size > 5000
    (record,) = caplog.records
    assert library.name in record.getMessage()


def test_a_library_that_others_may_write_is_compiled_again(folder: Path, monkeypatch) -> None:
    assert seven() == 7
    one_in(folder).chmod(0o766)
    names = opened(monkeypatch)
    assert seven() == 7
    assert names == ["out.so"]
    assert stat.S_IMODE(one_in(folder).stat().st_mode) == 0o700


def test_a_folder_that_others_could_write_is_emptied_and_made_private(folder: Path, monkeypatch, caplog) -> None:
    assert seven() == 7
    folder.chmod(0o777)
    names = opened(monkeypatch)
    with caplog.at_level(logging.WARNING, logger="whiptool"):
        assert seven() == 7
    assert names == ["out.so"]
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert "others could write" in caplog.text


def test_of_a_folder_of_another_user_nothing_is_loaded(folder: Path, monkeypatch, caplog) -> None:
    assert seven() == 7
    names = opened(monkeypatch)
    monkeypatch.setattr(os, "getuid", lambda: folder.stat().st_uid + 1)
    with caplog.at_level(logging.WARNING, logger="whiptool"):
        for _ in range(2):
            load_library("", DRIVER, {}, ("seven",))
    assert names[0] == "out.so"
    assert "belongs to another user" in caplog.text
    assert len(list(folder.iterdir())) == 1


def script(folder: Path, monkeypatch, text: str) -> None:
    """Make a shell script the compiler."""
    file = folder.parent.parent / "compiler"
    file.write_text("#!/bin/sh\n" + text)
    file.chmod(0o700)
    monkeypatch.setenv("CXX", str(file))


def test_a_compiler_that_hangs_is_ended_with_its_children_and_not_asked_again(
    folder: Path, monkeypatch, caplog
) -> None:
    monkeypatch.setattr(compiler, "LONGEST", 0.3)
    script(folder, monkeypatch, 'echo "$1" >> "$0.calls"\n[ "$1" = --version ] || { sleep 1000 & wait; }\n')
    with caplog.at_level(logging.WARNING, logger="whiptool"):
        assert [seven(), seven()] == [None, None]
    assert [record.getMessage().count("hangs (no answer within 0.3 s)") for record in caplog.records] == [1]
    assert len((folder.parent.parent / "compiler.calls").read_text().split()) == 2  # its version, and once


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (r"""printf 'caf\351 \377\n' >&2; exit 1""", "caf"),
        ("""while [ "$1" != -o ]; do shift; done; : > "$2" """, "cannot compile"),
        (
            """while [ "$1" != -o ]; do shift; done; echo 'int f;' | c++ -shared -fPIC -x c++ - -o "$2" """,
            "without seven",
        ),
    ],
    ids=["no UTF-8", "an empty library", "a library without the function"],
)
def test_a_compiler_that_does_nonsense_counts_as_one_that_fails(
    text: str, said: str, folder: Path, monkeypatch, caplog
) -> None:
    script(folder, monkeypatch, f"[ \"$1\" = --version ] && {{ printf 'v\\351\\n'; exit; }}\n{text}\n")
    with caplog.at_level(logging.WARNING, logger="whiptool"):
        assert seven() is None
    (record,) = caplog.records
    assert said in record.getMessage()
    assert not list(folder.iterdir())


def test_where_the_disk_of_the_cache_is_full_a_temporary_folder_takes_its_place(folder: Path, monkeypatch, caplog):
    assert seven() == 7
    kept = one_in(folder)
    make, write = compiler.tempfile.TemporaryFile, compiler.write_whole

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    def made(**where):
        file = make(**where)
        return contextlib.nullcontext(SimpleNamespace(write=full)) if where.get("dir") == folder else file

    monkeypatch.setattr(compiler.tempfile, "TemporaryFile", made)
    monkeypatch.setattr(
        compiler, "write_whole", lambda path, text: (full if folder in path.parents else write)(path, text)
    )
    assert seven() == 7  # what is cached is loaded
    kept.unlink()
    with caplog.at_level(logging.WARNING, "whiptool"):
        assert seven() == 7
    assert f"no room in {folder} (No space left on device)" in caplog.text
    assert list(folder.iterdir()) == []


def test_without_any_place_to_write_the_interpreter_is_left(folder: Path, monkeypatch, caplog) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", "/proc/nowhere")
    monkeypatch.setattr(compiler.tempfile, "mkdtemp", lambda **_: (_ for _ in ()).throw(OSError(28, "full")))
    with caplog.at_level(logging.WARNING, logger="whiptool"):
        assert seven() is None
    assert "cannot compile" in caplog.text


@pytest.mark.slow
def test_processes_that_start_at_once_share_the_cache(tmp_path):
    """Four first starts on an empty cache: all agree, one library is left, nothing half-written."""
    program = (
        "import numpy as np; from whiptool.models import preset; from whiptool.rollout import CompiledRollout;"
        "from whiptool.impedance import *;"
        "r = CompiledRollout(preset('lemon2024'), Controller(ConstantImpedance()), timestep=1e-3);"
        "assert r.engine != 'interpreter';"
        "print(repr(r.approach(np.array([[-1.2, 0.9, 1.2, 0.3, 0.7]]), np.array([1.3, 0.0]), t_stay=0.3).distance[0]))"
    )  # fmt: skip
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}
    runs = [
        subprocess.Popen([sys.executable, "-c", program], env=environment, stdout=subprocess.PIPE) for _ in range(4)
    ]
    printed = {run.communicate(timeout=HANG)[0] for run in runs}
    assert all(run.returncode == 0 for run in runs)
    assert len(printed) == 1
    left = [path.name for path in (tmp_path / "whiptool" / "compiled").iterdir()]
    assert len(left) == 1
    assert left[0].endswith(".so")


def test_a_damaged_cache_is_mended(tmp_path, monkeypatch):
    from whiptool.rollout import engine

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    engine.find_engine.cache_clear()
    CompiledRollout(LEMON, CONTROLLERS["held"])
    (library,) = (tmp_path / "whiptool" / "compiled").glob("*.so")
    library.unlink()
    library.write_bytes(b"not a library")
    engine.find_engine.cache_clear()
    assert CompiledRollout(LEMON, CONTROLLERS["held"]).engine != "interpreter"
    engine.find_engine.cache_clear()
