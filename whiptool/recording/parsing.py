"""What all readers share: whole files, foreign parsers kept from surprising the user, optional packages, hashes."""

from __future__ import annotations

import hashlib
import importlib
import types
from collections.abc import Iterable
from pathlib import Path

from whiptool.errors import InputError
from whiptool.given_files import LARGEST, parsing, whole_file

__all__ = ["LARGEST", "need", "parsing", "sha256", "whole_file"]


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
