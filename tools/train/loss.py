"""What the net is told: where (focal loss on peaks), exactly where and how sure (Gaussian), how large, which class.

A sigma learned by plain maximum likelihood starves the hard samples of gradient, and the centre never gets good
(Seitzer et al. 2022); their beta-weighted form with beta = 0.5 is used. The focal loss is that of CornerNet
(Law and Deng 2018), as CenterNet (Zhou et al. 2019) uses it.
"""

from dataclasses import dataclass
from typing import Final

import torch
from torch import Tensor
from torch.nn import functional

from tools.train.net import OUTPUTS_BEFORE_CLASSES, STRIDE

BETA: Final = 0.5
SMALLEST_SPREAD_CELLS: Final = 0.7  # of a peak: less would punish the cell next to the right one
SPREAD_PER_SIZE: Final = 0.15  # cells of spread per cell of object size
NEIGHBOUR_WEIGHT: Final = 0.25  # of the cells round the centre: the peak may fall one cell off
HIDDEN_MARGIN_CELLS: Final = 1.5  # about an object that cannot be seen: its place is known no better
LOG_SIGMA_RANGE: Final = (-4.0, 3.0)  # 0.02 to 20 px
NOMINAL_LOG_SIZE: Final = 2.1  # log of 8 px: where a fresh net's sizes begin


@dataclass(frozen=True)
class Losses:
    """The parts of a batch's loss, each a scalar."""

    heat: Tensor
    centre: Tensor
    size: Tensor
    label: Tensor

    def total(self) -> Tensor:
        """Their weighted sum; weights bring the parts to like magnitudes."""
        return self.heat + 0.5 * self.centre + 0.5 * self.size + 0.6 * self.label


def centres(raw: Tensor) -> tuple[Tensor, Tensor]:
    """`(B, 2, h, w)` centres in px and `(B, 1, h, w)` log sigmas from raw maps."""
    u, v = _columns_and_rows(raw)
    grid = torch.stack([u, v]) * STRIDE + (STRIDE - 1) / 2
    return grid + STRIDE * raw[:, 1:3], raw[:, 5:6].clamp(*LOG_SIGMA_RANGE)


def _columns_and_rows(raw: Tensor) -> tuple[Tensor, Tensor]:
    """The column and the row of every cell of maps `(B, C, h, w)`: `(h, w)` each."""
    rows, cols = (torch.arange(count, device=raw.device) for count in raw.shape[2:])
    v, u = torch.meshgrid(rows, cols, indexing="ij")
    return u, v


def losses(raw: Tensor, boxes: Tensor) -> Losses:
    """Losses of raw maps `(B, C, h, w)` against boxes `(B, M, 9)`.

    Of a box: x, y, width, height px, class, exact, telling, present, visible. What is there and cannot be seen is
    taught as neither object nor background.
    """
    present, visible = boxes[..., 7], boxes[..., 8]
    hidden = _about(raw, boxes, present * (1 - visible))
    heat, weight, owner = _targets(raw, boxes, present * visible)
    chosen = torch.stack([boxes[..., k].gather(1, owner.flatten(1)).view_as(weight) for k in range(7)], dim=1)
    measured = weight * chosen[:, 5]
    return Losses(
        heat=_focal(raw[:, 0], heat, hidden),
        centre=_centre(raw, chosen[:, :2], measured),
        size=_size(raw[:, 3:5], chosen[:, 2:4], measured),
        label=_label(raw[:, OUTPUTS_BEFORE_CLASSES:], chosen[:, 4], weight * chosen[:, 6]),
    )


def _targets(raw: Tensor, boxes: Tensor, which: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Peak heat, regression weight and owner of every cell `(B, h, w)`, of the boxes with `which` `(B, M)` set."""
    cell = ((boxes[..., :2] + 0.5) / STRIDE).floor()
    u, v = _columns_and_rows(raw)
    off_u = u - cell[..., 0, None, None]
    off_v = v - cell[..., 1, None, None]
    size = boxes[..., 2:4].amax(-1) / STRIDE
    # A loose label says "hereabouts": its neighbourhood is not to be taught as background.
    spread = (SPREAD_PER_SIZE * size * (1 + (boxes[..., 5] == 0))).clamp(min=SMALLEST_SPREAD_CELLS)
    heat = torch.exp(-(off_u**2 + off_v**2) / (2 * spread[..., None, None] ** 2)) * which[..., None, None]
    best, owner = heat.max(dim=1)
    near = (off_u.abs().maximum(off_v.abs()) <= 1).float() * which[..., None, None]
    weight = near.gather(1, owner[:, None]).squeeze(1) * torch.where(best == 1, 1.0, NEIGHBOUR_WEIGHT)
    return best, weight, owner


def _about(raw: Tensor, boxes: Tensor, which: Tensor) -> Tensor:
    """`(B, h, w)` whether a cell is at or next to an object of those with `which` `(B, M)` set."""
    u, v = _columns_and_rows(raw)
    centre = (boxes[..., :2] + 0.5) / STRIDE - 0.5
    reach = boxes[..., 2:4].amax(-1) / (2 * STRIDE) + HIDDEN_MARGIN_CELLS
    away = (u - centre[..., 0, None, None]).abs().maximum((v - centre[..., 1, None, None]).abs())
    return ((away <= reach[..., None, None]) & (which[..., None, None] > 0)).any(dim=1)


def _focal(logit: Tensor, heat: Tensor, hidden: Tensor) -> Tensor:
    chance = torch.sigmoid(logit)
    peak = heat == 1
    found = functional.logsigmoid(logit) * (1 - chance) ** 2 * peak
    empty = functional.logsigmoid(-logit) * chance**2 * (1 - heat) ** 4 * ~(peak | hidden)
    return -(found + empty).sum() / peak.sum().clamp(min=1)


def _centre(raw: Tensor, target: Tensor, weight: Tensor) -> Tensor:
    """Beta-weighted Gaussian negative log likelihood of both coordinates, in px."""
    centre, log_sigma = centres(raw)
    square = (centre - target).square().clamp(max=400)  # 20 px: one wrong box must not move the net
    likelihood = 0.5 * square * torch.exp(-2 * log_sigma) + log_sigma
    weighed = likelihood * torch.exp(2 * BETA * log_sigma).detach()
    return (weighed.sum(1) * weight).sum() / weight.sum().clamp(min=1)


def _size(raw: Tensor, target: Tensor, weight: Tensor) -> Tensor:
    error = functional.smooth_l1_loss(raw + NOMINAL_LOG_SIZE, target.clamp(min=1).log(), reduction="none", beta=0.2)
    return (error.sum(1) * weight).sum() / weight.sum().clamp(min=1)


def _label(logits: Tensor, label: Tensor, weight: Tensor) -> Tensor:
    """Cross entropy of the boxes whose class is known."""
    known = (label >= 0) * weight
    loss = functional.cross_entropy(logits, label.long().clamp(min=0), reduction="none")
    return (loss * known).sum() / known.sum().clamp(min=1)
