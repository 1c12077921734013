"""What NumPy makes of our objects: their numbers, or an error that says which to take.

Of an object that does not say, `np.asarray` makes an array of no dimension that holds the object itself; it broadcasts,
and an assignment, a sum or a comparison with it fails late or not at all.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from functools import wraps
from numbers import Real
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import DTypeLike

from whiptool.errors import refuse_call


class ArrayLike(ABC):
    """Base of classes that NumPy can convert to an array."""

    @abstractmethod
    def _as_array(self) -> np.ndarray:
        """Return a new array of its numbers."""

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> np.ndarray:
        if copy is False:
            raise ValueError(f"{type(self).__name__} has no array to share: its numbers are copied")
        array = self._as_array()
        return array if dtype is None else array.astype(dtype)


class Vector(ArrayLike):
    """Base of classes that can be converted to a vector, have a length and can be iterated over."""

    @property
    @abstractmethod
    def vector(self) -> np.ndarray:
        """The object as a new array of one dimension."""

    def _as_array(self) -> np.ndarray:
        return self.vector

    def __len__(self) -> int:
        return len(self.vector)

    def __iter__(self) -> Iterator[float]:
        return iter(self.vector.tolist())


C = TypeVar("C", bound=type)


def _row(given: Any) -> tuple[Any, ...]:
    """Return what a list, tuple or array of one dimension holds; nothing of anything else."""
    is_row = isinstance(given, (list, tuple)) or (isinstance(given, np.ndarray) and given.ndim == 1)
    return tuple(given) if is_row else ()


def made_of_numbers(arguments: Callable[[tuple[float, ...]], tuple[Any, ...]]) -> Callable[[C], C]:
    """Class decorator: the class can also be constructed from the numbers of its vector, such as `Target(1.25, 0.2)`.

    Args:
        arguments: Converts these numbers to the arguments of the class.
    """

    def decorate(cls: C) -> C:
        of_arguments: Callable[..., None] = cls.__init__

        @wraps(of_arguments)
        def __init__(self: object, *given: Any, **named: Any) -> None:
            row = given if len(given) != 1 or named or np.isscalar(given[0]) else _row(given[0])
            alone = bool(row) and all(isinstance(x, Real) for x in row)
            own = arguments(row) if alone else given
            try:
                of_arguments(self, *own, **named)
            except TypeError:
                refuse_call(cls.__name__, of_arguments, self, *own, **named)
                raise

        cls.__init__ = __init__
        return cls

    return decorate


class NoArray:
    """Base of classes that cannot be converted to an array: NumPy gets an error that names an alternative."""

    _instead: ClassVar[str]

    def __init_subclass__(cls, instead: str = "", **options: object) -> None:
        super().__init_subclass__(**options)
        if instead:
            cls._instead = instead

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> np.ndarray:
        raise TypeError(f"{type(self).__name__} is no array of numbers: take {self._instead}")
