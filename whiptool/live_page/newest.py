"""A thread that carries out the newest of each kind of request, and longer work while nothing newer waits."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator

Action = Callable[[], None]


class Newest:
    """Carries out requests in one thread. Of several waiting requests of one kind only the newest is carried out, so
    that what is dragged never lags behind.

    Args:
        after: Function that is called after requests were carried out, with the kinds of those that did not fail; it
            returns longer work as an iterator, whose steps are made while no request waits, or None.
        failed: Function that is called with an exception of a request or of longer work; the thread goes on.
        name: Name of the thread.
    """

    def __init__(
        self,
        after: Callable[[set[str]], Iterator[None] | None],
        failed: Callable[[Exception], None],
        *,
        name: str = "studio",
    ) -> None:
        self._after, self._failed = after, failed
        self._waiting: dict[str, Action] = {}
        self._longer: Iterator[None] | None = None
        self._closed = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def ask(self, kind: str, action: Action) -> None:
        """Have a request carried out, in place of a waiting one of its kind."""
        with self._changed:
            self._waiting.pop(kind, None)
            self._waiting[kind] = action
            self._changed.notify()

    @property
    def waiting(self) -> set[str]:
        """Kinds of the requests that wait."""
        with self._changed:
            return set(self._waiting)

    def close(self) -> None:
        """End the thread after what it is doing; requests that wait are dropped."""
        with self._changed:
            self._closed = True
            self._changed.notify()

    def join(self, timeout: float | None = None) -> None:
        """Wait until the thread has ended, at most `timeout` seconds."""
        self._thread.join(timeout)

    def _run(self) -> None:
        while (requests := self._next()) is not None:
            if requests:
                self._carry_out(requests)
            else:
                self._go_on()

    def _next(self) -> dict[str, Action] | None:
        """Return the requests that wait; empty: longer work is to go on; None: the thread is to end."""
        with self._changed:
            while not (self._closed or self._waiting or self._longer is not None):
                self._changed.wait()
            if self._closed:
                return None
            requests, self._waiting = self._waiting, {}
            return requests

    def _carry_out(self, requests: dict[str, Action]) -> None:
        done = set[str]()
        for kind, action in requests.items():
            try:
                action()
                done.add(kind)
            except Exception as error:
                self._failed(error)
        try:
            self._longer = self._after(done)
        except Exception as error:
            self._longer = None
            self._failed(error)

    def _go_on(self) -> None:
        assert self._longer is not None
        try:
            if next(self._longer, self) is self:
                self._longer = None
        except Exception as error:
            self._longer = None
            self._failed(error)
