"""Batches in parts on threads: all of a batch once, and memory that lives for as long as a thread uses it."""

from __future__ import annotations

import ctypes
import gc
import signal
import threading
import weakref

import numpy as np
import pytest
from processes import HANG

from whiptool.rollout.threads import run_in_parts


class Numbers(ctypes.Structure):
    _fields_ = [("x", ctypes.c_void_p)]


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("count", [1, 7, 8, 64, 65, 1000])
def test_every_element_is_done_once(count, threads):
    """In parts that begin at whole groups of lanes."""
    done, firsts = np.zeros(count, int), []

    def loop(arguments, first: int, number: int) -> None:
        firsts.append(first)
        done[first : first + number] += 1

    run_in_parts(loop, Numbers(), {}, count=count, lanes=4, threads=threads)
    assert (done == 1).all()
    assert all(first % 4 == 0 for first in firsts)


def test_an_interrupt_leaves_a_running_part_its_memory():
    """A part still runs when Ctrl-C unwinds its caller: its arrays outlive the call, not the part."""
    begun, may_end, unwound = threading.Event(), threading.Event(), threading.Event()
    left: list[weakref.ref] = []

    def loop(arguments, first: int, number: int) -> None:
        begun.set()
        may_end.wait(HANG)

    def call() -> None:
        x = np.zeros(1000)
        left.append(weakref.ref(x))
        arguments = Numbers(x.ctypes.data)
        threading.Thread(target=interrupt).start()
        run_in_parts(loop, arguments, {"x": x}, count=1000, lanes=4, threads=2)

    def interrupt() -> None:
        begun.wait(HANG)
        signal_main()
        while not unwound.wait(5):  # one that comes right before the wait for a part begins does not end that wait
            signal_main()

    usual = signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs ignore it
    gc.collect()
    gc.disable()  # an exception that a signal raises within a finalizer is lost
    try:
        with pytest.raises(KeyboardInterrupt):
            call()
    finally:
        unwound.set()
        signal.signal(signal.SIGINT, usual)
        gc.enable()
        gc.collect()
        lived = left[0]() is not None
        may_end.set()
    assert lived
    for _ in range(200):
        gc.collect()
        if left[0]() is None:
            break
        threading.Event().wait(0.05)
    assert left[0]() is None


def signal_main() -> None:
    """What Ctrl-C does: an exception in the main thread, wherever it is."""
    signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)


def test_an_error_in_a_part_is_raised():
    def loop(arguments, first: int, number: int) -> None:
        if first >= 100:
            raise ValueError("a part")

    with pytest.raises(ValueError, match="a part"):
        run_in_parts(loop, Numbers(), {}, count=1000, lanes=4, threads=2)
