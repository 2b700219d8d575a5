"""What tests of several rooms share."""

import socket
import time
from collections.abc import Callable

import pytest
from hypothesis import HealthCheck, settings

# The machine is shared: slowness is not a failure. The first text drawn builds Unicode tables for seconds.
settings.register_profile("skyfix", deadline=None, suppress_health_check=[HealthCheck.too_slow], print_blob=True)
settings.load_profile("skyfix")

Until = Callable[..., bool]


@pytest.fixture
def endpoint() -> str:
    """A Zenoh endpoint on loopback that nobody listens on yet."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


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
