"""The cache of compiled libraries: a folder that is private, and files whose names hold the hash of their content.

A library is machine code that this process runs, and one that was cut ends the process when it is loaded. So nothing is
loaded that another user could have written, or whose content does not match its name.
"""

from __future__ import annotations

import atexit
import ctypes
import hashlib
import logging
import os
import shutil
import stat
import tempfile
from functools import cache
from pathlib import Path

from platformdirs import user_cache_path

log = logging.getLogger("whiptool")

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
    """Return the cached library of a key if it is complete and owned by the user, else None; invalid files are
    removed."""
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
