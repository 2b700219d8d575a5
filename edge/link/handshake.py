"""One TLS handshake with a listener, beside Zenoh, for the reason that Zenoh does not tell.

Zenoh shows a refused certificate as a timeout, to whoever shows it: the cause stands in the listener's log only. TLS
itself says it, in an alert. So a program that cannot meet anybody shakes hands once by itself, reads the alert, and on
the way learns whom it reached and until when that one's certificate is good. The listener sees a connection that says
nothing and is closed; it counts no refusal that it would not have counted anyway.
"""

import contextlib
import datetime as dt
import socket
import ssl
import threading
import time
from dataclasses import dataclass
from typing import Any, Final

from edge.link.ports import place
from edge.link.settings import TlsSettings

DIAL_S: Final = 1.5
ALERT_S: Final = 1.0  # in TLS 1.3 the other side's refusal comes a round trip after our own part is done
GIVE_UP_LOOK_S: Final = 0.1  # how soon a handshake under way is given up
_ANY_NAME: Final = "verify_name_on_connect=false"

_OTHER_AUTHORITY: Final = "copy the files of this site's authority there: see deploy/certs/README.md"
# What the other side's alert means, by OpenSSL's name for it.
_ALERTS: Final = {
    "TLSV1_ALERT_UNKNOWN_CA": (
        "does not believe this machine's certificate: another authority made it",
        _OTHER_AUTHORITY,
    ),
    "TLSV1_ALERT_DECRYPT_ERROR": (
        "does not believe this machine's certificate: another authority of the same name made it",
        _OTHER_AUTHORITY,
    ),
    "SSLV3_ALERT_CERTIFICATE_EXPIRED": (
        "says that this machine's certificate has ended",
        "base-station certs renew, or correct the listener's clock",
    ),
    "SSLV3_ALERT_BAD_CERTIFICATE": ("does not accept this machine's certificate", _OTHER_AUTHORITY),
    "WRONG_VERSION_NUMBER": ("does not speak TLS", "give it [link.tls], or correct link.connect"),
}
# What we find wrong with the other side's certificate, by OpenSSL's number (x509_vfy.h).
_VERIFIED: Final = {
    9: ("has a certificate that is not valid yet", "correct this machine's clock"),
    10: ("has a certificate that has ended", "base-station certs renew, for the listener; or correct this clock"),
    62: ("has a certificate for another address", "base-station certs issue it with --address, as it is dialled"),
    64: ("has a certificate for another address", "base-station certs issue it with --address, as it is dialled"),
}


@dataclass(frozen=True)
class Reached:
    """Who answered: common name, site and role where the certificate has them, and its end."""

    common_name: str
    site: str
    role: str
    ends: dt.datetime


@dataclass(frozen=True)
class Handshake:
    """What came of it. reason: why there was none, empty if there was; absent: nobody was there to refuse."""

    endpoint: str
    reason: str = ""
    action: str = ""
    absent: bool = False
    reached: Reached | None = None


def shake_hands(endpoint: str, tls: TlsSettings, give_up: threading.Event) -> Handshake:
    """Dial a tls/ endpoint with this machine's certificate; takes up to DIAL_S and ALERT_S.

    give_up: set by another thread when nobody wants to know any more.
    """
    host, port = place(endpoint)
    try:
        context = _context(tls, any_name=_ANY_NAME in endpoint)
    except (OSError, ssl.SSLError) as error:
        return Handshake(endpoint, f"this machine's certificate cannot be used ({error})", _OTHER_AUTHORITY)
    try:
        with socket.create_connection((host, port), DIAL_S) as plain:
            try:
                return Handshake(endpoint, reached=_meet(plain, context, host, give_up))
            except ssl.SSLCertVerificationError as error:
                what, action = _VERIFIED.get(
                    error.verify_code,
                    ("has a certificate that this machine's authority did not make", _OTHER_AUTHORITY),
                )
                return Handshake(endpoint, f"the listener at {host}:{port} {what} ({error.verify_message})", action)
            except ssl.SSLError as error:
                what, action = _ALERTS.get(error.reason, ("refuses the connection", "look at its log"))
                return Handshake(endpoint, f"the listener at {host}:{port} {what} ({error.reason})", action)
    except OSError as error:
        why = error.strerror or str(error)
        return Handshake(endpoint, f"nobody answers at {host}:{port} ({why})", "", absent=True)


def _context(tls: TlsSettings, *, any_name: bool) -> ssl.SSLContext:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = not any_name
    context.load_verify_locations(tls.authority)
    context.load_cert_chain(tls.certificate, tls.key)
    return context


def _meet(plain: socket.socket, context: ssl.SSLContext, host: str, give_up: threading.Event) -> Reached:
    with context.wrap_socket(plain, server_hostname=host) as secure:
        secure.settimeout(GIVE_UP_LOOK_S)
        ends_s = time.monotonic() + ALERT_S
        while time.monotonic() < ends_s and not give_up.is_set():
            with contextlib.suppress(TimeoutError):
                secure.recv(1)  # an alert is raised here; Zenoh itself waits for us to speak
                break
        return _reached(secure.getpeercert() or {})


def _reached(certificate: dict[str, Any]) -> Reached:
    subject = {key: value for part in certificate.get("subject", ()) for key, value in part}
    ends_s = ssl.cert_time_to_seconds(certificate["notAfter"])
    return Reached(
        subject.get("commonName", ""),
        subject.get("organizationName", ""),
        subject.get("organizationalUnitName", ""),
        dt.datetime.fromtimestamp(ends_s, dt.UTC),
    )
