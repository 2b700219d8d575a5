"""Whose address is this machine's own, and whose only looks so."""

import pytest

from edge.common.hosts import is_own


@pytest.mark.parametrize("host", ["localhost", "127.0.0.1", "127.5.0.1", "::1"])
def test_this_machines_own(host: str) -> None:
    assert is_own(host)


@pytest.mark.parametrize("host", ["127.0.0.1.evil.example", "localhost.evil.example", "10.0.0.1", "0.0.0.0", "::", ""])
def test_somebody_elses(host: str) -> None:
    assert not is_own(host)
