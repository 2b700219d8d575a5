"""Each flood, and what it costs the others: positions a second and their delays, with and without, in turn.

    python -m tools.bench.floods [--seconds 15] [--rounds 2] [--floods questions detections]

A real base, three honest boxes, a listener over UDP, and one flood (tools/doubles/flooders.py) after the other, each in
turn with none: what else the machine does falls on both. Exit code 1 if one takes more than a fifth.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from tools.doubles.base import ROOT, SPEC, Base, scene_config
from tools.doubles.feed import boxes
from tools.doubles.flight import make
from tools.doubles.flooders import FLOODER, KINDS
from tools.doubles.listener import Listener
from tools.doubles.ports import free_endpoint, free_port

UNCHANGED: Final = 0.2  # of positions and of their 99th percentile
BEFORE_AND_AFTER_S: Final = 60.0  # of flight: until the first position, and what starting processes takes
SETTLES_S: Final = 2.0  # after each change, not measured
TOKEN: Final = "0123456789abcdef"


def measured(ear: Listener, seconds: float) -> tuple[float, list[float]]:
    """Positions a second and their delays, ms, validity to arrival: only differences mean something."""
    time.sleep(SETTLES_S)
    before = len(ear.positions)
    time.sleep(seconds)
    came = ear.positions[before:]
    return len(came) / seconds, [(one.received_ns - one.time_ns) * 1e-6 for one in came]


def flooding(kind: str, target: str, seconds: float) -> "subprocess.Popen[bytes]":
    """One flood, under way."""
    command = [sys.executable, "-m", "tools.doubles.flooders", kind, target, str(seconds)]
    return subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def compare(ear: Listener, kind: str, target: str, seconds: float, rounds: int) -> bool:
    """Print what a flood changes; whether that is little."""
    rates: dict[bool, list[float]] = {False: [], True: []}
    delays: dict[bool, list[float]] = {False: [], True: []}
    for number in range(2 * rounds):
        floods = number % 2 == 1
        process = flooding(kind, target, seconds + SETTLES_S + 1) if floods else None
        rate, own = measured(ear, seconds)
        rates[floods].append(rate)
        delays[floods] += own
        if process is not None:
            process.kill()
            process.wait()
    least_ms = min(delays[False] + delays[True], default=0.0)
    calm, flooded = (np.mean(rates[which]) for which in (False, True))
    p99 = [float(np.percentile(delays[which], 99)) - least_ms if delays[which] else np.inf for which in (False, True)]
    print(f"{kind:12} {calm:9.1f} {flooded:9.1f} {p99[0]:9.1f} {p99[1]:9.1f}", flush=True)
    return bool(flooded > (1 - UNCHANGED) * calm and p99[1] < (1 + UNCHANGED) * p99[0])


def main() -> int:
    """The table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=15.0, help="of each measurement")
    parser.add_argument("--rounds", type=int, default=2, help="calm and flooded, each so often")
    parser.add_argument("--floods", nargs="+", choices=KINDS, default=list(KINDS))
    options = parser.parse_args()
    whole, flown_s = True, 2 * options.rounds * (options.seconds + SETTLES_S) + BEFORE_AND_AFTER_S
    for kind in options.floods:
        with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
            ear, scene, served = stack.enter_context(Listener()), make(replace(SPEC, duration_s=flown_s)), free_port()
            token = Path(folder) / "token"
            token.touch(0o600)
            token.write_text(TOKEN)
            cameras = [{"id": camera.id} for camera in scene.truth] + [{"id": FLOODER}]
            endpoints = [{"url": url, "profile": ["ecef"]} for url in (ear.url, f"tcpin:127.0.0.1:{served}")]
            status = {"token_file": "token"} if kind == "tokens" else {}
            config = scene_config(
                scene, free_endpoint(), camera=cameras, mavlink={"endpoint": endpoints}, status=status
            )
            base = Base(Path(folder), config, scene.network)
            base.start()
            stack.callback(base.kill)
            stack.enter_context(boxes(scene, base.zenoh))
            if not ear.wait(30, 60.0):
                raise SystemExit(f"no position came\n{base.log()}")
            if kind == options.floods[0]:
                print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors, {options.rounds} rounds")
                print("flood        calm pos/s  flooded calm p99 ms  flooded")
            targets = {"silence": f"http://127.0.0.1:{served}", "questions": base.zenoh, "detections": base.zenoh}
            target = targets.get(kind, base.url)
            whole &= compare(ear, kind, target, options.seconds, options.rounds)
            told = [line for line in base.health().values() if line[0] != "ok"] if kind != "tokens" else []
            print(f"{'':12} log {len(base.log()) // 1000} kB; said: {told}"[:240])
    print(f"load {os.getloadavg()[0]:.1f}")
    return int(not whole)


if __name__ == "__main__":
    sys.exit(main())
