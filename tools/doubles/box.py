"""A camera box without a camera: the real link and the real spool, fed with a track folder in place of a lens.

    python -m tools.doubles.box --connect ENDPOINT --site NAME --camera ID --tracks FOLDER --spool FILE --start UNIX_S

Plays the camera's rows in real time, for ever, as if they were seen now. start_unix_s: the instant, the same for all
boxes, at which the flight began. Every Tracks message it makes is written to standard output as `epoch seq stamp late`,
the stamp and by how much it was missed in ns, so that a test knows what ought to arrive.
"""

import argparse
import bisect
import csv
import signal
import threading
import time
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np

from edge.common.own_thread import give_way_soon
from edge.lens import LensModel
from edge.link.link import Link
from edge.link.settings import LinkSettings, TlsSettings
from edge.link.spool import Spool, SpoolSettings
from edge.messages import Lens, Tracks, camera_key, encode
from tools.doubles.tracks import BoxCamera, SeenFrame, rays_of, tracks_message

PAUSE_NS = 10**9  # between the flight's end and its next beginning


class Player:
    """What a camera sees at any instant of its flight, which begins anew when it has ended."""

    def __init__(self, folder: Path, camera: str) -> None:
        site = tomllib.loads((folder / "site.toml").read_text())
        facts = next(item for item in site["camera"] if item["id"] == camera)
        self.camera = BoxCamera(
            LensModel(
                model=facts["lens"],
                intrinsics=tuple(facts["intrinsics"]),
                distortion=tuple(facts["distortion"]),
                size_px=(int(facts["size_px"][0]), int(facts["size_px"][1])),
                rms_px=0.3,
            ),
            facts.get("readout_s"),
        )
        with (folder / "tracks" / f"{camera}.csv").open() as file:
            rows = [row for row in csv.DictReader(file) if row.get("status", "confirmed") == "confirmed"]
        stamps = np.array([int(row["t_unix_ns"]) for row in rows])
        pixels = np.array([[float(row["u_px"]), float(row["v_px"])] for row in rows])
        labels = np.array([int(row["track"]) for row in rows])
        times, begin = np.unique(stamps, return_index=True)
        self.times: list[int] = times.tolist()
        frames = np.split(pixels, begin[1:])
        rays = rays_of(self.camera.lens, frames)
        self._seen = list(map(SeenFrame, self.times, frames, rays, np.split(labels, begin[1:])))

    def message(self, epoch: int, seq: int, index: int, later_ns: int) -> Tracks:
        """A frame, said later_ns after it was seen."""
        seen = self._seen[index]
        return tracks_message(self.camera, epoch, seq, replace(seen, t_unix_ns=seen.t_unix_ns + later_ns))


def index_at(times: list[int], t_unix_ns: int, lap_ns: int) -> int:
    """The first frame not before an instant of the flight, counted on over all its laps."""
    lap, into_ns = divmod(t_unix_ns - times[0], lap_ns)
    return lap * len(times) + bisect.bisect_left(times, times[0] + into_ns)


def lap_of(folder: Path) -> tuple[int, int]:
    """When the flight begins and how long it is until it begins again, in ns; the same for all its cameras."""
    ends = []
    for file in sorted((folder / "tracks").glob("*.csv")):
        lines = file.read_text().splitlines()
        ends += [int(lines[1].split(",")[0]), int(lines[-1].split(",")[0])]
    return min(ends), max(ends) - min(ends) + PAUSE_NS


def link_settings(options: argparse.Namespace) -> LinkSettings:
    """Whom the box dials, and as whom."""
    own: Path | None = options.certificate
    files = {} if own is None else {name: str(own / f"{name}.pem") for name in ("authority", "certificate", "key")}
    return LinkSettings(connect=(options.connect,), mode=options.mode, tls=TlsSettings(**files) if files else None)


def play(options: argparse.Namespace, stop: threading.Event) -> None:
    """Be a box until told to stop."""
    site, camera, folder = options.site, options.camera, options.tracks
    player = Player(folder, camera)
    epoch = time.time_ns() // 10**6
    began_ns, lap_ns = lap_of(folder)
    shift_ns = round(options.start * 1e9) - began_ns
    with Link(link_settings(options), name=camera) as link:
        requests = link.serve(camera_key(site, camera, "backlog"))
        with Spool(SpoolSettings(file=str(options.spool), max_mb=500), requests) as spool:
            link.set_state(camera_key(site, camera, "lens"), Lens.of(player.camera.lens))
            link.declare_presence(camera_key(site, camera))
            seq = 0
            next_one = index_at(player.times, time.time_ns() - shift_ns, lap_ns)
            while not stop.is_set():
                lap, index = divmod(next_one, len(player.times))
                t_unix_ns = player.times[index] + shift_ns + lap * lap_ns
                if stop.wait(max(0.0, (t_unix_ns - time.time_ns()) * 1e-9)):
                    return
                payload = encode(player.message(epoch, seq, index, t_unix_ns - player.times[index]))
                spool.keep(epoch, seq, t_unix_ns, payload)
                link.publish_bytes(camera_key(site, camera, "tracks"), payload)
                print(epoch, seq, t_unix_ns, time.time_ns() - t_unix_ns, flush=True)
                seq += 1
                next_one += 1


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="A camera box that plays a track folder.")
    for name in ("--connect", "--site", "--camera"):
        parser.add_argument(name, required=True)
    for name in ("--tracks", "--spool"):
        parser.add_argument(name, required=True, type=Path)
    parser.add_argument("--start", required=True, type=float, help="UTC second at which the flight begins")
    parser.add_argument("--mode", default="peer", choices=("peer", "client"))
    parser.add_argument("--certificate", type=Path, help="folder made by base-station certs issue; none: without TLS")
    return parser.parse_args()


if __name__ == "__main__":
    stopping = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stopping.set())
    give_way_soon()  # as edge-node does
    play(_options(), stopping)
