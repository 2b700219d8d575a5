"""What stands above a certificate: for whom it is, as text that a box reads without a parser.

Text before the block is allowed in PEM, and `base-station certs` writes it there. It decides nothing, the certificate
does; it serves to say beforehand that a certificate ends, or that it was carried to the wrong machine. What a site made
before there was a site, a role or a camera in it lacks these lines: then nothing is compared.
"""

import datetime as dt
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Self

HEADING_BYTES: Final = 8192  # a mast of a hundred cameras with long names; the block itself is another 900


@dataclass(frozen=True)
class Heading:
    """Common name, end, and for whom: site ("*" for any), role and cameras; empty where it does not say."""

    common_name: str
    ends: dt.datetime
    site: str = ""
    role: str = ""
    cameras: tuple[str, ...] = ()

    def encoded(self) -> bytes:
        """The lines to write above the certificate."""
        lines = [self.common_name, f"expires {self.ends.isoformat('T', 'seconds')}"]
        said = {"site": self.site, "role": self.role, "cameras": " ".join(self.cameras)}
        lines += [f"{word} {value}" for word, value in said.items() if value]
        return "".join(f"{line}\n" for line in lines).encode()

    @classmethod
    def decoded(cls, text: bytes) -> Self | None:
        """The heading in a file's first bytes; None if its end cannot be told."""
        lines = text.decode(errors="replace").partition("-----BEGIN")[0].splitlines()
        said = {word: value.strip() for word, _, value in (line.partition(" ") for line in lines)}
        name = "" if not lines or lines[0].startswith("expires ") else lines[0].strip()
        try:
            ends = dt.datetime.fromisoformat(said["expires"])
        except (KeyError, ValueError):
            return None
        return cls(
            name,
            ends if ends.tzinfo else ends.replace(tzinfo=dt.UTC),
            said.get("site", ""),
            said.get("role", ""),
            tuple(said.get("cameras", "").split()),
        )


def read_heading(file: Path) -> Heading | None:
    """The heading of a certificate's file; None if there is none, or no file."""
    try:
        with file.open("rb") as opened:
            return Heading.decoded(opened.read(HEADING_BYTES))
    except OSError:
        return None
