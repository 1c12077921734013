"""Servers of pages: a page for each browser that connects, until it is closed."""

from __future__ import annotations

import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Protocol

from whiptool.errors import InputError
from whiptool.extras import optional
from whiptool.live_page.gate import LOOPBACK, PORT, AccessGate, guarded
from whiptool.live_page.page import Choices, Page
from whiptool.live_page.panel import THEME
from whiptool.live_page.widgets import check_widgets

if TYPE_CHECKING:
    from viser import ClientHandle

_ANYWHERE = ("0.0.0.0", "::")  # hosts that stand for all addresses of this machine
_SILENT = threading.RLock()


class OpenPage(Protocol):
    """A page in a browser."""

    def close(self) -> None:
        """End the page's threads; the user has gone."""


class PageServer:
    """A running server, whose pages one function opens. From its start on, viser's warnings about connections that have
    just closed are not shown in this process.

    Args:
        opened: Function that opens the page of a browser that has connected.
        host: Address to serve on; other machines can only connect if it is not a loopback address, and then with the
            token in `address`.
        port: Port; the next free one is taken if it is in use.

    Raises:
        InputError: The host cannot be served on.
        MissingPackage: viser is not installed.
    """

    def __init__(self, opened: Callable[[ClientHandle], OpenPage], *, host: str = LOOPBACK, port: int = PORT) -> None:
        viser = optional("viser", "whiptool studio")
        _check_host(host)
        self._open, self._host = opened, host
        self._pages: dict[int, OpenPage] = {}
        self.gate = AccessGate.of(host)
        with guarded(self.gate), _silent():  # of its banner, which has no token
            self._server = viser.ViserServer(host=host, port=port, label="whiptool studio", verbose=False)
        # of frames for a browser that has just gone away
        warnings.filterwarnings("ignore", message="Queued a .* on a closed connection", category=UserWarning)
        self._server.request_share_url = lambda *_, **__: None  # nothing is made public by way of another's server
        self._server.gui.configure_theme(**THEME)
        self._server.on_client_connect(self._connected)
        self._server.on_client_disconnect(self._disconnected)

    @property
    def port(self) -> int:
        """Port that is served on."""
        return self._server.get_port()

    @property
    def everywhere(self) -> bool:
        """Whether all addresses of this machine are served on, so that `address` names it as `localhost`."""
        return self._host in _ANYWHERE

    @property
    def address(self) -> str:
        """Address to open in a browser, with the token if there is one."""
        host = "localhost" if self.everywhere else self._host
        named = f"[{host}]" if ":" in host else host
        return f"http://{named}:{self.port}/" + ("" if self.gate.token is None else f"?token={self.gate.token}")

    @property
    def pages(self) -> list[OpenPage]:
        """The pages that are open."""
        return list(self._pages.values())

    def close(self) -> None:
        """Close all pages and the server."""
        for page in self.pages:
            page.close()
        with _silent():
            self._server.stop()

    def _connected(self, client: ClientHandle) -> None:
        check_widgets(client.gui)
        self._pages[client.client_id] = self._open(client)

    def _disconnected(self, client: ClientHandle) -> None:
        page = self._pages.pop(client.client_id, None)
        if page is not None:
            page.close()


class Studio(PageServer):
    """A running studio.

    Args:
        choices: What users can choose.
        host, port: As for `PageServer`, with its errors.
    """

    def __init__(self, choices: Choices, *, host: str = LOOPBACK, port: int = PORT) -> None:
        super().__init__(lambda client: Page(client, choices), host=host, port=port)


@contextmanager
def _silent() -> Iterator[None]:
    """Keep viser from printing, and no other code of the process."""
    import rich

    def print_of_others(*texts: Any, **options: Any) -> None:
        if not sys._getframe(1).f_globals.get("__name__", "").startswith("viser."):
            plain(*texts, **options)

    with _SILENT:
        plain, rich.print = rich.print, print_of_others
        try:
            yield
        finally:
            rich.print = plain


def _check_host(host: str) -> None:
    """Refuse a host on which this machine cannot serve: the library would try one port after the other."""
    import socket

    try:
        family, kind, protocol, _, where = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind, protocol) as probe:
            probe.bind(where)
    except OSError as error:
        rule = "an address of this machine, such as 127.0.0.1, or 0.0.0.0 for all of them"
        raise InputError("host", host, rule, f"reason: {error.strerror}") from None
