"""The air between machines: network namespaces joined by a relay that loses, delays and cuts.

Each host is a network namespace of its own with one TUN device; the relay holds the other ends and carries packets from
one to the other. The kernel of this test may know no netem, so what netem does is done here: `loss`, `delay_s` and
`jitter_s` (uniform, order not kept, as netem does it), and silent cuts of single hosts. Runs as a process of its own,
told what to do by JSON lines, so that the test's own work does not disturb the packets.
"""

import ctypes
import fcntl
import heapq
import json
import os
import random
import selectors
import struct
import subprocess
import sys
import time
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

TUNSETIFF: Final = 0x400454CA
IFF_TUN_NO_PI: Final = 0x0001 | 0x1000
CLONE_NEWNET: Final = 0x40000000
MTU: Final = 1500
SYSCTL: Final = Path(__file__).parents[2] / "deploy" / "sysctl" / "60-skyfix.conf"
SEED: Final = 7


def possible() -> str:
    """Why this machine cannot do it; empty if it can."""
    if os.geteuid() != 0:
        return "network namespaces need root"
    if not Path("/dev/net/tun").exists():
        return "there is no /dev/net/tun"
    name = f"sf{os.getpid()}try"
    tried = subprocess.run(["ip", "netns", "add", name], capture_output=True, check=False)
    subprocess.run(["ip", "netns", "delete", name], capture_output=True, check=False)
    return "" if tried.returncode == 0 else f"`ip netns add` is not permitted ({tried.stderr.decode().strip()})"


class Air:
    """The test's side: makes the namespaces and tells the relay. Addresses are 10.77.0.1, .2, ... in order."""

    def __init__(self, *hosts: str) -> None:
        self.hosts = hosts
        self._prefix = f"sf{os.getpid()}"

    def __enter__(self) -> Self:
        command = [sys.executable, __file__, self._prefix, *self.hosts]
        self._relay = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self._relay.stdout is not None
        assert self._relay.stdout.readline() == "ready\n", "the relay did not start"
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        assert self._relay.stdin is not None
        assert self._relay.stdout is not None
        self._relay.stdin.close()  # its sign to take the namespaces down
        self._relay.wait(timeout=10)
        self._relay.stdout.close()

    def address(self, host: str) -> str:
        """A host's IP address."""
        return f"10.77.0.{1 + self.hosts.index(host)}"

    def inside(self, host: str) -> list[str]:
        """The words before a command that make it run on this host."""
        return ["ip", "netns", "exec", f"{self._prefix}{host}"]

    def set(self, *, cut: tuple[str, ...] = (), loss: float = 0.0, delay_s: float = 0.0, jitter_s: float = 0.0) -> None:
        """How the air is from now on. cut: hosts whose packets vanish, both ways, without a word."""
        indices = [self.hosts.index(host) for host in cut]
        order = {"cut": indices, "loss": loss, "delay_s": delay_s, "jitter_s": jitter_s}
        assert self._relay.stdin is not None
        assert self._relay.stdout is not None
        self._relay.stdin.write(json.dumps(order) + "\n")
        self._relay.stdin.flush()
        assert self._relay.stdout.readline() == "done\n"


# The relay's side


def _open_host(name: str, address: str) -> int:
    """A namespace with one TUN device; the descriptor of its other end."""
    subprocess.run(["ip", "netns", "add", name], check=True)
    libc = ctypes.CDLL(None, use_errno=True)
    home = os.open("/proc/self/ns/net", os.O_RDONLY)
    there = os.open(f"/run/netns/{name}", os.O_RDONLY)
    if libc.setns(there, CLONE_NEWNET) != 0:
        raise OSError(ctypes.get_errno(), "setns")
    tun = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(tun, TUNSETIFF, struct.pack("16sH", b"air0", IFF_TUN_NO_PI))
    libc.setns(home, CLONE_NEWNET)
    for command in (f"addr add {address}/24 dev air0", "link set air0 up", "link set lo up"):
        subprocess.run(["ip", "-n", name, *command.split()], check=True)
    for line in SYSCTL.read_text().splitlines():  # as deploy/install.sh sets it on a box
        key, equals, value = line.partition("=")
        if equals and not key.startswith("#"):
            file = f"/proc/sys/{key.strip().replace('.', '/')}"
            subprocess.run(["ip", "netns", "exec", name, "sh", "-c", f"echo {value.strip()} >{file}"], check=True)
    return tun


class _Relay:
    def __init__(self, tuns: list[int]) -> None:
        self.tuns = tuns
        self.order: dict[str, Any] = {"cut": [], "loss": 0.0, "delay_s": 0.0, "jitter_s": 0.0}
        self.waiting: list[tuple[float, int, int, bytes]] = []
        self.random = random.Random(SEED)
        self.count = 0

    def take(self, source: int) -> None:
        """All packets that wait at one host."""
        while True:
            try:
                packet = os.read(self.tuns[source], MTU + 100)
            except BlockingIOError:
                return
            self._consider(source, packet)

    def _consider(self, source: int, packet: bytes) -> None:
        if len(packet) < 20 or packet[0] >> 4 != 4:
            return
        target = packet[19] - 1
        cut, loss = self.order["cut"], self.order["loss"]
        if not 0 <= target < len(self.tuns) or source in cut or target in cut or self.random.random() < loss:
            return
        jitter_s = self.order["jitter_s"] * self.random.uniform(-1, 1)
        self.count += 1
        heapq.heappush(self.waiting, (time.monotonic() + self.order["delay_s"] + jitter_s, self.count, target, packet))

    def give(self) -> float | None:
        """Deliver what is due; how long until the next one is."""
        while self.waiting and (left := self.waiting[0][0] - time.monotonic()) <= 0:
            _, _, target, packet = heapq.heappop(self.waiting)
            try:
                os.write(self.tuns[target], packet)
            except OSError:
                continue  # the host's queue is full: lost, as in the air
        return left if self.waiting else None


def _serve(prefix: str, hosts: list[str]) -> None:
    tuns = [_open_host(f"{prefix}{host}", f"10.77.0.{1 + index}") for index, host in enumerate(hosts)]
    relay = _Relay(tuns)
    selector = selectors.DefaultSelector()
    for index, tun in enumerate(tuns):
        selector.register(tun, selectors.EVENT_READ, index)
    selector.register(sys.stdin, selectors.EVENT_READ, None)
    print("ready", flush=True)
    while True:
        for key, _ in selector.select(relay.give()):
            if key.data is not None:
                relay.take(key.data)
            elif line := sys.stdin.readline():
                relay.order = json.loads(line)
                print("done", flush=True)
            else:
                return


if __name__ == "__main__":
    try:
        _serve(sys.argv[1], sys.argv[2:])
    finally:
        for host_name in sys.argv[2:]:
            subprocess.run(["ip", "netns", "delete", f"{sys.argv[1]}{host_name}"], check=False)
