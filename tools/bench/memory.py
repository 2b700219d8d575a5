"""Whether a box's link and spool keep their size: messages at many times the pace of a camera, memory once a minute.

    python -m tools.bench.memory --minutes 36 --speed 10       six hours of a 30 Hz camera in 36 minutes

The base is there half of the time only, so that the queues fill and the spool is asked; the spool is small, so that its
oldest rows go. Prints the memory of the box's process as it went, and how much the last third is above the first.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Final

import numpy as np

from calib.station.backfill import Backfill
from edge.link import Link
from edge.link_profile import LinkSettings
from edge.messages import Detection, Tracks, camera_key, decode, encode
from edge.spool import Spool, SpoolSettings

ENDPOINT: Final = "tcp/127.0.0.1:27448"
KEY: Final = camera_key("field", "cam0", "tracks")
RATE_HZ: Final = 30.0
PRESENCE_S: Final = 40.0  # the base is there for so long, and away for as long
DETECTION: Final = Detection(
    track=1,
    u_px=640.0,
    v_px=360.0,
    ray_x=0.01,
    ray_y=0.01,
    width_px=8.0,
    height_px=6.0,
    score=0.9,
    status="confirmed",
)


def box(folder: str, speed: float, seconds: float) -> None:
    """The box's process."""
    with Link(LinkSettings(connect=(ENDPOINT,)), name="box") as link:
        requests = link.serve(camera_key("field", "cam0", "backlog"))
        with Spool(SpoolSettings(file=str(Path(folder) / "spool.sqlite"), max_mb=20), requests) as spool:
            began = next_s = time.monotonic()
            seq = 0
            while next_s < began + seconds:
                now_ns = time.time_ns()
                message = Tracks(
                    t_unix_ns=now_ns,
                    seq=seq,
                    epoch=1,
                    clock_bound_s=0.001,
                    size_px=(1280, 720),
                    readout_s=0.01,
                    detections=[DETECTION] * 3,
                )
                payload = encode(message)
                spool.keep(1, seq, now_ns, payload)
                link.publish_bytes(KEY, payload)
                seq += 1
                next_s += 1.0 / (RATE_HZ * speed)
                time.sleep(max(0.0, next_s - time.monotonic()))


def visit(seconds: float) -> tuple[int, int]:
    """A base that hears and asks for a while; how many rows came live and late."""
    live = late = 0
    with Link(LinkSettings(listen=(ENDPOINT,)), name="base") as link:
        inbox = link.subscribe(KEY, 4096)
        with Backfill(link, "field") as backfill:
            ends = time.monotonic() + seconds
            while time.monotonic() < ends:
                link.wait(0.1)
                for item in inbox.drain():
                    backfill.have("cam0", decode(item.payload, Tracks, where=KEY))
                    live += 1
                late += len(backfill.late.drain())
    return live, late


def rss_mb(pid: int) -> float:
    """The resident memory of a process."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith("VmRSS"))


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description="Whether a box's link and spool keep their size.")
    parser.add_argument("--minutes", type=float, default=36.0)
    parser.add_argument("--speed", type=float, default=10.0)
    parser.add_argument("--box", help=argparse.SUPPRESS)
    options = parser.parse_args()
    seconds = options.minutes * 60
    if options.box:
        box(options.box, options.speed, seconds)
        return 0
    sizes = []
    with tempfile.TemporaryDirectory() as folder:
        own = [sys.executable, "-m", "tools.bench.memory", "--box", folder]
        with subprocess.Popen([*own, "--minutes", str(options.minutes), "--speed", str(options.speed)]) as process:
            began = time.monotonic()
            while time.monotonic() - began < seconds - 2 * PRESENCE_S:
                live, late = visit(PRESENCE_S)
                time.sleep(PRESENCE_S)
                sizes.append(rss_mb(process.pid))
                print(
                    f"{(time.monotonic() - began) / 60:5.1f} min: {sizes[-1]:.1f} MB, {live} live, {late} late",
                    flush=True,
                )
            process.terminate()
    third = max(1, len(sizes) // 3)
    growth = float(np.mean(sizes[-third:]) / np.mean(sizes[:third]) - 1)
    print(f"growth from the first third to the last: {growth:+.1%} (asked: 5 %)")
    return 0


if __name__ == "__main__":
    sys.exit(main())
