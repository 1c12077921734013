"""Who may open the studio: pages of this machine, or whoever has the token."""

from __future__ import annotations

import urllib.error
import urllib.request

import pytest

from whiptool.errors import InputError
from whiptool.live_page.gate import COOKIE, AccessGate, guarded, is_loopback
from whiptool.models import preset

OURS = {"Host": "127.0.0.1:8080"}


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "::1", "[::1]", "127.3.2.1"])
def test_this_machine_alone_needs_no_token(host):
    assert is_loopback(host)
    assert AccessGate.of(host).token is None


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.168.1.5", "example.org", "localhost.example.org"])
def test_all_else_needs_one(host):
    assert not is_loopback(host)
    token = AccessGate.of(host).token
    assert token is not None
    assert len(token) >= 32
    assert token != AccessGate.of(host).token


def test_a_gate_shows_no_token():
    assert "secret" not in repr(AccessGate("secret"))


@pytest.mark.parametrize(
    ("headers", "served"),
    [
        ({}, True),
        ({"Origin": "http://127.0.0.1:8080"}, True),
        ({"Origin": "http://evil.example"}, False),  # a page of another site that connects from the user's browser
        ({"Origin": "http://127.0.0.1:9999"}, False),
        ({"Origin": "null"}, False),
        ({"Host": "evil.example:8080"}, False),  # a foreign name that is made to point here
        ({"Host": ""}, False),
    ],
)
def test_only_pages_of_this_machine_are_served(headers, served):
    assert (AccessGate(None).refusal("/", OURS | headers) is None) == served


@pytest.mark.parametrize(
    ("path", "cookie", "served"),
    [
        ("/", "", False),
        ("/?token=wrong", "", False),
        ("/?token=", "", False),
        ("/?token=secret", "", True),
        ("/", f"{COOKIE}=secret", True),
        ("/", f"{COOKIE}=wrong", False),
        ("/", "secret", False),
        ("/?token=wrong", f"{COOKIE}=secret", True),
        ("/?token=%C3%A9", "", False),
    ],
)
def test_the_token_is_asked_for(path, cookie, served):
    headers = {"Host": "192.168.1.5:8080", "Cookie": cookie}
    assert (AccessGate("secret").refusal(path, headers) is None) == served


def test_a_token_does_not_let_other_sites_in():
    headers = {"Host": "192.168.1.5:8080", "Origin": "http://evil.example", "Cookie": f"{COOKIE}=secret"}
    assert AccessGate("secret").refusal("/", headers) is not None


def test_a_server_that_is_started_otherwise_is_refused():
    with pytest.raises(Exception, match="access is not checked"), guarded(AccessGate("secret")):
        pass


def opened(address: str, **headers: str) -> tuple[int, bytes, str]:
    try:
        with urllib.request.urlopen(urllib.request.Request(address, headers=headers), timeout=30) as answer:
            return answer.status, answer.read(), answer.headers.get("Set-Cookie", "")
    except urllib.error.HTTPError as error:
        return error.code, error.read(), ""


@pytest.fixture(scope="module")
def studios():
    pytest.importorskip("viser")
    from whiptool.live_page.page import Choices
    from whiptool.live_page.server import Studio

    choices = Choices(lambda name: (preset(name), None), ("lemon2024",))
    every = [Studio(choices, host=host, port=0) for host in ("0.0.0.0", "127.0.0.1")]
    yield every
    for studio in every:
        studio.close()


def test_a_served_page_needs_the_token_and_keeps_it_as_a_cookie(studios):
    studio = studios[0]
    bare = studio.address.partition("?")[0]
    assert "?token=" in studio.address
    assert opened(bare)[0] == 403
    assert opened(bare + "?token=no")[0] == 403
    status, page, cookie = opened(studio.address)
    assert (status, b"<html" in page) == (200, True)
    assert "HttpOnly" in cookie
    assert opened(bare, Cookie=cookie.partition(";")[0])[0] == 200


def test_the_connection_of_a_page_is_guarded_like_the_page(studios):
    from websockets.exceptions import InvalidStatus
    from websockets.sync.client import connect
    from websockets.typing import Origin

    guarded_by_token, open_here = studios
    address = guarded_by_token.address.partition("?")[0].replace("http", "ws")
    with pytest.raises(InvalidStatus, match="403"), connect(address):
        pass
    address = open_here.address.replace("http", "ws")
    with pytest.raises(InvalidStatus, match="403"), connect(address, origin=Origin("http://evil.example")):
        pass
    with connect(address):
        pass


def test_a_host_that_is_not_of_this_machine_is_refused():
    pytest.importorskip("viser")
    from whiptool.live_page.page import Choices
    from whiptool.live_page.server import Studio

    choices = Choices(lambda name: (preset(name), None), ("lemon2024",))
    for host in ("203.0.113.7", "no.such.host.invalid"):
        with pytest.raises(InputError, match="host"):
            Studio(choices, host=host, port=0)
