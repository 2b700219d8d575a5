"""One camera that is let in and lies: every field of Tracks, Fix and Lens, from the start, slowly, and suddenly.

Keys keep strangers out; what they let in is believed as far as others bear it out, or not at all. A lie changes what a
camera's box truly says, from an instant on or from the beginning, and stays valid by the wire contract: whatever comes
of it comes of what a station makes of it.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Final

import msgspec

from edge.common.units import NS
from edge.messages import Detection, Fix, Lens, Tracks, camera_key, encode
from tools.doubles.box_messages import SITE, Sent
from tools.doubles.flight import T0_UNIX_NS

LIAR: Final = "cam0"
SUDDEN_S: Final = 35.0  # after the start: the site has calibrated itself by then
SLOWLY_S: Final = 10.0  # in which a slow lie grows to all of itself

Share = float  # how much of the lie is told: 0 to 1
TracksLie = Callable[[Tracks, Share], Tracks]
FixLie = Callable[[Fix, Share], Fix]
LensLie = Callable[[Lens, Share], Lens]


@dataclass(frozen=True)
class Lie:
    """What is said falsely of one field. since_s: of the flight; 0: from the beginning. slow: it grows."""

    name: str
    tracks: TracksLie | None = None
    fix: FixLie | None = None
    lens: LensLie | None = None
    since_s: float = SUDDEN_S
    slow: bool = False

    def share(self, t_unix_ns: int) -> Share:
        """How much of it is told at an instant."""
        told_s = (t_unix_ns - T0_UNIX_NS) / NS - self.since_s
        if told_s < 0:
            return 0.0
        return min(1.0, told_s / SLOWLY_S) if self.slow else 1.0


@dataclass
class Liar:
    """A box that tells a lie: every message of its own as it sends it. Others' go through."""

    lie: Lie
    _honest: dict[str, Sent] = field(default_factory=dict)  # its Fix and its Lens, said again while a lie grows
    _said_s: int = -1

    def __call__(self, sent: Sent) -> Iterator[Sent]:
        """What is sent in place of a message."""
        topic = sent.key.rpartition("/")[2]
        if sent.key != camera_key(SITE, LIAR, topic):
            yield sent
            return
        if topic in ("fix", "lens"):
            self._honest[topic] = sent
            yield self._told(sent, topic, sent.arrival_ns)
            return
        second = (sent.arrival_ns - T0_UNIX_NS) // NS
        if second != self._said_s:
            self._said_s = second
            for about, honest in self._honest.items():
                told = self._told(honest, about, sent.arrival_ns)
                if told.payload != honest.payload:
                    yield told
        yield self._told(sent, "tracks", sent.arrival_ns)

    def _told(self, sent: Sent, topic: str, now_ns: int) -> Sent:
        share = self.lie.share(now_ns)
        if share == 0.0:
            return sent
        if topic == "tracks" and self.lie.tracks is not None:
            message: msgspec.Struct = self.lie.tracks(msgspec.json.decode(sent.payload, type=Tracks), share)
        elif topic == "fix" and self.lie.fix is not None:
            message = self.lie.fix(msgspec.json.decode(sent.payload, type=Fix), share)
        elif topic == "lens" and self.lie.lens is not None:
            message = self.lie.lens(msgspec.json.decode(sent.payload, type=Lens), share)
        else:
            return sent
        return sent._replace(payload=encode(message), arrival_ns=max(now_ns, sent.arrival_ns))


def _all(tracks: Tracks, change: Callable[[Detection], Detection]) -> Tracks:
    return msgspec.structs.replace(tracks, detections=[change(one) for one in tracks.detections])


def _shifted(right_px: float, sigma_px: float | None = None, bound_s: float | None = -1.0) -> TracksLie:
    """Pixels that are off to the right; sigma_px, bound_s: what is said of them, as honestly if None and -1."""

    def lie(tracks: Tracks, share: Share) -> Tracks:
        said = {} if sigma_px is None else {"sigma_px": sigma_px}
        off = _all(tracks, lambda one: msgspec.structs.replace(one, u_px=one.u_px + share * right_px, **said))
        return off if bound_s == -1.0 else msgspec.structs.replace(off, clock_bound_s=bound_s)

    return lie


def _stamped(later_s: float, bound_s: float | None = -1.0, *, sees: bool = True) -> TracksLie:
    def lie(tracks: Tracks, share: Share) -> Tracks:
        t_unix_ns = tracks.t_unix_ns + round(share * later_s * NS)
        seen = tracks.detections if sees else []
        changed = msgspec.structs.replace(tracks, t_unix_ns=t_unix_ns, detections=seen)
        return changed if bound_s == -1.0 else msgspec.structs.replace(changed, clock_bound_s=bound_s)

    return lie


def _field(name: str, value: object) -> TracksLie:
    return lambda tracks, _: msgspec.structs.replace(tracks, **{name: value})


def _numbered(tracks: Tracks, _: Share) -> Tracks:
    """Every detection under another number each time."""
    return _all(tracks, lambda one: msgspec.structs.replace(one, track=(tracks.seq * 8 + one.track) % 1000))


def _crowded(tracks: Tracks, share: Share) -> Tracks:
    """Each object, and beside it another one."""
    beside = [
        msgspec.structs.replace(one, track=one.track + 50, u_px=min(one.u_px + 150.0 * share, tracks.size_px[0] - 1.0))
        for one in tracks.detections
    ]
    return msgspec.structs.replace(tracks, detections=tracks.detections + beside)


def _moved(up_m: float = 0.0, north_m: float = 0.0, sigma_m: float | None = None) -> FixLie:
    def lie(fix: Fix, share: Share) -> Fix:
        said = {} if sigma_m is None else {"sigma_m": (sigma_m,) * 3}
        lat_deg = fix.lat_deg + share * north_m / 111_200.0  # m a degree of latitude, near enough for a lie
        return msgspec.structs.replace(fix, height_m=fix.height_m + share * up_m, lat_deg=lat_deg, **said)

    return lie


def _zoomed(by: float, sigma_px: float | None = None) -> LensLie:
    def lie(lens: Lens, share: Share) -> Lens:
        fx, fy, cx, cy = lens.intrinsics
        zoom = 1 + share * by
        return msgspec.structs.replace(lens, intrinsics=(fx * zoom, fy * zoom, cx, cy), focal_sigma_px=sigma_px)

    return lie


def _bent(by: float) -> LensLie:
    def lie(lens: Lens, share: Share) -> Lens:
        first, *rest = lens.distortion
        return msgspec.structs.replace(lens, distortion=[first + share * by, *rest])

    return lie


LIES: Final = (
    Lie("nothing: it is honest"),
    Lie("u_px + 20", _shifted(20.0)),
    Lie("u_px + 20, slowly", _shifted(20.0), slow=True),
    Lie("u_px + 20 from the start", _shifted(20.0), since_s=0.0),
    Lie("u_px + 20, clock_bound_s 1", _shifted(20.0, bound_s=1.0)),
    Lie("u_px + 20, clock_bound_s 1e6", _shifted(20.0, bound_s=1e6)),
    Lie("u_px + 20, clock_bound_s null", _shifted(20.0, bound_s=None)),
    Lie("u_px + 20, sigma_px 0.001", _shifted(20.0, sigma_px=0.001)),
    Lie("u_px + 20, slowly, sigma_px 0.001", _shifted(20.0, sigma_px=0.001), slow=True),
    Lie("sigma_px 0.001 from the start", _shifted(0.0, sigma_px=0.001), since_s=0.0),
    Lie("t_unix_ns + 0.1 s", _stamped(0.1)),
    Lie("t_unix_ns + 0.1 s, slowly", _stamped(0.1), slow=True),
    Lie("t_unix_ns + 0.1 s from the start", _stamped(0.1), since_s=0.0),
    Lie("t_unix_ns + 0.4 s", _stamped(0.4)),
    Lie("t_unix_ns + 1 s", _stamped(1.0)),
    Lie("t_unix_ns + 1.9 s", _stamped(1.9)),
    Lie("t_unix_ns + 1 s, sees nothing", _stamped(1.0, sees=False)),
    Lie("t_unix_ns + 0.2 s, clock_bound_s 1e6", _stamped(0.2, 1e6)),
    Lie("readout_s 1 from the start", _field("readout_s", 1.0), since_s=0.0),
    Lie("track: another each time", _numbered),
    Lie("detections: each twice, beside it", _crowded),
    Lie("fix 10 m too high", fix=_moved(up_m=10.0), since_s=0.0),
    Lie("fix 3 m too high", fix=_moved(up_m=3.0), since_s=0.0),
    Lie("fix 3 m too far north, sigma_m 0.001", fix=_moved(north_m=3.0, sigma_m=0.001), since_s=0.0),
    Lie("fix climbs by 10 m", fix=_moved(up_m=10.0, sigma_m=0.001), slow=True),
    Lie("fix 50 m too far north", fix=_moved(north_m=50.0), since_s=0.0),
    Lie("focal length + 5 %", lens=_zoomed(0.05), since_s=0.0),
    Lie("focal length + 5 %, focal_sigma_px 0.1", lens=_zoomed(0.05, 0.1), since_s=0.0),
    Lie("focal length + 2 %, focal_sigma_px 0.1", lens=_zoomed(0.02, 0.1), since_s=0.0),
    Lie("focal length + 5 % in flight", lens=_zoomed(0.05)),
    Lie("focal length + 0.1 %, slowly", lens=_zoomed(0.001), slow=True),
    Lie("distortion k1 + 0.1", lens=_bent(0.1), since_s=0.0),
)
