"""Files that are whole: neither a kill nor a full disk leaves half of one, and an error names the file."""

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
    """A name next to the file's own to write it under; it takes the file's name when the block ends without an error.

    What is there already and no regular file, a device such as /dev/stdout or a pipe, is written to and not replaced.

    Raises:
        OSError: The disk is full, or the like; it names the file. What was there before stays.
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
    """Write a file so that no half of it is ever seen; where it cannot be written, what was there before stays.

    Raises:
        OSError: The disk is full, or the like; it names the file.
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
    """Add to the end of a file; where not all of it can be added, the file stays as it was.

    Raises:
        OSError: As for `write_whole`.
    """
    with Path(path).open("ab", buffering=0) as file:
        append_to(file, _encoded(content))


def append_to(file: FileIO, content: bytes) -> None:
    """As `append_whole`, to a file that is open, unbuffered and at its end."""
    before, left = file.tell(), content
    try:
        while left:
            left = left[file.write(left) :]
    except OSError as error:
        file.seek(before)
        file.truncate()
        raise _named(error, Path(file.name)) from error


def remove_unfinished(folder: Path) -> None:
    """Remove what a killed process had not finished writing in a folder and those below it."""
    for path in folder.rglob(_UNFINISHED + "*"):
        path.unlink(missing_ok=True)


def is_unfinished(path: Path) -> bool:
    """Whether a file is what a killed process had not finished writing."""
    return path.name.startswith(_UNFINISHED)


def _encoded(content: str | bytes) -> bytes:
    return content.encode("utf-8") if isinstance(content, str) else content


def _named(error: OSError, path: Path) -> OSError:
    if error.errno is None:
        return OSError(f"{path}: {error}")
    return OSError(error.errno, error.strerror, str(path))
