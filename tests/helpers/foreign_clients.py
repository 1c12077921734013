"""Clients of Dynamixel servos on PyPI that cannot be installed beside whiptool, and are fetched apart.

LeRobot's bus comes with a package of gigabytes, and dynamixel-controller with an old copy of dynamixel-sdk that
overwrites the maker's. Their files are fetched once into the user's cache, without their dependencies, at the versions
below; a test is skipped where they cannot be.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

import pytest

LEROBOT = ("lerobot==0.4.4", "deepdiff==8.6.1", "orderly-set==5.5.0")
DYNAMIXEL_CONTROLLER = ("dynamixel-controller==0.9.2", "deprecation==2.1.0")
_CACHE = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "whiptool-tests"


def fetched(requirements: tuple[str, ...], *, without: str | None = None) -> Path:
    """Folder with these packages' files, less the package `without`; skips the test where they cannot be fetched."""
    folder = _CACHE / requirements[0].replace("==", "-")
    if folder.exists():
        return folder
    _CACHE.mkdir(parents=True, exist_ok=True)
    new = Path(tempfile.mkdtemp(dir=_CACHE))
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target", str(new), *requirements]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        shutil.rmtree(new)
        pytest.skip(f"{requirements[0]} cannot be fetched: {done.stderr.strip().splitlines()[-1]}")
    if without is not None:
        shutil.rmtree(new / without)
    try:
        new.rename(folder)
    except OSError:  # another process was quicker
        shutil.rmtree(new)
    return folder


@contextmanager
def importable(folder: Path, **stand_ins: dict[str, object]) -> Iterator[None]:
    """Modules of a folder can be imported, and so can modules of these names (`.` as `__`) and contents; they are
    forgotten afterwards.
    """
    before = set(sys.modules)
    sys.path.insert(0, str(folder))
    for name, content in stand_ins.items():
        module = ModuleType(name.replace("__", "."))
        module.__dict__.update(content)
        sys.modules[module.__name__] = module
    try:
        yield
    finally:
        sys.path.remove(str(folder))
        for name in set(sys.modules) - before:
            if name.split(".")[0] in ("lerobot", "dynio", "deepdiff", "orderly_set", "deprecation", "pkg_resources"):
                del sys.modules[name]
