"""Compilation of generated code with the system's compiler, and the cache of libraries in a private folder.

A library is executed in this process, and a truncated library crashes it. Files that another user could have written,
or whose content does not match the hash in their name, are therefore not loaded.
"""

from __future__ import annotations

import atexit
import ctypes
import hashlib
import logging
import os
import platform
import shutil
import signal
import stat
import subprocess
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path

from platformdirs import user_cache_path

from whiptool.whole_files import write_whole

log = logging.getLogger("whiptool")

_ROOM = 1 << 23  # [bytes] of sources and library while one is built
_FOR_OTHERS = stat.S_IWGRP | stat.S_IWOTH


def cache_folder() -> Path:
    """Return the user's cache folder, made private (mode 0700), or a temporary folder if that is not possible.

    The content of a folder to which others could write is removed.

    Raises:
        OSError: No temporary folder can be created either.
    """
    folder = user_cache_path("whiptool") / "compiled"
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if not is_own(folder):
            return _temporary_folder(f"{folder} belongs to another user")
        mode = folder.stat().st_mode
        if mode & _FOR_OTHERS:
            log.warning("others could write to %s: it is made private, and what it holds is compiled again", folder)
            for library in folder.glob("*.so"):
                library.unlink()
        if stat.S_IMODE(mode) != 0o700:
            folder.chmod(0o700)
            if folder.stat().st_mode & _FOR_OTHERS:  # of a file system without such modes
                return _temporary_folder(f"{folder} cannot be made private")
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except OSError as error:
        return _temporary_folder(f"cannot write {folder} ({error.strerror})")


def _with_room(folder: Path) -> Path:
    """Return the folder if a library can be built in it, or a temporary one, as where its disk is full."""
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(bytes(_ROOM))
        return folder
    except OSError as error:
        return _temporary_folder(f"no room in {folder} ({error.strerror})")


def is_own(path: Path) -> bool:
    """Whether a file or folder belongs to the current user; always true on systems without owners of files."""
    return not hasattr(os, "getuid") or path.stat().st_uid == os.getuid()


@cache
def _temporary_folder(reason: str) -> Path:
    log.warning("%s; compiled code is kept for this process only", reason)
    folder = Path(tempfile.mkdtemp(prefix="whiptool-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


def cached(folder: Path, key: str) -> ctypes.CDLL | None:
    """Return the compiled library with this key from a cache folder, loaded; None if the folder has no such library.

    Files that are damaged, not the user's, or writable by others are removed, and a line in the log says so.
    """
    for file in folder.glob(f"{key}-*.so"):
        try:
            if _name(key, file.read_bytes()) == file.name and is_own(file) and not file.stat().st_mode & _FOR_OTHERS:
                return ctypes.CDLL(str(file))
            reason = "it is damaged, or others could write to it"
        except FileNotFoundError:  # another process removed it
            continue
        except OSError as error:
            reason = str(error)
        log.warning("the compiled library %s is not used (%s); compiling again", file, reason)
        file.unlink(missing_ok=True)
    return None


def keep(library: Path, folder: Path, key: str) -> None:
    """Move a library that was built within the folder to its final name, atomically and readable by its user only."""
    library.chmod(0o700)
    library.replace(folder / _name(key, library.read_bytes()))


def _name(key: str, content: bytes) -> str:
    return f"{key}-{hashlib.sha256(content).hexdigest()[:32]}.so"


LONGEST = 300.0  # [s] that a library may take to compile: some 10 s on an idle machine
_LONGEST_ANSWER = 30.0  # [s] of the question for its version

# no -ffast-math: it would remove the tests for NaN
FLAGS = (
    "-std=c++17",
    "-O3",
    "-march=native",
    "-fno-math-errno",
    "-fno-trapping-math",
    "-fno-signed-zeros",
    "-fPIC",
    "-fvisibility=hidden",  # else nothing of the generated code is inlined
    "-shared",
    "-w",
)


class CompilerHangs(Exception):
    """A compiler did not answer in time."""


def _run(command: list[str], longest: float) -> subprocess.CompletedProcess[str]:
    """Run the compiler; what cannot be run at all counts as failed.

    Raises:
        CompilerHangs: It took longer [s]; it is ended, with the processes that it began.
    """
    try:
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            encoding="utf-8",
            errors="replace",
            start_new_session=True,
        )
    except OSError as error:
        return subprocess.CompletedProcess(command, 126, "", str(error))
    with process:
        try:
            out, err = process.communicate(timeout=longest)
        except BaseException as error:
            with suppress(OSError):
                os.killpg(process.pid, signal.SIGKILL)
            if isinstance(error, subprocess.TimeoutExpired):
                raise CompilerHangs(f"no answer within {longest:g} s") from None
            raise
    return subprocess.CompletedProcess(command, process.returncode, out, err)


@cache
def find_compiler() -> str | None:
    """Return the path of the C++ compiler: `CXX` if set, else the first of g++, clang++, c++.

    Returns:
        The path; None, with one line in the log, if there is no compiler.
    """
    given = os.environ.get("CXX")
    names = [given] if given else ["g++", "clang++", "c++"]
    path = next((path for path in map(shutil.which, names) if path), None)
    if path is None:
        what = f"CXX={given} is not the name or path of a compiler" if given else "no C++ compiler found"
        log.warning("%s; strikes run in CasADi's interpreter, several times slower", what)
    return path


@cache
def compiler_version(compiler: str) -> str:
    """Return a compiler's version text.

    Raises:
        CompilerHangs: The compiler does not answer.
    """
    return _run([compiler, "--version"], _LONGEST_ANSWER).stdout


@cache
def _identity(compiler: str) -> str:
    """Compiler version and processor: a library built for one is not offered to another."""
    try:
        processor = next(line for line in Path("/proc/cpuinfo").read_text().splitlines() if line.startswith("flags"))
    except (OSError, StopIteration):
        processor = platform.processor()
    return f"{compiler_version(compiler)}\n{platform.machine()}\n{processor}"


_hanging: set[str] = set()  # compilers that are not asked again


def load_library(
    generated: str, driver: str, defines: dict[str, float], functions: Sequence[str] = ()
) -> ctypes.CDLL | None:
    """Return the shared library of a driver that includes generated C code, from the cache or newly compiled.

    The cache key is a hash of sources, compiler, processor and flags. The library is built under a temporary name and
    then renamed, so that concurrent processes never see incomplete files.

    Args:
        generated: C code that the driver includes as `GENERATED`.
        driver: C++ code.
        defines: Macros by name.
        functions: Names of functions that the library must have.

    Returns:
        The library; None if there is no compiler, or, with one line in the log, if it fails.
    """
    compiler = find_compiler()
    if compiler is None or compiler in _hanging:
        return None
    options = [*FLAGS, *(f"-D{name}={value}" for name, value in sorted(defines.items()))]
    try:
        key = hashlib.sha256("\0".join([generated, driver, _identity(compiler), *options]).encode()).hexdigest()[:32]
        folder = cache_folder()
        if (found := cached(folder, key)) is not None:
            return found
        return _built(_with_room(folder), key, [compiler, *options], (generated, driver), functions)
    except CompilerHangs as error:
        _hanging.add(compiler)
        log.warning("%s hangs (%s); strikes run in CasADi's interpreter, several times slower", compiler, error)
    except OSError as error:
        log.warning("cannot compile (%s); trying something simpler", error)
    return None


def _built(
    folder: Path, key: str, command: list[str], sources: tuple[str, str], functions: Sequence[str]
) -> ctypes.CDLL | None:
    """Compile a library, load it, and keep it in the cache; None, with one line in the log, where it fails.

    Raises:
        CompilerHangs: The compiler takes too long.
        OSError: A file cannot be written, or what was built does not load.
    """
    compiler = command[0]
    with tempfile.TemporaryDirectory(dir=folder, prefix="build-") as build:
        source, driver_file, output = Path(build, "generated.c"), Path(build, "driver.cpp"), Path(build, "out.so")
        for file, text in zip((source, driver_file), sources, strict=True):
            write_whole(file, text)
        run = _run([*command, f'-DGENERATED="{source}"', str(driver_file), "-o", str(output), "-lm"], LONGEST)
        if run.returncode != 0:
            reason = (run.stderr.strip().splitlines() or [f"exit status {run.returncode}"])[0]
            log.warning("%s failed (%s); trying something simpler", compiler, reason)
            return None
        library = ctypes.CDLL(str(output))
        missing = [name for name in functions if not hasattr(library, name)]
        if missing:
            log.warning("%s built a library without %s; trying something simpler", compiler, ", ".join(missing))
            return None
        keep(output, folder, key)
        return library
