"""The commands of the folder `papers` of the repository, which an installed wheel does not have."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from types import ModuleType

from whiptool.commands import cli
from whiptool.errors import InputError

CHECKOUT = Path(__file__).resolve().parents[2]  # where the repository is, unless whiptool was installed from a wheel


class _NoFolder:
    """What was given where there is no folder `papers`."""

    def __repr__(self) -> str:
        return "an installation of whiptool without its repository's folder papers"


def of_papers(module: str) -> ModuleType:
    """Import and return a module of the folder `papers`, which is next to the package whiptool in a checkout, or
    importable.

    Raises:
        InputError: The folder does not exist.
    """
    if (CHECKOUT / "papers" / "__init__.py").is_file() and str(CHECKOUT) not in sys.path:
        sys.path.insert(0, str(CHECKOUT))  # which processes of workers are given, too
    try:
        return import_module(f"papers.{module}")
    except ModuleNotFoundError as error:
        if error.name not in ("papers", f"papers.{module.partition('.')[0]}"):
            raise
        fix = "in a clone of the repository of whiptool: pip install --editable ."
        raise InputError("papers", _NoFolder(), "an editable installation", fix) from None


def human(args: Sequence[str] | None = None) -> int:
    """Compare people's whip throws with planned strikes; return the exit status of `cli.run`."""
    return cli.run(lambda: of_papers("human.command").run(args))


def reproduce(args: Sequence[str] | None = None) -> int:
    """Reproduce the figures and tables of papers as one report; return the exit status of `cli.run`."""
    return cli.run(lambda: of_papers("reproduce").run(args))
