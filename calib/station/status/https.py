"""HTTPS for the page and the status, with the certificate that the station shows on its link.

The hazard is the token that crosses a field's wireless in clear: who hears it once has it for as long as it lasts. The
site has an authority already, and the base a certificate under the names by which it is dialled.
"""

import ssl
from pathlib import Path

from calib.station.config import BaseConfig
from edge.common.errors import ConfigError
from edge.common.health import Check
from edge.common.hosts import is_own
from edge.link.settings import TlsSettings


def https_of(config: BaseConfig) -> TlsSettings | None:
    """The files that the page is served with; None: it is served without TLS."""
    return config.link.tls if config.status.tls else None


def serving(tls: TlsSettings) -> ssl.SSLContext:
    """Of whoever serves. Raises ConfigError if the files are none of ours."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    try:
        context.load_cert_chain(tls.certificate, tls.key)
    except (OSError, ssl.SSLError) as error:
        raise ConfigError(
            f"no certificate to serve the page with ({error})",
            where=tls.certificate,
            action="copy the base's own files there, or leave status.tls out",
        ) from error
    return context


def asking(tls: TlsSettings) -> ssl.SSLContext:
    """Of this machine's own programs, that ask by its number: any name will do, not any authority. Raises OSError."""
    context = ssl.create_default_context(cafile=str(Path(tls.authority)))
    context.check_hostname = False
    return context


def check_page(config: BaseConfig) -> Check | None:
    """Whether what others see of the page, and their token, can be read on the way; None: nobody else is served."""
    if config.status.port is None or is_own(config.status.host):
        return None
    if config.status.tls:
        return Check("page", "ok", f"https://{config.status.host}:{config.status.port}, for who knows the authority")
    action = "set status.tls = true, and give browsers the site's authority.pem"
    return Check("page", "warn", "its token and all that it shows cross the network in clear", action)
