"""PTP by real ptp4l and pmc, over a pair of virtual wires in a network of their own; no clock is touched.

free_running leaves the machine's clock alone. Also what a sandboxed service may not do: make its socket in /var/run.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from edge.clock.ptp import read_ptp
from tests.places import ROOT

CONFIGURATION = """[global]
free_running 1
time_stamping software
network_transport L2
uds_address {folder}/{name}
logAnnounceInterval -2
logSyncInterval -3
logMinDelayReqInterval -3
announceReceiptTimeout 2
slaveOnly {follows}
"""
# Run in a network namespace: two wires, whoever is named on them, and what read_ptp says of each until it has settled.
SCRIPT = """
import subprocess, sys, time
from edge.clock.ptp import read_ptp
folder, names = sys.argv[1], sys.argv[2:]
for command in ("ip link add leader type veth peer name follower", "ip link set leader up", "ip link set follower up"):
    subprocess.run(command.split(), check=True)
daemons = [subprocess.Popen(["ptp4l", "-i", n, "-S", "-f", f"{folder}/{n}.cfg"], stdout=subprocess.DEVNULL,
           stderr=subprocess.DEVNULL) for n in names]
try:
    for name in names:
        deadline = time.monotonic() + 15
        while True:
            state = read_ptp((f"{folder}/none", f"{folder}/{name}"))
            settled = state.synced or "grandmaster;" in state.reason
            if settled or time.monotonic() > deadline or (len(names) == 1 and "no PTP" in state.reason):
                break
            time.sleep(0.2)
        print(name, state.bound_s, state.source, state.reason, sep="|", flush=True)
finally:
    for daemon in daemons:
        daemon.kill()
"""


def said(folder: Path, *names: str) -> dict[str, list[str]]:
    for name in ("leader", "follower"):
        text = CONFIGURATION.format(folder=folder, name=name, follows=int(name == "follower"))
        (folder / f"{name}.cfg").write_text(text)
    runtime = folder / "runtime"
    runtime.mkdir()
    command = ["unshare", "--user", "--map-root-user", "--net", sys.executable, "-c", SCRIPT, str(folder), *names]
    environment = os.environ | {"RUNTIME_DIRECTORY": str(runtime), "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60, check=False)
    if "Operation not permitted" in done.stderr or "unshare failed" in done.stderr:
        pytest.skip("this machine allows no network namespaces")
    assert done.returncode == 0, done.stderr
    assert list(runtime.iterdir()) == []
    return {line.split("|")[0]: line.split("|")[1:] for line in done.stdout.splitlines()}


@pytest.mark.program("ptp4l", "pmc", "ip", "unshare")
def test_a_follower_and_its_grandmaster(tmp_path: Path) -> None:
    found = said(tmp_path, "leader", "follower")
    bound_s, source, reason = found["follower"]
    assert (source, reason.endswith("of the grandmaster")) == ("ptp", True)
    assert 0 < float(bound_s) < 0.05  # software stamps on a busy machine
    # The grandmaster follows nobody by PTP: its UTC is as good as whoever sets it says, here nobody or the kernel.
    _, source, reason = found["leader"]
    assert reason.startswith("this is the PTP grandmaster; ")
    assert source in ("chrony", "kernel")


@pytest.mark.program("ptp4l", "pmc", "ip", "unshare")
def test_a_follower_with_nobody_to_follow_is_no_grandmaster(tmp_path: Path) -> None:
    bound_s, source, reason = said(tmp_path, "follower")["follower"]
    assert (bound_s, source) == ("None", "ptp")
    assert reason == "no PTP grandmaster on this network"


def test_without_ptp4l_the_page_that_helps_is_named(tmp_path: Path) -> None:
    state = read_ptp((str(tmp_path / "none"),))
    assert (state.bound_s, state.action) == (None, "start ptp4l: deploy/chrony/PTP.md")
