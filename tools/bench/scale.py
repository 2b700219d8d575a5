"""Many sites under one headquarters: what grows with what. Boxes, stations and routers are real; pictures are not.

    python -m tools.bench.scale --sites 10 --cameras 10 --seconds 20

One process a site's router, one for its boxes (a session each), one for its station, which hears all tracks and says
targets; a router and a listener at the headquarters. Prints what was lost, latencies, CPU and memory by role.
"""

import argparse
import multiprocessing
import resource
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from multiprocessing.synchronize import Barrier
from typing import Any, Final

import msgspec
import numpy as np

from edge.link.inbox import Inbox, Received
from edge.link.link import Link
from edge.link.settings import LinkSettings
from edge.messages import Target, Targets, Tracks, camera_key, decode, encode, site_key, station_key
from tools.doubles.tracks import DETECTION

FIRST_PORT: Final = 18000
RATE_HZ: Final = 30.0
TARGETS_HZ: Final = 10.0
SETTLE_S: Final = 8.0  # for a hundred sessions to open and know each other
SEEN: Final = msgspec.structs.replace(DETECTION, sigma_px=0.5)
TARGET: Final = Target(
    track=1,
    state="confirmed",
    ecef_m=(4.2e6, 6e5, 4.6e6),
    velocity_m_s=(1.0, 2.0, 3.0),
    covariance=[0.1] * 21,
    cameras=["cam0", "cam1", "cam2"],
    age_s=1.0,
)
Report = dict[str, Any]


def endpoint(index: int) -> str:
    """The router's; 0 is the headquarters'."""
    return f"tcp/127.0.0.1:{FIRST_PORT + index}"


def tracks(seq: int) -> Tracks:
    """Five detections: about 1 kB."""
    return Tracks(
        t_unix_ns=time.time_ns(),
        seq=seq,
        epoch=1,
        clock_bound_s=0.001,
        size_px=(1280, 720),
        readout_s=0.01,
        detections=[SEEN] * 5,
    )


def router(site: int, options: argparse.Namespace, ready: Barrier) -> Report:
    """A site's router, or the headquarters' (site 0)."""
    settings = LinkSettings(
        mode="router", listen=(endpoint(site),), connect=() if site == 0 else (endpoint(0),), insecure=True
    )
    with Link(settings, name=f"router{site}"):
        ready.wait()
        time.sleep(SETTLE_S + options.seconds + 2.0)
    return {}


def boxes(site: int, options: argparse.Namespace, ready: Barrier) -> Report:
    """All boxes of a site, each with a session of its own, their frames spread over the period."""
    with ExitStack() as stack:
        settings = LinkSettings(mode="client", connect=(endpoint(site),))
        links = [stack.enter_context(Link(settings, name=f"box{k}")) for k in range(options.cameras)]
        ready.wait()
        time.sleep(SETTLE_S)
        sent, next_s = 0, time.monotonic()
        steps = round(options.seconds * RATE_HZ) * options.cameras
        for step in range(steps):
            index = step % options.cameras
            links[index].publish(camera_key(f"s{site}", f"cam{index}", "tracks"), tracks(step // options.cameras))
            sent += 1
            next_s += 1.0 / (RATE_HZ * options.cameras)
            time.sleep(max(0.0, next_s - time.monotonic()))
        time.sleep(1.0)
        counters = [link.counters for link in links]
    dropped = sum(counter.dropped + counter.stale for counter in counters)
    return {"sent": sent, "dropped": dropped}


def station(site: int, options: argparse.Namespace, ready: Barrier) -> Report:
    """Hears and decodes all tracks of its site, and says targets."""
    with Link(LinkSettings(mode="client", connect=(endpoint(site),)), name=f"station{site}") as link:
        inbox = link.subscribe(camera_key(f"s{site}", "*", "tracks"), 10_000)
        ready.wait()
        latencies, said = [], 0
        begun = time.monotonic()
        next_s = begun + SETTLE_S
        while time.monotonic() < begun + SETTLE_S + options.seconds + 2.0:
            link.wait(0.02)
            latencies += _latencies(inbox, lambda payload: decode(payload, Tracks, where="bench").t_unix_ns)
            if next_s <= time.monotonic() < begun + SETTLE_S + options.seconds:
                link.publish(
                    station_key(f"s{site}", "targets"), Targets(t_unix_ns=time.time_ns(), targets=[TARGET] * 3)
                )
                said += 1
                next_s += 1.0 / TARGETS_HZ
    return {"heard": len(latencies), "latencies": latencies, "said": said}


def headquarters(site: int, options: argparse.Namespace, ready: Barrier) -> Report:
    """Hears the targets of all sites."""
    with Link(LinkSettings(mode="client", connect=(endpoint(site),)), name="hq") as link:
        inbox = link.subscribe(site_key("*", "station/targets"), 10_000)
        ready.wait()
        latencies: list[float] = []
        begun = time.monotonic()
        while time.monotonic() < begun + SETTLE_S + options.seconds + 2.0:
            link.wait(0.1)
            latencies += _latencies(inbox, lambda payload: decode(payload, Targets, where="bench").t_unix_ns)
    return {"heard": len(latencies), "latencies": latencies}


def _latencies(inbox: Inbox[Received], t_unix_ns: Callable[[bytes], int]) -> list[float]:
    offset_ns = time.time_ns() - time.monotonic_ns()
    return [(item.t_monotonic_ns + offset_ns - t_unix_ns(item.payload)) * 1e-6 for item in inbox.drain()]


ROLES: Final[dict[str, Callable[[int, argparse.Namespace, Barrier], Report]]] = {
    "router": router,
    "boxes": boxes,
    "station": station,
    "headquarters": headquarters,
}


def process(
    role: str, site: int, options: argparse.Namespace, ready: Barrier, results: "multiprocessing.Queue[Report]"
) -> None:
    """One process of the bench."""
    imported_s = _cpu_s()
    report = ROLES[role](site, options, ready)
    rss_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    results.put({"role": role, "site": site, "cpu_s": _cpu_s() - imported_s, "rss_mb": rss_mb, **report})


def _cpu_s() -> float:
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def measure(options: argparse.Namespace) -> list[Report]:
    """Run all of it; every process's report."""
    context = multiprocessing.get_context("spawn")  # a Zenoh session does not survive a fork
    wanted = [("router", 0), ("headquarters", 0)]
    wanted += [(role, site) for site in range(1, options.sites + 1) for role in ("router", "boxes", "station")]
    ready = context.Barrier(len(wanted))
    results: multiprocessing.Queue[Report] = context.Queue()
    running = [context.Process(target=process, args=(*who, options, ready, results)) for who in wanted]
    for one in running:
        one.start()
    reports = [results.get() for _ in running]
    for one in running:
        one.join()
    return reports


def tell(reports: list[Report], options: argparse.Namespace) -> None:
    """The table."""
    by_role = {role: [r for r in reports if r["role"] == role] for role in ROLES}
    sent, dropped = sum(r["sent"] for r in by_role["boxes"]), sum(r["dropped"] for r in by_role["boxes"])
    heard = sum(r["heard"] for r in by_role["station"])
    said, at_hq = sum(r["said"] for r in by_role["station"]), sum(r["heard"] for r in by_role["headquarters"])
    size = len(encode(tracks(0)))
    print(
        f"{options.sites} sites x {options.cameras} cameras x {RATE_HZ:.0f} Hz, {size} bytes, {options.seconds:.0f} s"
    )
    print(f"tracks:  {sent} sent, {sent - heard} lost ({dropped} by their own boxes), {_spread(by_role['station'])}")
    print(
        f"targets: {said} said, {said - at_hq} lost on the way to the headquarters, {_spread(by_role['headquarters'])}"
    )
    for role, found in by_role.items():
        cpu = [r["cpu_s"] / options.seconds for r in found]
        rss = max(r["rss_mb"] for r in found)
        print(f"{role:13} {len(found):3} processes, {np.mean(cpu):5.1%} of a core each, at most {rss:.0f} MB")


def _spread(reports: list[Report]) -> str:
    found = np.concatenate([np.array(r["latencies"]) for r in reports])
    if not len(found):
        return "nothing heard"
    return f"latency p50 {np.median(found):.1f} ms, p99 {np.percentile(found, 99):.1f} ms"


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description="Many sites under one headquarters: losses, latency, CPU, memory.")
    parser.add_argument("--sites", type=int, default=10)
    parser.add_argument("--cameras", type=int, default=10)
    parser.add_argument("--seconds", type=float, default=20.0)
    options = parser.parse_args()
    tell(measure(options), options)
    return 0


if __name__ == "__main__":
    sys.exit(main())
