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
from tools.train.loss import NOMINAL_LOG_SIZE, centres
from tools.train.mine import SigmaFit
from tools.train.net import OUTPUTS_BEFORE_CLASSES, STEM_CHANNELS, STRIDE, SkyNet
from tools.train.patches import STACK_OFFSETS_S
from tools.train.ports import FLOAT_INPUT, take_bytes
from tools.train.quantise import quantise

FORMAT: Final = "skyfix"
FORMAT_VERSION: Final = 1
SIZE_MULTIPLE_PX: Final = 8
DETECTIONS: Final = 64  # per image: a quarter of a 64 px crop's cells, and more objects than a sky holds
OPSET: Final = 17


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
    """SkyNet with its peaks picked, its outputs in pixels and its sigma calibrated."""

    def __init__(self, net: SkyNet, sigma: SigmaFit) -> None:
        super().__init__()
        self.net = net
        self.sigma = sigma

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        raw = self.net(image)
        heat = torch.sigmoid(raw[:, :1])
        peaks = heat * (heat >= functional.max_pool2d(heat, 3, 1, 1))
        scores, index = peaks.flatten(1).topk(DETECTIONS, dim=1)
        centre, log_sigma = centres(raw)
        maps = torch.cat([centre, raw[:, 3:5] + NOMINAL_LOG_SIZE, log_sigma, raw[:, OUTPUTS_BEFORE_CLASSES:]], dim=1)
        # (B, K, C): the values of the peaks' cells.
        found = maps.flatten(2).gather(2, index[:, None].expand(-1, maps.shape[1], -1)).transpose(1, 2)
        log_size = found[..., 2:4].clamp(max=6)
        boxes = torch.cat([found[..., :2], log_size.exp()], dim=2)
        sigma = self.sigma.log_sigma(found[..., 4], log_size.mean(2)).exp()
        return boxes, scores, found[..., 5:].softmax(dim=2), sigma


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
