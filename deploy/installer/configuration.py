"""Configuration where there is none: the example, with the site, the camera and the base's address that were given.

What is there is never touched. A box that is given its base dials it with TLS: nothing else is right in a field.
"""

import argparse
import os
import re
import secrets
import shutil
import sys
import tomllib
from pathlib import Path
from typing import Any, Final

from .machine import USER
from .places import ROLES, Places, Role
from .telling import say, warn

PORT: Final = 7447  # Zenoh's own
SIGNING_KEY_B: Final = 32


def lay_configuration(
    folder: Path, deploy: Path, role: Role, given: dict[str, str | None], carried: str | None = None
) -> bool:
    """The role's configuration, if it has none; whether one was written.

    deploy: where templates and schemas lie. carried: the text that this machine was given instead of a template.
    """
    file = folder / f"{role.name}.toml"
    if file.exists():
        _tell_if_otherwise(file, given)
        return False
    text = carried or filled((deploy / role.template).read_text(), role.name, given)
    text = re.sub(r"\A#:schema .*schema/", f"#:schema {deploy}/schema/", text)
    write(file, text, 0o640, "root")
    say(f"wrote {file}: edit it")
    if role.name == "base" and not (folder / "mavlink.key").exists():
        write(folder / "mavlink.key", secrets.token_hex(SIGNING_KEY_B), 0o600, USER)
    return True


def _tell_if_otherwise(file: Path, given: dict[str, str | None]) -> None:
    """What is there stays, and whoever asked for a base's address has to know that it is not that one."""
    link = tomllib.loads(file.read_text()).get("link", {})
    endpoints = " ".join([*link.get("connect", []), *link.get("listen", [])])
    wanted = "tls/" if file.name == "base.toml" else f"{given.get('base')}"
    if given.get("base") and wanted not in endpoints:
        warn(f"{file} was there and stays as it is: {endpoints}. For a new one move it away and type this again")


def filled(text: str, role: str, given: dict[str, str | None]) -> str:
    """A template with what was given in its place; checked against what a reader of it then finds."""
    site, camera, base = given.get("site"), given.get("camera"), given.get("base")
    if site:
        text = _set(text, "name" if role == "base" else "site", site)
    if camera and role == "edge":
        text = _set(text, "id", camera).replace("cam0.lens.toml", f"{camera}.lens.toml")
    if base and role == "edge":
        address = f"[{base}]" if ":" in base else base
        text = re.sub(r"^connect = .*$", f'connect = ["tls/{address}:{PORT}"]', text, count=1, flags=re.MULTILINE)
        text = _with_certificates(text)
    _check(tomllib.loads(text), role, given)
    return text


def _set(text: str, key: str, value: str) -> str:
    return re.sub(rf'^{key}( *)= "[^"]*"', rf'{key}\g<1>= "{value}"', text, count=1, flags=re.MULTILINE)


def _with_certificates(text: str) -> str:
    for name in ("authority", "certificate", "key"):
        text = re.sub(rf'^# ({name} = "/etc)', r"\g<1>", text, count=1, flags=re.MULTILINE)
    return re.sub(r"^# \[link\.tls\]", "[link.tls]", text, count=1, flags=re.MULTILINE)


def _check(read: dict[str, Any], role: str, given: dict[str, str | None]) -> None:
    """A template whose lines were renamed would swallow what was given."""
    site = read["site"]["name"] if role == "base" else read["site"]
    assert given.get("site") in (None, site), "the template has no place for the site's name"
    if role == "edge":
        assert given.get("camera") in (None, read["camera"][0]["id"]), "the template has no place for the camera"
        assert not given.get("base") or "authority" in read["link"]["tls"], "the template has no place for the base"


def write(file: Path, text: str, mode: int, owner: str) -> None:
    """A file of the machine's, in one step, that the services' group reads if the mode lets it."""
    following = file.with_name(f".{file.name}.new")
    with os.fdopen(os.open(following, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, mode), "w") as opened:
        opened.write(text)
        opened.flush()
        os.fsync(opened.fileno())
    following.chmod(mode)
    shutil.chown(following, owner, USER)
    following.rename(file)


def main() -> int:
    """For a Debian package: `python3 -m installer.configuration ROLE [--site NAME] [--camera ID] [--base ADDRESS]`."""
    parser = argparse.ArgumentParser(prog="installer.configuration")
    parser.add_argument("role", choices=sorted(ROLES))
    for option in ("--site", "--camera", "--base"):
        parser.add_argument(option)
    given = parser.parse_args()
    lay_configuration(Places().config, Path(__file__).parents[1], ROLES[given.role], vars(given))
    return 0


if __name__ == "__main__":
    sys.exit(main())
