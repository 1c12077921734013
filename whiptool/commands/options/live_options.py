"""The option to watch long work while it goes on."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
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
        from whiptool.live_page.gate import LOOPBACK
        from whiptool.rig.child_process import end_child, start_child

        port = _free_port()
        note(f"whiptool: watch the run at http://{LOOPBACK}:{port}/ as soon as its page answers, in some seconds")
        process, connection = start_child("whiptool.following", str(folder), str(port))
        try:
            yield
        finally:
            connection.close()  # at which it ends, as it does if this process is killed
            end_child(process)
            note(f"whiptool: the page of the run is closed; python -m whiptool.studio {folder} opens it again")


def _free_port() -> int:
    """Return the port that the page will be served on: the first free one from the usual one on."""
    from whiptool.live_page.gate import LOOPBACK, PORT

    for port in range(PORT, PORT + 100):
        with suppress(OSError), socket.create_server((LOOPBACK, port)):
            return port
    return PORT  # the page takes another one, and says which
