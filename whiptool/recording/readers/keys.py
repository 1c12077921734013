"""Checked access to keys and values of a table, such as a sidecar file; and which of them were asked for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from glob import escape
from pathlib import Path
from typing import Any, Self

import numpy as np

from whiptool.errors import InputError
from whiptool.given_files import read_toml
from whiptool.models.numbers import float_array

# keys of sidecars that no file of a model, a prior, a camera or a tracker has
_OF_SIDECARS = {
    "units", "axes", "up", "fps", "timestamps", "markers", "start", "strike", "target", "joints", "joint_columns",
    "joint_units", "joint_ranges", "joints_start", "joints_topic", "hand", "hand_start", "hand_topic", "hand_frames",
    "hand_axes", "hand_offset", "hand_up",
}  # fmt: skip


def refuse_unheard(path: Path, what: str, fix: str) -> None:
    """Refuse a sidecar `NAME.toml` next to a file of which nothing is read; the message says `what` the file is, and in
    `fix` where its values have to be stated.

    One of another file `NAME` is left alone, and so is a TOML file that has no key of a sidecar, such as a model's.
    """
    side = path.with_suffix(".toml")
    if not side.is_file() or [x for x in path.parent.glob(f"{escape(path.stem)}.*") if x not in (path, side)]:
        return
    if _OF_SIDECARS & read_toml(side).keys():
        raise InputError(str(side), "a sidecar", f"none, for nothing of it is read with {what}", fix)


class _Asked(Mapping[str, Any]):
    """A table that notes whose values were asked for; whether a key is there is not such a question."""

    def __init__(self, table: Mapping[str, Any], asked: set[str]) -> None:
        self._table, self._asked = table, asked

    def __getitem__(self, key: str) -> Any:
        value = self._table[key]
        self._asked.add(key)
        return value

    def __contains__(self, key: object) -> bool:
        return key in self._table

    def __iter__(self) -> Iterator[str]:
        return iter(self._table)

    def __len__(self) -> int:
        return len(self._table)


@dataclass(frozen=True)
class Keys:
    """Checked access to the keys of a table."""

    values: Mapping[str, Any]  # values by key
    folder: Path  # folder to which file names in it are relative
    place: str  # prefix of names in error messages
    asked: set[str] = field(default_factory=set)  # keys whose values were asked for, also from changed copies

    @property
    def table(self) -> Mapping[str, Any]:
        """The values by key; a value that is asked for counts as used."""
        return _Asked(self.values, self.asked)

    def changed(self, **values: Any) -> Self:
        """Return a copy with other values; None: without the key."""
        table = {**self.values, **values}
        return replace(self, values={key: value for key, value in table.items() if value is not None})

    def check_used(self, but: tuple[str, ...] = ()) -> None:
        """Refuse keys whose values were never asked for, except those that are for something else in the file."""
        for key in self.values:
            if key not in self.asked and key not in but:
                raise self.refuse(key, "none, for it has no effect on this file", "leave it out")

    def refuse(self, key: str, allowed: str, fix: str = "") -> InputError:
        """Return the error for a key's value; `allowed` says which values are allowed, `fix` how to correct it."""
        return InputError(self.place + key, self.table.get(key), allowed, fix)

    def number(self, key: str, default: float, *, low: float = -np.inf, high: float = np.inf) -> float:
        """Return a key's value as a number from `low` to `high`; `default` if the key is missing."""
        value = self.table.get(key, default)
        if isinstance(value, bool) or not isinstance(value, (int, float, np.number)) or not low <= value <= high:
            raise self.refuse(key, f"a number from {low:g} to {high:g}")
        return float(value)

    def word(self, key: str, words: Mapping[str, Any] | tuple[str, ...], default: str) -> str:
        """Return a key's value, which has to be one of several words; `default` if the key is missing."""
        value = self.table.get(key, default)
        if not isinstance(value, str) or value not in words:
            raise self.refuse(key, "one of " + ", ".join(words))
        return value

    def flag(self, key: str) -> bool:
        """Return a key's value, true or false; false if the key is missing."""
        value = self.table.get(key, False)
        if not isinstance(value, bool):
            raise self.refuse(key, "true or false")
        return value

    def array(self, key: str, *shape: int | None) -> np.ndarray | None:
        """Return a key's value as an array of a shape, in which None means any length; None if the key is missing."""
        if key not in self.table:
            return None
        try:
            array = float_array(key, self.table[key])
        except InputError:
            array = np.array(np.nan)
        fits = array.ndim == len(shape) and all(n in (None, m) for n, m in zip(shape, array.shape))
        if not fits or not np.isfinite(array).all():
            raise self.refuse(key, "finite numbers, " + " x ".join("n" if n is None else str(n) for n in shape))
        return array

    def names(self, key: str) -> dict[str, str] | None:
        """Return a key's table of names, `name in whiptool = "name in the file"`, as a dict; None if the key is
        missing.

        The key may also be a list of names that are the same in whiptool and in the file.
        """
        value = self.table.get(key)
        if value is None:
            return None
        if isinstance(value, (list, tuple)):
            value = {name: name for name in value if isinstance(name, str)} if len(value) else None
        if not isinstance(value, Mapping) or not value or not all(isinstance(x, str) for x in value.values()):
            raise self.refuse(key, 'names, as in {tip = "WhipTip", handle = "Hand"}')
        return dict(value)

    def file(self, key: str) -> Path | None:
        """Return the path of a file in the sidecar's folder, or of any file if an option gives a path; None if the key
        is missing.
        """
        name = self.table.get(key)
        if name is None or isinstance(name, Path):
            return name
        if name is False:  # none, although the sidecar names one
            return None
        if not isinstance(name, str) or Path(name).name != name or name in ("", ".", ".."):
            raise self.refuse(key, "the name of a file next to it, without folders")
        return self.folder / name
