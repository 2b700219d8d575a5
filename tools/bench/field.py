"""What faults cost, in figures: real processes in network namespaces, three cameras. Needs root; nothing else.

    python -m tools.bench.field partition --seconds 10      cut one box off, and put it back
    python -m tools.bench.field storm --seconds 30          5 % loss, 50 ms +- 20 ms, order not kept
    python -m tools.bench.field frozen --seconds 30         SIGSTOP the base
    python -m tools.bench.field kills --times 50            kill -9 of boxes and base, at random (seeded)

Each prints what was asked and what was measured. Latencies are those of one machine with one clock: from the instant a
box makes a message to its arrival in the base's recording.
"""

import argparse
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np

from edge.spool_store import SpoolStore
from tools.fieldwork.air import Air, possible
from tools.fieldwork.site import ROOT, Row, Site, latency_s, live_again_after

CAMERAS: Final = ("cam0", "cam1", "cam2")
CALM_S: Final = 15.0  # before a fault, to compare with
PATIENCE_S: Final = 60.0  # for everything to be in the recording
SEED: Final = 11


def wait(condition: Callable[[], bool], within_s: float) -> float:
    """How long it took for a condition to come true; infinite if it did not in time."""
    began = time.monotonic()
    while time.monotonic() - began < within_s:
        if condition():
            return time.monotonic() - began
        time.sleep(0.25)
    return float("inf")


def keys(rows: list[Row]) -> set[tuple[str, int, int]]:
    """Which messages these are."""
    return {(row.camera, row.epoch, row.seq) for row in rows}


def settle(site: Site) -> None:
    """Start everything and let it run in calm."""
    for host in ("base", *CAMERAS):
        site.start(host)
    took_s = wait(lambda: {row.camera for row in site.recorded()} == set(CAMERAS), 60)
    if took_s == float("inf"):
        raise SystemExit(f"the base does not hear its boxes: look at {site.folder}/base-1.err")
    time.sleep(CALM_S + 1.0)


def p99_ms(rows: list[Row], begin_unix_s: float, end_unix_s: float) -> float:
    """99th percentile of the live latencies of a stretch of time."""
    found = latency_s(rows, begin_unix_s, end_unix_s)
    return float(np.percentile(found, 99) * 1e3) if len(found) else float("nan")


def partition(site: Site, options: argparse.Namespace) -> None:
    """Cut one box off."""
    calm = (time.time() - CALM_S, time.time())
    site.air.set(cut=("cam1",))
    time.sleep(options.seconds)
    restored = time.time()
    site.air.set()
    made = site.made()
    took_s = wait(lambda: made <= keys(site.recorded()), PATIENCE_S)
    end = time.time()
    rows = site.recorded()
    others = [row for row in rows if row.camera != "cam1"]
    print(
        f"cut of {options.seconds:.0f} s: {len(made - keys(rows))} of {len(made)} lost; complete after {took_s:.1f} s"
    )
    print(f"live again {live_again_after(rows, 'cam1', restored):.2f} s after the link (asked: 2)")
    calm_ms, late_ms = p99_ms(others, *calm), p99_ms(others, restored, end)
    print(f"live p99 of the other boxes: calm {calm_ms:.1f} ms, catching up {late_ms:.1f} ms")


def storm(site: Site, options: argparse.Namespace) -> None:
    """Lose and delay packets."""
    site.air.set(loss=0.05, delay_s=0.05, jitter_s=0.02)
    begin = time.time() + 1.0
    time.sleep(options.seconds)
    end = time.time() - 1.0
    site.air.set()
    made = site.made()
    wait(lambda: made <= keys(site.recorded()), PATIENCE_S)
    rows = site.recorded()
    found = latency_s(rows, begin, end)
    print(f"storm of {options.seconds:.0f} s: {len(made - keys(rows))} of {len(made)} lost")
    print(f"p50 {np.median(found) * 1e3:.0f} ms, p99 {p99_ms(rows, begin, end):.0f} ms (asked: 250)")


def frozen(site: Site, options: argparse.Namespace) -> None:
    """Freeze the base."""
    before = {camera: _rss_mb(site, camera) for camera in CAMERAS}
    begin = time.time()
    site.send("base", signal.SIGSTOP)
    time.sleep(options.seconds)
    after = {camera: _rss_mb(site, camera) for camera in CAMERAS}
    site.send("base", signal.SIGCONT)
    made = site.made()
    wait(lambda: made <= keys(site.recorded()), PATIENCE_S)
    rows = site.recorded()
    stamps = [sorted({row.t_unix_ns for row in rows if row.camera == camera}) for camera in CAMERAS]
    gap_s = max(float(np.max(np.diff([t for t in line if t > (begin - 1) * 1e9]))) for line in stamps) * 1e-9
    print(
        f"frozen for {options.seconds:.0f} s: {len(made - keys(rows))} of {len(made)} lost; longest gap {gap_s:.2f} s"
    )
    print("memory of the boxes, MB: " + ", ".join(f"{before[c]:.0f} -> {after[c]:.0f}" for c in CAMERAS))


def _rss_mb(site: Site, host: str) -> float:
    pid = site.processes[host].pid
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return int(line.split()[1]) / 1024
    return float("nan")


def kills(site: Site, options: argparse.Namespace) -> None:
    """Kill -9 boxes and base at random."""
    chance = random.Random(SEED)
    print(f"seed {SEED}")
    recoveries: dict[str, list[float]] = {"box": [], "base": []}
    for _ in range(options.times):
        host = chance.choice(("base", *CAMERAS))
        time.sleep(chance.uniform(0.0, 1.0))
        site.kill(host)
        killed_ns = time.time_ns()
        site.start(host)
        whom = set(CAMERAS) if host == "base" else {host}
        took_s = wait(lambda: whom <= _heard_since(site, killed_ns), 30.0)  # noqa: B023 -- called here
        recoveries["base" if host == "base" else "box"].append(took_s)
    time.sleep(3.0)
    made = site.made()
    # The ends of killed runs: rows that no disk had yet.
    last: dict[tuple[str, int], int] = {}
    for camera, epoch, seq in made:
        last[camera, epoch] = max(seq, last.get((camera, epoch), -1))

    def lost() -> list[tuple[str, int, int]]:
        return [k for k in made - keys(site.recorded()) if last[k[0], k[1]] - k[2] > 20]

    wait(lambda: not lost(), PATIENCE_S)
    rows = site.recorded()
    all_lost = made - keys(rows)
    print(f"{options.times} kills: {len(all_lost)} of {len(made)} lost, {len(lost())} not in the last 0.5 s of a run")
    for what, times_s in recoveries.items():
        told = f"back after {np.median(times_s):.1f} s, {max(times_s):.1f} s at worst (asked: 5)"
        print(f"{what}: {len(times_s)} times, {told}")
    misses = site.misses_m()
    if len(misses):
        worst = f"p95 {np.percentile(misses, 95):.2f} m, at worst {np.max(misses):.2f} m from the truth"
        print(f"positions sent: {len(misses)}, {worst}")
    for camera in CAMERAS:
        site.kill(camera)
        store = SpoolStore(site.folder / f"{camera}.sqlite", max_bytes=10**9)  # checks the file
        print(f"{camera}: spool is sound, {sum(item.rows for item in store.inventory())} rows")
        store.close()


def _heard_since(site: Site, t_unix_ns: int) -> set[str]:
    return {row.camera for row in site.recorded(since_unix_ns=t_unix_ns) if not row.late and row.t_unix_ns > t_unix_ns}


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description="What faults cost, measured on real processes in namespaces.")
    parser.add_argument("fault", choices=("partition", "storm", "frozen", "kills"))
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--times", type=int, default=50)
    options = parser.parse_args()
    if reason := possible():
        print(reason, file=sys.stderr)
        return 1
    with tempfile.TemporaryDirectory() as temporary, Air("base", *CAMERAS) as air:
        flight = Path(temporary) / "flight"
        command = [sys.executable, "-m", "tools.simulate", str(ROOT / "deploy" / "scenes" / "demo.toml")]
        subprocess.run([*command, "-o", str(flight)], check=True, cwd=ROOT, stdout=subprocess.DEVNULL)
        site = Site(air, Path(temporary), flight)
        try:
            settle(site)
            {"partition": partition, "storm": storm, "frozen": frozen, "kills": kills}[options.fault](site, options)
        finally:
            site.bury()
    return 0


if __name__ == "__main__":
    sys.exit(main())
