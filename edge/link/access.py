"""Who may say what: the site's list of certificates, turned into Zenoh's access control.

Everything that is not allowed here is denied. A camera's certificate may write below its own key and nowhere else, so
a stolen box cannot speak for another; only the station's may write station keys, so nobody else can add an aircraft.
Who is not on the list is connected to nothing, even with a valid certificate: that is how a certificate is revoked, as
Zenoh knows no revocation lists. A common name is one certificate's alone, as its end is made of the key: whoever keeps
a key that was revoked is not let in when the machine's name is issued again. The list is read when the session opens.
"""

import datetime as dt
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import msgspec

from edge.common.errors import ConfigError
from edge.messages import Name, camera_key, site_key, station_key

Role = Literal["camera", "station", "reader", "router"]

# What one side says, and what it asks; in Zenoh's words.
_SPEAK: Final = ["put", "delete", "liveliness_token", "declare_queryable", "reply"]
_ASK: Final = ["declare_subscriber", "query", "declare_liveliness_subscriber", "liveliness_query"]


class Subject(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One certificate: its common name (AUTHORITY.NAME.KEY), what it is for, of which site, for which cameras."""

    common_name: str
    role: Role
    site: Annotated[str, msgspec.Meta(pattern=r"^(\*|[A-Za-z0-9_-]{1,64})$")] | None = (
        None  # None: the list's own; "*": all, for a headquarters that listens
    )
    cameras: tuple[Name, ...] = ()
    not_after: str  # ISO 8601, UTC; for people: the certificate itself decides

    @property
    def name(self) -> str:
        """The machine's name, as it is issued and revoked by."""
        return self.common_name.split(".")[1] if "." in self.common_name else self.common_name

    @property
    def ends(self) -> dt.datetime | None:
        """When it is over; None if the list does not say it in a way that can be read."""
        try:
            end = dt.datetime.fromisoformat(self.not_after)
        except ValueError:
            return None
        return end if end.tzinfo else end.replace(tzinfo=dt.UTC)


class Access(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The list of a site, or of all that share an authority: access.json, for whoever listens."""

    site: Name
    subjects: tuple[Subject, ...]


def load_access(path: Path) -> Access:
    """The list in a file. Raises ConfigError."""
    try:
        return msgspec.json.decode(path.read_bytes(), type=Access)
    except (OSError, msgspec.MsgspecError) as error:
        raise ConfigError(
            f"the list of certificates cannot be read ({error})",
            where=str(path),
            action="copy access.json from the authority's folder, or make one with `base-station certs init`",
        ) from error


def access_control(access: Access) -> dict[str, Any]:
    """Zenoh's `access_control` section for this list: default deny, one policy a subject."""
    rules = [rule for subject in access.subjects for rule in _rules(subject.site or access.site, subject)]
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [
            {"id": subject.common_name, "cert_common_names": [subject.common_name]} for subject in access.subjects
        ],
        "policies": [
            {"subjects": [s.common_name], "rules": [rule["id"] for rule in _rules(s.site or access.site, s)]}
            for s in access.subjects
        ],
    }


def _rules(site: str, subject: Subject) -> list[dict[str, Any]]:
    own = _own_keys(site, subject)
    hears = _below(station_key(site)) if subject.role == "camera" else [site_key(site, "**")]
    name = subject.common_name
    rules = [
        # It asks, we speak; on the keys it may hear.
        _rule(f"{name}-asks", "ingress", _ASK, hears),
        _rule(f"{name}-hears", "egress", _SPEAK, hears),
    ]
    if own:
        # It speaks, on its own keys. What others ask for may be known to it: without, it would not speak at all.
        rules.append(_rule(f"{name}-speaks", "ingress", _SPEAK, own))
        rules.append(_rule(f"{name}-is-asked", "egress", _ASK, [site_key("*", "**")]))
    return rules


def _own_keys(site: str, subject: Subject) -> list[str]:
    if subject.role == "camera":
        return [key for camera in subject.cameras for key in _below(camera_key(site, camera))]
    if subject.role == "station":
        return _below(station_key(site))
    return [site_key(site, "**")] if subject.role == "router" else []


def _below(key: str) -> list[str]:
    return [key, f"{key}/**"]


def _rule(name: str, flow: str, messages: list[str], keys: list[str]) -> dict[str, Any]:
    return {"id": name, "messages": messages, "flows": [flow], "permission": "allow", "key_exprs": keys}
