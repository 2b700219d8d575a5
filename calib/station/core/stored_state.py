"""What an earlier run of the station left to this one, as plain data; archive/state_store.py keeps it on the disk."""

from dataclasses import dataclass

from calib.network import Network


@dataclass(frozen=True)
class StoredState:
    """epoch: this start's number. first_track, signing_ticks: nothing below was left unused. network: or None."""

    epoch: int = 1
    first_track: int = 1
    signing_ticks: int = 0
    network: Network | None = None
