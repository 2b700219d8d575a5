"""Other people's programs that tests ask: which Debian package each is in, or that `make peers` lays them beside ours,
and what a test without one does.

The hazard is the test that nobody runs: a machine without a browser passes every test of the page by skipping it. So
`make test` skips with the package's name, for a person who wants no browser; and where SKYFIX_REQUIRE_PROGRAMS is set,
as `.ci/run` sets it, the same test fails. Standard library only: `.ci/run` asks this file for the list of packages
before anything is installed.
"""

import os
import shutil
from pathlib import Path
from typing import Final

PACKAGES: Final = {
    "buildah": "buildah",
    "chromedriver": "chromium-driver",
    "chromium": "chromium",
    "chronyd": "chrony",
    "dpkg-deb": "dpkg",
    "ffmpeg": "ffmpeg",
    "gpsdecode": "gpsd-clients",
    "ip": "iproute2",
    "lintian": "lintian",
    "mmdebstrap": "mmdebstrap",
    "nsenter": "util-linux",
    "pipx": "pipx",
    "pmc": "linuxptp",
    "ptp4l": "linuxptp",
    "setpriv": "util-linux",
    "socat": "socat",
    "ssh-keygen": "openssh-client",
    "str2str": "rtklib",
    "systemd-analyze": "systemd",
    "systemd-nspawn": "systemd-container",
    "tshark": "tshark",
    "unshare": "util-linux",
}
PEERS: Final = Path(__file__).parents[1] / ".venv" / "peers"  # MAVProxy, and MAVSDK that it is installed with
MAVPROXY: Final = "mavproxy.py"
REQUIRED: Final = "SKYFIX_REQUIRE_PROGRAMS"  # environment variable: a missing program is a failure, not a skip


def missing(program: str) -> str:
    """Why a test that asks this program cannot run here; empty if it can. KeyError: it is not listed."""
    if program == MAVPROXY:
        return "" if (PEERS / "bin" / program).exists() else "MAVProxy and MAVSDK are not installed (make peers)"
    package = PACKAGES[program]
    return "" if shutil.which(program) else f"{program} is not installed (Debian package {package})"


def required() -> bool:
    """Whether a missing program fails the test."""
    return bool(os.environ.get(REQUIRED))


if __name__ == "__main__":
    print(*sorted(set(PACKAGES.values())))  # noqa: T201 -- .ci/run reads it
