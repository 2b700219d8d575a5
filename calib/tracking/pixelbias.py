"""What a camera's pixels get wrong for seconds on end, given to the live filter as a pointing error of its own.

The hazard is the filter that averages what does not average. A lens model's error moves with the object through the
picture, a detector prefers one end of it: thirty rows a second then say as much as one, and a filter that counts all
thirty is sure of a place that is wrong. The adjustment measures for how long a camera's errors last; what outlives the
filter's own memory is no noise to it but a small error of attitude, which rays share and which never averages away.
"""

from dataclasses import replace
from typing import Final

import numpy as np

from calib.network import Camera, Network, pose_of
from edge.common.arrays import Array

MEMORY_S: Final = 1.0  # s the filter looks back on while an object turns: errors that last longer it cannot tell
WHITE_S: Final = 0.1  # s: errors gone so soon are noise: a few frames


def bias_rad(camera: Camera) -> float:
    """One sigma, rad, of the error that stays while an object passes; 0 if a camera's pixels are not known to have any.

    Of a noise that lasts T, the mean over a memory M keeps the share T / M of the variance, at most all.
    """
    if camera.sigma_px is None:
        return 0.0
    share = float(np.clip((camera.correlated_s - WHITE_S) / MEMORY_S, 0.0, 1.0))
    return camera.sigma_px * float(np.sqrt(share)) / min(camera.lens.intrinsics[:2])


def with_bias(network: Network, learnt_px: Array | None = None) -> Network:
    """The network with every camera's lasting pixel error in its attitude's covariance, each camera's its own.

    learnt_px: (C,) one sigma of what was seen to last beyond what the network says.
    """
    covariance = network.covariance.copy()
    learnt_px = np.zeros(len(network.cameras)) if learnt_px is None else learnt_px
    for k, camera in enumerate(network.cameras):
        # Turns about the image's axes move a pixel; one about the third does not.
        across = pose_of(k).start + np.arange(2)
        learnt_rad = learnt_px[k] / min(camera.lens.intrinsics[:2])
        covariance[across, across] += bias_rad(camera) ** 2 + learnt_rad**2
    return replace(network, covariance=covariance)
