"""What a stored result is known by: a hash of the kind and of all fields of the unit that gave it."""

from __future__ import annotations

import hashlib
import json
import re
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

KEY = re.compile(r"-[0-9a-f]{16}$")  # what the key of every unit ends in; results of older versions have no such ending


class Unit(ABC):
    """A part of a study, a frozen dataclass: its result follows from its fields alone, wherever it is worked on.

    Random numbers are drawn with seeds that are among the fields.
    """

    @cached_property
    def key(self) -> str:
        """What tells it from all other units, fit for a file: words for people, and a hash of kind and fields."""
        plain = json.dumps(plain_of(self), sort_keys=True)
        return f"{_words(self)}-{hashlib.sha256(plain.encode()).hexdigest()[:16]}"

    @abstractmethod
    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Do it.

        Args:
            folder: For checkpoints of what takes long; None, or not there (another machine): none are kept.
            threads: Threads of the simulator; the result does not depend on it.

        Returns:
            Plain data, which JSON can hold.
        """


def _words(unit: Any) -> str:
    """Return the kind of a unit and those of its short fields that are not as usual, for people who look at files."""
    words = [type(unit).__name__.removesuffix("Unit").lower()]
    for field in fields(unit):
        value = getattr(unit, field.name)
        if isinstance(value, str | int) and value != field.default:
            words.append(str(value) if isinstance(value, str) else f"{field.name}{value:d}")
    return re.sub(r"[^A-Za-z0-9.+-]", "_", "-".join(words))[:100]


def plain_of(value: Any) -> Any:
    """Return what a hash is computed of: a value as plain data, the kind of every object and all its fields with it.

    Fields of dataclasses that do not count in comparisons (`compare=False`) do not count here.

    Raises:
        TypeError: There is something in it of which no plain data can be made.
    """
    if value is None or isinstance(value, str | bool | int | float):
        return value
    if isinstance(value, np.generic):
        return plain_of(value.item())
    if isinstance(value, np.ndarray) and not value.dtype.hasobject:
        return [value.dtype.str, value.shape, hashlib.sha256(value.tobytes()).hexdigest()]
    if isinstance(value, tuple | list):
        return [plain_of(x) for x in value]
    if isinstance(value, Mapping):
        return [[plain_of(name), plain_of(value[name])] for name in sorted(value)]
    if isinstance(value, Path):
        return str(value)
    if is_dataclass(value):
        table = {field.name: getattr(value, field.name) for field in fields(value) if field.compare}
    elif hasattr(value, "__dict__") and not callable(value):
        table = vars(value)
    else:
        raise TypeError(f"a unit holds {value!r}, of which no key can be made")
    return [type(value).__name__, {name: plain_of(x) for name, x in table.items()}]
