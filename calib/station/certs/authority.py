"""A site's own certificate authority: one folder, four acts.

The folder holds the power to make cameras: its key is 0600, stays on one machine, and nothing in the field needs it. A
certificate's beginning is dated back to 2020, for a box without a battery wakes in the past and must still be let in;
its end is real. Revoking takes a name off access.json, the list that whoever listens reads at start. A name may be
issued again, and what was revoked must stay out: so a common name ends with the fingerprint of the certificate's key.
"""

import datetime as dt
import hashlib
import ipaddress
import re
from pathlib import Path
from typing import Final, NamedTuple

import msgspec
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from edge.common.atomic import write_atomically
from edge.common.errors import ConfigError
from edge.link.access import Access, Role, Subject, load_access
from edge.link.heading import Heading

NOT_BEFORE: Final = dt.datetime(2020, 1, 1, tzinfo=dt.UTC)  # before any box was built; see above
AUTHORITY_DAYS: Final = 3650
MAX_COMMON_NAME: Final = 64  # characters, of X.509
FINGERPRINT: Final = 8  # hexadecimal digits of the key's SHA-256; nobody but the authority can look for a second one
_NAME: Final = re.compile(r"^[A-Za-z0-9_-]{1,64}$")


class Issued(NamedTuple):
    """What `issue` made: the folder to copy to the machine, and until when it is good."""

    folder: Path
    not_after: dt.datetime


class Authority:
    """An authority's folder: authority.pem, authority.key, access.json and issued/<name>/."""

    def __init__(self, folder: Path) -> None:
        """Raises ConfigError if there is no authority in the folder."""
        self.folder = folder
        try:
            self._certificate = x509.load_pem_x509_certificate((folder / "authority.pem").read_bytes())
            key = serialization.load_pem_private_key((folder / "authority.key").read_bytes(), password=None)
        except (OSError, ValueError) as error:
            raise ConfigError(
                f"there is no certificate authority ({error})",
                where=str(folder),
                action="make one with `base-station certs init SITE`, or give its folder with --folder",
            ) from error
        if not isinstance(key, ec.EllipticCurvePrivateKey):
            raise ConfigError(
                "not a key of ours", where=str(folder / "authority.key"), action="restore it from a backup"
            )
        self._key = key

    @classmethod
    def create(cls, folder: Path, site: str, now: dt.datetime) -> "Authority":
        """A new authority for a site. Raises ConfigError if the folder has one already: its certificates would die."""
        if (folder / "authority.key").exists():
            raise ConfigError(
                "there is an authority already", where=str(folder), action="use it, or give another --folder"
            )
        _checked(site)
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        key = ec.generate_private_key(ec.SECP256R1())
        heading = Heading(_bounded(f"{site} authority"), now + dt.timedelta(days=AUTHORITY_DAYS))
        name = _named(heading)
        certificate = (
            _builder(name, name, key, now + dt.timedelta(days=AUTHORITY_DAYS))
            .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
            .add_extension(_usage(signs_certificates=True), critical=True)
            .sign(key, hashes.SHA256())
        )
        write_atomically(folder / "access.json", _encoded(Access(site=site, subjects=())))
        write_atomically(folder / "authority.pem", _under(heading, certificate))
        write_atomically(folder / "authority.key", _pem(key), mode=0o600)
        return cls(folder)

    @property
    def access(self) -> Access:
        """The list of valid certificates."""
        return load_access(self.folder / "access.json")

    def issue(
        self,
        name: str,
        role: Role,
        *,
        cameras: tuple[str, ...],
        addresses: tuple[str, ...],
        days: int,
        now: dt.datetime,
        site: str | None = None,
    ) -> Issued:
        """Key and certificate for one machine, under issued/<name>; what the name had before is off the list.

        cameras: whom it speaks for (role camera; its own name if none is given). addresses: the host names and IP
        addresses under which others dial it: a listener without them is refused by every box. site: where it belongs,
        if one authority serves several sites; "*" for a headquarters that listens to all of them.
        """
        for text in (name, *cameras, "any" if site is None or site == "*" else site):
            _checked(text)
        speaks_for = (cameras or (name,)) if role == "camera" else ()
        rights = Subject(common_name="", role=role, site=site, cameras=speaks_for, not_after="")
        made, subject = self._make(name, rights, addresses, now + dt.timedelta(days=days))
        self._list(*(other for other in self.access.subjects if other.name != name), subject)
        return made

    def renew(self, name: str, *, days: int, now: dt.datetime) -> Issued:
        """A new key and certificate with the same name, rights and addresses.

        The one before stays on the list until it ends, so that the machine is heard while the new one is carried to it.
        """
        subject = self._subject(name)
        old = x509.load_pem_x509_certificate((self.folder / "issued" / name / "certificate.pem").read_bytes())
        names = old.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
        addresses = tuple(str(entry.value) for entry in names if str(entry.value) != _common_name(old))
        made, new = self._make(name, subject, addresses, now + dt.timedelta(days=days))
        self._list(*(other for other in self.access.subjects if other.ends is None or other.ends > now), new)
        return made

    def revoke(self, name: str) -> None:
        """Take a name off the list. It takes effect where access.json is copied to and the listener restarts."""
        self._subject(name)
        self._list(*(subject for subject in self.access.subjects if subject.name != name))

    def _subject(self, name: str) -> Subject:
        """The newest certificate of a machine."""
        subjects = self.access.subjects
        for subject in reversed(subjects):
            if subject.name == name:
                return subject
        known = ", ".join(dict.fromkeys(subject.name for subject in subjects)) or "nobody"
        raise ConfigError(f"{name} has no certificate here", where=str(self.folder), action=f"known are: {known}")

    def _list(self, *subjects: Subject) -> None:
        write_atomically(self.folder / "access.json", _encoded(Access(site=self.access.site, subjects=subjects)))

    def _make(self, name: str, rights: Subject, addresses: tuple[str, ...], end: dt.datetime) -> tuple[Issued, Subject]:
        key = ec.generate_private_key(ec.SECP256R1())
        ends = min(end, self._certificate.not_valid_after_utc)  # nothing is believed longer than its authority
        common_name = _bounded(f"{self.access.site}.{name}.{_fingerprint(key)}")
        heading = Heading(common_name, ends, rights.site or self.access.site, rights.role, rights.cameras)
        self._write(name, heading, addresses, key)
        until = ends.isoformat("T", "minutes")
        subject = msgspec.structs.replace(rights, common_name=common_name, not_after=until)
        return Issued(self.folder / "issued" / name, ends), subject

    def _write(self, name: str, heading: Heading, addresses: tuple[str, ...], key: ec.EllipticCurvePrivateKey) -> None:
        names = [_address(address) for address in addresses] + [x509.DNSName(heading.common_name)]
        both = [ExtendedKeyUsageOID.CLIENT_AUTH, ExtendedKeyUsageOID.SERVER_AUTH]
        certificate = (
            _builder(_named(heading), self._certificate.subject, key, heading.ends)
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(_usage(signs_certificates=False), critical=True)
            .add_extension(x509.ExtendedKeyUsage(both), critical=False)
            .add_extension(x509.SubjectAlternativeName(names), critical=False)
            .sign(self._key, hashes.SHA256())
        )
        folder = self.folder / "issued" / name
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        write_atomically(folder / "key.pem", _pem(key), mode=0o600)
        write_atomically(folder / "certificate.pem", _under(heading, certificate))
        write_atomically(folder / "authority.pem", (self.folder / "authority.pem").read_bytes())


def _builder(
    subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePrivateKey, not_after: dt.datetime
) -> x509.CertificateBuilder:
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(NOT_BEFORE)
        .not_valid_after(not_after)
    )


def _usage(*, signs_certificates: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not signs_certificates,
        key_cert_sign=signs_certificates,
        crl_sign=signs_certificates,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        encipher_only=False,
        decipher_only=False,
    )


def _named(heading: Heading) -> x509.Name:
    """Site and role stand in the certificate too: whoever dials reads there whom it has reached."""
    parts = [x509.NameAttribute(NameOID.COMMON_NAME, heading.common_name)]
    if heading.site:
        parts.append(x509.NameAttribute(NameOID.ORGANIZATION_NAME, heading.site))
    if heading.role:
        parts.append(x509.NameAttribute(NameOID.ORGANIZATIONAL_UNIT_NAME, heading.role))
    return x509.Name(parts)


def _common_name(certificate: x509.Certificate) -> str:
    return str(certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)[0].value)


def _under(heading: Heading, certificate: x509.Certificate) -> bytes:
    return heading.encoded() + certificate.public_bytes(serialization.Encoding.PEM)


def _fingerprint(key: ec.EllipticCurvePrivateKey) -> str:
    form = serialization.PublicFormat.SubjectPublicKeyInfo
    public = key.public_key().public_bytes(serialization.Encoding.DER, form)
    return hashlib.sha256(public).hexdigest()[:FINGERPRINT]


def _bounded(common_name: str) -> str:
    if len(common_name) > MAX_COMMON_NAME:
        longer = len(common_name) - MAX_COMMON_NAME
        raise ConfigError(
            f"{common_name!r} is too long for a certificate",
            where="certs",
            action=f"take shorter names, {longer} characters less in all",
        )
    return common_name


def _address(text: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(text))
    except ValueError:
        return x509.DNSName(text)


def _pem(key: ec.EllipticCurvePrivateKey) -> bytes:
    encoding, form = serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8
    return key.private_bytes(encoding, form, serialization.NoEncryption())


def _encoded(access: Access) -> bytes:
    return msgspec.json.format(msgspec.json.encode(access), indent=2) + b"\n"


def _checked(name: str) -> None:
    if not _NAME.match(name):
        raise ConfigError(f"{name!r} is no name", where="certs", action="use letters, digits, _ and -, at most 64")
