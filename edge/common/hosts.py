"""Which addresses are this machine's own.

The hazard is the name that only looks so: 127.0.0.1.evil.example begins like loopback and is somebody's server.
"""

from ipaddress import ip_address
from typing import Final

OWN_NAME: Final = "localhost"


def is_own(host: str) -> bool:
    """Whether an address is only reached from this machine."""
    if host == OWN_NAME:
        return True
    try:
        return ip_address(host).is_loopback
    except ValueError:  # some other name
        return False
