"""A new network in the time of the one before.

The hazard is the jump nobody ordered. Where no camera knows its UTC, the site's time is that of whichever camera the
adjustment chose, and the next one, of more cameras, may choose another: everything then flies a third of a second ago,
five metres back at fifteen metres a second, and no residual shows it. So as long as no clock is known, time goes on as
it was, by the median of what the cameras in both networks say; and at the pace of the median clock, for one camera that
counts 29.97 frames as thirty must not set it.
"""

from dataclasses import replace

import numpy as np

from calib.network import Network


def in_time_of(new: Network, old: Network, at_unix_ns: int) -> Network:
    """The new network with its clocks shifted so that, at that instant, cameras in both read as they did.

    All clocks move together, offset and rate: the geometry is the same. Without a camera in common, the new as it is.
    The old rates are not kept: those of a first half minute are guesses.
    """
    at_new_s, at_old_s = ((at_unix_ns - network.t_mid_unix_ns) * 1e-9 for network in (new, old))
    pairs = [(camera, before) for camera in new.cameras if (before := old.camera(camera.id)) is not None]
    if not pairs:
        return new
    rate = -float(np.median([camera.clock_rate for camera in new.cameras]))
    reads = [
        before.clock_offset_s + before.clock_rate * at_old_s - camera.clock_offset_s - camera.clock_rate * at_new_s
        for camera, before in pairs
    ]
    offset_s = float(np.median(reads)) - rate * at_new_s
    cameras = tuple(
        replace(camera, clock_offset_s=camera.clock_offset_s + offset_s, clock_rate=camera.clock_rate + rate)
        for camera in new.cameras
    )
    return replace(new, cameras=cameras)
