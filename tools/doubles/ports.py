"""Ports of this machine that nobody has at the moment."""

import socket


def free_port(kind: socket.SocketKind = socket.SOCK_STREAM) -> int:
    """A port of 127.0.0.1 that nobody has at the moment."""
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def free_endpoint() -> str:
    """A Zenoh endpoint on loopback that nobody listens on yet."""
    return f"tcp/127.0.0.1:{free_port()}"
