"""Checks of numbers in arguments, and conversion of whiptool's objects by NumPy.

Without `__array__`, `np.asarray(thing)` is an array of no dimension that contains the thing; such an array broadcasts,
and an assignment, a sum or a comparison with it fails late or not at all.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import suppress
from functools import wraps
from numbers import Real
from typing import Any, ClassVar, TypeGuard, TypeVar

import numpy as np
from numpy.typing import DTypeLike

from whiptool.errors import InputError, refuse_call

# of any quantity in SI units: what is beyond is a slip, and overflows or vanishes where it is squared
LARGEST, SMALLEST = 1e15, 1e-12
MOST = 2**63 - 1  # of anything that is counted
LONGEST, THICKEST = 100.0, 0.2  # [m] of whips and arms: what is beyond was given in millimetres
LARGEST_GAP = 1.0  # [m] that may be asked for between arm, whip and floor
ASK_UNIT = "lengths are in metres; are these millimetres?"


def number(name: str, value: object, *, low: float = -math.inf, high: float = LARGEST, strict: bool = False) -> float:
    """Return `value` as a finite float from `low` to `high`, or refuse it.

    With `strict` it has to be above `low`, and if `low` is 0 at least `SMALLEST`.
    """
    rule = "a finite number" if low == -math.inf else f"a finite number {'>' if strict else '>='} {low:g}"
    rule += "" if high == LARGEST else f" and <= {high:g}"
    if isinstance(value, (bool, np.timedelta64)) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise InputError(name, value, rule)
    try:
        x = float(value)
    except OverflowError:  # an integer of hundreds of digits
        raise InputError(name, value, f"a number of magnitude <= {min(high, LARGEST):g}") from None
    if not math.isfinite(x) or x < low or (strict and x == low):
        raise InputError(name, value, rule)
    if strict and low == 0 and x < SMALLEST:
        raise InputError(name, value, f"a number >= {SMALLEST:g}")
    if abs(x) > high:
        raise InputError(name, value, rule if high != LARGEST else f"a number of magnitude <= {LARGEST:g}")
    return x


def metres(name: str, value: object, *, longest: float = LONGEST, low: float = 0.0, strict: bool = True) -> float:
    """Return `value` as a length [m] from `low` (above it if `strict`) to `longest`; a longer one is probably in mm and
    refused.
    """
    x = number(name, value, low=low, strict=strict)
    if x > longest:
        raise InputError(name, value, f"a length of at most {longest:g} m", ASK_UNIT)
    return x


def whole(name: str, value: object, *, low: int = 1, high: int | None = None) -> int:
    """Return `value` as an int from `low` to `high`, or refuse it; no machine counts beyond `MOST`."""
    if isinstance(value, (int, np.integer)) and not isinstance(value, (bool, np.timedelta64)):
        x = int(value)
        if low <= x <= (MOST if high is None else high):
            return x
        high = MOST if x > MOST else high
    span = f">= {low}" if high is None else f"from {low} to {high}"
    raise InputError(name, value, f"a whole number {span}")


def numbers(name: str, value: object, count: int | None = None) -> tuple[float, ...]:
    """Return `value` as `count` finite floats, or as one or more if `count` is None, or refuse it."""
    rule = "finite numbers" if count is None else f"{count} finite numbers"
    row = value if isinstance(value, (list, tuple)) else array_of(name, value, rule).tolist()
    nested = not isinstance(row, (list, tuple)) or any(isinstance(x, (list, tuple, np.ndarray)) for x in row)
    if nested or not row or len(row) != (count or len(row)):
        raise InputError(name, value, rule)
    return tuple(number(f"{name}[{i}]", x) for i, x in enumerate(row))


def array_of(name: str, value: object, rule: str) -> np.ndarray:
    """Return `value` as an array of finite floats, or refuse it.

    Text, booleans, complex numbers and rows of unequal lengths are refused; `rule` says what is allowed.
    """
    try:
        array = np.asarray(value)
    except Exception:  # a class may raise anything, such as a tensor of PyTorch that has gradients
        raise InputError(name, value, rule) from None
    if array.dtype.kind not in "iuf" or not np.isfinite(array := array.astype(float, copy=False)).all():
        raise InputError(name, value, rule)
    if (np.abs(array) > LARGEST).any():
        raise InputError(name, value, f"numbers of magnitude <= {LARGEST:g}")
    return array


def float_array(name: str, value: object) -> np.ndarray:
    """Return numbers as a new float array, with NaN if missing; refuse what `array_of` refuses, except for NaN."""
    try:
        array = np.array(value)  # a copy: what the caller does to its own array later must not show here
        if array.dtype.kind == "O" and all(
            x is None or (isinstance(x, Real) and not isinstance(x, bool)) for x in array.flat
        ):
            array = array.astype(float)
    except Exception:  # a class may raise anything, such as a tensor of PyTorch that has gradients
        raise InputError(name, value, "numbers") from None
    if array.dtype.kind not in "iuf":
        raise InputError(name, value, "numbers, which are neither text, nor true or false, nor complex")
    if np.isinf(array).any():
        raise InputError(name, "infinite values", "finite numbers, or NaN where missing")
    return array.astype(float, copy=False)


def ends_and_duration(vector: object, rule: str) -> tuple[tuple[float, ...], tuple[float, ...], float]:
    """Split a strike vector into start, end and duration; `rule` describes the vector in error messages."""
    values = array_of("strike vector", vector, "a vector of finite numbers").tolist()
    if np.ndim(values) != 1 or len(values) < 3 or len(values) % 2 == 0:
        raise InputError("strike", values, rule)
    n = len(values) // 2
    return tuple(values[:n]), tuple(values[n : 2 * n]), values[-1]


def is_row(value: object) -> TypeGuard[list[Any] | tuple[Any, ...] | np.ndarray]:
    """Whether a value is a list, a tuple, or an array that has rows."""
    return isinstance(value, (list, tuple)) or (isinstance(value, np.ndarray) and value.ndim > 0)


def tuple_of(name: str, value: object, rule: str) -> tuple[Any, ...]:
    """Return what can be iterated over, except for a text, as a tuple, or refuse it; `rule` says what is allowed."""
    if isinstance(value, Iterable) and not isinstance(value, str):
        with suppress(Exception):  # a class may raise anything, such as an array of no dimension
            return tuple(value)
    raise InputError(name, value, rule)


def one_of(name: str, value: object, known: Collection[str]) -> str:
    """Return `value`, which has to be one of the texts `known`, or refuse it."""
    if not isinstance(value, str) or value not in known:
        raise InputError(name, value, ", ".join(known))
    return value


def texts(name: str, value: object, *, least: int = 0) -> tuple[str, ...]:
    """Return `value` as a tuple of at least so many strings, or refuse it."""
    rule = "a list of texts" + (f", at least {least}" if least else "")
    found = tuple_of(name, value, rule)
    if len(found) < least or not all(isinstance(x, str) for x in found):
        raise InputError(name, value, rule)
    return found


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
    """Class decorator: the class can also be constructed from the numbers of its vector, such as `Target(1.25, 0.2)`;
    `arguments` returns the class's arguments for these numbers.
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
