"""Registration of the Gymnasium environment as soon as both packages are imported, in either order.

Gymnasium 1.0 and later do not read entry points of packages: an id exists once the package that registers it has been
imported. Gymnasium is not imported here.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType

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
