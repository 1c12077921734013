"""Compiles generated code with the system's compiler into the user's cache folder."""

from __future__ import annotations

import atexit
import ctypes
import hashlib
import logging
import os
import platform
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path

from platformdirs import user_cache_path

from whiptool.whole_files import write_whole

log = logging.getLogger("whiptool")

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


def _run(command: list[str]) -> subprocess.CompletedProcess[str]:
    """Run the compiler; what cannot be run at all counts as failed."""
    try:
        return subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError as error:
        return subprocess.CompletedProcess(command, 126, "", str(error))


@cache
def find_compiler() -> str | None:
    """Path of the C++ compiler: `CXX` if set, else the first of g++, clang++, c++.

    Returns:
        None, with one line in the log, where there is no compiler.
    """
    given = os.environ.get("CXX")
    names = [given] if given else ["g++", "clang++", "c++"]
    path = next((path for path in map(shutil.which, names) if path), None)
    if path is None:
        what = f"CXX={given} is not the name or path of a compiler" if given else "no C++ compiler found"
        log.warning("%s; strikes run in CasADi's interpreter, several times slower", what)
    return path


@cache
def _identity(compiler: str) -> str:
    """Compiler version and processor: a library built for one is not offered to another."""
    version = _run([compiler, "--version"]).stdout
    try:
        processor = next(line for line in Path("/proc/cpuinfo").read_text().splitlines() if line.startswith("flags"))
    except (OSError, StopIteration):
        processor = platform.processor()
    return f"{version}\n{platform.machine()}\n{processor}"


def cache_folder() -> Path:
    """The cache folder; a temporary one where the user's cannot be written."""
    folder = user_cache_path("whiptool") / "compiled"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if os.access(folder, os.W_OK):
            return folder
    except OSError:
        pass
    log.warning("cannot write %s; compiled code is kept for this process only", folder)
    return _temporary_folder()


@cache
def _temporary_folder() -> Path:
    folder = Path(tempfile.mkdtemp(prefix="whiptool-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


def load_library(generated: str, driver: str, defines: dict[str, float]) -> ctypes.CDLL | None:
    """The shared library of generated C code included by a driver, from the cache or freshly compiled.

    The cache key is a hash of sources, compiler, processor and flags. The library is written under a temporary name
    and renamed, so that processes that start at once do not see each other's half-written files.

    Args:
        generated: C code that the driver includes as `GENERATED`.
        driver: C++ code.
        defines: Macros.

    Returns:
        The library; None where there is no compiler, and, with one line in the log, where it fails.
    """
    compiler = find_compiler()
    if compiler is None:
        return None
    options = [*FLAGS, *(f"-D{name}={value}" for name, value in sorted(defines.items()))]
    key = hashlib.sha256("\0".join([generated, driver, _identity(compiler), *options]).encode()).hexdigest()[:32]
    folder = cache_folder()
    library = folder / f"{key}.so"
    if library.exists():
        try:
            return ctypes.CDLL(str(library))
        except OSError as error:  # a damaged file: compile again
            log.warning("cached %s does not load (%s); compiling again", library.name, error)
    with tempfile.TemporaryDirectory(dir=folder, prefix="build-") as build:
        source, driver_file, output = Path(build, "generated.c"), Path(build, "driver.cpp"), Path(build, "out.so")
        write_whole(source, generated)
        write_whole(driver_file, driver)
        command = [compiler, *options, f'-DGENERATED="{source}"', str(driver_file), "-o", str(output), "-lm"]
        run = _run(command)
        if run.returncode != 0:
            reason = (run.stderr.strip().splitlines() or [f"exit status {run.returncode}"])[0]
            log.warning("%s failed (%s); trying something simpler", compiler, reason)
            return None
        output.replace(library)
    try:
        return ctypes.CDLL(str(library))
    except OSError as error:
        log.warning("%s does not load (%s); trying something simpler", library, error)
        return None
