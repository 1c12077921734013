"""Settings of the whole process that threads change at once are put back, and are in force until the last has ended."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager

import pytest
from processes import HANG
from threadpoolctl import threadpool_info

from whiptool.identification.fit import _FEW_THREADS


def _threads_of_blas() -> list[int]:
    return [x["num_threads"] for x in threadpool_info() if x["user_api"] == "blas"]


def _overlapping(held: Callable[[], AbstractContextManager[None]], read: Callable[[], object]) -> tuple[object, object]:
    """What is in force in the second of two overlapping blocks after the end of the first, and after both."""
    inside, first_ended = threading.Event(), threading.Event()
    seen = []

    def second() -> None:
        with held():
            inside.set()
            assert first_ended.wait(HANG)
            seen.append(read())

    thread = threading.Thread(target=second)
    with held():
        thread.start()
        assert inside.wait(HANG)
    first_ended.set()
    thread.join(HANG)
    return seen[0], read()


def test_two_threads_that_train_leave_the_threads_of_torch_as_they_were():
    torch = pytest.importorskip("torch")
    from whiptool.rl.trained import one_torch_thread

    before = torch.get_num_threads()
    torch.set_num_threads(3)
    try:
        assert _overlapping(one_torch_thread, torch.get_num_threads) == (1, 3)
        with ThreadPoolExecutor(1) as new:
            assert new.submit(torch.get_num_threads).result() == 3
    finally:
        torch.set_num_threads(before)


def test_two_threads_that_fit_leave_the_threads_of_blas_as_they_were():
    before = _threads_of_blas()
    during, after = _overlapping(_FEW_THREADS.held, _threads_of_blas)
    assert during == [1] * len(before)
    assert after == before
