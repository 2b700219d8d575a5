"""A trained net as the ONNX files a camera box runs: peaks picked and decoded in the graph, everything said in a note.

The file is the contract ("skyfix" format): input `(B, H, W, 3)` uint8; outputs boxes `(B, K, 4)` centre and size in
input pixels, scores `(B, K)`, classes `(B, K, n)`, sigma `(B, K)` in px. The box reads the stack's time offsets from
the note, so a model of other offsets needs no other program.
"""

import tempfile
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import torch
from torch import Tensor, nn
from torch.nn import functional

from tools.train.compose import Composer
from tools.train.loss import LOG_SIGMA_RANGE, NOMINAL_LOG_SIZE
from tools.train.mine import SigmaFit
from tools.train.net import STEM_CHANNELS, STRIDE, SkyNet
from tools.train.patches import STACK_OFFSETS_S
from tools.train.ports import FLOAT_INPUT, take_bytes
from tools.train.quantise import quantise

FORMAT: Final = "skyfix"
FORMAT_VERSION: Final = 1
SIZE_MULTIPLE_PX: Final = 8
DETECTIONS: Final = 64  # per image: a quarter of a 64 px crop's cells, and more objects than a sky holds
OPSET: Final = 17
NO_PEAK_LOGIT: Final = -30.0  # a score of nothing


@dataclass(frozen=True)
class About:
    """What a model file says of itself: its classes, what it was trained on, its licence and seed."""

    classes: tuple[str, ...]
    origin: str
    seed: int
    licence: str = "Apache-2.0"

    def note(self) -> dict[str, Any]:
        """The `skyfix` metadata entry."""
        return {
            "format": FORMAT,
            "version": FORMAT_VERSION,
            "classes": list(self.classes),
            "stack_offsets_s": list(STACK_OFFSETS_S),
            "stride": STRIDE,
            "size_multiple": SIZE_MULTIPLE_PX,
            "origin": self.origin,
            "licence": self.licence,
            "seed": self.seed,
        }


class Decoder(nn.Module):  # type: ignore[misc]
    """SkyNet with its peaks picked, its outputs in pixels and its sigma calibrated.

    Only heat is computed everywhere. The rest of the heads is read at the peaks alone: computed for every cell, it
    costs as much as half the convolutions before it.
    """

    def __init__(self, net: SkyNet, sigma: SigmaFit) -> None:
        super().__init__()
        self.net = net
        self.sigma = sigma

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        fine, middle = (each.permute(0, 2, 3, 1) for each in self.net.features(image))
        heat, index = _peaks(functional.linear(fine, self.net.head.weight[:1, :, 0, 0])[..., 0])
        logits = heat + self.net.head.bias[0]  # here rather than everywhere: it moves no peak
        row, col = index // fine.shape[2], index % fine.shape[2]
        found = _at(_cells(fine, row, col), self.net.head, slice(1, None))
        kind = _at(_cells(middle, row // 2, col // 2), self.net.kind[1], slice(None))
        centre = STRIDE * (torch.stack([col, row], dim=2) + found[..., :2]) + (STRIDE - 1) / 2
        log_size = (found[..., 2:4] + NOMINAL_LOG_SIZE).clamp(max=6)
        log_sigma = self.sigma.log_sigma(found[..., 4].clamp(*LOG_SIGMA_RANGE), log_size.mean(2))
        return torch.cat([centre, log_size.exp()], dim=2), logits.sigmoid(), kind.softmax(dim=2), log_sigma.exp()


def _peaks(logits: Tensor) -> tuple[Tensor, Tensor]:
    """The DETECTIONS highest local peaks of `(B, h, w)`: their values and flat places, `(B, K)` each."""
    highest = functional.max_pool2d(logits[:, None], 3, 1, 1)[:, 0]
    # An infinity would do as well, but not in 8 bits.
    return torch.where(logits >= highest, logits, NO_PEAK_LOGIT).flatten(1).topk(DETECTIONS, dim=1)  # type: ignore[no-any-return]


def _cells(maps: Tensor, row: Tensor, col: Tensor) -> Tensor:
    """`(B, K, C)`: the cells (row, col) of `(B, h, w, C)`."""
    first = torch.arange(maps.shape[0], device=maps.device)[:, None] * (maps.shape[1] * maps.shape[2])
    return maps.flatten(0, 2)[first + row * maps.shape[2] + col]


def _at(values: Tensor, head: nn.Conv2d, outputs: slice) -> Tensor:
    """Some outputs of a 1x1 convolution, of values `(..., C)`."""
    return functional.linear(values, head.weight[outputs, :, 0, 0], head.bias[outputs])


def export(net: SkyNet, sigma: SigmaFit, out: Path, about: About, composer: Composer) -> None:
    """Write OUT-fp32.onnx and OUT.onnx, its int8 form; the composer gives calibration samples."""
    decoder = Decoder(net.cpu().float().eval(), sigma).eval()
    with tempfile.TemporaryDirectory() as folder:
        raw = Path(folder) / "raw.onnx"
        _to_onnx(decoder, raw)
        exact, fast = out.with_name(out.name + "-fp32.onnx"), out.with_name(out.name + ".onnx")
        quantise(raw, fast, composer)
        exact.write_bytes(raw.read_bytes())
    for path in (exact, fast):
        take_bytes(path, about.note())


def _to_onnx(decoder: Decoder, path: Path) -> None:
    names = ["boxes", "scores", "classes", "sigma"]
    free = {FLOAT_INPUT: {0: "batch", 2: "height", 3: "width"}}
    with warnings.catch_warnings():
        # The older exporter, which says so at length: node names, by which `quantise` finds the heads, are its own.
        warnings.simplefilter("ignore")
        torch.onnx.export(
            decoder,
            (torch.zeros(2, STEM_CHANNELS, 16, 16),),
            str(path),
            input_names=[FLOAT_INPUT],
            output_names=names,
            dynamic_axes=free | {name: {0: "batch"} for name in names},
            opset_version=OPSET,
            dynamo=False,
        )
