"""What NumPy makes of our objects: their numbers, or an error that says which to take.

Of an object that does not say, `np.asarray` makes an array of no dimension that holds the object itself; it broadcasts,
and an assignment, a sum or a comparison with it fails late or not at all.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import ClassVar

import numpy as np
from numpy.typing import DTypeLike


class ArrayLike(ABC):
    """What can stand for an array of its numbers."""

    @abstractmethod
    def _as_array(self) -> np.ndarray:
        """Return a new array of its numbers."""

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> np.ndarray:
        if copy is False:
            raise ValueError(f"{type(self).__name__} has no array to share: its numbers are copied")
        array = self._as_array()
        return array if dtype is None else array.astype(dtype)


class Vector(ArrayLike):
    """What can stand for a vector of its numbers, and be counted and gone through."""

    @property
    @abstractmethod
    def vector(self) -> np.ndarray:
        """Its numbers, a new array of one dimension."""

    def _as_array(self) -> np.ndarray:
        return self.vector

    def __len__(self) -> int:
        return len(self.vector)

    def __iter__(self) -> Iterator[float]:
        return iter(self.vector.tolist())


class NoArray:
    """What is too much for one array: NumPy is told so when it is to make one of it."""

    _instead: ClassVar[str]

    def __init_subclass__(cls, instead: str = "", **options: object) -> None:
        super().__init_subclass__(**options)
        if instead:
            cls._instead = instead

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> np.ndarray:
        raise TypeError(f"{type(self).__name__} is no array of numbers: take {self._instead}")
