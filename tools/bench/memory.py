"""Whether a box keeps its size: six hours of a 30 Hz camera at many times its pace, memory every minute or so.

    python -m tools.bench.memory --node --minutes 36          a whole edge-node, a video again and again, flat out
    python -m tools.bench.memory --minutes 36 --speed 10      its link and spool alone, at ten times a camera's pace

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

import cv2
import numpy as np

from calib.station.archive.backfill import Backfill
from edge.link.link import Link
from edge.link.settings import LinkSettings
from edge.link.spool import Spool, SpoolSettings
from edge.messages import Tracks, camera_key, decode, encode
from tools.doubles.tracks import DETECTION

ENDPOINT: Final = "tcp/127.0.0.1:27448"
KEY: Final = camera_key("field", "cam0", "tracks")
RATE_HZ: Final = 30.0
SIZE: Final = (640, 360)  # px, of the video
SEED: Final = 3
PRESENCE_S: Final = 40.0  # the base is there for so long, and away for as long


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


def visit(seconds: float) -> tuple[int, int, int]:
    """A base that hears and asks for a while; how many rows came live and late, and the last number heard."""
    live = late = last_seq = 0
    with Link(LinkSettings(listen=(ENDPOINT,)), name="base") as link:
        inbox = link.subscribe(KEY, 4096)
        with Backfill(link, "field") as backfill:
            ends = time.monotonic() + seconds
            while time.monotonic() < ends:
                link.wait(0.1)
                for item in inbox.drain():
                    tracks = decode(item.payload, Tracks, where=KEY)
                    backfill.have("cam0", tracks)
                    live, last_seq = live + 1, tracks.seq
                late += len(backfill.late.drain())
    return live, late, last_seq


def rss_mb(pid: int) -> float:
    """The resident memory of a process."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith("VmRSS"))


def film(file: Path) -> None:
    """Twenty seconds of sky with something that flies in it."""
    rng = np.random.default_rng(SEED)
    sky = cv2.GaussianBlur(rng.normal(150, 60, (SIZE[1], SIZE[0], 3)), (0, 0), 9).clip(0, 255)
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter.fourcc(*"mp4v"), RATE_HZ, SIZE)
    for number in range(int(20 * RATE_HZ)):
        frame = (sky + rng.normal(0, 2, sky.shape)).clip(0, 255).astype(np.uint8)
        angle = number / RATE_HZ
        at = (round(SIZE[0] * (0.5 + 0.35 * np.cos(angle))), round(SIZE[1] * (0.5 + 0.3 * np.sin(1.3 * angle))))
        cv2.ellipse(frame, (at, (9, 4), 20.0), (40, 40, 40), -1)
        writer.write(frame)
    writer.release()


def node_toml(folder: Path) -> str:
    """A box whose video never ends and is played without waiting."""
    w, h = SIZE
    lens = f"[camera.lens]\nmodel = 'radtan'\nintrinsics = [{w}.0, {w}.0, {w / 2}, {h / 2}]\ndistortion = [0, 0, 0, 0]"
    source = f"[[camera]]\nid = 'cam0'\nsource = {{ path = '{folder}/flight.mp4', loop = true }}"
    spool = f"[spool]\nfolder = '{folder}'\nmax_mb = 20"
    link = f"[link]\nconnect = ['{ENDPOINT}']"
    return "\n".join(
        ("site = 'field'", source, lens, f"size_px = [{w}, {h}]", spool, "[clock]\nsource = 'assumed'", link)
    )


def command(options: argparse.Namespace, folder: Path) -> list[str]:
    """The box's process."""
    if not options.node:
        own = [sys.executable, "-m", "tools.bench.memory", "--box", str(folder)]
        return [*own, "--minutes", str(options.minutes), "--speed", str(options.speed)]
    film(folder / "flight.mp4")
    (folder / "edge.toml").write_text(node_toml(folder))
    return [sys.executable, "-m", "edge.app", "run", "--config", str(folder / "edge.toml")]


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description="Whether a box keeps its size.")
    parser.add_argument("--minutes", type=float, default=36.0)
    parser.add_argument("--speed", type=float, default=10.0)
    parser.add_argument("--node", action="store_true", help="a whole edge-node, with a video")
    parser.add_argument("--box", help=argparse.SUPPRESS)
    options = parser.parse_args()
    seconds = options.minutes * 60
    if options.box:
        box(options.box, options.speed, seconds)
        return 0
    sizes, last_seq = [], 0
    with tempfile.TemporaryDirectory() as folder, subprocess.Popen(command(options, Path(folder))) as process:
        began = time.monotonic()
        while time.monotonic() - began < seconds - 2 * PRESENCE_S and process.poll() is None:
            live, late, last_seq = visit(PRESENCE_S)
            time.sleep(PRESENCE_S)
            sizes.append(rss_mb(process.pid))
            told = f"{sizes[-1]:.1f} MB, {live} live, {late} late, {last_seq / RATE_HZ / 3600:.2f} h of a camera"
            print(f"{(time.monotonic() - began) / 60:5.1f} min: {told}", flush=True)
        process.terminate()
        code = process.wait()
    third = max(1, len(sizes) // 3)
    growth = float(np.mean(sizes[-third:]) / np.mean(sizes[:third]) - 1)
    print(f"{last_seq} messages; growth from the first third to the last: {growth:+.1%} (asked: 5 %); exit code {code}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
