"""The option to watch long work while it goes on."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from whiptool.commands.options.option_group import OptionGroup
from whiptool.progress import note


@dataclass(frozen=True, kw_only=True)
class LiveOptions(OptionGroup):
    """Option of commands that work long."""

    of_this_call: ClassVar[tuple[str, ...]] = ("live",)
    heading: ClassVar[str] = "result"
    first: ClassVar[tuple[str, ...]] = ("live",)

    live: bool = False
    """Show the run on a page while it goes on. The page has the best strike so far, and charts of how the run
    converges; its address is printed, and it ends with the command. Another process makes it from the run folder.
    `python -m whiptool.studio RUN` shows any run, also from another terminal."""

    def needs(self) -> tuple[str, ...]:
        return (*super().needs(), *(("viser",) if self.live else ()))

    @contextmanager
    def shown(self, folder: Path) -> Iterator[None]:
        """Show a run folder within the `with` block, if that was asked for."""
        if not self.live:
            yield
            return
        from whiptool.rig.child_process import end_child, start_child

        process, connection = start_child("whiptool.following", str(folder))
        try:
            yield
        finally:
            connection.close()  # at which it ends, as it does if this process is killed
            end_child(process)
            note(f"whiptool: the page of the run is closed; python -m whiptool.studio {folder} opens it again")
