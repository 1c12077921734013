"""What all readers share: whole files, foreign parsers kept from surprising the user, hashes."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from pathlib import Path

from whiptool.errors import InputError
from whiptool.given_files import LARGEST, parsing, whole_file

__all__ = ["LARGEST", "parsing", "sha256", "whole_file"]


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
