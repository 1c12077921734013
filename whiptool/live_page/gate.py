"""Who may open a page of the studio: this machine's own pages, or whoever has the token."""

from __future__ import annotations

import hmac
import http
import ipaddress
import secrets
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs, urlsplit

from whiptool.errors import WhiptoolError

LOOPBACK = "127.0.0.1"
PORT = 8080
COOKIE = "whiptool_studio"
_STARTING = threading.Lock()


def is_loopback(host: str) -> bool:
    """Return whether a host name or address is that of this machine alone."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


@dataclass(frozen=True)
class AccessGate:
    """Checks requests of a page and of its connection.

    A page of another site cannot connect from a user's browser, as the origin that the browser states has to be the
    host that is asked. Without a token only names of this machine are served, so that a foreign name that is made to
    point here is refused, too.

    Args:
        token: Secret that a request states as `?token=`, and then as a cookie; None: no token is needed.
    """

    token: str | None = field(default=None, repr=False)

    @classmethod
    def of(cls, host: str) -> AccessGate:
        """Return the gate of a server: with a new token unless only this machine can reach it."""
        return cls(None if is_loopback(host) else secrets.token_urlsafe(24))

    def refusal(self, path: str, headers: Any) -> str | None:
        """Return why a request is refused; None: it is served.

        Args:
            path: Path of the request with its query.
            headers: Headers of the request by name, such as `Host`.
        """
        host, origin = headers.get("Host", ""), headers.get("Origin")
        if origin is not None and urlsplit(origin).netloc != host:
            return "a page of another site may not connect"
        if self.token is None:
            name = urlsplit(f"//{host}").hostname or ""
            return None if is_loopback(name) else "only pages of this machine are served"
        given = parse_qs(urlsplit(path).query).get("token", [])
        stated = [*given, _cookie(headers.get("Cookie", ""))]
        known = any(hmac.compare_digest(each.encode(), self.token.encode()) for each in stated)
        return None if known else "open the address with its token, as the studio printed it"

    def cookie(self) -> str | None:
        """Return the value of the header `Set-Cookie`; None: none is needed."""
        return None if self.token is None else f"{COOKIE}={self.token}; HttpOnly; SameSite=Strict; Path=/"


def _cookie(header: str) -> str:
    try:
        found = SimpleCookie(header).get(COOKIE)
    except CookieError:
        return ""
    return "" if found is None else found.value


@contextmanager
def guarded(gate: AccessGate) -> Iterator[None]:
    """Have the server that is started within the block ask a gate before it answers any request.

    Raises:
        WhiptoolError: The server was not started in the way that is guarded.
    """
    from websockets.asyncio import server

    _STARTING.acquire()  # else the second of two that start at once would keep the first one's function
    plain, started = server.serve, False

    def serve(*args: Any, process_request: Callable[..., Any] | None = None, **options: Any) -> Any:
        nonlocal started
        started = True
        return plain(*args, process_request=_asked_first(gate, process_request), **options)

    server.serve = serve  # pyrefly: ignore  # viser passes no other check through
    try:
        yield
    finally:
        server.serve = plain
        _STARTING.release()
    if not started:
        raise WhiptoolError("this version of viser starts its server in another way, so that access is not checked")


def _asked_first(gate: AccessGate, answer: Callable[..., Any] | None) -> Callable[..., Any]:
    """Return a function that answers requests as another does, but asks a gate first."""

    def process_request(connection: Any, request: Any) -> Any:
        refusal = gate.refusal(request.path, request.headers)
        if refusal is not None:
            return connection.respond(http.HTTPStatus.FORBIDDEN, f"Refused: {refusal}.\n")
        answered = None if answer is None else answer(connection, request)
        cookie = gate.cookie()
        if answered is not None and cookie is not None:
            answered.headers["Set-Cookie"] = cookie
        return answered

    return process_request
