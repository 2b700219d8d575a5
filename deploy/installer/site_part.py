"""A machine's part of a site: made with the base, carried to each box, laid where the programs look for it.

The hazard is the site that two people typed: a box that dials an address on which nobody listens, with a certificate
that nobody made. So the base's installation makes the parts of all machines, `base-station init` writing them, and a
box takes its own. A part is a folder: ROLE.toml, the files that stand beside it, and the certificates.
"""

import argparse
import contextlib
import errno
import ipaddress
import os
import re
import shutil
import socket
import subprocess
import tomllib
from pathlib import Path
from typing import Any, Final

from .configuration import PORT, write
from .machine import USER
from .places import ROLES, Role
from .telling import RefusedError, say, warn

PEMS: Final = ("authority.pem", "certificate.pem", "key.pem")
BESIDE: Final = {"edge": "*.lens.toml", "base": "survey.toml"}  # the configuration, and with it
BEARS: Final = {"edge": "camera", "base": "station", "router": "router"}  # the role in its certificate
CERTIFICATES: Final = "/etc/skyfix/certs"  # as configurations name it


def check(wanted: argparse.Namespace, role: Role, config: Path) -> None:
    """Before anything is changed. Raises RefusedError for a part that is none, another's, or would be made twice."""
    if wanted.carried is None:
        wanted.carried = _lies_here(wanted, role)
    part: Path | None = wanted.carried
    if part is None:
        folder = Path(wanted.site or "")
        if _makes(wanted, role, config) and wanted.site and folder.exists():
            raise RefusedError(f"{folder.resolve()} is there already", f"give --from {folder}, or move it away", 2)
        return
    pems = _pems(part, role)
    if not (part / f"{role.name}.toml").exists() and pems is None:
        raise RefusedError(f"{part} has no {role.name}.toml and no certificates", "carry it here from the base", 2)
    said = _said_by(pems) if pems else {}
    if said.get("role", BEARS[role.name]) != BEARS[role.name]:
        raise RefusedError(f"the certificate in {part} is a {said['role']}'s", f"give the {role.name}'s own folder", 2)
    _check_names(wanted, role, said)


def _check_names(wanted: argparse.Namespace, role: Role, said: dict[str, str]) -> None:
    """What is typed beside a part is what stands in it. said: by its certificate."""
    part = wanted.carried
    read = _read(part, role)
    site = read.get("site", {}).get("name") if role.name == "base" else read.get("site")
    stands: dict[str, list[str | None]] = {"site": [site, said.get("site")]}
    if role.name == "edge":
        stands["camera"] = [each.get("id") for each in read.get("camera", ())] or [*said.get("cameras", "").split()]
        stands["base"] = [base_of(part, role)]
    for option, found in stands.items():
        given, known = getattr(wanted, option), [each for each in found if each not in (None, "*")]
        if given and known and given not in known:
            raise RefusedError(f"{part} is of {option} {known[0]}, not {given}", f"leave --{option} away", 2)


def _lies_here(wanted: argparse.Namespace, role: Role) -> Path | None:
    """A box's part where it is typed, for whoever names site and camera instead of the folder."""
    if role.name != "edge" or not wanted.site or not wanted.camera:
        return None
    part = Path(str(wanted.site)) / str(wanted.camera)
    if not (part / "edge.toml").exists():
        return None
    say(f"taking {part}, which lies here")
    return part


def _makes(wanted: argparse.Namespace, role: Role, config: Path) -> bool:
    return role.name == "base" and bool(wanted.base) and not (config / "base.toml").exists()


def part_of(wanted: argparse.Namespace, role: Role, config: Path, version: Path) -> Path | None:
    """The part to lay: what was carried here, or a new site's, made by that version; None: neither was asked for."""
    if wanted.carried is not None:
        return Path(wanted.carried)
    if not _makes(wanted, role, config):
        return None
    if wanted.site is None:
        raise RefusedError("a base that boxes dial needs its site's name", "give --site NAME as well", 2)
    folder = Path(wanted.site)
    words = ["init", wanted.site, "--cameras", str(wanted.cameras), "--base", wanted.base, "--certs", "-o", str(folder)]
    done = subprocess.run([str(version / "bin/base-station"), *words], capture_output=True, text=True, check=False)
    if done.returncode:
        told = (done.stderr or done.stdout).strip().splitlines()[-1:]
        raise RefusedError(f"the site could not be made: {' '.join(told)}", "nothing was changed", done.returncode)
    _give_to_whoever_typed(folder)
    if not _is_here(wanted.base):
        warn(f"{wanted.base} is no address of this machine now: boxes dial that, and it stands in its certificate")
    boxes = " ".join(str(box.parent) for box in sorted(folder.glob("*/edge.toml")))
    say(
        f"made {folder.resolve()}; carry to each box its own folder ({boxes}), and there: install.sh edge --from FOLDER"
    )
    say(f"{folder}/certs/authority.key makes machines of this site: move {folder} off this machine afterwards")
    return folder


def _give_to_whoever_typed(folder: Path) -> None:
    """They copy it to the boxes, and are root on none of these machines but by sudo."""
    user, group = os.environ.get("SUDO_UID", ""), os.environ.get("SUDO_GID", "")
    if user.isdigit() and group.isdigit():
        for path in (folder, *folder.rglob("*")):
            with contextlib.suppress(PermissionError):  # a stick knows no owners
                os.chown(path, int(user), int(group), follow_symlinks=False)


def _is_here(address: str) -> bool:
    """Whether an address is one of this machine's; a name is believed."""
    try:
        family = socket.AF_INET6 if ipaddress.ip_address(address).version == 6 else socket.AF_INET
        with socket.socket(family, socket.SOCK_DGRAM) as probe:
            probe.bind((address, 0))
    except ValueError:
        return True
    except OSError as error:
        return error.errno != errno.EADDRNOTAVAIL
    return True


def lay_part(part: Path, role: Role, config: Path) -> None:
    """Certificates, new ones over old; what stands beside the configuration, where it is not there yet."""
    pems = _pems(part, role)
    if pems is not None and not _are_newer(config / certificates_of(role, config), pems):
        _lay_certificates(pems, config / certificates_of(role, config))
    listed = part / "certs/access.json"
    if role.name != "edge" and listed.exists():
        write(config / certificates_of(role, config) / "access.json", listed.read_text(), 0o644, "root")
    for file in part.glob(BESIDE.get(role.name, "")) if role.name in BESIDE else ():
        if not (config / file.name).exists():
            write(config / file.name, file.read_text(), 0o640, "root")
            say(f"wrote {config / file.name}")


def _are_newer(here: Path, carried: Path) -> bool:
    """Whether what is here was renewed since: an upgrade by the first line again brings the first ones again."""
    if not all((here / name).exists() for name in PEMS):
        return False
    ours, theirs = _said_by(here), _said_by(carried)
    same = all(ours.get(word) == theirs.get(word) for word in ("site", "role", "cameras"))
    if not same or ours.get("expires", "") <= theirs.get("expires", ""):
        return False
    say(f"{here} stays: it is good for longer than what {carried} has")
    return True


def _lay_certificates(pems: Path, folder: Path) -> None:
    folder.mkdir(exist_ok=True)
    folder.chmod(0o750)
    shutil.chown(folder, "root", USER)
    for name in PEMS:
        private = name == "key.pem"
        write(folder / name, (pems / name).read_text(), 0o600 if private else 0o644, USER if private else "root")
    say(f"wrote {folder}: who this machine is")


def configuration_of(part: Path, role: Role, config: Path) -> str | None:
    """The configuration in a part, with the certificates where they are laid here; None: it has none."""
    file = part / f"{role.name}.toml"
    if not file.exists():
        return None
    return re.sub(rf"{CERTIFICATES}/", f"/etc/skyfix/{certificates_of(role, config)}/", file.read_text())


def certificates_of(role: Role, config: Path) -> str:
    """The folder of a role's certificates below /etc/skyfix: two roles of one machine are two to their site."""
    own = config / f"{role.name}.toml"
    if own.exists():
        return f"certs-{role.name}" if f"{CERTIFICATES}-{role.name}/" in own.read_text() else "certs"
    others = [config / f"{other}.toml" for other in ROLES if other != role.name]
    taken = any(re.search(rf'^key = "{CERTIFICATES}/', other.read_text(), re.M) for other in others if other.exists())
    return f"certs-{role.name}" if taken else "certs"


def base_of(part: Path | None, role: Role) -> str | None:
    """The address of the base that a box's part dials; None if it says none."""
    if part is None or role.name != "edge":
        return None
    for endpoint in _read(part, role).get("link", {}).get("connect", []):
        found = re.fullmatch(rf"tls/\[?(.+?)\]?:{PORT}", endpoint)
        if found:
            return found[1]
    return None


def _pems(part: Path, role: Role) -> Path | None:
    """Where a part's certificates lie: in it, below it, or, in a whole site's folder, where they were issued."""
    places = (part, part / "certs", part / "certs/issued" / role.name)
    return next((place for place in places if all((place / name).exists() for name in PEMS)), None)


def _said_by(pems: Path) -> dict[str, str]:
    """What stands above a certificate: role, site and cameras, by these words; older ones say nothing."""
    heading = (pems / "certificate.pem").read_text(errors="replace").partition("-----BEGIN")[0]
    return {word: value for word, _, value in (line.partition(" ") for line in heading.splitlines())}


def _read(part: Path, role: Role) -> dict[str, Any]:
    """What a part's configuration says; empty if it has none. Raises RefusedError if it cannot be read."""
    try:
        return tomllib.loads((part / f"{role.name}.toml").read_text())
    except FileNotFoundError:
        return {}
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise RefusedError(f"{part}/{role.name}.toml cannot be read ({error})", "correct it", 2) from None
