"""People's whip throws compared with planned strikes: the command is in the folder `papers`."""

from __future__ import annotations

from collections.abc import Sequence

from whiptool.commands import cli
from whiptool.commands.papers import of_papers


def main(args: Sequence[str] | None = None) -> int:
    """Run the command line; the exit status is 0, 1 for a failure, 2 for bad input, 130 when interrupted."""
    return cli.run(lambda: of_papers("human.command").run(args))
