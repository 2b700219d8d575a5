"""What tests of several rooms share."""

import time
from collections.abc import Callable

import pytest
from hypothesis import HealthCheck, settings

from tests.foreign import missing, required
from tools.doubles.ports import free_endpoint

# The machine is shared: slowness is not a failure. The first text drawn builds Unicode tables for seconds.
settings.register_profile("patient", deadline=None, suppress_health_check=[HealthCheck.too_slow], print_blob=True)
# The same examples on every machine and every day: a red test is then a fault of the change that made it red.
settings.register_profile("skyfix", settings.get_profile("patient"), derandomize=True, database=None)
# `make fuzz`: others each time, and many more of them.
settings.register_profile("fuzz", settings.get_profile("patient"), max_examples=5000)
settings.load_profile("skyfix")

Until = Callable[..., bool]


@pytest.hookimpl(tryfirst=True)  # before the fixtures, which start what is missing
def pytest_runtest_setup(item: pytest.Item) -> None:
    """A test marked `program("socat")` is skipped where that is not installed, or fails where it has to be."""
    for marker in item.iter_markers("program"):
        for program in marker.args:
            if reason := missing(program):
                (pytest.fail if required() else pytest.skip)(reason)


@pytest.fixture
def endpoint() -> str:
    """A Zenoh endpoint on loopback that nobody listens on yet."""
    return free_endpoint()


@pytest.fixture
def until() -> Until:
    """Wait for a condition: `until(lambda: ..., within_s=5)` says whether it came true in time."""

    def wait(condition: Callable[[], object], within_s: float = 5.0) -> bool:
        deadline = time.monotonic() + within_s
        while time.monotonic() < deadline:
            if condition():
                return True
            time.sleep(0.01)
        return False

    return wait
