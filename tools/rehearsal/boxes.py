"""Three boxes beside the base, each a machine of its own, joined by cables: from bare roots to positions over TLS.

What the pages tell is typed; what a person has to bring is brought: where the tripods stand, a lens each, a camera. The
cameras are videos of one flight, rendered here, and the boxes' own programs find it in them.
"""

import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
import tomli_w

from calib.geodesy import enu_to_geodetic
from calib.simulation.description import CameraSpec, Simulation
from calib.station.archive.scene_file import load
from tools.rehearsal.cable import plug
from tools.rehearsal.life import FLOWN_S, PORT, POSITIONS, ROOT, SETTLED_S, Life
from tools.rehearsal.machine import Machine
from tools.rehearsal.pages import line

SCENE: Final = Path(__file__).with_name("boxes.toml")
BASE: Final = "192.168.7.1"  # the address in the pages
BUNDLE: Final = "root/skyfix-0.1.0-bundle.tar"
SITE: Final = "root/hill"  # what the base's installation makes, where it is typed
SUDO: Final = 'sudo() { "$@"; }; cd /root\n'
RENDERED_S: Final = 300.0  # 15 s of two cores; on a busy computer
RECEIVES_S: Final = 4.0  # from saying when the flight begins until it does: three programs start meanwhile
FILM: Final = "/var/lib/skyfix/film.mp4"
# How many of these cameras a base hears, asked in its machine.
HEARD: Final = (
    "import json, urllib.request as u; "
    "s = json.load(u.urlopen('http://127.0.0.1:8080/status.json', timeout=20)); "
    "print(*sorted(c['id'] for c in s['cameras'] if c['online']))"
)


@dataclass
class Field:
    """The base's machine and the boxes', by camera."""

    life: Life
    rendering: "subprocess.Popen[bytes]"
    scene: Simulation = field(default_factory=lambda: load(SCENE))
    boxes: dict[str, Machine] = field(default_factory=dict)
    said: dict[str, "subprocess.CompletedProcess[str]"] = field(default_factory=dict)
    began_s: float = field(default_factory=time.monotonic)

    def camera(self, name: str) -> CameraSpec:
        """A camera of the scene."""
        return next(camera for camera in self.scene.camera if camera.id == name)


@contextmanager
def boxes(life: Life) -> Iterator[Field]:
    """Three bare machines on the base's network; their videos are being rendered."""
    render = ["nice", sys.executable, "-m", "tools.render", str(SCENE), "-o", str(life.bundles / "footage")]
    with ExitStack() as stack, subprocess.Popen(render, cwd=ROOT, stdout=subprocess.DEVNULL) as rendering:
        stack.callback(rendering.kill)
        there = Field(life, rendering)
        for camera in there.scene.camera:
            there.boxes[camera.id] = stack.enter_context(Machine(life.bare, f"skyfix-{camera.id}"))
        plug(life.machine, BASE, {f"192.168.7.{10 + k}": box for k, box in enumerate(there.boxes.values())})
        yield there


def carry(there: Field) -> None:
    """The bundle, and each box's own folder of the site: with a stick, or by scp, which a person types."""
    for camera, box in there.boxes.items():
        shutil.copyfile(there.life.machine.root / BUNDLE, box.root / BUNDLE)
        shutil.copytree(there.life.machine.root / SITE / camera, box.root / SITE / camera)


def install_others(there: Field, first: str) -> None:
    """The lines of README.md on the boxes but the first, each with its own camera, side by side.

    By somebody whose files nobody else may read: the services' user reads the programs nevertheless.
    """
    lines = [line("README.md", words).replace(first, "{camera}") for words in ("tar xf", "install.sh edge")]

    def install(camera: str) -> None:
        typed = "\n".join(lines).format(camera=camera)
        there.said[camera] = there.boxes[camera].run(f"umask 077\n{SUDO}{typed}", timeout_s=900)

    threads = [threading.Thread(target=install, args=[camera]) for camera in there.boxes if camera != first]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


def survey(there: Field) -> None:
    """Where the lenses are, typed in on the base, as deploy/GUIDE.md says."""
    enter = "base-station survey --config /etc/skyfix/base.toml enter"
    for camera in there.scene.camera:
        lat, lon, height = enu_to_geodetic(np.array([camera.centre_enu]), there.scene.origin)[0].tolist()
        place = f"{camera.id} {lat:.9f} {lon:.9f} {height:.3f} --sigma 0.02 0.02 0.04"
        done = there.life.machine.run(f"{enter} {place}")
        if done.returncode:
            there.life.note("a position is typed in", False, done.stdout + done.stderr)
    there.life.machine.run("systemctl restart base-station")


def bring_cameras(there: Field) -> int:
    """A lens and a camera to each box; its configuration corrected, its service restarted.

    Returns when the flight begins, UTC in ns.
    """
    there.rendering.wait(RENDERED_S)
    for camera, box in there.boxes.items():
        shutil.copyfile(there.life.bundles / "footage" / f"{camera}.mp4", box.root / FILM.lstrip("/"))
        spec = there.camera(camera)
        lens: dict[str, object] = {
            "model": spec.lens,
            "intrinsics": list(spec.intrinsics),
            "distortion": list(spec.distortion),
        }
        lens |= {"size_px": list(spec.size_px), "rms_px": 0.3}
        (box.root / f"etc/skyfix/{camera}.lens.toml").write_text(tomli_w.dumps(lens))
    began_ns = time.time_ns() + round(RECEIVES_S * 1e9)
    for camera, box in there.boxes.items():
        file = box.root / "etc/skyfix/edge.toml"
        played = there_from(began_ns + round(there.camera(camera).phase_s * 1e9))
        (before, after) = file.read_text().split('path = "/dev/video0"')
        file.write_text(f"{before}{played}{after}")
        box.run("systemctl restart --no-block edge-node")
    return began_ns


def there_from(t_unix_ns: int) -> str:
    """The lines of a camera that is a video, whose first frame is of that instant, again and again."""
    times = f"bound_s = 0\nt0_unix_ns = {t_unix_ns}\nstart_at_unix_ns = {t_unix_ns}"
    return f'path = "{FILM}"\nrealtime = true\nloop = true\n{times}'


def flown(there: Field) -> None:
    """The boxes' own programs see it, the base's own says where it is."""
    life = there.life
    survey(there)
    began_ns = bring_cameras(there)
    words = [str(PORT), str(POSITIONS), str(FLOWN_S), "--scene", str(SCENE), "--began", str(began_ns)]
    listening = life.machine.on_its_network(sys.executable, "-m", "tools.rehearsal.positions", *words)
    heard = life.machine.becomes(f'python3 -c "{HEARD}"', " ".join(there.boxes), SETTLED_S)
    told = "" if heard else "\n".join(box.journal("edge-node") for box in there.boxes.values())
    life.note("the base hears every box", heard, told or life.machine.ask("base-station check | grep security"))
    positions, errors = listening.communicate()
    life.note("positions come out", listening.returncode == 0, f"{positions}{errors}; {life.last_words()}")


def forbidden(there: Field) -> None:
    """What the units said of being kept from something."""
    said = [there.life.machine.journal("base-station", 400)]
    said += [box.journal("edge-node", 400) for box in there.boxes.values()]
    words = ("ermission", "not permitted", "Traceback", "Read-only")
    ill = [each for text in said for each in text.splitlines() if any(word in each for word in words)]
    there.life.note("nothing that they ask is forbidden", not ill, "\n".join(ill) or said[1][-600:])


def revoked(there: Field, camera: str) -> None:
    """A box that was stolen: off the list, and heard no more, while the others are."""
    machine = there.life.machine
    pid = machine.ask("systemctl show -P MainPID base-station")
    machine.run(f"cd /root/hill && base-station certs revoke {camera} && cp certs/access.json /etc/skyfix/certs/")
    now = "p=$(systemctl show -P MainPID base-station)"
    again = machine.becomes(
        f"{now}; [ $p != 0 ] && [ $p != {pid} ] && systemctl is-active base-station", "active", 60.0
    )
    others = " ".join(name for name in there.boxes if name != camera)
    heard = machine.becomes(f'python3 -c "{HEARD}"', others, SETTLED_S)
    told = there.boxes[camera].ask("edge-node check --config /etc/skyfix/edge.toml | grep -E '^[A-Z]+ +link'")
    fine = again and heard and told.startswith("FAIL")
    there.life.note(
        "a box that was revoked is heard no more", fine, told or there.boxes[camera].journal("edge-node", 4)
    )
