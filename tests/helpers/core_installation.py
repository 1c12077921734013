"""Imports every module of whiptool, and starts commands, as if some packages were not installed: run by itself.

Args: names of top-level modules, and the words of commands, both as JSON lists. Prints, as JSON, which modules of
whiptool could not be imported, and the commands' exit statuses, or "started" where they made their run folders.
"""

from __future__ import annotations

import importlib
import json
import pkgutil
import sys
from typing import Any


class Without:
    """A finder of modules that does not see some of them.

    Args:
        finder: Which sees them.
        missing: Names of top-level modules.
    """

    def __init__(self, finder: Any, missing: set[str]) -> None:
        self.finder, self.missing = finder, missing

    def __getattr__(self, name: str) -> Any:
        return getattr(self.finder, name)

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> Any:
        """Find a module."""
        return None if name.partition(".")[0] in self.missing else self.finder.find_spec(name, path, target)


def hide(missing: set[str]) -> None:
    """Keep top-level modules from being imported, as if they were not installed."""
    sys.meta_path[:] = [Without(finder, missing) for finder in sys.meta_path]


class Started(BaseException):
    """A command came to making its run folder."""


def not_importable() -> list[str]:
    """Import every module of whiptool, and return which could not be imported."""
    import whiptool

    failed = []
    for module in pkgutil.walk_packages(whiptool.__path__, "whiptool."):
        if module.name.endswith("__main__"):
            continue
        try:
            importlib.import_module(module.name)
        except ImportError:
            failed.append(module.name)
    return failed


def begun(words: list[str]) -> int | str:
    """Start a command, and return its exit status, or that it started."""
    from whiptool.commands.cli import main_of

    try:
        return main_of(words[0])(words[1:])
    except Started:
        return "started"


def start(*_: Any, **__: Any) -> None:
    """Stand in for making a run folder."""
    raise Started


if __name__ == "__main__":
    hide(set(json.loads(sys.argv[1])))
    failed = not_importable()
    from whiptool.runs import RunFolder

    RunFolder.create = RunFolder.open = start
    print(json.dumps([failed, [begun(words) for words in json.loads(sys.argv[2])]]))
