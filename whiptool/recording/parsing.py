"""What all readers share: foreign parsers kept from surprising the user, optional packages, hashes."""

from __future__ import annotations

import hashlib
import importlib
import types
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from whiptool.errors import InputError, WhiptoolError

LARGEST = 2**31  # [bytes] of tracks; video, which is streamed, may be larger


@contextmanager
def parsing(path: Path, kind: str) -> Iterator[None]:
    """Turn whatever a parser throws at damaged bytes into one line that names the file.

    Raises:
        InputError: The block raised anything but an error of whiptool itself, whose place is added instead.
    """
    try:
        yield
    except InputError as error:
        named = str(path.with_suffix("")) in error.name  # or its sidecar is
        raise (error if named else error.within(f"{path}: ")) from None
    except WhiptoolError:
        raise
    except Exception as error:  # parsers document few of the errors that they raise: on damage all mean the same
        reason = f"{type(error).__name__}: {error}".replace("\n", " ")[:160]
        raise InputError(
            str(path), "a damaged or different file", f"a whole {kind} file", f"its parser says {reason}"
        ) from None


def whole_file(path: Path | str, *, largest: float = LARGEST) -> Path:
    """The path of a file that can be read and is not empty.

    Raises:
        InputError: It is not there, is a folder, empty, cannot be opened, or is larger than `largest` bytes.
    """
    path = Path(path)
    try:
        if path.is_dir():
            raise InputError("recording", str(path), "a file, not a folder")
        with path.open("rb"):
            size = path.stat().st_size
    except (OSError, ValueError) as error:  # ValueError: a name with a NUL byte
        reason = getattr(error, "strerror", None) or error
        raise InputError("recording", str(path), f"a file that can be read ({reason})") from None
    if size == 0:
        raise InputError(str(path), "an empty file", "a recording")
    if size > largest:
        raise InputError(str(path), f"{size} bytes", f"at most {largest:.0f} bytes", "cut the strike out of it")
    return path


def need(module: str, extra: str, purpose: str) -> types.ModuleType:
    """Import an optional package.

    Raises:
        InputError: It is not installed; the command that installs it is named.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        fix = f"pip install 'whiptool[{extra}]'" if extra else f"pip install {package}"
        raise InputError(package, f"no such package ({error})", f"installed, to read {purpose}", fix) from None


def sha256(paths: Path | Iterable[Path]) -> str:
    """Of the bytes of a file, or of several one after the other, as hexadecimal digits.

    Raises:
        InputError: One cannot be read.
    """
    digest = hashlib.sha256()
    for path in [paths] if isinstance(paths, Path) else paths:
        try:
            with path.open("rb") as file:
                while block := file.read(1 << 20):
                    digest.update(block)
        except OSError as error:
            raise InputError("recording", str(path), f"a file that can be read ({error.strerror})") from None
    return digest.hexdigest()
