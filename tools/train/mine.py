"""Hard negatives and an honest sigma: what a net says of things whose truth is known, once it has learned something."""

from typing import Final

import numpy as np
import torch
from torch import Tensor

from tools.train.compose import CROP_PX, Composer
from tools.train.loss import centres
from tools.train.net import SkyNet
from tools.train.patches import Floats, Grey

EASY_WEIGHT: Final = 0.15  # of a background that fools nobody, against 1 for one that does
MOST_TRUSTED: Final = 0.9  # a score above it on "background" is more likely an unlabelled bird than a mistake
FOUND: Final = 0.3  # score from which a detection counts for the calibration
OUTLIER_PX: Final = 6.0  # a peak further off belongs to something else


@torch.no_grad()
def background_weights(net: SkyNet, backgrounds: list[Grey], batch: int = 64) -> Floats:
    """`(N,)` weights of backgrounds, by the best score of a trained net in each."""
    net.eval()
    scores = []
    for start in range(0, len(backgrounds), batch):
        stack = np.stack(backgrounds[start : start + batch])
        scores.append(torch.sigmoid(_maps(net, stack)[:, 0]).flatten(1).amax(1).cpu().numpy())
    best = np.concatenate(scores)
    weights: Floats = np.where(best > MOST_TRUSTED, EASY_WEIGHT, EASY_WEIGHT + best).astype(np.float32)
    return weights


@torch.no_grad()
def normalised_errors(net: SkyNet, composer: Composer, batches: int = 60) -> Floats:
    """`(N, 2)` centre errors over sigma, both coordinates, of the measured objects a net finds in composed samples."""
    net.eval()
    errors = []
    for _ in range(batches):
        stacks, boxes = composer.batch(64)
        raw = _maps(net, stacks)
        centre, log_sigma = (part.cpu().numpy() for part in centres(raw))
        heat = torch.sigmoid(raw[:, 0]).cpu().numpy()
        for k, m in zip(*np.nonzero(boxes[..., 5] * boxes[..., 6]), strict=True):
            x, y = boxes[k, m, :2]
            u, v = (int(np.clip((c + 0.5) // 4, 1, CROP_PX // 4 - 2)) for c in (x, y))
            near = heat[k, v - 1 : v + 2, u - 1 : u + 2]
            row, col = np.unravel_index(near.argmax(), near.shape)
            at = np.s_[k, :, v - 1 + row, u - 1 + col]
            off = centre[at] - [x, y]
            if near.max() >= FOUND and np.hypot(*off) < OUTLIER_PX:
                errors.append(off / np.exp(log_sigma[at]))
    return np.array(errors, np.float32).reshape(-1, 2)


def _maps(net: SkyNet, stacks: Grey) -> Tensor:
    place = next(net.parameters()).device
    image = torch.from_numpy(stacks).to(place).permute(0, 3, 1, 2).float()
    return net(image)  # type: ignore[no-any-return]
