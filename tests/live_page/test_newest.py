"""The thread of a page: the newest of each kind of request, and longer work while nothing newer waits."""

from __future__ import annotations

import threading

import pytest
from processes import HANG

from whiptool.live_page.newest import Newest


class Recorder:
    """A thread that is held until it is let go, and what it did."""

    def __init__(self, steps: int = 0) -> None:
        self.done: list[str] = []
        self.kinds: list[set[str]] = []
        self.errors: list[Exception] = []
        self.steps, self.quiet = steps, threading.Event()
        self.gate, self.entered = threading.Event(), threading.Event()
        self.thread = Newest(self.after, self.errors.append)

    def after(self, kinds: set[str]):
        self.kinds.append(kinds)
        return self.longer()

    def longer(self):
        for i in range(self.steps):
            self.done.append(f"step {i}")
            yield
        self.quiet.set()

    def hold(self) -> None:
        self.entered.set()
        assert self.gate.wait(HANG)

    def held(self) -> None:
        self.thread.ask("hold", self.hold)
        assert self.entered.wait(HANG)

    def ask(self, kind: str, what: str) -> None:
        self.thread.ask(kind, lambda: self.done.append(what))

    def finish(self) -> None:
        self.quiet.clear()
        self.gate.set()
        assert self.quiet.wait(HANG)
        self.thread.close()
        self.thread.join(HANG)


@pytest.fixture
def held():
    recorder = Recorder()
    recorder.held()
    return recorder


def test_only_the_newest_of_a_kind_is_carried_out(held):
    for i in range(50):
        held.ask("drag", f"drag {i}")
    held.ask("slider", "slider")
    held.finish()
    assert held.done == ["drag 49", "slider"]
    assert held.kinds[-1] == {"drag", "slider"}


def test_requests_keep_the_order_of_their_newest(held):
    held.ask("a", "a 1")
    held.ask("b", "b 1")
    held.ask("a", "a 2")
    held.finish()
    assert held.done == ["b 1", "a 2"]


def test_an_error_is_told_and_the_rest_goes_on(held):
    def broken() -> None:
        raise ValueError("no")

    held.thread.ask("broken", broken)
    held.ask("after", "after")
    assert held.thread.waiting == {"broken", "after"}
    held.finish()
    assert held.thread.waiting == set()
    assert held.done == ["after"]
    assert held.kinds[-1] == {"after"}
    assert [str(error) for error in held.errors] == ["no"]


def test_a_request_ends_longer_work_that_is_out_of_date():
    recorder = Recorder(steps=3)
    recorder.held()
    seen = []

    def longer():
        for i in range(3):
            seen.append(i)
            if i == 1 and not recorder.done:
                recorder.ask("new", "new")
            yield
        recorder.quiet.set()

    recorder.longer = longer
    recorder.finish()
    assert recorder.done == ["new"]
    assert seen == [0, 1, 0, 1, 2]  # what was begun is left, and all is begun anew


def test_after_closing_nothing_is_carried_out(held):
    held.thread.close()
    held.ask("late", "late")
    held.gate.set()
    held.thread.join(HANG)
    assert held.done == []
