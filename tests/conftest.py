"""Make the tests independent of how fast the machine is, and of matplotlib's list of fonts in the user's home."""

import os

import pytest
from hypothesis import HealthCheck, settings

# no property has a deadline, and none is too slow
settings.register_profile("any machine", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any machine")


def pytest_configure(config: pytest.Config) -> None:
    """Give matplotlib a configuration folder in pytest's cache.

    A list of fonts in the home may name files of an environment that has been deleted since; notebooks would then
    print warnings. Worker processes inherit the folder.
    """
    if "PYTEST_XDIST_WORKER" not in os.environ:
        assert config.cache is not None
        os.environ["MPLCONFIGDIR"] = str(config.cache.mkdir("matplotlib"))
