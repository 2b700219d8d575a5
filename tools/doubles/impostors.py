"""Impostors at a real site with the production profile: how many messages get in, are believed, and are counted.

One intruder after the other dials the base from a machine of his own: with no certificate, another authority's, one
that has ended, one that was revoked, another camera's; and with the very certificate of the camera he speaks for,
saying again what it said, or what it will say in an hour. Meanwhile every position that goes out is compared with the
truth, in units of its own sigma.
"""

import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec
import numpy as np

from calib.scoring.consistency import CHI2_3_999
from calib.station.archive import recording
from edge.messages import Tracks, camera_key, encode
from tools.doubles.site import ROOT, Site, wait

VICTIM: Final = "cam1"
HOUR_NS: Final = 3600 * 10**9
CALIBRATES_S: Final = 240.0  # the solver steps back behind everything else that a busy machine does
SHOWS_S: Final = 2.5  # until the base's status, made once a second, shows what came
DISBELIEVED: Final = ("repeated", "twins", "future", "past", "leapt", "backwards")


class Impostor(NamedTuple):
    """Who he is: the folder and name of his certificate, and how he changes what he heard; None: as it was."""

    name: str
    certificate: str | None  # below the site's folder
    change: Callable[[Tracks, int], Tracks] | None = None


def earlier_start(tracks: Tracks, _: int) -> Tracks:
    """Yesterday's message of yesterday's start."""
    return msgspec.structs.replace(tracks, epoch=tracks.epoch - 10**6, t_unix_ns=tracks.t_unix_ns - 24 * HOUR_NS)


def an_hour_ahead(tracks: Tracks, number: int) -> Tracks:
    """A message of this start that the box has yet to say, dated ahead."""
    return msgspec.structs.replace(tracks, seq=tracks.seq + 10_000 + number, t_unix_ns=tracks.t_unix_ns + HOUR_NS)


IMPOSTORS: Final = (
    Impostor("no certificate", None),
    Impostor("another authority's certificate", "others/issued/cam1"),
    Impostor("a certificate that has ended", "certs/issued/ended"),
    Impostor("a revoked certificate", "certs/issued/revoked"),
    Impostor("another camera's certificate", "certs/issued/cam2"),
    Impostor("its own, said again", "certs/issued/cam1"),
    Impostor("its own, an earlier start's", "certs/issued/cam1", earlier_start),
    Impostor("its own, dated an hour ahead", "certs/issued/cam1", an_hour_ahead),
)


class Row(NamedTuple):
    """A line of the table. admitted: in the recording, beside the box's own; disbelieved: of those; refused: before."""

    name: str
    said: int
    admitted: int
    disbelieved: int
    refused: int

    @property
    def harmless(self) -> bool:
        """Whether nothing of it was believed, and all of it counted."""
        return self.admitted == self.disbelieved and (self.admitted + self.refused > 0)


def certify(site: Site) -> None:
    """The impostors' certificates, before the base reads its list."""
    site.certs("issue", "ended", "--camera", VICTIM, "--days=-1")
    site.certs("issue", "revoked", "--camera", VICTIM)
    site.certs("revoke", "revoked")
    site.certs("init", site.name, folder="others")
    site.certs("issue", VICTIM, folder="others")


def intrude(site: Site, impostor: Impostor, count: int) -> Row:
    """Let one impostor speak, and see what became of it."""
    before, heard = site.status(), _said(site)
    chosen = [heard[k] for k in np.linspace(0, len(heard) - 1, count).astype(int).tolist()]
    change = impostor.change or (lambda tracks, _: tracks)
    file = site.folder / "payloads"
    file.write_bytes(b"\n".join(encode(change(tracks, number)) for number, tracks in enumerate(chosen)))
    rows, known = len(site.recorded()), set(site.heard.keys)
    said = _speak(site, impostor, file)
    time.sleep(SHOWS_S)
    after = site.status()
    admitted = _strange(site, rows, known)
    doors = ("link_refused_handshakes", "link_refused_messages")
    refused = sum(after["counters"][name] - before["counters"][name] for name in doors)
    disbelieved = sum(_counted(after, name) - _counted(before, name) for name in DISBELIEVED)
    return Row(impostor.name, said, admitted, disbelieved, int(refused))


def _strange(site: Site, since_row: int, known: set[tuple[str, int, int]]) -> int:
    """How many live rows under the victim's key its box did not say, or had said before."""
    rows, strange = site.recorded()[since_row:], 0
    time.sleep(0.5)  # a box notes what it said after it has said it
    made = site.made()
    for row in rows:
        key = (row.camera, row.epoch, row.seq)
        if row.camera == VICTIM and not row.late:
            strange += key not in made or key in known
            known.add(key)
    return strange


def _said(site: Site) -> list[Tracks]:
    """What the victim said so far, in the base's present recording."""
    file = max((site.folder / "recordings").glob("*.mcap"))
    key = camera_key(site.name, VICTIM, "tracks")
    found = [msgspec.json.decode(item.payload, type=Tracks) for item in recording.read(file) if item.key == key]
    epoch = found[0].epoch  # nothing of the impostors before
    return [tracks for tracks in found if tracks.epoch == epoch]


def _speak(site: Site, impostor: Impostor, file: Path) -> int:
    endpoint = site.endpoint if impostor.certificate else site.endpoint.replace("tls/", "tcp/")
    proof = ["--certificate", str(site.folder / impostor.certificate)] if impostor.certificate else []
    words = ["--connect", endpoint, "--key", camera_key(site.name, VICTIM, "tracks"), "--payloads", str(file), *proof]
    program = [sys.executable, "-m", "tools.doubles.intruder", *words]
    spoken = subprocess.run([*site.air.inside("evil"), *program], capture_output=True, text=True, cwd=ROOT, check=True)
    return int(spoken.stdout.split()[-1])


def _counted(status: dict[str, Any], name: str) -> int:
    victim = next(camera for camera in status["cameras"] if camera["id"] == VICTIM)
    return int(victim["counters"].get(name, 0))


def trial(site: Site, count: int, impostors: Sequence[Impostor] = IMPOSTORS) -> tuple[list[Row], float, int]:
    """One impostor after the other; the share of positions within 99.9 % of what they claim, of how many meanwhile."""
    certify(site)
    site.settle()
    if wait(lambda: site.heard.positions_since(0), CALIBRATES_S) == float("inf"):
        raise SystemExit(f"no position came in {CALIBRATES_S:.0f} s: the base says {site.status().get('reason')}")
    began = time.time()
    rows = []
    for impostor in impostors:
        rows.append(intrude(site, impostor, count))
        print("{:34} {:>6} {:>9} {:>12} {:>8}".format(*rows[-1]), flush=True)
    nees = np.array([error.nees for error in site.errors() if error.sent_unix_s > began])
    return rows, float(np.mean(nees <= CHI2_3_999)) if len(nees) else 0.0, len(nees)
