"""Tests do not depend on how fast the machine is, nor on matplotlib's list of fonts in the home; a disk can be full."""

from __future__ import annotations

import os
import resource

import pytest
from hypothesis import HealthCheck, settings

# no property has a deadline, and none is too slow
settings.register_profile("any machine", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any machine")


def pytest_configure(config: pytest.Config) -> None:
    """Give matplotlib a configuration folder in pytest's cache.

    A list of fonts in the home may name files of an environment that has been deleted since; notebooks would then
    print warnings. Worker processes inherit the folder. Trials of mutants run without a cache.
    """
    cache = getattr(config, "cache", None)
    if cache is not None and "PYTEST_XDIST_WORKER" not in os.environ:
        os.environ["MPLCONFIGDIR"] = str(cache.mkdir("matplotlib"))


def fill_disk(left: int = 0) -> None:
    """From now on no file of this process grows beyond this size [bytes], as on a disk that is full."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (left, resource.getrlimit(resource.RLIMIT_FSIZE)[1]))


@pytest.fixture
def disk():
    """What fills the disk; it is empty again afterwards."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    yield fill_disk
    resource.setrlimit(resource.RLIMIT_FSIZE, before)
