"""A bench: base and box on one machine, by their examples; a flight that is replayed to the base."""

import subprocess
import sys
from pathlib import Path
from typing import Final

import cv2
import numpy as np

from tools.rehearsal.life import FLOWN_S, PORT, POSITIONS, ROOT, SETTLED_S, WATCH_S, Life
from tools.rehearsal.machine import Machine

FLIGHT: Final = Path(__file__).with_name("flight.toml")
LENS: Final = (
    'lens = { model = "radtan", intrinsics = [300.0, 300.0, 160.0, 120.0], distortion = [0.0, 0.0, 0.0, 0.0], '
    "size_px = [320, 240], rms_px = 0.3 }"
)
# Asked in the machine: does the station hear its first camera.
ONLINE: Final = (
    "import json, urllib.request as u; "
    "print(json.load(u.urlopen('http://127.0.0.1:8080/status.json', timeout=20))['cameras'][0]['online'])"
)


def first_base(life: Life) -> None:
    """A base from a bare machine, by the README's lines."""
    base_is_there(life, life.install("0.1.0", "base"))


def base_is_there(life: Life, done: "subprocess.CompletedProcess[str]") -> None:
    """What an installation says, and what then runs."""
    life.note("a base is installed", done.returncode == 0, done.stdout + done.stderr)
    life.note("the base runs", life.machine.ask("systemctl is-active base-station") == "active", life.state())
    failed = [line for line in done.stdout.splitlines() if line.startswith("FAIL")]
    life.note("the check after it finds no fault", "PASS" in done.stdout and not failed, "; ".join(failed) or "no FAIL")


def flight(life: Life) -> None:
    """A flight replayed to it until MAVLink positions come out."""
    folder = life.machine.root / "root/flight"
    simulate = [sys.executable, "-m", "calib.station.app", "simulate", str(FLIGHT), "-o", str(folder)]
    subprocess.run(simulate, check=True, cwd=ROOT, stdout=subprocess.DEVNULL)
    site = life.machine.ask("grep -m1 ^name /etc/skyfix/base.toml | cut -d'\"' -f2")
    words = (str(PORT), str(POSITIONS), str(FLOWN_S))
    listening = life.machine.on_its_network(sys.executable, "-m", "tools.rehearsal.positions", *words)
    assert listening.stdout is not None
    listening.stdout.readline()
    replay = f"echo $$ >/run/replay; exec base-station replay /root/{folder.name} --site {site}"
    playing = life.machine.start(replay)
    told, errors = listening.communicate()
    played = "still playing" if playing.poll() is None else f"replay ended with {playing.returncode}"
    life.note("positions come out", listening.returncode == 0, f"{told}{errors}{played}; {life.last_words()}")
    life.machine.run("kill $(cat /run/replay)")  # what is to be seen was seen: nobody waits for the rest of the minute
    playing.communicate()
    said = life.machine.journal("base-station", 400)
    forbidden = ("ermission", "not permitted", "Traceback", "Read-only")
    ill = [line for line in said.splitlines() if any(word in line for word in forbidden)]
    life.note("nothing that it asks is forbidden", not ill, "\n".join(ill) or said[-600:])


def second_role(life: Life) -> None:
    """A box on the same machine: the base goes on, and hears it."""
    machine = life.machine
    pid = machine.ask("systemctl show -P MainPID base-station")
    film(machine.root / "root/film.avi")
    machine.run("mkdir -p /etc/skyfix /var/lib/skyfix; cp /root/film.avi /var/lib/skyfix/")
    configure_box(machine)
    done = life.install("0.1.0", f"edge --watch {WATCH_S:g}")
    life.note("a box is installed beside it", done.returncode == 0, done.stdout + done.stderr)
    life.note("both run", life.state() == "0.1.0.2 active active", f"{life.state()}; base was {pid}")
    heard = machine.becomes(f'python3 -c "{ONLINE}"', "True", SETTLED_S)
    life.note("the base hears the box", heard, machine.journal("edge-node", 5))


def film(file: Path) -> None:
    """Ten seconds of a sky with a dot in it."""
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, (320, 240))
    for k in range(100):
        picture = np.full((240, 320, 3), 180, np.uint8)
        picture[100:104, 20 + 2 * k : 24 + 2 * k] = 20
        writer.write(picture)
    writer.release()


def configure_box(machine: Machine, site: str = "field1") -> None:
    """edge.toml as a person would edit the example: a film for a camera, a lens, no receiver."""
    text = (ROOT / "deploy/edge.example.toml").read_text().replace('site = "field1"', f'site = "{site}"')
    text = text.replace(
        'path = "/dev/video0"',
        'path = "/var/lib/skyfix/film.avi"\nrealtime = true\nloop = true\nt0_unix_ns = 1700000000000000000'
        "\nbound_s = 0",
    )
    text = text.replace('lens = "cam0.lens.toml" ', LENS + " ")
    before, _, rest = text.partition("[gnss]")
    text = before + "[spool]" + rest.partition("[spool]")[2]
    (machine.root / "etc/skyfix").mkdir(exist_ok=True)
    (machine.root / "etc/skyfix/edge.toml").write_text(text)
