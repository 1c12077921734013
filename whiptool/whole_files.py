"""Atomic writing of files: a killed process or a full disk leaves no incomplete file, and errors name the file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from io import BytesIO, FileIO
from pathlib import Path
from typing import Any

import numpy as np

_UNFINISHED = ".tmp-"


@contextmanager
def replacing(path: Path | str) -> Iterator[Path]:
    """Yield a temporary path next to a file; it is renamed to the file when the `with` block ends without an error.

    A device such as /dev/stdout, or a pipe, is written to directly.

    Raises:
        OSError: Writing fails, such as on a full disk; the error names the file. An existing file is unchanged.
    """
    path = Path(path)
    if path.exists() and not path.is_file():
        try:
            yield path
        except OSError as error:
            raise _named(error, path) from error
        return
    unfinished = path.with_name(_UNFINISHED + path.name)
    try:
        yield unfinished
        unfinished.replace(path)
    except OSError as error:
        unfinished.unlink(missing_ok=True)
        raise _named(error, path) from error
    except BaseException:
        unfinished.unlink(missing_ok=True)
        raise


def write_whole(path: Path | str, content: str | bytes) -> None:
    """Write a file atomically: it is never incomplete, and an existing file is kept if writing fails.

    Raises:
        OSError: Writing fails, such as on a full disk; the error names the file.
    """
    with replacing(path) as unfinished:
        unfinished.write_bytes(_encoded(content))


def write_npz(path: Path | str, arrays: Mapping[str, Any]) -> None:
    """Write arrays as an NPZ file, without pickle, under exactly this name.

    Raises:
        OSError: As for `write_whole`.
    """
    buffer = BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **arrays)
    write_whole(path, buffer.getvalue())


def append_whole(path: Path | str, content: str | bytes) -> None:
    """Append to a file; if not everything can be written, the file is unchanged.

    Raises:
        OSError: As for `write_whole`.
    """
    with Path(path).open("ab", buffering=0) as file:
        append_to(file, _encoded(content))


def append_to(file: FileIO, content: bytes) -> None:
    """Append like `append_whole` to a file that is open, unbuffered and at its end."""
    before, left = file.tell(), content
    try:
        while left:
            left = left[file.write(left) :]
    except OSError as error:
        file.seek(before)
        file.truncate()
        raise _named(error, Path(file.name)) from error


def remove_unfinished(folder: Path) -> None:
    """Remove, from a folder and its subfolders, incomplete files of killed processes."""
    for path in folder.rglob(_UNFINISHED + "*"):
        path.unlink(missing_ok=True)


def is_unfinished(path: Path) -> bool:
    """Whether a file is an incomplete file of a killed process."""
    return path.name.startswith(_UNFINISHED)


def _encoded(content: str | bytes) -> bytes:
    return content.encode("utf-8") if isinstance(content, str) else content


def _named(error: OSError, path: Path) -> OSError:
    if error.errno is None:
        return OSError(f"{path}: {error}")
    return OSError(error.errno, error.strerror, str(path))
