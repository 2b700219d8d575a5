"""Whether memory stays flat: `python -m tools.bench.edge_memory VIDEO [--seconds 3600]`: a looped video through a node.

Also says how long it took from the start of the process to the first message. Run it alone on the machine.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import cv2

CONFIG = """
site = "bench"
[[camera]]
id = "cam1"
source = {{ path = "{video}", realtime = true, loop = true }}
lens = {{ model = "radtan", intrinsics = [{w}.0, {w}.0, {cx}, {cy}], distortion = [0, 0, 0, 0], size_px = [{w}, {h}] }}
"""
PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")


def resident_mb(pid: int) -> float:
    """Memory a process holds."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * PAGE_BYTES / 1e6


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("video", type=Path)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--samples", type=int, default=12)
    arguments = parser.parse_args()
    capture = cv2.VideoCapture(str(arguments.video))
    w, h = (int(capture.get(prop)) for prop in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
    with tempfile.TemporaryDirectory() as folder:
        file, shown = Path(folder) / "edge.toml", Path(folder) / "first.jpg"
        file.write_text(CONFIG.format(video=arguments.video.resolve(), w=w, h=h, cx=(w - 1) / 2, cy=(h - 1) / 2))
        began = time.monotonic()
        node = subprocess.Popen(
            [sys.executable, "-m", "edge.app", "run", "--config", str(file), "--preview", str(shown)]
        )
        while not shown.exists() and node.poll() is None:
            time.sleep(0.02)
        print(f"first frame shown after {time.monotonic() - began:.2f} s, of which up to 0.5 s is the preview's rate")
        for _ in range(arguments.samples):
            time.sleep(arguments.seconds / arguments.samples)
            print(f"{time.monotonic() - began:6.0f} s  {resident_mb(node.pid):6.1f} MB", flush=True)
        node.terminate()
        return node.wait()


if __name__ == "__main__":
    sys.exit(main())
