"""Play a bench scene over real Zenoh, at real rate, as if the boxes were there.

`python -m tools.doubles.feed --connect tcp/127.0.0.1:7447 --seconds 60 --uavs 3`
"""

import argparse
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from edge.link.link import Link
from edge.link.settings import LinkSettings
from edge.messages import MESSAGES, camera_key, camera_of_key, decode
from tools.doubles.box_messages import SITE, Sent, messages
from tools.doubles.flight import T0_UNIX_NS, Scene, Spec, make


def feed(link: Link, sent: Iterator[Sent], speed: float = 1.0) -> int:
    """Publish messages as they fall due; returns how many."""
    began, count = time.monotonic(), 0
    for message in sent:
        due = began + (message.arrival_ns - T0_UNIX_NS) * 1e-9 / speed
        while (left := due - time.monotonic()) > 0:
            time.sleep(left)
        topic = message.key.rpartition("/")[2]
        if topic in {"lens", "fix"}:
            link.set_state(message.key, decode(message.payload, MESSAGES[f"cam/{topic}"], where=message.key))
        else:
            link.publish_bytes(message.key, message.payload)
        count += 1
    return count


@contextmanager
def boxes(scene: Scene, endpoint: str) -> Iterator[None]:
    """Boxes that say what the scene's cameras see, in real time, for as long as the context lasts."""
    ready, stop = list(messages(scene)), threading.Event()

    def until_stopped() -> Iterator[Sent]:
        for message in ready:
            if stop.is_set():
                return
            yield message

    with Link(LinkSettings(connect=(endpoint,)), name="boxes") as link:
        thread = threading.Thread(target=lambda: feed(link, until_stopped()))
        thread.start()
        try:
            yield
        finally:
            stop.set()
            thread.join()


def main() -> None:
    """Feed a station."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--connect", default="tcp/127.0.0.1:7447")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--cameras", type=int, default=6)
    parser.add_argument("--uavs", type=int, default=3)
    parser.add_argument("--birds", type=int, default=0)
    parser.add_argument("--rate", type=float, default=30.0)
    parser.add_argument("--speed", type=float, default=1.0)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    spec = Spec(
        cameras=options.cameras,
        uavs=options.uavs,
        birds=options.birds,
        rate_hz=options.rate,
        duration_s=options.seconds,
        seed=options.seed,
    )
    ready = list(messages(make(spec)))  # made beforehand: making them costs more than sending
    with Link(LinkSettings(connect=(options.connect,)), name="feed") as link:
        for camera in sorted({camera_of_key(message.key) or "" for message in ready}):
            link.declare_presence(camera_key(SITE, camera))
        link.wait_open(10.0)
        print(f"seed {options.seed}: sending {len(ready)} messages", flush=True)
        print(f"{feed(link, iter(ready), options.speed)} sent; {link.counters}")


if __name__ == "__main__":
    main()
