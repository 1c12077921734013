"""Tests do not depend on how fast the machine is, nor on matplotlib's list of fonts in the home."""

from __future__ import annotations

import gc
import os
import signal
from collections.abc import Generator, Iterator

import pytest
from hypothesis import HealthCheck, settings

# no property has a deadline, and none is too slow
settings.register_profile("any machine", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any machine")

# Files and folders that take longest, in their order. One process runs a file, so that the tests of a file share what
# they compile and compute; with the short files at the end both processes end at the same time.
LONGEST = (
    "tests/whole/test_docs.py",
    "tests/whole/test_notebooks.py",
    "tests/whole/test_page_commands.py",
    "tests/whole/test_quick_benchmarks.py",
    "tests/papers/test_reproduce.py",
    "tests/commands/test_identify.py",
    "tests/commands/",
    "tests/papers/",
    "tests/whole/",
)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Collect no garbage while tests are collected, nor look at modules and tests later: all of these stay."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_configure(config: pytest.Config) -> None:
    """Give matplotlib a configuration folder in pytest's cache.

    A list of fonts in the home may name files of an environment that has been deleted since; notebooks would then
    print warnings. Worker processes inherit the folder. Trials of mutants run without a cache.
    """
    cache = getattr(config, "cache", None)
    if cache is not None and "PYTEST_XDIST_WORKER" not in os.environ:
        os.environ["MPLCONFIGDIR"] = str(cache.mkdir("matplotlib"))


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what takes hours unless `-m` names it, and put the files first that take longest."""
    if "hours" not in config.getoption("markexpr"):
        long = [item for item in items if item.get_closest_marker("hours") is not None]
        config.hook.pytest_deselected(items=long)
        items[:] = [item for item in items if item not in long]
    items.sort(key=lambda item: next((i for i, x in enumerate(LONGEST) if item.nodeid.startswith(x)), len(LONGEST)))


@pytest.fixture(autouse=True)
def handlers_of_signals() -> Iterator[None]:
    """A command that was interrupted ignores further signals until its process ends; the next test's does not.

    SIGHUP is heard also where the tests run under nohup, and SIGINT where a shell runs them in the background.
    """
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)
