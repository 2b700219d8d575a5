"""Machines on one network and no other: a switch inside the first, a cable from it to each of the others."""

import subprocess
from collections.abc import Mapping
from typing import Final

from tools.rehearsal.machine import Machine

FIELD: Final = "eth0"  # the name of the interface on every machine
PREFIX: Final = 24


def plug(first: Machine, address: str, others: Mapping[str, Machine]) -> None:
    """Join machines: the first at its address, and each other at its own. Raises CalledProcessError."""
    _ip(first, "link", "add", FIELD, "type", "bridge")
    _up(first, address)
    for number, (place, machine) in enumerate(others.items()):
        port = f"port{number}"
        ends = ["netns", str(first.leader), "type", "veth", "peer", "name", FIELD, "netns", str(machine.leader)]
        subprocess.run(["ip", "link", "add", port, *ends], check=True)
        _ip(first, "link", "set", port, "master", FIELD, "up")
        _up(machine, place)


def _up(machine: Machine, address: str) -> None:
    _ip(machine, "address", "add", f"{address}/{PREFIX}", "dev", FIELD)
    _ip(machine, "link", "set", FIELD, "up")


def _ip(machine: Machine, *words: str) -> None:
    subprocess.run(["nsenter", f"--target={machine.leader}", "--net", "ip", *words], check=True)
