"""Hard negatives and an honest sigma: what a net says of things whose truth is known, once it has learned something."""

import itertools
import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import minimize
from torch import Tensor

from edge.common.errors import SkyfixError
from tools.train.compose import Composer
from tools.train.loss import NOMINAL_LOG_SIZE, centres
from tools.train.net import STRIDE, SkyNet, cells
from tools.train.patches import Floats, Grey, flies
from tools.train.rendered import FIRST_TEST_SEED, centred_crops
from tools.train.windows import CROP_PX

EASY_WEIGHT: Final = 0.1  # of a background that fools nobody, against 1 for one that does
FLYER_SCORE: Final = 0.4  # from which a peak on "background" may be an object nobody labelled
FOUND_SCORE: Final = 0.3  # score from which a detection counts for the calibration
LEAST_FOUND: Final = 100  # seven parameters from fewer would be a guess
# Log px. How far the net's own sigma is off changes with the size to and fro: no straight line says it.
SIZE_KNOTS: Final = tuple(math.log(size_px) for size_px in (3, 5, 8, 13, 20, 32))
CLIP_SIGMAS: Final = 5.0  # an error so large is a different object, not a worse centre
OUTLIER_PX: Final = 6.0  # a peak further off belongs to something else


@torch.no_grad()  # type: ignore[untyped-decorator]
def weigh_backgrounds(net: SkyNet, backgrounds: list[Grey], batch: int = 64) -> tuple[Floats, Floats]:
    """`(N,)` weights of backgrounds, by the best score of a trained net in each, and `(N, 2)` where that is, px.

    A background with a flying thing on plain sky that nobody labelled has no weight: it would teach to overlook it.
    """
    net.eval()
    weights, spots = [], []
    for start in range(0, len(backgrounds), batch):
        for stack, score, spot, size in zip(*_worst(net, backgrounds[start : start + batch]), strict=True):
            flyer = score > FLYER_SCORE and flies(stack, (float(spot[0]), float(spot[1])), float(size))
            weights.append(0.0 if flyer else EASY_WEIGHT + score**2)
            spots.append(spot)
    return np.array(weights, np.float32), np.array(spots, np.float32)


def _worst(net: SkyNet, stacks: list[Grey]) -> tuple[list[Grey], Floats, Floats, Floats]:
    """The stacks again; of the best peak in each its score `(B,)`, its centre `(B, 2)` and its longer side `(B,)`."""
    raw = _maps(net, np.stack(stacks))
    score, index = torch.sigmoid(raw[:, 0]).flatten(1).max(1)
    found = torch.cat([centres(raw)[0], raw[:, 3:5] + NOMINAL_LOG_SIZE], dim=1).flatten(2)
    at = found.gather(2, index[:, None, None].expand(-1, 4, 1))[..., 0].cpu().numpy()
    return stacks, score.cpu().numpy(), at[:, :2], np.exp(at[:, 2:].max(axis=1))


@dataclass(frozen=True)
class SigmaFit:
    """log sigma = slope * (the net's own) + an offset by log size, straight between SIZE_KNOTS, level beyond them."""

    slope: float = 1.0
    offsets: tuple[float, ...] = (0.0,) * len(SIZE_KNOTS)

    def log_sigma(self, raw: Any, log_size: Any) -> Any:
        """Calibrated log sigma (px) of tensors or arrays."""
        total = self.slope * raw + self.offsets[0]
        for k, (low, high) in enumerate(itertools.pairwise(SIZE_KNOTS)):
            rise = (self.offsets[k + 1] - self.offsets[k]) / (high - low)
            total = total + rise * (log_size.clip(low, high) - low)
        return total


@dataclass(frozen=True)
class Found:
    """Objects found whose centre is known exactly: error `(N, 2)` px, the net's log sigma `(N,)`, log size `(N,)`."""

    error_px: Floats
    log_sigma: Floats
    log_size: Floats

    def normalised(self, fit: SigmaFit) -> float:
        """Root mean square of error over sigma, both coordinates: 1 if sigma is true."""
        ratio = self.error_px / np.exp(fit.log_sigma(self.log_sigma, self.log_size))[:, None]
        return float(np.sqrt(np.mean(np.clip(ratio, -CLIP_SIGMAS, CLIP_SIGMAS) ** 2)))


def fit_sigma(found: Found) -> SigmaFit:
    """The maximum-likelihood calibration; the few errors beyond CLIP_SIGMAS count as that. Raises SkyfixError."""
    if len(found.log_sigma) < LEAST_FOUND:
        raise SkyfixError(
            f"the net finds {len(found.log_sigma)} of the objects made for it: too few to calibrate its sigma",
            where="training",
            action="train for more steps",
        )

    def cost(values: NDArray[np.float64]) -> float:
        fit = SigmaFit(values[0], tuple(values[1:]))
        log_sigma = fit.log_sigma(found.log_sigma, found.log_size)[:, None]
        ratio = np.clip(found.error_px * np.exp(-log_sigma), -CLIP_SIGMAS, CLIP_SIGMAS)
        return float(np.mean(0.5 * ratio**2 + log_sigma))

    best = minimize(cost, np.array([1.0, *SigmaFit().offsets]), method="BFGS").x
    return SigmaFit(float(best[0]), tuple(float(value) for value in best[1:]))


@torch.no_grad()  # type: ignore[untyped-decorator]
def find_measured(net: SkyNet, composer: Composer, scenes: int, batches: int = 30) -> Found:
    """The measured objects a net finds in composed samples and in rendered scenes, raw and through a codec.

    Composed samples have more noise than most cameras, rendered ones less; a sigma fitted to either alone was off by a
    third on the other.
    """
    net.eval()
    rows: list[list[float]] = []
    for _ in range(batches):
        stacks, boxes = composer.batch(64)
        exact = [(int(k), boxes[k, m, :2]) for k, m in np.argwhere((boxes[..., 5] == 1) & (boxes[..., 7] == 1))]
        rows += _rows(net, stacks, exact)
    for number in range(scenes):
        width_px = float(np.exp(composer.random.uniform(np.log(3), np.log(32))))
        seed, coded = int(composer.random.integers(FIRST_TEST_SEED)), number % 3 > 0  # most cameras send coded video
        crops = centred_crops(seed, width_px, "drone", coded=coded, size_px=CROP_PX)
        if crops:
            rows += _rows(net, np.stack([crop for crop, _ in crops]), [(k, at) for k, (_, at) in enumerate(crops)])
    table = np.array(rows, np.float32).reshape(-1, 4)
    return Found(table[:, :2], table[:, 2], table[:, 3])


def _rows(net: SkyNet, stacks: Grey, exact: list[tuple[int, Floats]]) -> list[list[float]]:
    """Error x, y, log sigma and log size of those objects (number of the stack, centre px) that the net finds."""
    raw = _maps(net, stacks)
    centre, log_sigma = (part.cpu().numpy() for part in centres(raw))
    heat = torch.sigmoid(raw[:, 0]).cpu().numpy()
    log_size = raw[:, 3:5].mean(1).cpu().numpy() + NOMINAL_LOG_SIZE
    rows = []
    for k, place in exact:
        u, v = (int(np.clip((c + 0.5) // STRIDE, 1, CROP_PX // STRIDE - 2)) for c in place)
        near = heat[k, v - 1 : v + 2, u - 1 : u + 2]
        row, col = np.unravel_index(near.argmax(), near.shape)
        y, x = v - 1 + row, u - 1 + col
        off = centre[k, :, y, x] - place
        if near.max() >= FOUND_SCORE and np.hypot(*off) < OUTLIER_PX:
            rows.append([*off, log_sigma[k, 0, y, x], log_size[k, y, x]])
    return rows


def _maps(net: SkyNet, stacks: Grey) -> Tensor:
    place = next(net.parameters()).device
    return net(cells(torch.from_numpy(stacks).to(place)))
