"""Where things lie on a machine, and which roles it may have."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final


@dataclass(frozen=True)
class Role:
    """One thing a machine can be. extras: of the wheel; program: whose `check` says what is missing."""

    name: str
    unit: str
    extras: tuple[str, ...]
    program: str | None
    template: str


ROLES: Final = {
    role.name: role
    for role in (
        Role("edge", "edge-node", ("box",), "edge-node", "edge.example.toml"),
        Role("base", "base-station", ("base", "page", "certs"), "base-station", "base.example.toml"),
        Role("router", "skyfix-router", (), None, "router/router.example.toml"),
    )
}
SERVICES: Final = tuple(role.unit for role in ROLES.values())
PROGRAMS: Final = {"edge-node": "edge.app", "base-station": "calib.station.app"}  # and where each begins


@dataclass(frozen=True)
class Places:
    """The machine's folders. root: another folder than /, in tests."""

    root: Path = Path("/")

    @property
    def prefix(self) -> Path:
        """Every version that is laid."""
        return self.root / "opt/skyfix"

    @property
    def config(self) -> Path:
        """Configuration and certificates."""
        return self.root / "etc/skyfix"

    @property
    def state(self) -> Path:
        """What is measured."""
        return self.root / "var/lib/skyfix"

    @property
    def units(self) -> Path:
        """The administrator's systemd units."""
        return self.root / "etc/systemd/system"

    @property
    def commands(self) -> Path:
        """Where a person's shell finds the programs."""
        return self.root / "usr/local/bin"

    def etc(self, name: str) -> Path:
        """Another program's file below /etc."""
        return self.root / "etc" / name
