"""What faults cost, in figures: real processes in network namespaces, three cameras. Needs root; nothing else.

    python -m tools.bench.field partition --seconds 10      cut one box off and put it back, five times
    python -m tools.bench.field storm --seconds 30          5 % loss, 50 ms +- 20 ms, order not kept
    python -m tools.bench.field frozen --seconds 30         SIGSTOP the base
    python -m tools.bench.field kills --times 50            kill -9 of boxes, router and base, at random (seeded)

Each prints what was asked and what was measured. With mutual TLS and access control, as in the field, unless `--plain`.
Latencies are those of one machine with one clock: from the instant a box makes a message to its arrival in the base's
recording. Nothing else should run meanwhile: what the two cores are kept from is measured as latency.
"""

import argparse
import random
import signal
import sys
import tempfile
import time
from pathlib import Path
from typing import Final

import numpy as np

from calib.scoring.consistency import CHI2_3_999
from calib.station.archive import recording
from edge.link.store import SpoolStore
from tools.doubles.air import Air, possible
from tools.doubles.heard import Row, latency_s, live_again_after
from tools.doubles.site import CAMERAS, PATIENCE_S, Site, demo_flight, wait
from tools.doubles.truth import CHI2_3_95, Error

CALM_S: Final = 15.0  # before a fault, to compare with
AFTER_S: Final = 5.0  # within which everything must be back, and what is sent is looked at closely
SEED: Final = 11


def p99_ms(rows: list[Row], begin_unix_s: float, end_unix_s: float) -> float:
    """99th percentile of the live latencies of a stretch of time."""
    found = latency_s(rows, begin_unix_s, end_unix_s)
    return float(np.percentile(found, 99) * 1e3) if len(found) else float("nan")


def partition(site: Site, options: argparse.Namespace) -> None:
    """Cut one box off, again and again."""
    calm: list[float] = []
    busy: dict[str, list[float]] = {"the cut box": [], "the others": []}
    for number in range(options.cuts):
        began, restored, end, lost = _cut(site, options.seconds)
        rows = site.recorded()
        took_s = f"complete after {end - restored:.1f} s" if not lost else f"{lost} LOST"
        live_s = live_again_after(rows, "cam1", restored)
        print(
            f"cut {number + 1} of {options.seconds:.0f} s: live again {live_s:.2f} s (asked: 2), {took_s}", flush=True
        )
        calm += latency_s(rows, began - CALM_S, began).tolist()
        for row in rows:
            made_s = row.t_unix_ns * 1e-9
            if not row.late and restored + live_s <= made_s < end:
                who = "the cut box" if row.camera == "cam1" else "the others"
                busy[who].append((row.t_arrival_ns - row.t_unix_ns) * 1e-9)
        time.sleep(CALM_S)
    print(f"live latency, ms {'count':>22} {'p50':>7} {'p99':>7}")
    for what, found_s in (("in calm", calm), *((f"catching up: {who}", late) for who, late in busy.items())):
        p50, p99 = np.percentile(found_s, (50, 99)) * 1e3
        print(f"  {what:26} {len(found_s):10} {p50:7.1f} {p99:7.1f}")


def _cut(site: Site, seconds: float) -> tuple[float, float, float, int]:
    """One cut: when it began, when the link was back, when all was recorded, and how many then were not."""
    began = time.time()
    site.air.set(cut=("cam1",))
    time.sleep(seconds)
    restored = time.time()
    site.air.set()
    made = site.made()
    wait(lambda: not site.lost(made), PATIENCE_S)
    return began, restored, time.time(), len(site.lost(made))


def storm(site: Site, options: argparse.Namespace) -> None:
    """Lose and delay packets."""
    site.air.set(loss=0.05, delay_s=0.05, jitter_s=0.02)
    begin = time.time() + 1.0
    time.sleep(options.seconds)
    end = time.time() - 1.0
    site.air.set()
    made = site.made()
    wait(lambda: not site.lost(made), PATIENCE_S)
    rows = site.recorded()
    found = latency_s(rows, begin, end)
    print(f"storm of {options.seconds:.0f} s: {len(site.lost(made))} of {len(made)} lost")
    print(f"p50 {np.median(found) * 1e3:.0f} ms, p99 {p99_ms(rows, begin, end):.0f} ms (asked: 250)")


def frozen(site: Site, options: argparse.Namespace) -> None:
    """Freeze the base."""
    before = {camera: _rss_mb(site, camera) for camera in CAMERAS}
    calm = site.lateness_s(time.time() - CALM_S, time.time())
    begin = time.time()
    site.send("base", signal.SIGSTOP)
    time.sleep(options.seconds)
    end = time.time()
    after = {camera: _rss_mb(site, camera) for camera in CAMERAS}
    site.send("base", signal.SIGCONT)
    made = site.made()
    wait(lambda: not site.lost(made), PATIENCE_S)
    late = site.lateness_s(begin, end)
    print(f"frozen for {options.seconds:.0f} s: {len(site.lost(made))} of {len(made)} lost")
    told = f"calm {max(calm) * 1e3:.0f} ms, frozen {max(late) * 1e3:.0f} ms"
    print(f"latest of {len(late)} frames at the boxes: {told} (asked: none missed; a frame is 40 ms)")
    print("memory of the boxes, MB: " + ", ".join(f"{before[c]:.0f} -> {after[c]:.0f}" for c in CAMERAS))


def _rss_mb(site: Site, host: str) -> float:
    pid = site.processes[host].pid
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return int(line.split()[1]) / 1024
    return float("nan")


def kills(site: Site, options: argparse.Namespace) -> None:
    """Kill -9 boxes, router and base at random."""
    chance = random.Random(SEED)
    print(f"seed {SEED}; calibrating")
    wait(lambda: site.heard.positions_since(0), PATIENCE_S)
    calm_unix_s = time.time()
    time.sleep(CALM_S)
    killed: list[tuple[str, float, float, float]] = []  # host, when, until live again, until positions are sent again
    for number in range(options.times):
        host = chance.choice(site.air.hosts)
        time.sleep(chance.uniform(0.0, 1.0))
        killed_ns = time.time_ns()
        site.kill(host)
        site.start(host)
        whom = {host} if host in CAMERAS else set(CAMERAS)
        live_s = wait(lambda: whom <= site.heard.live_since(killed_ns), 30.0)  # noqa: B023 -- called here
        sent_s = live_s + wait(lambda: site.heard.positions_since(killed_ns), 30.0)  # noqa: B023 -- called here
        killed.append((host, killed_ns * 1e-9, live_s, sent_s))
        print(f"{number + 1:3} {host:6} live again {live_s:5.2f} s, positions {sent_s:5.2f} s", flush=True)
    time.sleep(3.0)
    _recoveries(killed)
    _losses(site, options.times)
    _judge(site.errors(), calm_unix_s, [when for _, when, _, _ in killed])
    _look_at_spools(site)


def _recoveries(killed: list[tuple[str, float, float, float]]) -> None:
    for what, hosts in (("box", CAMERAS), ("router", ("router",)), ("base", ("base",))):
        for which, column in (("heard live", 2), ("positions sent", 3)):
            times_s = [float(row[column]) for row in killed if row[0] in hosts]
            if times_s:
                told = f"after {np.median(times_s):5.2f} s, at worst {max(times_s):5.2f} s (asked: {AFTER_S:.0f})"
                print(f"{what:6} killed {len(times_s):3} times: {which:14} again {told}")


def _losses(site: Site, times: int) -> None:
    made = site.made()
    wait(lambda: not site.lost_inside(made), PATIENCE_S)
    lost, inside = site.lost(made), site.lost_inside(made)
    print(f"{times} kills: {len(lost)} of {len(made)} lost, {len(inside)} not in the last 0.5 s of a run")


def _judge(errors: list[Error], calm_unix_s: float, killed_unix_s: list[float]) -> None:
    """Positions against what they say of themselves: in calm, just after a kill, and all."""
    shaken = [e for e in errors if any(0 <= e.sent_unix_s - when < AFTER_S for when in killed_unix_s)]
    calm = [e for e in errors if calm_unix_s <= e.sent_unix_s < min(killed_unix_s, default=calm_unix_s)]
    heads = ("count", "median m", "worst m", "in 95 %", "in 99.9 %", "worst")
    print("{:28} {:>6} {:>9} {:>8} {:>8} {:>10} {:>8}".format("positions sent", *heads))
    for what, some in (("in calm", calm), (f"within {AFTER_S:.0f} s of a kill", shaken), ("in all", errors)):
        if not some:
            print(f"{what:28} none")
            continue
        metres, nees = (np.array([error[column] for error in some]) for column in (1, 2))
        inside = [f"{np.mean(nees <= bound):8.1%}" for bound in (CHI2_3_95, CHI2_3_999)]
        sigmas = float(np.sqrt(nees.max()))
        told = f"{np.median(metres):9.2f} {metres.max():8.2f} {inside[0]} {inside[1]:>10} {sigmas:5.1f} s."
        print(f"{what:28} {len(some):6} {told}")


def _look_at_spools(site: Site) -> None:
    for camera in CAMERAS:
        site.kill(camera)
        store = SpoolStore(site.folder / f"{camera}.sqlite", max_bytes=10**9)  # checks the file
        print(f"{camera}: spool is sound, {sum(item.rows for item in store.inventory())} rows")
        store.close()
    for file in sorted((site.folder / "recordings").glob("*.mcap")):
        messages = sum(1 for _ in recording.read(file))
        print(f"{file.name}: read to its end, {messages} messages")


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description="What faults cost, measured on real processes in namespaces.")
    parser.add_argument("fault", choices=("partition", "storm", "frozen", "kills"))
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--times", type=int, default=50, help="kills")
    parser.add_argument("--cuts", type=int, default=5, help="cuts of a partition, one after the other")
    parser.add_argument("--plain", action="store_true", help="without TLS and access control")
    parser.add_argument("--router", action="store_true", help="boxes and base dial a router; always so for kills")
    options = parser.parse_args()
    if reason := possible():
        print(reason, file=sys.stderr)
        return 1
    hosts = ("base", "router") if options.router or options.fault == "kills" else ("base",)
    with tempfile.TemporaryDirectory() as temporary, Air(*hosts, *CAMERAS) as air:
        site = Site(air, Path(temporary), demo_flight(Path(temporary) / "flight"), secure=not options.plain)
        try:
            site.settle(CALM_S)
            {"partition": partition, "storm": storm, "frozen": frozen, "kills": kills}[options.fault](site, options)
        finally:
            site.bury()
    return 0


if __name__ == "__main__":
    sys.exit(main())
