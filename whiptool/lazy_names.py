"""Public names of a package that are imported when first used, so that importing the package costs nothing."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from types import ModuleType


class _Package(ModuleType):
    """A package with public names that modules in it have, too: `whiptool.train` is a function, and a door of `-m`."""

    _functions: frozenset[str] = frozenset()

    def __setattr__(self, name: str, value: object) -> None:
        if not (name in self._functions and isinstance(value, ModuleType)):  # an import of the door keeps it here
            super().__setattr__(name, value)


def doors_aside(package: str, names: Mapping[str, str]) -> None:
    """Make the names of a package refer to its functions even after modules with the same names have been imported."""
    module = sys.modules[package]
    module.__class__ = _Package
    module._functions = frozenset(names)  # pyrefly: ignore[missing-attribute]


def imported_when_used(
    package: str, homes: Mapping[str, str]
) -> tuple[Callable[[str], object], Callable[[], list[str]]]:
    """Return the `__getattr__` and the `__dir__` of a package whose names are imported when first used.

    A name is looked up in its module at every use. It is not stored in the package, because importing a module of the
    same name would overwrite it.

    Args:
        package: `__name__` of the package.
        homes: For each name, the module of the package from which it is imported.
    """

    def find(name: str) -> object:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(f"{package}.{homes[name]}"), name)

    def names() -> list[str]:
        return list(homes)

    return find, names
