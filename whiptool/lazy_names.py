"""Names that are imported when first used, and registration of the Gymnasium environment, at no cost of import.

Gymnasium 1.0 and later do not read entry points of packages: an id exists once the package that registers it has been
imported.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType


class _Package(ModuleType):
    """A package with public names that modules in it have, too: `whiptool.train` is a function, and a door of `-m`."""

    _functions: frozenset[str] = frozenset()

    def __setattr__(self, name: str, value: object) -> None:
        if not (name in self._functions and isinstance(value, ModuleType)):  # an import of the door keeps it here
            super().__setattr__(name, value)


def doors_aside(package: str, names: Mapping[str, str]) -> None:
    """Keep the given names of a package bound to its functions when modules of the same names are imported."""
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


ID = "whiptool/WhipTarget-v0"
_HOME = "whiptool.rl.environment"


def register_with_gymnasium() -> None:
    """Register the environment with Gymnasium now, or as soon as Gymnasium is imported."""
    if "gymnasium" in sys.modules:
        _register()
    else:
        sys.meta_path.insert(0, _WhenImported())


def _register() -> None:
    import gymnasium

    gymnasium.register(ID, entry_point=f"{_HOME}:WhipEnv", vector_entry_point=f"{_HOME}:WhipEnvs")


class _WhenImported(MetaPathFinder):
    """Finds Gymnasium as the other finders do, and registers the environment when it has been imported."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return Gymnasium's specification; None for any other module, or if it is not installed."""
        if fullname != "gymnasium":
            return None
        others = [finder for finder in sys.meta_path if finder is not self]
        found = (finder.find_spec(fullname, path, target) for finder in others)
        spec = next((spec for spec in found if spec is not None), None)
        if spec is not None and spec.loader is not None:
            execute = spec.loader.exec_module

            def then_register(module: ModuleType) -> None:
                execute(module)
                _register()

            spec.loader.exec_module = then_register
        return spec
