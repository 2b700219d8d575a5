"""A stored network on trial: do rays meet as it says, or has somebody moved the tripods overnight?

The hazard is chance: now and then two rays meet under any network. So most pairs of cameras that see something at the
same time must meet, again and again, before it is believed; and rays that do not for seconds refuse it.
"""

from typing import Final

from calib.guarding.meetings import meetings
from calib.guarding.raytracks import RayTracks
from calib.network import Network

AGREE_PAIRS: Final = 2  # of cameras whose rays meet, at least, before a stored network is accepted
AGREE_SHARE: Final = 0.5  # of the pairs that saw something at the same time
AGREE_TIMES: Final = 3  # in a row
AGREE_EVERY_NS: Final = 300_000_000
REFUSE_NS: Final = 6_000_000_000  # of rays that do not meet, after which it is refused


class StoredTrial:
    """Since when rays could have met, when last looked, how often in a row most met."""

    def __init__(self, network: Network) -> None:
        self.network = network
        self._since_ns = 0
        self._asked_ns = 0
        self._agreed = 0

    def verdict(
        self, tracks: RayTracks, pairs: list[tuple[str, str]], now_unix_ns: int, watched_ns: int
    ) -> bool | None:
        """True or False once it is clear whether rays of the last watched_ns meet; None until then."""
        if abs(now_unix_ns - self._asked_ns) < AGREE_EVERY_NS:
            return None
        self._asked_ns = now_unix_ns
        looked = [meetings(self.network, pair, tracks, now_unix_ns - watched_ns) for pair in pairs]
        met, could = sum(found is not None for found, _ in looked), sum(possible for _, possible in looked)
        if could < AGREE_PAIRS:
            return None
        self._since_ns = self._since_ns or now_unix_ns
        # By chance two rays meet now and then; most pairs at once, again and again, only if the network is right.
        self._agreed = self._agreed + 1 if met >= max(AGREE_PAIRS, AGREE_SHARE * could) else 0
        if self._agreed >= AGREE_TIMES:
            return True
        return False if now_unix_ns - self._since_ns > REFUSE_NS else None
