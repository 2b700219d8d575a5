"""The net: 3 grey frames in, one peak map at stride 4 out, with a box, a sigma and class scores at every cell.

A flying object is often 4 px wide, so nothing coarser than stride 4 may decide where it is; what is around it (sky,
trees, a neighbouring bird) is cheap to see at stride 8 and 16. Batch norms are folded on export.
"""

from typing import Final

import torch
from torch import Tensor, nn
from torch.nn import functional

STRIDE: Final = 4
STEM_CHANNELS: Final = 3 * STRIDE**2
OUTPUTS_BEFORE_CLASSES: Final = 6  # heat, x, y, log width, log height, log sigma
MID_GREY: Final = 128
GREY_SCALE: Final = 1 / 64
HEAT_PRIOR_LOGIT: Final = -4.6  # about 1 % : a fresh net must not drown in false positives


def cells(image: Tensor) -> Tensor:
    """`(B, H, W, 3)` bytes to what the net takes: `(B, 48, H/4, W/4)`, each cell's 16 pixels of 3 frames, normalised.

    In 8 bits a convolution over three channels at full resolution costs four times this one over 48 at a quarter.
    """
    batch, height, width, frames = image.shape
    parts = image.reshape(batch, height // STRIDE, STRIDE, width // STRIDE, STRIDE, frames)
    stacked = parts.permute(0, 2, 4, 5, 1, 3).reshape(batch, STEM_CHANNELS, height // STRIDE, width // STRIDE)
    return (stacked.float() - MID_GREY) * GREY_SCALE


def conv(inputs: int, outputs: int, stride: int = 1, size: int = 3) -> nn.Sequential:
    """Convolution, batch norm, ReLU."""
    layer = nn.Conv2d(inputs, outputs, size, stride, size // 2, bias=False)
    return nn.Sequential(layer, nn.BatchNorm2d(outputs), nn.ReLU(inplace=True))


def backward_conv(inputs: int, outputs: int) -> nn.Sequential:
    """A 2x2 convolution over a cell and those above and to its left, batch norm, ReLU.

    In cells, that is what a 3x3 convolution of stride 2 is in pixels.
    """
    layers = (nn.ZeroPad2d((1, 0, 1, 0)), nn.Conv2d(inputs, outputs, 2, bias=False))
    return nn.Sequential(*layers, nn.BatchNorm2d(outputs), nn.ReLU(inplace=True))


class Residual(nn.Module):  # type: ignore[misc]
    """Two 3x3 convolutions round a shortcut (He et al. 2016)."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first = conv(channels, channels)
        self.second = nn.Sequential(nn.Conv2d(channels, channels, 3, 1, 1, bias=False), nn.BatchNorm2d(channels))

    def forward(self, x: Tensor) -> Tensor:
        return functional.relu(x + self.second(self.first(x)))


class SkyNet(nn.Module):  # type: ignore[misc]
    """`cells` of an image to `(B, 6 + classes, H/4, W/4)` raw maps; H and W multiples of 8."""

    def __init__(self, classes: int) -> None:
        super().__init__()
        self.fine = nn.Sequential(backward_conv(STEM_CHANNELS, 64), backward_conv(64, 32), Residual(32))
        self.middle = nn.Sequential(conv(32, 64, 2), Residual(64))
        self.coarse = nn.Sequential(conv(64, 96, 2), Residual(96))
        self.coarse_to_middle = conv(96, 64, size=1)
        self.middle_to_fine = conv(64, 32, size=1)
        self.neck = conv(32, 48)
        self.head = nn.Conv2d(48, OUTPUTS_BEFORE_CLASSES, 1)
        # What a thing is shows in more pixels than where it is: classes are read a level up.
        self.kind = nn.Sequential(conv(64, 64), nn.Conv2d(64, classes, 1))
        nn.init.zeros_(self.head.weight)
        nn.init.zeros_(self.head.bias)
        with torch.no_grad():
            self.head.bias[0] = HEAT_PRIOR_LOGIT

    def features(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """What the heads read: `(B, 48, H/4, W/4)` for where, `(B, 64, H/8, W/8)` for what."""
        fine = self.fine(x)
        middle = self.middle(fine)
        coarse = self.coarse_to_middle(self.coarse(middle))
        middle = middle + functional.interpolate(coarse, size=middle.shape[2:], mode="nearest")
        fine = fine + functional.interpolate(self.middle_to_fine(middle), size=fine.shape[2:], mode="nearest")
        return self.neck(fine), self.kind[0](middle)

    def forward(self, x: Tensor) -> Tensor:
        fine, middle = self.features(x)
        kind = functional.interpolate(self.kind[1](middle), size=fine.shape[2:], mode="nearest")
        return torch.cat([self.head(fine), kind], dim=1)
