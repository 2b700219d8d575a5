"""Temporal gating: confirm what is seen again, bridge gaps, give track numbers. Pure; live and offline the same."""

from edge.config import GateConfig
from edge.gate.paper import PaperGate
from edge.gate.rows import Gate, TrackRow
from edge.gate.tracks import TrackGate

__all__ = ["Gate", "PaperGate", "TrackGate", "TrackRow", "make_gate"]


def make_gate(config: GateConfig, size_px: tuple[int, int], track_score: float, first_track: int = 1) -> Gate:
    """The gate of a profile, for images of size_px (width, height), numbering its tracks from first_track.

    track_score: the detector's own word on how surely it sees an object.
    """
    gate: Gate = PaperGate(size_px) if config.profile == "paper" else TrackGate(size_px, config, track_score)
    gate.next_track = first_track
    return gate
